"""The pot core of geometries/ beside an independent axisymmetric solution by NGSolve, linear and saturated.

    python benchmarks/pot_core_ngsolve.py

Box, B-H curve and gap are the same; meshes, elements and the routes to the force are not. NGSolve's force is
by Maxwell's stress weighted over the air round the disc (the eggshell, which is the derivative of the energy by the
disc's place on one solution); in linear iron it is stated a second time, as the slope of the coenergies of meshes of
their own, which scatters by up to 0.1 %.
"""

import json
from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np
from netgen.geom2d import CSG2d, Rectangle
from ngsolve import (
    H1,
    BilinearForm,
    BSpline,
    GridFunction,
    Integrate,
    Mesh,
    SetNumThreads,
    Variation,
    dx,
    grad,
    sqrt,
    x,
)

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.magnetics.field.magnet_field import solve
from msl_fem.materials.material import load_iron

MU_0, MU_R = 4e-7 * pi, 1000.0
ROOT = Path(__file__).parent.parent
STEP = 0.06  # of the gap, for the coenergy's slope by five points
ORDER = 4
CURVE = np.concatenate([[0.0], np.geomspace(1e-2, 1.0, 60), np.linspace(1.01, 2.6, 160)])  # T, of the iron's curve
LINEAR, STEEL = ((3e-4, 1.0), (6e-4, 1.0), (1e-3, 1.0)), ((6e-4, 1.0), (6e-4, 2.0), (3e-4, 2.0))  # gap, current
SOLID = ("core", "coil", "armature")


def section(magnet: object, gap: float, margin: float) -> Mesh:
    """The half plane (r, z) in m with sizes in fractions of the gap around the poles."""
    m = magnet
    post, half = m.post_diameter / 2, m.half_width
    inner, roof, top = post + m.window_width, gap + m.window_height, gap + m.height
    low, coil = -m.armature_thickness, m.coil
    left, bottom = post + coil.leg_clearance, gap + coil.face_clearance
    armature = Rectangle((0, low), (half, 0), mat="armature", bc="inner").Maxh(half / 25)
    core = Rectangle((0, gap), (half, top), mat="core", bc="inner")
    window = Rectangle((post, gap), (inner, roof), mat="air", bc="inner")
    turns = Rectangle((left, bottom), (left + coil.width, bottom + coil.height), mat="coil", bc="inner")
    strip = Rectangle((0, 0), (1.2 * half, gap), mat="air", bc="inner")
    box = Rectangle((0, low - margin), (half + margin, top + margin), mat="air", bc="box")
    geometry = CSG2d()
    geometry.Add(armature)
    geometry.Add((core - window).Maxh(half / 25))
    geometry.Add(strip.Maxh(gap / 3))
    geometry.Add(turns)
    geometry.Add(window - turns)
    geometry.Add(box - armature - core - strip)
    return Mesh(geometry.GenerateMesh(maxh=half, grading=0.25))


@dataclass
class Solved:
    """A field of NGSolve; force, flux linkage and coenergy in SI units."""

    mesh: Mesh
    potential: GridFunction
    force: float
    flux_linkage: float
    coenergy: float


def free_dofs(space: H1) -> object:
    """All but those on box and axis: edges between materials are no boundary of the field."""
    free = space.FreeDofs()
    for dof in range(space.ndof):
        free[dof] = True
    for edge in space.mesh.Boundaries("box|default").Elements():
        for dof in space.GetDofNrs(edge):
            free[dof] = False
    return free


def solved(actuator: Actuator, gap: float, current: float, margin: float) -> Solved:
    """A_phi with A = 0 on axis and box: B_z = dA/dr + A/r, B_r = -dA/dz; Newton on the energy, halved steps."""
    magnet = actuator.magnet
    mesh = section(magnet, gap, margin)
    space = H1(mesh, order=ORDER, dirichlet=".*")
    free = free_dofs(space)
    iron = load_iron(magnet.iron.core, folder=actuator.folder)
    curve = BSpline(2, [0.0, *CURVE.tolist()], iron.magnetise(CURVE)[0].tolist())
    energy = curve.Integrate()
    u, _ = space.TnT()
    density = current * magnet.turns / (magnet.coil.width * magnet.coil.height)
    form = BilinearForm(space)
    size = sqrt((grad(u)[0] + u / x) ** 2 + grad(u)[1] ** 2 + 1e-18)
    order = {"bonus_intorder": 2}
    form += Variation(energy(size) * 2 * pi * x * dx("core|armature", **order))
    form += Variation(((grad(u)[0] + u / x) ** 2 + grad(u)[1] ** 2) / (2 * MU_0) * 2 * pi * x * dx("air|coil", **order))
    form += Variation(-density * 2 * pi * x * u * dx("coil"))
    a = GridFunction(space)
    newton(form, a, free)
    linkage = float(Integrate(density / current * 2 * pi * x * a * dx("coil"), mesh))
    b = sqrt((grad(a)[0] + a / x) ** 2 + grad(a)[1] ** 2 + 1e-18)
    stored = float(Integrate(energy(b) * 2 * pi * x * dx("core|armature", **order), mesh))
    stored += float(Integrate(b**2 / (2 * MU_0) * 2 * pi * x * dx("air|coil", **order), mesh))
    return Solved(mesh, a, eggshell(mesh, a), linkage, current * linkage - stored)


def newton(form: BilinearForm, a: GridFunction, free: object) -> None:
    """The potential of least energy; ArithmeticError where the steps do not end."""
    step, residual = a.vec.CreateVector(), a.vec.CreateVector()
    energy = 0.0
    for _ in range(60):
        form.Apply(a.vec, residual)
        form.AssembleLinearization(a.vec)
        step.data = form.mat.Inverse(free, "sparsecholesky") * residual
        length = 1.0
        a.vec.data -= step
        if step.Norm() <= 1e-9 * a.vec.Norm():
            return
        following = form.Energy(a.vec)
        while following > energy and length > 1e-3:
            length /= 2
            a.vec.data += length * step
            following = form.Energy(a.vec)
        energy = following
    raise ArithmeticError("NGSolve's Newton iteration did not end")


def eggshell(mesh: Mesh, a: GridFunction) -> float:
    """N towards the core: Maxwell's stress against the gradient of a weight, 1 on the disc and 0 on core and coil.

    The weight is harmonic in the air: F_z = 1/mu_0 integral of |B|^2/2 dg/dz - B_z (B . grad g) 2 pi r.
    """
    space = H1(mesh, order=2)
    free = space.FreeDofs()
    weight = GridFunction(space)
    fixed = [(element, material) for material in SOLID for element in mesh.Materials(material).Elements()]
    fixed += [(edge, "box") for edge in mesh.Boundaries("box").Elements()]
    for element, material in fixed:
        for dof in space.GetDofNrs(element):
            free[dof] = False
            if material == "armature" and dof < mesh.nv:  # a constant is that of its vertices
                weight.vec[dof] = 1.0
    u, v = space.TnT()
    laplace = BilinearForm(space)
    laplace += grad(u) * grad(v) * dx
    laplace.Assemble()
    weight.vec.data -= laplace.mat.Inverse(free, "sparsecholesky") * (laplace.mat * weight.vec)
    b_r, b_z = -grad(a)[1], grad(a)[0] + a / x
    slope = grad(weight)
    density = (b_r**2 + b_z**2) / 2 * slope[1] - b_z * (b_r * slope[0] + b_z * slope[1])
    return float(Integrate(density / MU_0 * 2 * pi * x * dx("air", bonus_intorder=4), mesh))


def by_coenergies(actuator: Actuator, gap: float, current: float, margin: float) -> float:
    """N, the slope of the coenergies of five meshes."""
    w = [solved(actuator, gap * (1 + k * STEP), current, margin).coenergy for k in (-2, -1, 1, 2)]
    return (8 * (w[1] - w[2]) - (w[0] - w[3])) / (12 * STEP * gap)


def with_iron(actuator: Actuator, iron: str, margin: float) -> Actuator:
    """The actuator with another iron in the stated box."""
    content = actuator.magnet.model_dump(exclude_none=True)
    content["iron"] |= {"core": iron, "armature": iron}
    content["air"] = dict.fromkeys(("side", "bottom", "top"), margin)
    return actuator.model_copy(update={"magnet": type(actuator.magnet).model_validate(content)})


def main() -> None:
    """One JSON line a point: force and flux linkage of both, and their relative differences."""
    SetNumThreads(1)
    pot = load_actuator(ROOT / "geometries" / "pot_core_holding.toml")
    margin = 4 * pot.magnet.half_width
    largest = 0.0
    for iron, points in ((f"linear:{MU_R:g}", LINEAR), (pot.magnet.iron.core, STEEL)):
        actuator = with_iron(pot, iron, margin)
        for gap, current in points:
            ours = solve(actuator, current, gap, accuracy="fine").quantities
            theirs = solved(actuator, gap, current, margin)
            largest = max(largest, abs(ours.force / theirs.force - 1))
            told = {
                "iron": iron,
                "gap_m": gap,
                "current_A": current,
                "flux_density_T": max(part.mean for part in ours.flux_density.values()),
                "force_N": ours.force,
                "ngsolve_force_N": theirs.force,
                "force_difference": ours.force / theirs.force - 1,
                "flux_difference": ours.flux_linkage / theirs.flux_linkage - 1,
                "coenergy_difference": ours.coenergy / theirs.coenergy - 1,
            }
            if iron.startswith("linear"):  # a saturated field takes minutes
                told["force_difference_to_coenergies"] = ours.force / by_coenergies(actuator, gap, current, margin) - 1
            print(json.dumps(told), flush=True)
    print(json.dumps({"largest_force_difference": largest}))


if __name__ == "__main__":
    main()
