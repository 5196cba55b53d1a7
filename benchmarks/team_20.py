"""TEAM workshop problem 20, a three-dimensional static force, against the published measurement.

    python benchmarks/team_20.py 1000 3000 4500 5000

A steel pole in a coil over the bottom of a steel frame (Takahashi, Nakata and Morishige, Summary of results for
problem 20, COMPEL 14 (1995) 57; compumag.org, problem 20). Dimensions, B-H curve and forces are those of the problem,
here with y upwards. The force on the pole is Maxwell's stress on a box in the air around it.
"""

import sys
import time

import numpy as np

from msl_fem.magnetics.three_d.boxes import Box, BoxModel, Racetrack
from msl_fem.magnetics.three_d.coenergy_law import coenergy_curves
from msl_fem.magnetics.three_d.readings import field_at
from msl_fem.magnetics.three_d.scalar_potential import PotentialSolution, solve_potential
from msl_fem.magnetics.three_d.tensor_grid import SizeNear
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import iron_from_points

MEASURED = {1000: 8.1, 3000: 54.4, 4500: 75.0, 5000: 80.1}  # ampere-turns to N
B = [0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.35, 1.4, 1.45, 1.5, 1.55, 1.6, 1.65,
     1.7, 1.75, 1.8, 1.85, 1.9, 1.95, 2.0, 2.05, 2.1, 2.15, 2.2, 2.25, 2.3]  # fmt: skip
H = [0, 100, 153, 205, 233, 255, 285, 320, 355, 405, 470, 555, 673, 836, 1065, 1220, 1420, 1720, 2130, 2670, 3480, 4500,
     5950, 7650, 10100, 13000, 15900, 21100, 26300, 32900, 42700, 61700, 84300, 110000, 135000]  # fmt: skip
MM = 1e-3


def problem_20() -> BoxModel:
    """A quarter: frame, pole and coil; x = 0 and z = 0 are planes of symmetry."""
    mm = [
        ((0, 63.5), (0, 25), (0, 12.5)),
        ((38.5, 63.5), (25, 125), (0, 12.5)),
        ((13.5, 63.5), (125, 150), (0, 12.5)),
        ((0, 12.5), (26.5, 125), (0, 5)),
    ]
    steel = iron_from_points(B, H, name="problem 20", source="TEAM problem 20, table 1")
    return BoxModel(
        boxes=tuple(Box(0, *(tuple(MM * side for side in sides) for sides in box)) for box in mm),
        curves=coenergy_curves([(steel, 1.0)]),
        coil=Racetrack((-14.5 * MM, 14.5 * MM), (-14.5 * MM, 14.5 * MM), 5 * MM, 18 * MM, (26.7 * MM, 123.3 * MM), 1.0),
        air=((0.0, 0.3), (-0.25, 0.4), (0.0, 0.3)),
        breaks=((13 * MM,), (25.75 * MM, 126 * MM), (6 * MM,)),
        near=(
            (SizeNear(12.5 * MM, 0.4 * MM), SizeNear(13.5 * MM, 0.4 * MM), SizeNear(38.5 * MM, 4 * MM)),
            (SizeNear(25 * MM, 0.4 * MM), SizeNear(26.5 * MM, 0.4 * MM), SizeNear(125 * MM, 0.5 * MM),
             SizeNear(150 * MM, 4 * MM)),
            (SizeNear(5 * MM, 0.5 * MM), SizeNear(12.5 * MM, 2 * MM)),
        ),
    )  # fmt: skip


def force_on_box(model: BoxModel, solution: PotentialSolution, box: tuple[float, float, float, float]) -> float:
    """N along y on what is in |x| < x1, y0 < y < y1, |z| < z1 (mm); half a box beside the grid's planes."""
    x1, y0, y1, z1 = (MM * side for side in box)
    x, y, z = (_gauss(solution, axis, ends) for axis, ends in enumerate(((0.0, x1), (y0, y1), (0.0, z1))))
    total = 0.0
    for level, outwards in ((y0, -1.0), (y1, 1.0)):
        field, weight = _on_plane(model, solution, (x, (np.array([level]), np.ones(1)), z))
        total += outwards * weight @ (field[:, 1] ** 2 - np.sum(field**2, axis=1) / 2)
    for axis, face in ((0, ((np.array([x1]), np.ones(1)), y, z)), (2, (x, y, (np.array([z1]), np.ones(1))))):
        field, weight = _on_plane(model, solution, face)
        total += weight @ (field[:, 1] * field[:, axis])
    return 4 * MU_0 * float(total)


def _gauss(solution: PotentialSolution, axis: int, ends: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights in every interval of the grid's planes between two ends."""
    planes = solution.problem.grid.planes[axis]
    planes = np.unique(np.r_[ends, planes[(planes > ends[0]) & (planes < ends[1])]])
    t, weight = np.polynomial.legendre.leggauss(4)
    size = np.diff(planes)[:, None]
    return (planes[:-1, None] + size * (t + 1) / 2).ravel(), (size * weight / 2).ravel()


def _on_plane(model: BoxModel, solution: PotentialSolution, axes: tuple) -> tuple[np.ndarray, np.ndarray]:
    points = np.stack(np.meshgrid(*(a for a, _ in axes), indexing="ij"), axis=-1).reshape(-1, 3)
    weight = np.einsum("i,j,k->ijk", *(w for _, w in axes)).ravel()
    return field_at(model, solution, points)[0], weight


if __name__ == "__main__":
    model = problem_20()
    print("| ampere-turns | measured N | computed N | another box | coarser grid | off % | gap T | CPU s |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for turns in map(int, sys.argv[1:]):
        started = time.process_time()
        coarse = solve_potential(model.problem(0.5), turns, tolerance=1e-6)
        problem = model.problem(1.0)
        start = coarse.problem.grid.interpolation(problem.grid)(coarse.potential)
        solution = solve_potential(problem, turns, start=start)
        near, far = (12.97, 25.6, 126.1, 6.1), (13.1, 25.9, 125.6, 7.5)
        force, other = (abs(force_on_box(model, solution, box)) for box in (near, far))
        gap = field_at(model, solution, np.array([[0.0, 25.75 * MM, 0.0]]))[1][0, 1]
        before = abs(force_on_box(model, coarse, near))
        cells = [turns, MEASURED[turns], f"{force:.2f}", f"{other:.2f}", f"{before:.2f}",
                 f"{100 * (force / MEASURED[turns] - 1):+.1f}", f"{abs(gap):.3f}",
                 f"{time.process_time() - started:.0f}"]  # fmt: skip
        print("|", " | ".join(map(str, cells)), "|", flush=True)
