"""What a study is of: the drawing with all data of the design, the irons' curves, heat and what a controller meets."""

import io
import re
from xml.etree import ElementTree

import numpy as np

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.design.sizing.masses import masses
from msl_fem.design.sizing.requirement import Densities
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.schema import document
from msl_fem.files.toml_text import toml_text
from msl_fem.losses import Heating, ThermalLimit, choose_wire, continuous_current, steady_rise
from msl_fem.losses.copper_loss import copper_loss
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import Iron, load_iron
from msl_fem.report.figures import BLUE, GREEN, GREY, ORANGE, SERIES, figure, line, logarithmic, two_rows
from msl_fem.report.page import Stage
from msl_fem.report.page_words import millimetres
from msl_fem.report.section_drawing import COPPER, INK, IRON, LINE, draw_section
from msl_fem.table.magnetic_table import MagneticTable

Numbers = tuple[tuple[str, str], ...]
IN_THE_PAGES_COLOURS = {
    INK: "var(--ink)", LINE: "var(--soft)", IRON: "var(--iron)", COPPER: "var(--copper)", "#ffffff": "var(--paper)",
}  # fmt: skip


def magnet_stages(actuator: Actuator) -> list[Stage]:
    """Drawing with data and the irons' curves; none of a magnet that is not known by its dimensions."""
    if not isinstance(actuator.magnet, MagnetKind) or actuator.magnet.own_mesh() is not None:
        return []
    return [magnet_stage(actuator), iron_stage(actuator)]


def operation_stages(actuator: Actuator, table: MagneticTable) -> list[Stage]:
    """Heat, where the winding is known, and what drive and controller meet."""
    stages = [inductance_stage(actuator, table)]
    try:
        return [heat_stage(actuator), *stages]
    except InputError:  # no dimensions, and no thermal resistance stated
        return stages


def magnet_stage(actuator: Actuator) -> Stage:
    """The dimensioned section, and beside it every number of the design; the actuator file itself below."""
    magnet = actuator.magnet_kind("a drawing of the section")
    sides = actuator.sides
    several = sides is not None and sides.count * sides.magnets_per_side > 1
    assert sides is not None or not several
    how_many = f"{sides.count * sides.magnets_per_side} such magnets" if several and sides else "One magnet"
    moving = f" move {format_quantity(actuator.motion.moving_mass, 'kg')}" if actuator.motion else ""
    sentence = (
        f"{how_many}{moving or ' as drawn'}. Lengths are those of the file; with the numbers beside the drawing and "
        "the file below it the design can be made again."
    )
    listing = toml_text(document(actuator))
    numbers = (*_winding(actuator, magnet), *_mass_numbers(magnet), *_mover(actuator), *_electronics(actuator))
    return Stage("The magnet", sentence, numbers, drawing=_drawing(actuator), listing=("actuator file", listing))


def _drawing(actuator: Actuator) -> str:
    """The section as SVG that takes the page's colours; no text of the file is in it, glyphs are outlines."""
    made, buffer = draw_section(actuator), io.StringIO()
    made.savefig(buffer, format="svg", transparent=True, metadata={"Date": None}, bbox_inches="tight", pad_inches=0.05)
    ElementTree.register_namespace("", "http://www.w3.org/2000/svg")
    ElementTree.register_namespace("xlink", "http://www.w3.org/1999/xlink")
    root = ElementTree.fromstring(buffer.getvalue())  # comments, which hold the drawn texts, are left behind
    for name in ("width", "height"):
        root.attrib.pop(name, None)
    root.set("role", "img")
    root.set("aria-label", "section with dimensions")
    text = ElementTree.tostring(root, encoding="unicode")
    for colour, variable in IN_THE_PAGES_COLOURS.items():
        text = re.sub(re.escape(colour), variable, text, flags=re.IGNORECASE)
    return text


def _winding(actuator: Actuator, magnet: MagnetKind) -> Numbers:
    try:
        wire = choose_wire(actuator).winding.wire
        fits = f"{wire.name} (outer {millimetres(wire.outer_diameter)}, grade {wire.grade})"
    except InputError:
        fits = "none of the standard series"
    return (
        ("turns", f"{magnet.turns}"),
        ("fill factor of the copper", f"{magnet.coil.fill_factor:g}"),
        ("thickest round wire that fits", fits),
        ("coil resistance, 20 °C", format_quantity(actuator.coil_resistance(), "ohm", digits=4)),
    )


def _mass_numbers(magnet: MagnetKind) -> Numbers:
    own = masses(magnet, Densities())
    return tuple(
        (f"mass of the {name}", f"{getattr(own, name) * 1e3:.3g} g") for name in ("core", "armature", "copper")
    )


def _mover(actuator: Actuator) -> Numbers:
    motion = actuator.motion
    if motion is None:
        return ()
    rows = [("moving mass", format_quantity(motion.moving_mass, "kg"))]
    rows += [("stiffness", f"{motion.stiffness:.4g} N/m"), ("damping", f"{motion.damping:.4g} N s/m")]
    if motion.stiffness > 0:
        natural = np.sqrt(motion.stiffness / motion.moving_mass) / (2 * np.pi)
        rows.append(("natural frequency, no current", f"{natural:.4g} Hz"))
    rows += [
        (words, millimetres(length))
        for words, length in (
            ("nominal gap", motion.nominal_gap),
            ("range, plus and minus", motion.range),
            ("end stops at", motion.end_stop),
        )
        if length is not None
    ]
    return (*rows, ("constant force", f"{motion.constant_force:.4g} N"))


def _electronics(actuator: Actuator) -> Numbers:
    drive, sensor, controller = actuator.drive, actuator.position_sensor, actuator.controller
    rows = []
    if drive is not None:
        stated = (
            ("drive", drive.kind),
            ("drive bandwidth", drive.bandwidth and format_quantity(drive.bandwidth, "Hz")),
            ("voltage limit of a side", drive.voltage_limit and format_quantity(drive.voltage_limit, "V")),
            ("current limit of a side", drive.current_limit and format_quantity(drive.current_limit, "A")),
        )
        rows += [(name, text) for name, text in stated if text]
    rows.append(("noise of the position sensor, RMS", format_quantity(sensor.noise, "m")))
    rows.append(("noise of the current sensor, RMS", format_quantity(actuator.current_sensor.noise, "A")))
    if controller is not None:
        delay = controller.delay_samples
        rate = f"{format_quantity(controller.rate, 'Hz')}, delay {delay} sample{'' if delay == 1 else 's'}"
        rows.append(("controller", rate))
    return tuple(rows)


def iron_stage(actuator: Actuator) -> Stage:
    """B over H of each iron, its points and the curve that the field solution takes, and where it comes from."""
    magnet = actuator.magnet_kind("the curves of its irons")
    names = dict.fromkeys((magnet.iron.core, magnet.iron.armature))
    plot = figure(x="field strength in A/m", y="flux density in the sheets in T")
    numbers: list[tuple[str, str]] = []
    shown = []
    for name, colour in zip(names, SERIES, strict=False):
        iron = load_iron(name, folder=actuator.folder)
        end = iron.tail_from if isinstance(iron, Iron) else 2.0
        b = np.linspace(0.002, end * 1.05, 400)
        h, slope = iron.magnetise(b)
        plot.add_trace(line(h, b, name=name, colour=colour))
        shown.append(h)
        if isinstance(iron, Iron):
            points = {"mode": "markers", "marker": {"size": 5}, "showlegend": False}
            plot.add_trace(line(iron.field_strength[1:], iron.flux_density[1:], name=name, colour=colour, **points))
        steepest = 1 / (MU_0 * slope.min())
        numbers.append((f"{name}: largest differential permeability, relative", f"{steepest:.0f}"))
        numbers += [
            (f"{name}: field strength at {level:g} T", f"{float(iron.magnetise(np.array([level]))[0][0]):.3g} A/m")
            for level in (1.0, 1.5)
            if level < end
        ]
        numbers.append((f"{name}, from", getattr(iron, "source", "") or "a formula"))
    logarithmic(plot, shown, along="x")
    spec = magnet.iron
    numbers.append(("stacking factor, core and armature", f"{spec.core_stacking:g}, {spec.armature_stacking:g}"))
    many = "irons saturate" if len(names) > 1 else "iron saturates"
    sentence = (
        f"How the {many}: {' and '.join(names)}, dots where the curve was given, lines as the field solution takes "
        "them, without hysteresis."
    )
    return Stage("The iron", sentence, tuple(numbers), plot=plot)


def heat_stage(actuator: Actuator, *, limit: ThermalLimit | None = None) -> Stage:
    """Temperature rise of the winding over a current without pause, and the current that it bears."""
    allowed = limit or ThermalLimit()
    bearable = continuous_current(actuator, allowed)
    top = 1.25 * bearable.continuous
    current = np.linspace(0.0, min(top, 0.98 * bearable.runaway), 80)
    heating = Heating(actuator.coil_resistance(), allowed.ambient)
    rise = np.array([steady_rise(bearable.network, heating, float(i))[0] for i in current])
    plot = figure(x="coil current without pause in A (RMS)", y="rise of the winding in K")
    plot.add_trace(line(current, rise, name="winding over ambient", colour=ORANGE))
    edge = {"dash": "dash"}
    ends = np.array([0.0, current[-1]])
    plot.add_trace(line(ends, np.full(2, allowed.temperature_rise), name="allowed", colour=GREY, line=edge))
    hot = copper_loss(actuator, bearable.continuous, temperature=allowed.hottest)
    numbers = (
        ("continuous current of a coil", f"{bearable.continuous:.3g} A"),
        ("copper loss there, hot", f"{hot.loss:.3g} W a magnet"),
        ("resistance of the hot coil", format_quantity(bearable.resistance, "ohm", digits=3)),
        ("allowed rise", f"{allowed.temperature_rise:g} K over {allowed.ambient - 273.15:.3g} °C"),
        *((f"note {n}", note) for n, note in enumerate(bearable.notes, start=1)),
    )
    sentence = (
        f"A coil may carry {bearable.continuous:.3g} A without pause before its winding is "
        f"{allowed.temperature_rise:g} K above ambient, by its copper loss alone and an estimated way of the heat; "
        "'msl-fem losses' takes iron loss, duty cycles and a measured thermal resistance."
    )
    return Stage("Heat and continuous current", sentence, numbers, plot=plot)


def inductance_stage(actuator: Actuator, table: MagneticTable) -> Stage:
    """Incremental inductance and negative stiffness of one magnet over the gap: what drive and controller meet."""
    gap = np.linspace(float(table.gap[0]), float(table.gap[-1]), 240)
    top = float(table.current[-1])
    currents = [share * top for share in (0.1, 0.25, 0.5)]
    plot = two_rows("inductance in mH", "dF/dg in N/mm", x="air gap in mm")
    for i, colour in zip(currents, (BLUE, ORANGE, GREEN), strict=True):
        values = table.evaluate(np.full_like(gap, i), gap)
        henry, slope = values["incremental_inductance"], values["force_gap_slope"]
        name = f"{i:.3g} A"
        plot.add_trace(line(gap * 1e3, henry * 1e3, name=name, colour=colour), row=1, col=1)
        plot.add_trace(line(gap * 1e3, slope * 1e-3, name=name, colour=colour, showlegend=False), row=2, col=1)
    nominal = actuator.motion.nominal_gap if actuator.motion is not None else None
    at = nominal if nominal is not None else float(np.median(table.gap))
    numbers: list[tuple[str, str]] = []
    for i in currents:
        here = table.evaluate(i, at)
        numbers.append((f"inductance at {i:.3g} A", f"{float(here['incremental_inductance']) * 1e3:.3g} mH"))
        numbers.append((f"dF/dg at {i:.3g} A", f"{float(here['force_gap_slope']) * 1e-3:.4g} N/mm"))
    sentence = (
        f"A magnet pulls harder the nearer its armature is: a spring of negative stiffness, here of one magnet at "
        f"constant current. Its inductance sets how fast a voltage changes the current. Numbers are at "
        f"{millimetres(at)}."
    )
    return Stage("Inductance and negative stiffness", sentence, tuple(numbers), plot=plot)
