"""A problem of FEMM and its stored solution beside this project's: flux linkage and force on the armature.

    python benchmarks/femm_pair.py actuator.ans --group 2 --pull=-x

An .ans file holds the problem too. The stored force is that of the stored potential: Maxwell's stress weighted over the
air around the armature (F. Henrotte, G. Deliege, K. Hameyer, The eggshell approach, COMPEL 23, 2004), with the harmonic
weight that is 1 on the armature and 0 on all else; FEMM's own weighted stress is of that kind.
"""

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import spsolve

import msl_fem
from msl_fem.export.femm_file import LENGTHS, FemmProblem, read_femm
from msl_fem.export.femm_magnet import magnet_from_femm

MU_0 = 4e-7 * np.pi


@dataclass(frozen=True, eq=False)
class StoredField:
    """A stored solution of first order: points (n, 2) in m, vector potential (n,) in Wb/m, triangles (m, 3), the index
    of each one's block label (m,)."""

    problem: FemmProblem
    points: np.ndarray
    potential: np.ndarray
    triangles: np.ndarray
    label: np.ndarray


def read_solution(path: str | Path) -> StoredField:
    """The solution of a static .ans file."""
    problem = read_femm(path)
    lines = Path(path).read_text(encoding="latin-1").splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("[Solution]")) + 1
    unit = LENGTHS[problem.head["lengthunits"].lower()]
    n = int(lines[start])
    nodes = np.array([line.split()[:3] for line in lines[start + 1 : start + 1 + n]], dtype=float)
    start += 1 + n
    m = int(lines[start])
    cells = np.array([line.split()[:4] for line in lines[start + 1 : start + 1 + m]], dtype=int)
    return StoredField(problem, nodes[:, :2] * unit, nodes[:, 2], cells[:, :3], cells[:, 3])


def gradients(field: StoredField) -> tuple[np.ndarray, np.ndarray]:
    """Gradients (m, 3, 2) of the corners' functions and areas (m,) of the triangles."""
    p = field.points[field.triangles]
    opposite = np.roll(p, -2, axis=1) - np.roll(p, -1, axis=1)
    (ux, uy), (vx, vy) = (p[:, 1] - p[:, 0]).T, (p[:, 2] - p[:, 0]).T
    double = ux * vy - uy * vx
    turned = np.stack([-opposite[..., 1], opposite[..., 0]], axis=-1)
    return turned / double[:, None, None], np.abs(double) / 2


def flux_linkages(field: StoredField) -> dict[str, float]:
    """Wb of each circuit."""
    _, area = gradients(field)
    mean = field.potential[field.triangles].mean(axis=1)
    found: dict[str, float] = {}
    for k, label in enumerate(field.problem.labels):
        if label.circuit is None:
            continue
        inside = field.label == k
        linked = field.problem.depth * label.turns * float((mean * area)[inside].sum() / area[inside].sum())
        name = field.problem.circuits[label.circuit].name
        found[name] = found.get(name, 0.0) + linked
    return found


def force(field: StoredField, group: int) -> np.ndarray:
    """N (2,) on the blocks of a group."""
    labels, materials = field.problem.labels, field.problem.materials
    moved = np.array([label.group == group for label in labels])[field.label]
    air = np.array([not materials[label.material].magnetic and label.circuit is None for label in labels])[field.label]
    shape, area = gradients(field)
    n = len(field.points)
    weight = np.zeros(n)
    weight[field.triangles[moved]] = 1.0
    free = np.zeros(n, dtype=bool)
    free[field.triangles[air]] = True
    free[field.triangles[~air]] = False
    edges = np.sort(np.concatenate([field.triangles[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    once, count = np.unique(edges, axis=0, return_counts=True)
    free[once[count == 1]] = False
    stiffness = np.einsum("kid,kjd,k->kij", shape, shape, area)
    rows, columns = (np.broadcast_to(field.triangles[:, a, b], (len(area), 3, 3)) for a, b in
                     ((slice(None), None), (None, slice(None))))  # fmt: skip
    matrix = csr_matrix((stiffness.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n))
    weight[free] = spsolve(matrix[free][:, free].tocsc(), -matrix[free][:, ~free] @ weight[~free])
    slope = np.einsum("kid,ki->kd", shape, weight[field.triangles])
    potential = np.einsum("kid,ki->kd", shape, field.potential[field.triangles])
    b = np.stack([potential[:, 1], -potential[:, 0]], axis=-1)
    stress = np.einsum("ki,kj->kij", b, b) - 0.5 * np.eye(2) * (b**2).sum(axis=1)[:, None, None]
    found = -field.problem.depth / MU_0 * np.einsum("kij,kj,k->ki", stress, slope, area * air)
    return np.asarray(found.sum(axis=0))


def main() -> None:
    asked = argparse.ArgumentParser()
    asked.add_argument("solution", type=Path)
    asked.add_argument("--group", type=int, required=True)
    asked.add_argument("--pull", required=True)
    asked.add_argument("--accuracy", default="normal")
    given = asked.parse_args()
    field = read_solution(given.solution)
    current = max(abs(circuit.current) for circuit in field.problem.circuits)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder, "magnet.toml")
        actuator = msl_fem.load_actuator(
            magnet_from_femm(given.solution, target, armature=given.group, pull=given.pull)
        )
        ours = msl_fem.solve(actuator, current, actuator.magnet.gap, accuracy=given.accuracy).quantities
    stored, linked = float(np.abs(force(field, given.group)).max()), sum(flux_linkages(field).values())
    print(f"force        stored {stored:.5g} N, here {ours.force:.5g} N ({100 * (ours.force / stored - 1):+.2f} %)")
    print(f"flux linkage stored {linked:.5g} Wb, here {ours.flux_linkage:.5g} Wb "
          f"({100 * (ours.flux_linkage / linked - 1):+.2f} %)")  # fmt: skip


if __name__ == "__main__":
    main()
