"""A table as a Simulink model: a MAT-file, and a MATLAB function that builds the blocks around it."""

import re
from pathlib import Path
from typing import Any

from scipy.io import savemat

from msl_fem.errors import InputError
from msl_fem.export.table_formats import both_signs, origin, refined_grid
from msl_fem.files.whole_file import whole_file
from msl_fem.table.magnetic_table import MagneticTable

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,49}")
LOOKED_UP = ("flux_linkage", "incremental_inductance", "force_current_slope", "force")
"""What the model has a lookup table for."""
_BLOCKS = """\
block('simulink/Sources/In1', 'voltage');
block('simulink/Sources/In1', 'gap');
block('simulink/Sources/In1', 'gap_velocity');
block('simulink/Continuous/Integrator', 'current', 'InitialCondition', '0');
block('simulink/Math Operations/Gain', 'resistive_voltage', 'Gain', num2str(resistance, 17));
block('simulink/Math Operations/Product', 'motional_voltage', 'Inputs', '**');
block('simulink/Math Operations/Sum', 'inductive_voltage', 'Inputs', '+-+');
block('simulink/Math Operations/Product', 'current_rate', 'Inputs', '*/');
table('flux_linkage');
table('incremental_inductance');
table('force_current_slope');
table('force');
block('simulink/Sinks/Out1', 'current_out');
block('simulink/Sinks/Out1', 'force_out');
block('simulink/Sinks/Out1', 'flux_linkage_out');
wire('voltage', 'inductive_voltage', 1);
wire('resistive_voltage', 'inductive_voltage', 2);
wire('motional_voltage', 'inductive_voltage', 3);
wire('current', 'resistive_voltage', 1);
wire('force_current_slope', 'motional_voltage', 1);
wire('gap_velocity', 'motional_voltage', 2);
wire('inductive_voltage', 'current_rate', 1);
wire('incremental_inductance', 'current_rate', 2);
wire('current_rate', 'current', 1);
wire('current', 'current_out', 1);
wire('force', 'force_out', 1);
wire('flux_linkage', 'flux_linkage_out', 1);"""
_SCRIPT = """\
function model = {name}(resistance)
% {name}(resistance) builds the Simulink model {name}_model of one magnet; resistance in ohm of its winding.
%
% Inputs: voltage (V), gap (m), gap_velocity (m/s, positive while the gap grows). Outputs: current (A), force (N,
% attractive positive), flux linkage (Wb). The circuit is voltage = resistance current + d(flux linkage)/dt, so
%   L d(current)/dt = voltage - resistance current + K gap_velocity,
% L the incremental inductance and K the force's slope over the current: the flux linkage falls by K a metre of gap.
% Beside this file lies {name}_table.mat. Outside the table the simulation stops with an error.
if nargin < 1
    error('{name}:resistance', 'Give the resistance in ohm, like {name}(1.8).');
end
data = load(fullfile(fileparts(mfilename('fullpath')), '{name}_table.mat'));
model = '{name}_model';
if bdIsLoaded(model)
    close_system(model, 0);
end
new_system(model);
space = get_param(model, 'ModelWorkspace');
names = fieldnames(data);
for k = 1:numel(names)
    assignin(space, names{{k}}, data.(names{{k}}));
end
{blocks}
set_param(model, 'SolverType', 'Variable-step', 'RelTol', '1e-6');
Simulink.BlockDiagram.arrangeSystem(model);
save_system(model);

    function block(kind, label, varargin)
        add_block(kind, [model '/' label], varargin{{:}});
    end

    function table(label)
        block('simulink/Lookup Tables/2-D Lookup Table', label, 'BreakpointsForDimension1', 'current', ...
            'BreakpointsForDimension2', 'gap', 'Table', label, 'ExtrapMethod', 'Clip', ...
            'DiagnosticForOutOfRangeInput', 'Error');
        wire('current', label, 1);
        wire('gap', label, 2);
    end

    function wire(from, to, port)
        add_line(model, [from '/1'], [to '/' num2str(port)], 'autorouting', 'on');
    end
end
"""


def simulink_script(name: str) -> str:
    """The text of the function `name`, which builds the model."""
    return _SCRIPT.format(name=name, blocks=_BLOCKS)


def simulink_variables(table: MagneticTable) -> dict[str, Any]:
    """Variable to value: current (n,) of either sign and gap (m,), increasing; matrices (n, m) of `LOOKED_UP`."""
    grid = refined_grid(table)
    current = both_signs(grid, LOOKED_UP[0])[0]
    matrices = {name: both_signs(grid, name)[1] for name in LOOKED_UP}
    errors = origin(table, linear_error=max(grid.linear_error.values()))
    return {"current": current, "gap": grid.gap, **matrices, **errors}


def write(table: MagneticTable, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The function (.m) and its MAT-file beside it. The function's name is that of the file.

    Raises
    ------
    InputError : the file's name does not end in .m or is no name of MATLAB's, or the folder cannot be written
    """
    if target.suffix != ".m" or not _NAME.fullmatch(target.stem):
        raise InputError(
            f"{target}: a function of MATLAB is a file like magnet.m; letters, digits and _, at most 50, a letter first"
        )
    matrices = target.with_name(f"{target.stem}_table.mat")
    with whole_file(matrices) as partial:
        savemat(partial, simulink_variables(table), appendmat=False, oned_as="row")
    with whole_file(target) as partial:
        partial.write_text(simulink_script(target.stem), encoding="ascii", newline="\n")
    return (target, matrices)
