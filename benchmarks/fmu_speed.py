"""How fast the FMU's printed C is against the compiled kernel: the same run, alternately, in one process.

    python benchmarks/fmu_speed.py            plain, and with every effect of the catalogue

The FMU is stepped as a master does, through fmi2SetReal, fmi2DoStep and fmi2GetReal, by a loop in C that is linked with
its sources under its own flags; the kernel runs the same samples in one call. What counts is their ratio, of the least
times.
"""

import ctypes
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from msl_fem.actuator import load_actuator
from msl_fem.computing.arrays import Array
from msl_fem.export import fmu
from msl_fem.export.fmu_library import FLAGS
from msl_fem.export.formats import ModelSource
from msl_fem.plant import Inputs, Options, simulate
from msl_fem.plant.effects import EffectValues
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parent.parent
RATE, N_SAMPLE, ROUNDS = 1e4, 20_000, 7
LOOP = """\
#include <stdlib.h>
#include "fmi2Functions.h"
#include "fmu_variables.h"

static void *zeros(size_t n, size_t size) { return calloc(n, size); }

/* Position before every communication step under commands (n, 2); the status of the last step */
__attribute__((visibility("default"))) int run(const double *command, int n, double size, double *position)
{
    const fmi2CallbackFunctions functions = {0, zeros, free, 0, 0};
    const fmi2ValueReference in[2] = {V_COMMAND_1, V_COMMAND_2}, out[1] = {V_POSITION};
    fmi2Component c = fmi2Instantiate("one", fmi2CoSimulation, MODEL_GUID, "", &functions, 0, 0);
    int k, status;
    fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
    fmi2EnterInitializationMode(c);
    status = fmi2ExitInitializationMode(c);
    for (k = 0; k < n && status == fmi2OK; ++k) {
        fmi2GetReal(c, out, 1, &position[k]);
        fmi2SetReal(c, in, 2, &command[2 * k]);
        status = fmi2DoStep(c, k * size, size, 1);
    }
    fmi2FreeInstance(c);
    return status;
}
"""


def library(source: ModelSource, folder: Path, flags: tuple[str, ...]) -> ctypes.CDLL:
    """The FMU's sources and the loop, compiled."""
    for path, text in fmu.fmu_files(source).items():
        if path.startswith("sources/"):
            (folder / Path(path).name).write_bytes(text)
    (folder / "loop.c").write_text(LOOP)
    subprocess.run(["gcc", *flags, "-o", "loop.so", *fmu.COMPILED, "loop.c", "-lm"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "loop.so"))


def stepped(unit: ctypes.CDLL, commands: Array) -> Array:
    """The positions of a run of the unit."""
    position = np.zeros(len(commands))
    pointer = ctypes.POINTER(ctypes.c_double)
    status = unit.run(
        commands.ctypes.data_as(pointer), len(commands), ctypes.c_double(1 / RATE), position.ctypes.data_as(pointer)
    )
    assert status == 0
    return position


def compare(name: str, effects: EffectValues | None, flags: tuple[str, ...]) -> None:
    """Prints the times of both, and their ratio."""
    actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    table = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    noise = np.random.default_rng(1).standard_normal((N_SAMPLE, 2))
    commands = 0.5 + 0.02 * noise
    inputs, options = Inputs(commands, RATE), Options(substeps=10)
    with tempfile.TemporaryDirectory() as folder:
        unit = library(ModelSource(actuator, table, effects), Path(folder), flags)
        times = np.zeros((ROUNDS, 2))
        for row in times:
            begin = time.perf_counter()
            wanted = simulate(actuator, table, inputs, effects=effects, options=options)
            row[0] = time.perf_counter() - begin
            begin = time.perf_counter()
            found = stepped(unit, commands)
            row[1] = time.perf_counter() - begin
    apart = np.abs(found - wanted.position).max() / np.abs(wanted.position).max()
    kernel, printed = times[1:].min(axis=0) / (N_SAMPLE * 10) * 1e9  # the first round compiles
    print(f"{name:30s} kernel {kernel:6.0f} ns, FMU {printed:6.0f} ns a step: {kernel / printed:.2f} of its speed; "
          f"positions differ by {apart:.1e}")  # fmt: skip


def main() -> None:
    sys.path.append(str(ROOT / "tests" / "plant"))
    from effect_sets import ALL_EFFECTS

    for name, flags in (("", FLAGS), (", -march=native", (*FLAGS, "-march=native"))):
        compare(f"plain{name}", None, flags)
        compare(f"all effects{name}", ALL_EFFECTS, flags)


if __name__ == "__main__":
    main()
