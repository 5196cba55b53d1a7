"""Field problems with known answers on structured meshes, and the reference values of E1."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron

REFERENCE = Path(__file__).parents[1] / "reference"


def reference(name: str) -> np.ndarray:
    """A file of tests/reference as a structured array."""
    return np.genfromtxt(REFERENCE / name, delimiter=",", names=True, dtype=None, encoding="utf-8")


def structured_mesh(
    x: np.ndarray, y: np.ndarray, region_at: Callable[[float, float], str], *, gap: float
) -> TriangleMesh:
    """The grid of lines x, y with each rectangle halved; `region_at` names the region of a rectangle's centre."""
    points = np.stack(np.meshgrid(x, y, indexing="ij")).reshape(2, -1)
    corner = np.arange(x.size * y.size).reshape(x.size, y.size)
    a, b, c, d = (m.ravel() for m in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    centre_x, centre_y = (x[:-1] + x[1:]) / 2, (y[:-1] + y[1:]) / 2
    cell = [region_at(float(u), float(v)) for u in centre_x for v in centre_y]
    names = tuple(dict.fromkeys(cell))
    region = np.array([names.index(name) for name in cell])
    triangles = np.concatenate([np.stack([a, b, c]), np.stack([a, c, d])], axis=1)
    return TriangleMesh(points, triangles.astype(np.int64), np.tile(region, 2), names, gap)


def cubic_iron(*, initial_permeability: float = 800.0, knee: float = 1.0) -> AnalyticIron:
    """H = nu B (1 + B^2/B_0^2): smooth, so that orders of convergence show undisturbed."""
    nu = 1 / (MU_0 * initial_permeability)
    return AnalyticIron(
        name="cubic",
        law=lambda b: (nu * b * (1 + b**2 / knee**2), nu * (1 + 3 * b**2 / knee**2)),
        energy_law=lambda b: nu * (b**2 / 2 + b**4 / (4 * knee**2)),
        source="test",
    )


def observed_order(errors: np.ndarray, *, refinement: float = 2.0) -> float:
    """The order from the last two of a series of errors."""
    return float(np.log(errors[-2] / errors[-1]) / np.log(refinement))
