"""E1 of constant permeability by a second formulation: the vector potential of NGSolve beside our scalar potential.

    python benchmarks/three_d_vector_potential.py [--gap 0.6] [--size 1.0] [--order 2]

The same quarter, irons, coil and flux lines, on tetrahedra with edge elements: curl (nu curl A) = curl T_0, A x n = 0.
A makes the inductance too small where the scalar potential makes it too large, so that both
enclose the true one. Needs ngsolve (the bench extra).
"""

import argparse
import time
from pathlib import Path

import numpy as np
from netgen.occ import Box as OccBox
from netgen.occ import Glue, OCCGeometry, Pnt
from ngsolve import (
    BilinearForm,
    CGSolver,
    CoefficientFunction,
    GridFunction,
    HCurl,
    IfPos,
    InnerProduct,
    Integrate,
    LinearForm,
    Mesh,
    Preconditioner,
    TaskManager,
    curl,
    dx,
    sqrt,
    x,
    y,
    z,
)  # fmt: skip

from msl_fem.actuator import load_actuator
from msl_fem.magnetics.three_d.magnet_point import solve_solid
from msl_fem.materials.constants import MU_0

ROOT = Path(__file__).parent.parent
MU_R = 1000.0
GAUGE = 1e-6  # of the reluctivity of air over a square metre of edges: what fixes A and changes no flux


def occ_box(sides, size):
    """A box of netgen between the sides (3 pairs in mm), with elements of a size."""
    low, high = zip(*sides, strict=True)
    solid = OccBox(Pnt(*low), Pnt(*high))
    solid.maxh = size
    return solid


def meshed(model, gap, size):
    """Tetrahedra in mm that no box cuts; short at the edges of the poles."""
    air = [(1e3 * low, 1e3 * high) for low, high in model.air]

    def inside(box):
        sides = zip((box.x, box.y, box.z), air, strict=True)
        return [(max(1e3 * a, low), min(1e3 * b, high)) for (a, b), (low, high) in sides]

    irons = [inside(box) for box in model.boxes if box.iron >= 0]
    coil = model.coil
    reach = 1e3 * (coil.clearance + coil.width)
    legs = [(0.0, 1e3 * coil.x[1] + reach), tuple(1e3 * v for v in coil.height), (0.0, 1e3 * coil.z[1] + reach)]
    right = max(sides[0][1] for sides in irons)
    depth = max(sides[2][1] for sides in irons)
    strip = [(0.0, right), (0.0, gap), (0.0, depth)]
    solids = [occ_box(strip, 0.8 * size), *(occ_box(sides, 3 * size) for sides in irons), occ_box(legs, 3 * size)]
    whole = Glue([occ_box(air, 8 * size), *solids])
    for edge in whole.edges:
        c = edge.center
        if -1e-6 < c.y < gap + 1e-6 and c.x < right + 1e-6 and c.z < depth + 1e-6:
            edge.maxh = 0.5 * size
    for face in whole.faces:
        c = face.center
        on_side = (abs(v - side) < 1e-6 for v, sides in zip((c.x, c.y, c.z), air, strict=True) for side in sides)
        face.name = "outer" if any(on_side) else "inner"
    return Mesh(OCCGeometry(whole).GenerateMesh(maxh=8 * size, grading=0.4))


def source(coil):
    """T_0 in y at 1 A over mm, in A/m."""
    away = []
    for value, (low, high) in ((x, coil.x), (z, coil.z)):
        below, above = 1e3 * low - value, value - 1e3 * high
        away.append(IfPos(below, below, IfPos(above, above, 0.0)))
    distance = sqrt(away[0] ** 2 + away[1] ** 2 + 1e-20)
    share = (1e3 * (coil.clearance + coil.width) - distance) / (1e3 * coil.width)
    share = IfPos(share, IfPos(share - 1, 1.0, share), 0.0)
    low, high = (1e3 * v for v in coil.height)
    inside = IfPos(y - low, IfPos(high - y, 1.0, 0.0), 0.0)
    return CoefficientFunction((0.0, inside * share * coil.turns / (coil.height[1] - coil.height[0]), 0.0))


def reluctivity(model):
    """1/mu over mm: of the iron in its boxes, later ones over earlier ones, else of air."""
    nu = CoefficientFunction(1 / MU_0)
    for box in model.boxes:
        value = 1 / (MU_0 * MU_R) if box.iron >= 0 else 1 / MU_0
        inside = CoefficientFunction(1.0)
        for coordinate, (low, high) in ((x, box.x), (y, box.y), (z, box.z)):
            for distance in (coordinate - 1e3 * max(low, -1.0), 1e3 * min(high, 1.0) - coordinate):
                inside = IfPos(distance, inside, 0.0)
        nu = IfPos(inside - 0.5, value, nu)
    return nu


def inductance_by_a(model, gap, size, order):
    """(H of the whole magnet, unknowns)."""
    mesh = meshed(model, 1e3 * gap, size)
    space = HCurl(mesh, order=order, dirichlet="outer", nograds=True)
    u, v = space.TnT()
    nu, t_0 = reluctivity(model), source(model.coil)
    form = BilinearForm(nu * curl(u) * curl(v) * dx + GAUGE / MU_0 * u * v * dx)
    preconditioner = Preconditioner(form, "bddc")
    right = LinearForm(t_0 * curl(v) * dx(bonus_intorder=2))
    potential = GridFunction(space)
    with TaskManager():
        form.Assemble()
        right.Assemble()
        solver = CGSolver(form.mat, preconditioner.mat, tol=1e-9, maxiter=600)
        potential.vec.data = solver * right.vec
        linked = Integrate(InnerProduct(curl(potential), t_0), mesh, order=2 * order + 4)
    return model.copies * 1e-9 * linked, space.ndof  # A is in T mm by lengths in mm: curl A in T, the volume in mm^3


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gap", type=float, default=0.6, help="mm")
    parser.add_argument("--size", type=float, default=1.0, help="of the elements, mm beside the gap")
    parser.add_argument("--order", type=int, default=2)
    parser.add_argument("--accuracy", default="normal")
    given = parser.parse_args()
    e1 = load_actuator(ROOT / "geometries" / "e1.toml")
    iron = e1.magnet.iron.model_copy(update={"core": f"linear:{MU_R:g}", "armature": f"linear:{MU_R:g}"})
    linear = e1.model_copy(update={"magnet": e1.magnet.model_copy(update={"iron": iron})})
    started = time.process_time()
    point, model, _ = solve_solid(linear, 1.0, 1e-3 * given.gap, accuracy=given.accuracy)
    middle = time.process_time()
    by_a, unknowns = inductance_by_a(model, 1e-3 * given.gap, given.size, given.order)
    ended = time.process_time()
    print(f"scalar potential: {1e3 * point.flux_linkage:.4f} mH, {point.unknowns} nodes, {middle - started:.0f} s, "
          f"stated error {100 * point.flux_error:.2f} %")  # fmt: skip
    print(f"vector potential: {1e3 * by_a:.4f} mH, {unknowns} unknowns, {ended - middle:.0f} s; difference "
          f"{100 * (by_a / point.flux_linkage - 1):+.2f} %")  # fmt: skip
    assert np.isfinite(by_a)


if __name__ == "__main__":
    main()
