"""Two published plunger magnets as verification cases: the tables of docs/verification.md.

    python benchmarks/published_magnets.py

The numbers they are held against lie in tests/reference/solenoid and tests/reference/roters.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from marked_text import rewrite

from msl_fem.magnetics.field.plunger import PlungerMagnet, PlungerResult, plunger_field, solve_plunger
from msl_fem.magnetics.section import Region
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import Iron, iron_from_points

ROOT = Path(__file__).parent.parent
REFERENCE = ROOT / "tests" / "reference"
DOCUMENT = ROOT / "docs" / "verification.md"
INCH = 0.0254
SOLENOID_CURRENT, ROTERS_CURRENT = 1.2, 1.5


def box(name: str, r0: float, z0: float, r1: float, z1: float) -> Region:
    return Region(name, ((r0, z0), (r1, z0), (r1, z1), (r0, z1)))


def steel_9smnpb28() -> Iron:
    """mu_r(B) of the solenoid's steel as points; cut where the formula lets the polarisation fall."""
    b = np.r_[np.linspace(0, 0.1, 21)[1:], np.linspace(0.1, 2.8, 271)[1:]]
    x = b / 1.488
    mu_r = 1 + (400 - 1 + 1200 * x) / (1 + 3 * x + x**12.5)
    return iron_from_points(b, b / (MU_0 * mu_r), name="9SMnPb28", source="Modelica Standard Library, FluxTubes")


def solenoid(pole_face: float = 10e-3) -> PlungerMagnet:
    """The solenoid with its armature on the pole at displacement 0; the air gap x is the displacement."""
    length, bottom, r_out, r_in, r_arm, l_arm = 35e-3, 3.5e-3, 15e-3, 13.5e-3, 5e-3, 26e-3
    bore = r_arm + 0.65e-3
    yoke = Region(
        "yoke",
        (
            (0.0, 0.0),
            (r_out, 0.0),
            (r_out, length),
            (bore, length),
            (bore, length - bottom),
            (r_in, length - bottom),
            (r_in, bottom),
            (r_arm, bottom),
            (r_arm, pole_face),
            (0.0, pole_face),
        ),
    )
    coil = box("coil", bore, bottom, r_in, length - bottom)
    steel = steel_9smnpb28()
    return PlungerMagnet(
        fixed=(yoke, coil),
        plunger=((0.0, pole_face), (r_arm, pole_face), (r_arm, pole_face + l_arm), (0.0, pole_face + l_arm)),
        irons={"yoke": steel, "plunger": steel},
        turns_density={"coil": 957 / ((r_in - bore) * (length - 2 * bottom))},
        box=(60e-3, -45e-3, 90e-3),
        gap=0.65e-3,
    )


def roters() -> PlungerMagnet:
    """Roters' taper-plunger magnet; the measured displacement withdraws the plunger along -z."""
    geometry = json.loads((REFERENCE / "roters" / "geometry.json").read_text())
    points = [(r * INCH, z * INCH) for r, z in geometry["points"]]
    curve = np.genfromtxt(REFERENCE / "roters" / "bh_1020_half_hard.csv", delimiter=",", names=True)
    steel = iron_from_points(curve["B_T"], curve["H_A_per_m"], name="1020 half hard", source="Roters 1941")
    shell = Region("shell", tuple(points[k] for k in (0, 1, 4, 3, 7, 10, 9, 18, 11, 6, 5, 2)))
    coil = Region("coil", tuple(points[k] for k in (2, 5, 6, 11)))
    (r0, z0), (r1, z1) = points[2], points[6]
    return PlungerMagnet(
        fixed=(shell, coil),
        plunger=tuple(points[k] for k in (12, 13, 20, 19, 8)),
        irons={"shell": steel, "plunger": steel},
        turns_density={"coil": geometry["turns"] / ((r1 - r0) * (z1 - z0))},
        box=(8 * INCH, -7 * INCH, 14 * INCH),
        gap=INCH / 32,
    )


def solve_both_orders(magnet: PlungerMagnet, current: float, displacement: float) -> tuple[PlungerResult, float]:
    """The solution with cubic elements, and the relative change of its force from quadratic ones."""
    two, three = (
        field.evaluate(field.solve(current)) for field in (plunger_field(magnet, displacement, order=k) for k in (2, 3))
    )
    return three, abs(two.force / three.force - 1)


def with_coil(magnet: PlungerMagnet, coil: Region) -> PlungerMagnet:
    """The magnet with another rectangular coil of as many turns."""
    (r0, z0), _, (r1, z1), _ = coil.vertices
    (s0, y0), _, (s1, y1), _ = magnet.fixed[1].vertices
    turns = magnet.turns_density["coil"] * (s1 - s0) * (y1 - y0)
    return replace(magnet, fixed=(magnet.fixed[0], coil), turns_density={"coil": turns / ((r1 - r0) * (z1 - z0))})


def with_curve(magnet: PlungerMagnet, factor: float) -> PlungerMagnet:
    """The magnet with all flux densities of its iron's curve times a factor."""
    iron = magnet.irons["plunger"]
    scaled = iron_from_points(iron.flux_density * factor, iron.field_strength, name=iron.name, source=iron.source)
    return replace(magnet, irons=dict.fromkeys(magnet.irons, scaled))


def with_plunger_radius(magnet: PlungerMagnet, change: float) -> PlungerMagnet:
    """The magnet with every radius of its plunger changed."""
    return replace(magnet, plunger=tuple((r + change if r else 0.0, z) for r, z in magnet.plunger))


def percent(value: float, reference: float) -> str:
    return f"{(value / reference - 1) * 100:+.1f}"


def beside(reference: float, ours: float, digits: int) -> list[str]:
    """Reference, ours and the error in %, as a table's cells."""
    return [f"{reference:.{digits}f}", f"{ours:.{digits}f}", percent(ours, reference)]


def markdown(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join("| " + " | ".join(row) + " |" for row in [head, ["---:"] * len(head), *rows])


def solenoid_table() -> str:
    """Force, flux and inductance of the solenoid beside the reference."""
    reference = np.genfromtxt(REFERENCE / "solenoid" / "fea_quasistatic_12V.csv", delimiter=",")
    rows, inductances, forces, changes, routes = [], [], [], [], []
    for x, force, flux, inductance in reference:
        got, change = solve_both_orders(solenoid(), SOLENOID_CURRENT, x)
        ours = got.flux_linkage / SOLENOID_CURRENT
        inductances.append(ours)
        forces.append(got.force)
        changes.append(change)
        routes.append(abs(got.force_stress_tensor / got.force - 1))
        rows.append(
            [
                f"{x * 1e3:.2f}",
                *beside(force, got.force, 3),
                *beside(flux * 1e6, abs(got.plunger_flux) * 1e6, 1),
                *beside(inductance * 1e3, ours * 1e3, 2),
            ]
        )
    print(
        f"solenoid, largest differences: quadratic to cubic {max(changes):.1e}, the two force routes {max(routes):.1e}"
    )
    far = slice(6, 19)  # 1.75 to 4.75 mm
    for name, force, inductance in (("theirs", reference[:, 1], reference[:, 3]), ("ours", forces, inductances)):
        slope = SOLENOID_CURRENT**2 / 2 * np.gradient(inductance, reference[:, 0])
        gap = (slope / np.array(force) - 1)[far] * 100
        print(f"{name}: i^2/2 dL/dx against the force, 1.75 to 4.75 mm: {gap.min():+.1f} to {gap.max():+.1f} %")
    head = ["x (mm)", "F (N)", "ours", "error (%)", "flux (uWb)", "ours", "error (%)", "L (mH)", "ours", "error (%)"]
    return markdown(head, rows)


def published_error(displacement: float) -> str:
    """What is known of the published computation's error in %, by displacement in inches."""
    if displacement < 0.05:
        return "+17"
    if displacement < 0.55:
        return "+4 to +6"
    return "-4 to -9" if displacement > 0.75 else "between"


def roters_table() -> str:
    """Force over stroke of Roters' magnet beside the measurement and the published computation."""
    rows, changes, routes = [], [], []
    for displacement, _, force in np.genfromtxt(REFERENCE / "roters" / "measured_force.csv", delimiter=","):
        got, change = solve_both_orders(roters(), ROTERS_CURRENT, -displacement * INCH)
        changes.append(change)
        routes.append(abs(got.force_stress_tensor / got.force - 1))
        rows.append(
            [
                f"{displacement:.3f}",
                f"{displacement * 25.4:.2f}",
                *beside(force, got.force, 1),
                published_error(displacement),
            ]
        )
    print(f"Roters, largest differences: quadratic to cubic {max(changes):.1e}, the two force routes {max(routes):.1e}")
    head = ["d (in)", "d (mm)", "measured F (N)", "ours", "error (%)", "published error (%)"]
    return markdown(head, rows)


def solenoid_sensitivity() -> str:
    """What another reading of the solenoid's data would change, in %."""
    magnet, positions = solenoid(), (0.25e-3, 1e-3, 3e-3, 5e-3)
    inset = box("coil", 6.65e-3, 4.5e-3, 13.5e-3, 30.5e-3)
    outer = box("coil", 5.65e-3, 3.5e-3, 12.5e-3, 31.5e-3)
    cases = {
        "coil on a bobbin, 1 mm to bore and ends": with_coil(magnet, inset),
        "coil 1 mm clear of the yoke's inner radius": with_coil(magnet, outer),
        "B of the steel's curve 5 % higher": with_curve(magnet, 1.05),
        "air box twice as large": replace(magnet, box=(120e-3, -100e-3, 150e-3)),
        "pole face at 8.25 mm": solenoid(8.25e-3),
    }
    base = [solve_plunger(magnet, SOLENOID_CURRENT, x) for x in positions]
    rows = []
    for name, other in cases.items():
        got = [solve_plunger(other, SOLENOID_CURRENT, x) for x in positions]
        pairs = list(zip(got, base, strict=True))
        rows.append(
            [name, *(f"{percent(g.force, b.force)} / {percent(g.flux_linkage, b.flux_linkage)}" for g, b in pairs)]
        )
    return markdown(["force / inductance at", *(f"{x * 1e3:g} mm" for x in positions)], rows)


def roters_sensitivity() -> str:
    """The force's error in % at some positions, for other data of Roters' magnet."""
    measured = np.genfromtxt(REFERENCE / "roters" / "measured_force.csv", delimiter=",")[[0, 5, 8, 11, 15]]
    magnet, i = roters(), ROTERS_CURRENT
    cases = {
        "as given": (magnet, i, 0.0),
        "air box of the example": (replace(magnet, box=(2.5 * INCH, -2.5 * INCH, 8 * INCH)), i, 0.0),
        "B of the curve 5 % higher": (with_curve(magnet, 1.05), i, 0.0),
        "B of the curve 5 % lower": (with_curve(magnet, 0.95), i, 0.0),
        "current 2 % higher": (magnet, 1.02 * i, 0.0),
        "plunger 0.05 in further out": (magnet, i, 0.05),
        "plunger radius 0.01 in smaller": (with_plunger_radius(magnet, -0.01 * INCH), i, 0.0),
        "B 7 % lower and current 8 % higher": (with_curve(magnet, 0.93), 1.08 * i, 0.0),
    }
    rows = []
    for name, (other, current, offset) in cases.items():
        errors = [percent(solve_plunger(other, current, -(d + offset) * INCH).force, force) for d, _, force in measured]
        rows.append([name, *errors])
    return markdown(["error (%) at", *(f"{d:.3f} in" for d in measured[:, 0])], rows)


TABLES = {
    "solenoid": solenoid_table,
    "solenoid sensitivity": solenoid_sensitivity,
    "roters": roters_table,
    "roters sensitivity": roters_sensitivity,
}


def main() -> None:
    """Write the tables between their markers in docs/verification.md."""
    rewrite(DOCUMENT, {name: table() for name, table in TABLES.items()})


if __name__ == "__main__":
    main()
