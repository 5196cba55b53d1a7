"""The reduced field beside the full one: CPU time over a default table, and how its certificates hold.

    python benchmarks/reduced_field.py time [geometries/fast_tool_servo.toml]
    python benchmarks/reduced_field.py certificates [--magnets 20] [--points 5] [--keep certificates.jsonl]

`time`: the nodes of the default table, by the reduced field and by the full solver (a quarter of the rows, scaled),
alternating in one process. `certificates`: random e-core, u-core and pot magnets, a table of each by the reduced field,
then full solutions at random points of the grid's rectangle that no check has seen; a line a magnet is kept,
and a run goes on where the last one ended.
"""

import argparse
import json
import statistics
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.errors import ComputationError, InputError
from msl_fem.magnetics.field.magnet_field import MagnetField, magnet_mesh
from msl_fem.magnetics.kinds.kind import MagnetKind
from msl_fem.magnetics.reduced.full_field import FullField
from msl_fem.magnetics.reduced.reduced_model import FieldPoints
from msl_fem.magnetics.reduced.reduction import ReductionSettings, reduce_at_all
from msl_fem.magnetics.sweep.reduced_rows import reduced_rows
from msl_fem.magnetics.sweep.rows import RowSolver, SweepJob, SweepRow
from msl_fem.magnetics.sweep.table_sweep import default_grid
from msl_fem.materials.constants import MU_0

ROOT = Path(__file__).parent.parent
KINDS = ("fast_tool_servo", "u_core_ui60", "pot_core_holding")
SPREAD = 0.2  # of every thickness of a magnet's iron
PART = 4


@one_blas_thread
def times(actuator: Actuator, runs: int) -> Iterator[tuple[float, float]]:
    """CPU seconds of the reduced rows, and of the same rows in full."""
    gaps, currents = default_grid(actuator)
    magnet = actuator.magnet_kind()
    mesh = magnet_mesh(magnet, float(np.sqrt(gaps[0] * gaps[-1])))
    job = SweepJob(magnet, mesh, actuator.folder, 2)
    rows = [SweepRow(float(gap), tuple(currents.tolist())) for gap in gaps]
    reduced_rows(job.field(), rows, "normal")  # compiles
    for _ in range(runs):
        started = time.process_time()
        answer = reduced_rows(job.field(), rows, "normal")
        middle = time.process_time()
        solver = RowSolver(job)
        for row in rows[::PART]:
            solver.solve(row)
        full = (time.process_time() - middle) * len(rows) / len(rows[::PART])
        if answer is None:
            print("no certificate held")
        yield middle - started, full


def varied(magnet: MagnetKind, rng: np.random.Generator) -> MagnetKind:
    """The magnet with yoke and armature changed at random, which says where it saturates."""
    content = magnet.model_dump()
    lengths = {
        name: value * float(np.exp(rng.uniform(-SPREAD, SPREAD)))
        for name, value in content.items()
        if isinstance(value, float) and value > 0 and name.endswith("thickness")
    }
    return magnet.model_copy(update=lengths)


@one_blas_thread
def certificate_of(name: str, seed: int, n_point: int) -> dict[str, object]:
    """What the reduced field of a random magnet states, and by how much it errs at unseen points."""
    rng = np.random.default_rng(seed)
    actuator = load_actuator(ROOT / "geometries" / f"{name}.toml")
    magnet = varied(actuator.magnet_kind(), rng)
    gaps = magnet.half_width * np.geomspace(0.006, 0.06, 14)
    density = float(rng.uniform(0.5, 2.5))  # T, what the current would drive through the mean gap without iron
    top = density * 2 * float(np.sqrt(gaps[0] * gaps[-1])) / (MU_0 * magnet.turns)
    currents = top * np.linspace(0, 1, 34) ** 2
    mesh = magnet_mesh(magnet, float(np.sqrt(gaps[0] * gaps[-1])))
    field = MagnetField(magnet, mesh, folder=actuator.folder, order=2)
    full = FullField(field.model, [field.model.source])
    grid = FieldPoints(np.repeat(gaps, currents.size), np.tile(currents, gaps.size)[:, None])
    reduction = reduce_at_all(full, grid, ReductionSettings())
    if reduction is None:
        return {"kind": name, "seed": seed, "held": None}
    gap = np.exp(rng.uniform(np.log(gaps[0]), np.log(gaps[-1]), n_point))
    unseen = FieldPoints(gap, top * rng.uniform(0.05, 1, (n_point, 1)))
    states = reduction.model.solve(unseen)
    scale = np.abs(reduction.states.energy_slope).max(), np.abs(reduction.states.flux_linkage).max()
    errors = []
    for n in range(n_point):
        solution = full.solve(unseen, n, reduction.model.basis.vectors @ states.states[n])
        exact = full.numbers(float(gap[n]), solution.potential)
        force = abs(exact.energy_slope - states.energy_slope[n]) / scale[0]
        errors.append(max(force, abs(exact.flux_linkage[0] - states.flux_linkage[n, 0]) / scale[1]))
    estimate = reduction.certificate.error_estimate
    return {
        "kind": name,
        "seed": seed,
        "estimate": estimate,
        "effectivity": reduction.certificate.effectivity,
        "solutions": reduction.solutions,
        "errors": [float(e) for e in errors],
        "held": bool(max(errors) <= estimate),
    }


def certificates(magnets: int, points: int, kept: Path) -> None:
    """Go on with the study, and say what it shows."""
    lines = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    for seed in range(len(lines), magnets):
        name = KINDS[seed % len(KINDS)]
        try:
            lines.append(certificate_of(name, seed, points))
        except (InputError, ComputationError) as err:
            lines.append({"kind": name, "seed": seed, "refused": str(err)})
        with kept.open("a") as stream:
            stream.write(json.dumps(lines[-1]) + "\n")
        print(json.dumps(lines[-1]), flush=True)
    told = [line for line in lines if "errors" in line]
    errors = [error for line in told for error in line["errors"]]
    within = sum(error <= line["estimate"] for line in told for error in line["errors"])
    reduced, refused = len(told), sum("refused" in line for line in lines)
    print(f"{reduced} magnets reduced, {len(lines) - reduced - refused} left to the full solver, {refused} impossible")
    if errors:
        ratio = statistics.median(line["estimate"] / max(line["errors"]) for line in told)
        print(
            f"{within} of {len(errors)} points within the estimate; estimate over the largest error, median {ratio:.2g}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("time", "certificates"))
    parser.add_argument("actuator", nargs="?", default=str(ROOT / "geometries" / "fast_tool_servo.toml"))
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--magnets", type=int, default=20)
    parser.add_argument("--points", type=int, default=5)
    parser.add_argument("--keep", type=Path, default=Path("certificates.jsonl"))
    given = parser.parse_args()
    if given.what == "certificates":
        certificates(given.magnets, given.points, given.keep)
        return
    taken = list(times(load_actuator(given.actuator), given.runs))
    ratios = sorted(reduced / full for reduced, full in taken)
    seconds = statistics.median(reduced for reduced, _ in taken)
    print(
        f"reduced {seconds:.2f} s; over the full solver {statistics.median(ratios):.2f}", [f"{r:.2f}" for r in ratios]
    )


if __name__ == "__main__":
    main()
