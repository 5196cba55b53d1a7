"""A table on a dask.distributed cluster of eight workers on this machine, one of which is killed on the way.

    python benchmarks/cluster_deaths.py [--workers 8] [--kill 1]

Nothing may be lost: every row is there once, and the table is that of one process, to the last bit.
"""

import argparse
import os
import signal
import time
from pathlib import Path

import distributed
import numpy as np

from msl_fem.actuator import load_actuator
from msl_fem.computing import jobs
from msl_fem.magnetics.sweep.table_sweep import SweepSettings, default_grid, sweep

ROOT = Path(__file__).parent.parent
AFTER = 5  # rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=8)
    parser.add_argument("--kill", type=int, default=1, help="workers to kill")
    given = parser.parse_args()
    jobs.CONNECT = jobs.FIRST_WORKER = 300.0  # a machine of few cores starts eight workers slowly
    actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    gaps, currents = default_grid(actuator)
    grid = (gaps[::2], currents[::3])
    alone, _ = sweep(actuator, *grid)
    with distributed.LocalCluster(
        n_workers=given.workers, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as cluster:
        with distributed.Client(cluster) as client:
            client.wait_for_workers(given.workers, timeout=300)
            processes = sorted(client.run(os.getpid).values())
        told: list[int] = []

        def kill(done: int, total: int) -> None:
            told.append(done)
            if done == AFTER:
                for process in processes[: given.kill]:
                    os.kill(process, signal.SIGKILL)

        begin = time.perf_counter()
        settings = SweepSettings(scheduler=cluster.scheduler_address)
        table, _ = sweep(actuator, *grid, settings=settings, progress=kill)
        seconds = time.perf_counter() - begin
    same = all(np.array_equal(table.nodes[name], values) for name, values in alone.nodes.items())
    print(
        f"{given.workers} workers, {given.kill} killed after {AFTER} rows: {told[-1]} rows in {seconds:.1f} s, each "
        f"told once: {told == list(range(told[-1] + 1))}; the table of one process to the last bit: {same}"
    )


if __name__ == "__main__":
    main()
