"""The speed of the parts beside the field solver, each over what it is measured against: the README's second table.

    python benchmarks/speed.py [--runs 5] [--readme]

One thread. Ratios are medians of alternating pairs, with the least and the largest: on a machine that does other things
too, a ratio of neighbours says more than seconds. The coupled model is measured against SciPy's solve_ivp with its
interpolation of the same table (see coupled_model.py); the exported FMU against the compiled kernel in Python; the
guard in C against its compiled array call; a sweep in two processes against one. Without gcc or FMPy their rows are
left out.
"""

import argparse
import platform
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from coupled_model import ALL_EFFECTS, RATE, SPEC, SUBSTEPS, by_scipy, lanes, single
from guard import of_c, pairs
from marked_text import rewrite

from msl_fem.actuator import load_actuator
from msl_fem.export import fmu
from msl_fem.export.formats import ModelSource
from msl_fem.magnetics.sweep.table_sweep import SweepSettings, default_grid, sweep
from msl_fem.maps import Guard, operating_map
from msl_fem.plant import plant_parameters, surface_of
from msl_fem.plant.excitation import Inputs, excitation_inputs, parse_excitation
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parent.parent
Work = Callable[[], object]
Row = tuple[str, str, str, list[float]]


def seconds(work: Work) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def ratios(fast: Work, slow: Work, *, runs: int) -> tuple[list[float], float]:
    """(seconds of slow over those of fast in each pair, median seconds of fast); both ran once before."""
    fast(), slow()
    taken = [(seconds(fast), seconds(slow)) for _ in range(runs)]
    return [b / a for a, b in taken], statistics.median(a for a, _ in taken)


def model_rows(runs: int) -> Iterator[Row]:
    """The coupled model, plain, with effects, in lanes."""
    actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    table = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    plant, surface = plant_parameters(actuator), surface_of(table)
    inputs, short = (excitation_inputs(actuator, parse_excitation(SPEC.format(d)), rate=RATE) for d in (1, 0.05))
    steps, few = inputs.time.size * SUBSTEPS, short.time.size * SUBSTEPS
    slow = by_scipy(plant, table, short)
    for name, work, count in (
        ("coupled model", single(surface, plant, inputs, None), steps),
        ("coupled model, all effects", single(surface, plant, inputs, ALL_EFFECTS), steps),
        ("64 runs together, all effects", lanes(surface, plant, inputs, ALL_EFFECTS, 64), 64 * steps),
    ):
        found, best = ratios(work, slow, runs=runs)
        yield name, f"{count / best:.2g} steps/s", "SciPy's solve_ivp", [r * count / few for r in found]
    yield from fmu_rows(ModelSource(actuator, table), runs)


def fmu_rows(source: ModelSource, runs: int) -> Iterator[Row]:
    """The exported FMU, a second of the model in steps of a sample."""
    try:
        from fmpy import extract, read_model_description
        from fmpy.fmi2 import FMU2Slave
    except ImportError:
        return
    with tempfile.TemporaryDirectory() as folder:
        archive = Path(folder) / "model.fmu"
        fmu.write(source, archive)
        if not fmu.platforms(archive):
            return
        description = read_model_description(str(archive))
        slave = FMU2Slave(
            guid=description.guid, unzipDirectory=extract(str(archive), unzipdir=str(Path(folder) / "x")),
            modelIdentifier=description.coSimulation.modelIdentifier, instanceName="one",
        )  # fmt: skip
        slave.instantiate()
        n = int(RATE)

        def in_c() -> None:
            slave.reset()
            slave.setupExperiment(startTime=0.0)
            slave.enterInitializationMode()
            slave.exitInitializationMode()
            slave.doStep(0.0, n / RATE)  # one call: the cost of ctypes is Python's

        plant, surface = plant_parameters(source.actuator), surface_of(source.table)
        kernel = single(surface, plant, Inputs(np.zeros((n, 2)), RATE), None)
        found, best = ratios(in_c, kernel, runs=runs)
        yield "exported FMU (C, gcc -O2)", f"{n * SUBSTEPS / best:.2g} steps/s", "the compiled kernel", found
        slave.freeInstance()


def guard_rows(runs: int) -> Iterator[Row]:
    """A judgement in C along a motion."""
    made = operating_map(read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc"))
    current, gap = pairs(made, 500_000)["along a motion"]
    guard, found, spent = Guard(made), [], []
    guard.regions(current, gap)
    for _ in range(runs):
        c = of_c(made, current, gap, 3)
        if not c:
            return
        spent.append(c["region"])
        found.append(seconds(lambda: guard.regions(current, gap)) / current.size * 1e9 / c["region"])
    yield "guard, exported C", f"{statistics.median(spent):.2g} ns", "its compiled array call", found


def sweep_rows(runs: int) -> Iterator[Row]:
    """Every other row of the reference actuator's default table, start of the processes included."""
    actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    gaps, currents = default_grid(actuator)
    gaps = gaps[::2]

    def by(workers: int) -> Work:
        return lambda: sweep(actuator, gaps, currents, settings=SweepSettings(workers=workers))

    found, best = ratios(by(2), by(1), runs=max(1, runs // 2))
    yield "half the default table, two processes", f"{best:.3g} s", "one process", found


def markdown(runs: int) -> str:
    """The table."""
    lines = ["| part | measured | over | times as fast, median (least ... largest) |", "| --- | ---: | --- | ---: |"]
    for rows in (model_rows, guard_rows, sweep_rows):
        for name, measured, peer, found in rows(runs):
            spread = f"{statistics.median(found):.3g} ({min(found):.3g} ... {max(found):.3g})"
            lines.append(f"| {name} | {measured} | {peer} | {spread} |")
    machine = f"{platform.machine()}, Python {platform.python_version()}"
    return "\n".join([*lines, "", f"{runs} alternating pairs (the sweep: {max(1, runs // 2)}), {machine}."]) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--readme", action="store_true", help="write the table into README.md")
    given = parser.parse_args()
    text = markdown(given.runs)
    print(text)
    if given.readme:
        rewrite(ROOT / "README.md", {"speed": text})


if __name__ == "__main__":
    main()
