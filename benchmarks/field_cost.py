"""How the cost of a field solution grows with the unknowns, and how much of it is the factorisation (the floor).

    python benchmarks/field_cost.py

Prints a Markdown table: unknowns, CPU ms a point (10 currents at one gap of E1, slopes and section values included),
the share of the factorisation, Newton steps a point.
"""

import time
from pathlib import Path

import numpy as np

from msl_fem.actuator import load_actuator
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate
from msl_fem.magnetics.solver.tangent import SparseTangent
from msl_fem.magnetics.sweep.rows import RowSolver, SweepJob, SweepRow

ROOT = Path(__file__).parent.parent
CURRENTS = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
SIZES = (
    (MeshSize(corner=0.3, gap=3.0, iron=1.0, growth=1.5), 2),
    (MeshSize(corner=0.02, gap=2.0, iron=0.6, growth=0.5), 2),
    (MeshSize(corner=0.004, gap=3.0, iron=0.6, growth=0.75, across=0.2), 3),
    (MeshSize(corner=0.005, gap=1.0, iron=0.3, growth=0.25), 3),
    (MeshSize(corner=0.002, gap=0.5, iron=0.15, growth=0.12), 3),
)


class _Stopwatch:
    """CPU seconds spent in SparseTangent.factor."""

    def __init__(self) -> None:
        self.seconds, self._plain = 0.0, SparseTangent.factor

    def factor(self, tangent: SparseTangent, data: np.ndarray) -> None:
        started = time.process_time()
        self._plain(tangent, data)
        self.seconds += time.process_time() - started


@one_blas_thread
def main() -> None:
    actuator = load_actuator(ROOT / "geometries" / "e1.toml")
    magnet = actuator.magnet
    watch = _Stopwatch()
    SparseTangent.factor = lambda tangent, data: watch.factor(tangent, data)  # type: ignore[method-assign]
    print("| unknowns | CPU ms a point | factorisation | Newton steps a point |\n| --- | --- | --- | --- |")
    for size, order in SIZES:
        mesh = triangulate(magnet.section(3e-4), size)
        solver = RowSolver(SweepJob(magnet, mesh, actuator.folder, order))
        solver.solve(SweepRow(5e-4, CURRENTS[:1]))  # ordering and memory
        watch.seconds, started = 0.0, time.process_time()
        row = solver.solve(SweepRow(3e-4, CURRENTS))
        spent = time.process_time() - started
        steps = row["newton_iterations"].mean()
        unknowns = solver.field().model.free.size
        print(f"| {unknowns} | {spent / len(CURRENTS) * 1e3:.1f} | {watch.seconds / spent:.0%} | {steps:.1f} |")


if __name__ == "__main__":
    main()
