"""TEAM workshop problem 20, a three-dimensional static force, against the published measurement.

    python benchmarks/team_20.py 1000 3000 4500 5000
    python benchmarks/team_20.py --sensitivity      # at 1000 ampere-turns
    python benchmarks/team_20.py --flux 1000 3000 4500 5000
    python benchmarks/team_20.py --grids            # at 1000 ampere-turns

A steel pole in a coil over the bottom of a steel frame (Takahashi, Nakata and Morishige, Summary of results for
problem 20, COMPEL 14 (1995) 57; compumag.org, problem 20). Dimensions, B-H curve and forces are those of the problem,
here with y upwards. The force on the pole is the mean of Maxwell's stress over a shell of air around it, between the
pole's own faces and a box: with w = 1 on the pole and 0 from the box on, F_y = mu_0 int H^2/2 dw/dy - H_y H . grad w
(Henrotte et al., J. Appl. Phys. 95, 2004).
"""

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from msl_fem.magnetics.three_d.boxes import Box, BoxModel, Racetrack
from msl_fem.magnetics.three_d.coenergy_law import coenergy_curves
from msl_fem.magnetics.three_d.forces import DisplacementWeight
from msl_fem.magnetics.three_d.readings import field_at
from msl_fem.magnetics.three_d.scalar_potential import PotentialSolution, solve_potential
from msl_fem.magnetics.three_d.tensor_grid import SizeNear
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import iron_from_points, linear_iron

MEASURED = {1000: 8.1, 3000: 54.4, 4500: 75.0, 5000: 80.1}  # ampere-turns to N
FLUX_DENSITY = {
    1000: (0.36, 0.24, 0.72, 0.13), 3000: (0.84, 0.63, 1.75, 0.36), 4500: (0.99, 0.72, 2.01, 0.43),
    5000: (1.03, 0.74, 2.05, 0.46),
}  # fmt: skip
"""T along y as measured: P1 and P2 in mid-gap, below the pole's middle and its corner; means in pole and outer leg."""
B = [0, 0.01, 0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.35, 1.4, 1.45,
     1.5, 1.55, 1.6, 1.65, 1.7, 1.75, 1.8, 1.85, 1.9, 1.95, 2.0, 2.05, 2.1, 2.15, 2.2, 2.25, 2.3]  # fmt: skip
H = [0, 27, 58, 100, 153, 185, 205, 233, 255, 285, 320, 355, 405, 470, 555, 673, 836, 1065, 1220, 1420, 1720, 2130,
     2670, 3480, 4500, 5950, 7650, 10100, 13000, 15900, 21100, 26300, 32900, 42700, 61700, 84300, 110000,
     135000]  # fmt: skip
MM = 1e-3
EDGE = 0.05
SHELLS = (13.5, 25, 126, 6), (13.0, 25.75, 126, 6), (13.5, 25, 125.5, 6)  # of air around the pole, in mm
GRIDS = ((0.4, 0.7), (0.15, 0.7), (0.05, 0.7), (0.15, 1.0), (0.05, 1.0), (0.02, 1.0), (0.05, 1.4))
"""Sizes in mm at the pole's edges, and refinements of all."""


def problem_20(gap: float = 1.5, field: Sequence[float] = H, edge: float = EDGE) -> BoxModel:
    """A quarter: frame, pole and coil; x = 0 and z = 0 are planes of symmetry.

    The gap in mm, the steel's H in A/m, and the boxes' size in mm at the pole's edges, where the field is singular.
    """
    face = 26.5 - gap
    mm = [
        ((0, 63.5), (0, face), (0, 12.5)),
        ((38.5, 63.5), (face, 125), (0, 12.5)),
        ((13.5, 63.5), (125, 150), (0, 12.5)),
        ((0, 12.5), (26.5, 125), (0, 5)),
    ]
    steel = iron_from_points(B, field, name="problem 20", source="TEAM problem 20, table 1")
    return BoxModel(
        boxes=tuple(Box(0, *(tuple(MM * side for side in sides) for sides in box)) for box in mm),
        curves=coenergy_curves([(steel, 1.0)]),
        coil=Racetrack((-14.5 * MM, 14.5 * MM), (-14.5 * MM, 14.5 * MM), 5 * MM, 18 * MM, (26.7 * MM, 123.3 * MM), 1.0),
        air=((0.0, 0.3), (-0.25, 0.4), (0.0, 0.3)),
        breaks=((13 * MM,), ((face + gap / 2) * MM, 126 * MM), (6 * MM,)),
        near=(
            (SizeNear(12.5 * MM, edge * MM), SizeNear(13.5 * MM, edge * MM), SizeNear(38.5 * MM, 4 * MM)),
            (SizeNear(face * MM, edge * MM), SizeNear(26.5 * MM, edge * MM), SizeNear(125 * MM, edge * MM),
             SizeNear(150 * MM, 4 * MM)),
            (SizeNear(5 * MM, edge * MM), SizeNear(12.5 * MM, 2 * MM)),
        ),
    )  # fmt: skip


def force_in_shell(solution: PotentialSolution, box: tuple[float, float, float, float]) -> float:
    """N upwards on the pole, by the air between it and |x| < x1, y0 < y < y1, |z| < z1 (mm)."""
    x1, y0, y1, z1 = box
    grid = solution.problem.grid
    x, y, z = (planes / MM for planes in grid.planes)
    weight = DisplacementWeight(
        np.interp(x, [12.5, x1], [1, 0]), np.interp(y, [y0, 26.5, 125, y1], [0, 1, 1, 0]), np.interp(z, [5, z1], [1, 0])
    )
    slope, field = weight.at_points(grid), solution.state.strength
    along = np.einsum("cqk,cqk->cq", field, slope)
    stress = np.sum(field**2, axis=-1) / 2 * slope[..., 1] - field[..., 1] * along
    return 4 * MU_0 * solution.problem.integral(stress)


def attraction(model: BoxModel, turns: float, refinement: float, face: float = 25.0) -> tuple[float, float, int]:
    """N towards the frame, by the air as far as it and by half of that in the gap, and the unknowns."""
    solution = solve_potential(model.problem(refinement), turns, tolerance=1e-8)
    boxes = (13.5, face, 126, 6), (13.0, (face + 26.5) / 2, 126, 6)
    far, near = (-force_in_shell(solution, box) for box in boxes)
    return far, near, solution.problem.grid.n_nodes


def flux_densities(model: BoxModel, turns: float, refinement: float) -> list[float]:
    """T along y: at P1 and P2, and the means over pole and outer leg between y = 70 and 80 mm."""
    x_near, y_near, z_near = model.near
    model = replace(model, near=(x_near, (*y_near, SizeNear(75 * MM, 4 * MM)), z_near))
    solution = solve_potential(model.problem(refinement), turns, tolerance=1e-8)
    points = MM * np.array([(0.0, 25.75, 0.0), (12.5, 25.75, 5.0)])
    at_points = field_at(model, solution, points)[1][:, 1]
    problem = solution.problem
    x, y, z = (centres / MM for centres in problem.grid.centres())
    means = []
    for inside in ((x < 12.5) & (z < 5), (x > 38.5) & (x < 63.5) & (z < 12.5)):
        cells = inside & (y > 70) & (y < 80)
        flux, weights = solution.state.flux_density[cells, :, 1], problem.weights[cells]
        means.append(abs(float(np.sum(weights * flux) / weights.sum())))
    return [*map(float, at_points), *means]


def ideal_steel() -> None:
    """The force and the flux densities at 1000 ampere-turns of steel with a relative permeability of 100 000."""
    model = replace(problem_20(), curves=coenergy_curves([(linear_iron(1e5), 1.0)]))
    found = ", ".join(f"{value:.3f}" for value in flux_densities(model, 1000, 1.0))
    print(f"ideal steel: {attraction(model, 1000, 1.0)[0]:.2f} N; P1, P2, pole, leg in T: {found}", flush=True)


def flux_table(turns: Sequence[int]) -> None:
    """Measured and computed flux densities, and what they differ by in per cent."""
    print("| ampere-turns | P1 | P2 | pole | outer leg |\n| ---: | ---: | ---: | ---: | ---: |")
    for at in turns:
        pairs = zip(FLUX_DENSITY[at], flux_densities(problem_20(), at, 1.4), strict=True)
        cells = (f"{was:.2f}, {found:.3f} ({100 * (found / was - 1):+.1f})" for was, found in pairs)
        print(f"| {at} | {' | '.join(cells)} |", flush=True)


def grids() -> None:
    """Force in N by three shells and coenergy in mJ at 1000 ampere-turns, as edges and grid become finer."""
    force: dict[tuple[float, float], float] = {}
    for edge, refinement in GRIDS:
        solution = solve_potential(problem_20(edge=edge).problem(refinement), 1000, tolerance=1e-8)
        found = [-force_in_shell(solution, box) for box in SHELLS]
        force[edge, refinement] = float(np.mean(found))
        nodes, told = solution.problem.grid.n_nodes, ", ".join(f"{one:.4f}" for one in found)
        print(f"{edge:g} mm, {nodes} unknowns: {told} N, {4e3 * solution.coenergy:.3f} mJ", flush=True)
    limit, error = extrapolated(force)
    print(f"{limit:.3f} +- {error:.3f} N, {100 * (limit / MEASURED[1000] - 1):+.2f} % from the measurement")


def extrapolated(force: Mapping[tuple[float, float], float]) -> tuple[float, float]:
    """The force (N) on boxes of no size, and its error, from those at (size at the edges, refinement).

    The refinement's steps are alike, so its changes are a geometric series, of the order seen. What the edges of the
    pole leave goes with the power 4/3 of the size there (right angles of iron). The error is all that is added.
    """
    coarse, middle, fine = (force[0.05, refinement] for refinement in (0.7, 1.0, 1.4))
    boxes = (fine - middle) / ((coarse - middle) / (middle - fine) - 1)
    edges = (force[0.02, 1.0] - middle) / (1 - (0.02 / 0.05) ** (4 / 3))
    return fine + boxes + edges, abs(boxes) + abs(edges)


def sensitivity() -> None:
    """By how much the force at 1000 ampere-turns changes with what the problem states."""
    base, _, _ = attraction(problem_20(), 1000, 0.7)
    changed = {
        "gap 1.55 mm": attraction(problem_20(1.55), 1000, 0.7, 24.95)[0],
        "1010 ampere-turns": attraction(problem_20(), 1010, 0.7)[0],
        "H of the steel 10 % larger": attraction(problem_20(field=[1.1 * h for h in H]), 1000, 0.7)[0],
    }
    for what, force in changed.items():
        print(f"{what}: {100 * (force / base - 1):+.1f} %", flush=True)


if __name__ == "__main__":
    if "--sensitivity" in sys.argv:
        sensitivity()
        ideal_steel()
        sys.exit()
    if "--grids" in sys.argv:
        grids()
        sys.exit()
    if "--flux" in sys.argv:
        flux_table([int(word) for word in sys.argv[1:] if word != "--flux"])
        sys.exit()
    print("| ampere-turns | measured N | computed N | thinner shell | coarser grid | off % | unknowns | CPU s |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for turns in map(int, sys.argv[1:]):
        started = time.process_time()
        before, _, _ = attraction(problem_20(), turns, 0.7)
        far, near, unknowns = attraction(problem_20(), turns, 1.0)
        cells = [turns, MEASURED[turns], f"{far:.2f}", f"{near:.2f}", f"{before:.2f}"]
        cells += [f"{100 * (far / MEASURED[turns] - 1):+.1f}", unknowns, f"{time.process_time() - started:.0f}"]
        print("|", " | ".join(map(str, cells)), "|", flush=True)
