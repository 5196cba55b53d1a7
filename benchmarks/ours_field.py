"""E1's 60 points with msl_fem: one JSON line with CPU seconds and the values. Imports are not timed.

Each by the full solver, or, with "reduced": true, all from the reduced field, as `msl-fem table` does.
"""

import json
import resource
import sys
import time
from pathlib import Path

from msl_fem.actuator import load_actuator
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.magnetics.field.accuracy import LEVELS, Accuracy
from msl_fem.magnetics.field.magnet_field import magnet_mesh
from msl_fem.magnetics.sweep.reduced_rows import reduced_rows
from msl_fem.magnetics.sweep.rows import RowSolver, SweepJob, SweepRow

ROOT = Path(__file__).parent.parent
GAPS = (0.1, 0.2, 0.3, 0.5, 0.75, 1.0)  # mm
CURRENTS = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)


@one_blas_thread
def table(accuracy: Accuracy, *, reduced: bool = False) -> dict[str, list[float]]:
    """All that a table stores at all points: forces by both routes, flux, coenergy, slopes, section flux densities."""
    actuator = load_actuator(ROOT / "geometries" / "e1.toml")
    mesh = magnet_mesh(actuator.magnet, (GAPS[0] * GAPS[-1]) ** 0.5 * 1e-3, accuracy)
    job = SweepJob(actuator.magnet, mesh, actuator.folder, LEVELS[accuracy].order)
    asked = [SweepRow(gap * 1e-3, CURRENTS) for gap in GAPS]
    if reduced:
        found = reduced_rows(job.field(), asked, accuracy)
        assert found is not None, "no certificate"
        rows = found.answers
    else:
        solver = RowSolver(job)
        rows = [solver.solve(row) for row in asked]
    return {name: [float(v) for row in rows for v in row[name]] for name in ("force", "flux_linkage", "coenergy")}


if __name__ == "__main__":
    settings = json.loads(sys.argv[1])
    table("fast", reduced="reduced" in settings)  # warm-up, as the peer has one
    started = time.process_time()
    values = table(**settings)
    seconds = time.process_time() - started
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps({"cpu_seconds": seconds, "peak_memory_MB": memory, **values}))
