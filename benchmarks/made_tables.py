"""Tables of made magnets from their parent's reduced field beside the same in full: CPU time, errors, certificates.

    python benchmarks/made_tables.py [geometries/fast_tool_servo.toml] [--magnets 40] [--full 4] [--workers 1]

Magnets are drawn within the default tolerances; each has the levels' currents at five gaps, force and flux linkage at
a point, and a table of five gaps by twelve currents. The first few are solved in full as well, one after each reduced
one. With several workers the whole study's clock time is told, without the full ones.
"""

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.jobs import Executor
from msl_fem.design.tolerances.manufactured import NAMES
from msl_fem.design.tolerances.sensitivity import ManufacturedMagnet, ManufacturingJob, RowRun
from msl_fem.design.tolerances.study import ToleranceSettings, by_children, direct_band, draw, study_job

ROOT = Path(__file__).parent.parent


@one_blas_thread
def beside_full(job: ManufacturingJob, rows: list[ManufacturedMagnet], n_full: int) -> None:
    """One process: seconds a magnet both ways, and how far apart they are."""
    started = time.process_time()
    reduced, full = job.solver(), replace(job, limits=None).solver()
    found = [reduced.solve(rows[0])]
    print(f"made ready and first magnet: {time.process_time() - started:.1f} CPU s")
    seconds: list[list[float]] = [[], []]
    off: list[tuple[float, float, float]] = []
    for k, row in enumerate(rows[1:], start=1):
        begin = time.process_time()
        found.append(reduced.solve(row))
        seconds[0].append(time.process_time() - begin)
        if k > n_full:
            continue
        begin = time.process_time()
        exact = full.solve(row)
        seconds[1].append(time.process_time() - begin)
        names = ("table_force", "table_flux_linkage")
        tables = [float(np.abs(found[-1][name] - exact[name]).max() / exact[name].max()) for name in names]
        off.append((*tables, float(np.nanmax(np.abs(found[-1]["current"] / exact["current"] - 1)))))
    certified, each = sum("table_error" in row for row in found), seconds[0]
    print(f"{certified} of {len(rows)} certified; {np.mean(each):.3f} CPU s a magnet, median {np.median(each):.3f}")
    if off:
        force, flux, current = np.max(off, axis=0)
        print(f"in full {np.mean(seconds[1]):.2f} CPU s; largest differences of {len(off)} magnets:")
        print(f"force {force:.1e}, flux linkage {flux:.1e} of full scale, a level's current {current:.1e} of itself")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("actuator", nargs="?", type=Path, default=ROOT / "geometries" / "fast_tool_servo.toml")
    parser.add_argument("--magnets", type=int, default=40)
    parser.add_argument("--full", type=int, default=4)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    actuator: Actuator = load_actuator(given.actuator)
    job, tolerances = study_job(actuator, ToleranceSettings(tables=True))
    if given.workers == 1:
        rows = [
            ManufacturedMagnet(tuple(d.get(name, 0.0) for name in NAMES), False)
            for d in draw(tolerances, given.magnets, 1)
        ]
        beside_full(by_children(job, tolerances), rows, given.full)
        return
    before, begin = os.times(), time.perf_counter()
    band = direct_band(job, tolerances, RowRun(Executor(given.workers)), samples=given.magnets, seed=1)
    after = os.times()
    assert band.table is not None
    print(
        f"{given.magnets} magnets, {given.workers} processes: {time.perf_counter() - begin:.0f} s that passed, "
        f"{sum(after[:4]) - sum(before[:4]):.0f} CPU s; {band.table.certified} certified, the largest estimate "
        f"{band.table.error_estimate:.1e} of full scale"
    )


if __name__ == "__main__":
    main()
