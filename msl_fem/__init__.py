"""Design of magnetic-levitation actuators: field solutions, tables, maps, coupled models, identification, control.

The verbs of the command line as functions of records; results carry the JSON's field names. Each is loaded when it is
first used, so that a control engineer needs no finite elements.
"""

from collections.abc import Sequence
from importlib import import_module
from operator import attrgetter
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from msl_fem.actuator import Actuator
    from msl_fem.maps import OperatingMap
    from msl_fem.table.magnetic_table import MagneticTable

_VERBS = {
    "load_actuator": "msl_fem.actuator",
    "draw": "msl_fem.report.section_drawing:draw_section",
    "solve": "msl_fem.magnetics.field.magnet_field",
    "field_picture": "msl_fem.report.notebook",
    "sweep": "msl_fem.magnetics.sweep.table_sweep",
    "read_table": "msl_fem.table.magnetic_table",
    "write_table": "msl_fem.table.magnetic_table",
    "lookup": "msl_fem.table.magnetic_table:MagneticTable.evaluate",
    "operating_map": "msl_fem.maps",
    "read_map": "msl_fem.maps",
    "write_map": "msl_fem.maps",
    "Guard": "msl_fem.maps",
    "choose_wire": "msl_fem.losses",
    "copper_loss": "msl_fem.losses.copper_loss",
    "iron_loss": "msl_fem.losses",
    "sine_operation": "msl_fem.losses",
    "continuous_current": "msl_fem.losses",
    "assess_flexure": "msl_fem.mechanics",
    "gap_trade": "msl_fem.mechanics.gap_trade",
    "tolerance_study": "msl_fem.design.tolerances",
    "load_requirement": "msl_fem.design.sizing",
    "size_magnet": "msl_fem.design.sizing",
    "load_record": "msl_fem.record",
    "write_record": "msl_fem.record",
    "record_from_frames": "msl_fem.record",
    "import_log": "msl_fem.record.log_import",
    "import_into": "msl_fem.record.log_import",
    "doubts_of_file": "msl_fem.record.file_doubts",
    "compare": "msl_fem.comparison",
    "parse_excitation": "msl_fem.plant.excitation",
    "excitation_inputs": "msl_fem.plant.excitation",
    "simulate": "msl_fem.plant",
    "simulation_record": "msl_fem.plant",
    "sealed_record": "msl_fem.bench",
    "identify": "msl_fem.identification",
    "design_controller": "msl_fem.control",
    "run_closed_loop": "msl_fem.control",
    "examine_design": "msl_fem.control",
    "measured_loops": "msl_fem.control",
    "self_sensing": "msl_fem.control.self_sensing",
    "suspects": "msl_fem.diagnosis.planning.ranking",
    "experiments": "msl_fem.diagnosis.planning.experiments",
    "diagnose": "msl_fem.diagnosis",
    "DiagnosisSettings": "msl_fem.diagnosis",
    "run_study": "msl_fem.study",
    "export_as": "msl_fem.export.formats",
}
"""A verb and the module that holds it, with the name that it has there where it is another."""
__all__ = sorted(_VERBS)


def operating_map(
    source: "Actuator | MagneticTable",
    gap: "ArrayLike | None" = None,
    *,
    levels: Sequence[float] = (1.2, 1.6),
    **further: Any,
) -> "OperatingMap":
    """The operating map of an actuator, by root finding on field solutions, or of a table, by interpolation.

    Parameters
    ----------
    source : an actuator or a table of one magnet; only the first needs finite elements
    gap : (n_gap,) m, increasing, at least 2; by default those of the actuator's range, or the table's own
    levels : flux densities in the iron in T, increasing
    further : of an actuator `criterion`, `settings` and `progress` as of `msl_fem.magnetics.field_map.field_map`; of a
        table `actuator` and `digest` as of `msl_fem.maps.operating_map`

    Raises
    ------
    InputError : levels, gaps, a criterion or a largest current that are not allowed
    TableError : the table has no section flux densities, or some are not finite
    ComputationError : field solutions or the search failed at some gap
    """
    if isinstance(source, import_module("msl_fem.actuator").Actuator):
        found = import_module("msl_fem.magnetics.field_map").field_map(source, gap, levels=levels, **further)
    else:
        found = import_module("msl_fem.maps").operating_map(source, gap=gap, levels=levels, **further)
    return cast("OperatingMap", found)


def __getattr__(name: str) -> Any:
    """A verb, from the module that holds it; the version, as it is installed."""
    if name == "__version__":
        metadata = import_module("importlib.metadata")
        try:
            return metadata.version("msl-fem")
        except metadata.PackageNotFoundError:  # a checkout that is not installed
            return "0"
    if name not in _VERBS:
        raise AttributeError(f"module 'msl_fem' has no attribute '{name}'")
    module, _, there = _VERBS[name].partition(":")
    return attrgetter(there or name)(import_module(module))


def __dir__() -> list[str]:
    return sorted({*globals(), *_VERBS})
