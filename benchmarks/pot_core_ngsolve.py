"""The pot core of geometries/ beside an independent axisymmetric solution by NGSolve, in linear iron.

    python benchmarks/pot_core_ngsolve.py

NGSolve's force is the slope of its coenergy over gaps on meshes of their own; both have the same box and permeability.
"""

import json
from math import pi
from pathlib import Path

from netgen.geom2d import CSG2d, Rectangle
from ngsolve import H1, BilinearForm, GridFunction, Integrate, LinearForm, Mesh, SetNumThreads, dx, grad, x

from msl_fem.actuator import load_actuator
from msl_fem.magnetics.field.magnet_field import solve

MU_0, MU_R = 4e-7 * pi, 1000.0
ROOT = Path(__file__).parent.parent
STEP = 0.06  # of the gap, for the coenergy's slope by five points


def section(magnet: object, gap: float, margin: float) -> Mesh:
    """The half plane (r, z) in m with sizes in fractions of the gap around the poles."""
    m = magnet
    post, half = m.post_diameter / 2, m.half_width
    inner, roof, top = post + m.window_width, gap + m.window_height, gap + m.height
    low, coil = -m.armature_thickness, m.coil
    left, bottom = post + coil.leg_clearance, gap + coil.face_clearance
    armature = Rectangle((0, low), (half, 0), mat="iron", bc="inner").Maxh(half / 25)
    core = Rectangle((0, gap), (half, top), mat="iron", bc="inner")
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


def coenergy(magnet: object, gap: float, current: float, margin: float) -> float:
    """J, of A_phi with A = 0 on axis and box: B_z = dA/dr + A/r, B_r = -dA/dz."""
    mesh = section(magnet, gap, margin)
    space = H1(mesh, order=4, dirichlet=".*")
    free = space.FreeDofs()
    nodes = H1(mesh, order=4)
    for dof in range(space.ndof):  # inner edges are no boundary of the field
        free[dof] = True
    for edge in mesh.Boundaries("box|default").Elements():
        for dof in nodes.GetDofNrs(edge):
            free[dof] = False
    u, v = space.TnT()
    nu = mesh.MaterialCF({"iron": 1 / (MU_0 * MU_R)}, default=1 / MU_0)
    b = lambda a: grad(a)[0] + a / x  # noqa: E731
    stiffness = BilinearForm(space)
    stiffness += nu * 2 * pi * x * (b(u) * b(v) + grad(u)[1] * grad(v)[1]) * dx(bonus_intorder=2)
    density = current * magnet.turns / (magnet.coil.width * magnet.coil.height)
    load = LinearForm(space)
    load += density * 2 * pi * x * v * dx("coil")
    stiffness.Assemble()
    load.Assemble()
    a = GridFunction(space)
    a.vec.data = stiffness.mat.Inverse(free, "sparsecholesky") * load.vec
    return float(Integrate(density * 2 * pi * x * a * dx("coil"), mesh)) / 2


def main() -> None:
    """One JSON line a point: force and flux linkage of both, and their relative difference."""
    SetNumThreads(1)
    actuator = load_actuator(ROOT / "geometries" / "pot_core_holding.toml")
    margin = 4 * actuator.magnet.half_width
    content = actuator.magnet.model_dump(exclude_none=True)
    content["iron"] |= {"core": f"linear:{MU_R:g}", "armature": f"linear:{MU_R:g}"}
    content["air"] = dict.fromkeys(("side", "bottom", "top"), margin)
    magnet = type(actuator.magnet).model_validate(content)
    linear = actuator.model_copy(update={"magnet": magnet})
    for gap in (3e-4, 6e-4, 1e-3):
        ours = solve(linear, 1.0, gap, accuracy="fine").quantities
        w = [coenergy(magnet, gap * (1 + k * STEP), 1.0, margin) for k in (-2, -1, 0, 1, 2)]
        force, flux = (8 * (w[1] - w[3]) - (w[0] - w[4])) / (12 * STEP * gap), 2 * w[2]
        told = {
            "gap_m": gap,
            "force_N": ours.force,
            "ngsolve_force_N": force,
            "force_difference": ours.force / force - 1,
            "flux_linkage_Wb": ours.flux_linkage,
            "ngsolve_flux_linkage_Wb": flux,
            "flux_difference": ours.flux_linkage / flux - 1,
        }
        print(json.dumps(told))


if __name__ == "__main__":
    main()
