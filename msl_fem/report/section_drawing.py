"""The dimensioned section of a magnet, from its dimensions alone: iron, winding, gap, and every length by its name."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.path import Path as Outline

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.whole_file import whole_file
from msl_fem.magnetics.kinds.kind import DrawnLength
from msl_fem.magnetics.section import Section, both_halves, is_taken_off
from msl_fem.report.paper_figure import PaperFigure

IRON, COPPER, LINE, INK = "#c9d1da", "#e0a070", "#334155", "#1f2937"
FORMATS = ("svg", "png", "pdf")
OFFSET = 0.07  # of the drawing's larger side: from the body to a line of dimensions
SMALLEST_SHOWN = 0.012  # of the larger side: a smaller gap is drawn this large, and says so
TEXT = 8.0  # points
LETTER = 0.55  # width of a letter, in its height
NEAR = 1e-9  # m


def draw_section(actuator: Actuator, gap: float | None = None) -> PaperFigure:
    """The figure of the whole section at a gap (m), by default the nominal one.

    Raises
    ------
    ActuatorError : the magnet is not known by its dimensions
    InputError : no gap is given and the actuator states none
    """
    magnet = actuator.magnet_kind("a drawing of the section")
    if magnet.own_mesh() is not None:
        raise InputError(f"{actuator.name}: a drawing needs [magnet] of a kind with dimensions; this one is a mesh")
    nominal = gap if gap is not None else actuator.motion.nominal_gap if actuator.motion is not None else None
    if nominal is None or not nominal > 0:
        raise InputError(f'{actuator.name} states no motion.nominal_gap; give a gap above 0, like --gap "0.5 mm"')
    body = magnet.section(nominal).body
    larger = max(2 * body[1], body[3] - body[2])
    shown = max(nominal, SMALLEST_SHOWN * larger)
    section = magnet.section(shown)
    figure = PaperFigure(figsize=(8.4, 6.6))
    axes = figure.add_axes((0.01, 0.03, 0.98, 0.92))
    _paint(axes, section)
    right, low, high = section.body[1], section.body[2], section.body[3]
    wide, tall = 1e3 * (2 * right + 0.5 * larger), 1e3 * (high - low + 0.48 * larger)
    beside = _name_parts(axes, section, magnet, scale=72 * min(8.23 / wide, 6.07 / tall))
    for measure in magnet.measures(shown):
        _dimension(axes, measure, section, larger)
    _gap_note(axes, section, nominal, shown=shown, larger=larger, edge=magnet.half_width)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_xlim(-1e3 * (right + 0.1 * larger), 1e3 * (right + 0.4 * larger))
    axes.set_ylim(1e3 * (low - 0.12 * larger), 1e3 * (high + 0.36 * larger))
    axes.set_title(_title(actuator, magnet), loc="left", fontsize=11, color=INK)
    figure.text(0.01, 0.005, "\n".join(["; ".join(beside), _summary(magnet)]).strip(), fontsize=TEXT, color=INK)
    return figure


def save_drawing(figure: PaperFigure, path: Path) -> None:
    """The figure as svg, png or pdf by the path's end; InputError for another one or where it cannot be written."""
    form = path.suffix.removeprefix(".").lower()
    if form not in FORMATS:
        raise InputError(f"{path}: a drawing is written as {', '.join(FORMATS)} or dxf; end the name with one of these")
    with whole_file(path) as partial:
        figure.savefig(partial, format=form, dpi=160)


def _paint(axes: Axes, section: Section) -> None:
    """Iron and coils of both halves with their outlines, painted in order; air and windows show the paper."""
    shown = [r for r in section.regions if r.name in section.iron or r.name in section.turns_density or is_taken_off(r)]
    for order, region in enumerate(shown, start=1):
        iron, coil = region.name in section.iron, region.name in section.turns_density
        colour = IRON if iron else COPPER if coil else "white"
        for ring in both_halves(np.array(region.vertices)):
            axes.add_patch(
                Polygon(ring * 1e3, closed=True, facecolor=colour, edgecolor=LINE, linewidth=0.9, zorder=order / 10)
            )
            if not (iron or coil):  # it is open towards the gap
                x = ring[np.abs(ring[:, 1] - section.gap) < NEAR][:, 0] * 1e3
                axes.plot([x.min(), x.max()], [section.gap * 1e3] * 2, color="white", linewidth=1.6, zorder=order / 10)
    low, high = section.body[2] * 1e3, section.body[3] * 1e3
    beyond = 0.03 * (high - low)
    axes.plot([0, 0], [low - beyond, high + beyond], color=LINE, linewidth=0.6, linestyle=(0, (12, 3, 2, 3)), zorder=3)


def _name_parts(axes: Axes, section: Section, magnet: MagnetKind, *, scale: float) -> list[str]:
    """Core and armature by their irons, the coil by its turns; names that do not fit into their part come back.

    `scale` is in points a millimetre.
    """
    beside = []
    for part in section.parts:
        if part.region == "armature" or part is section.parts[0]:
            x, y = np.array(part.vertices).T * 1e3
            iron = section.iron[part.region][0]
            words = f"{'armature' if part.region == 'armature' else 'core'}: {iron}"
            place = (0.0 if x.min() <= 0 else (x.min() + x.max()) / 2, (y.min() + y.max()) / 2)
            upright = part.region != "armature" and np.ptp(y) > 2 * np.ptp(x)
            room = np.ptp(y) if upright else np.ptp(x) * (2 if x.min() <= 0 else 1)
            inside = x.min() <= 0 or Outline(np.column_stack([x, y])).contains_point(place)
            if not inside or len(words) * LETTER * TEXT > scale * room:
                beside.append(words)
                continue
            paper = {"facecolor": IRON, "edgecolor": "none", "pad": 0.5}
            axes.text(*place, words, ha="center", va="center", fontsize=TEXT, color=INK, zorder=4, bbox=paper,
                      rotation=90 if upright else 0)  # fmt: skip
    coils = [region for region in section.regions if region.name in section.turns_density]
    each = magnet.turns // magnet.winding_space.coils
    for region in coils[:1]:
        x, y = np.array(region.vertices).T * 1e3
        axes.text(-x.mean(), y.mean(), f"{each} turns", ha="center", va="center", fontsize=TEXT, color=INK, zorder=4,
                  rotation=90)  # fmt: skip
    return beside


def _dimension(axes: Axes, measure: DrawnLength, section: Section, larger: float) -> None:
    """A line of dimension with its name and length, away from the body; of the coil inside the window."""
    (x0, y0), (x1, y1) = measure.start, measure.end
    level = abs(y1 - y0) <= 1e-12
    own = measure.name.startswith("coil.")
    shift = 0.0 if own else OFFSET * larger
    far = (section.body[3] if level else section.body[1]) + shift
    start, end = ((x0, y0), (x1, y1)) if own else ((x0, far), (x1, far)) if level else ((far, y0), (far, y1))
    words = f"{measure.name.removeprefix('coil.').replace('_', ' ')} {format_quantity(measure.length, 'm')}"
    words = f"coil {words}" if own else words
    for here, there in ((measure.start, start), (measure.end, end)):
        if not own:
            axes.plot([here[0] * 1e3, there[0] * 1e3], [here[1] * 1e3, there[1] * 1e3], color=LINE, linewidth=0.4)
    arrow = {"arrowstyle": "<->", "color": LINE, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7}
    tail, head = (start[0] * 1e3, start[1] * 1e3), (end[0] * 1e3, end[1] * 1e3)
    axes.annotate("", xy=head, xytext=tail, arrowprops=arrow, zorder=5)
    middle = (np.array(start) + np.array(end)) / 2 * 1e3
    apart = 0.012 * larger * 1e3
    if level and own:  # inside the coil, or below one that is too narrow for words
        narrow = measure.length < 0.12 * larger
        x, y = (start[0] * 1e3, middle[1] - apart) if narrow else (middle[0], middle[1] + apart)
        alignment = ("left", "top") if narrow else ("center", "bottom")
        axes.text(x, y, words, fontsize=TEXT, color=INK, zorder=5, ha=alignment[0], va=alignment[1])
        return
    if level:
        wide = measure.length > 0.3 * larger
        axes.text(middle[0], middle[1] + apart, words, fontsize=TEXT, color=INK, zorder=5, va="bottom",
                  ha="center" if wide else "left", rotation=0 if wide else 55)  # fmt: skip
        return
    side = -1 if own else 1
    axes.text(middle[0] + side * apart, middle[1], words, fontsize=TEXT, color=INK, zorder=5, va="center",
              ha="right" if own else "left", rotation=90 if own else 0)  # fmt: skip


def _gap_note(axes: Axes, section: Section, gap: float, *, shown: float, larger: float, edge: float) -> None:
    """Points at the gap beside the core's edge."""
    words = f"gap {format_quantity(gap, 'm')}" + (" (drawn larger)" if shown > gap else "")
    right = edge * 1e3
    axes.annotate(words, xy=(-0.97 * right, shown / 2 * 1e3), xytext=(-right, (section.body[2] - 0.04 * larger) * 1e3),
                  fontsize=TEXT, color=INK, ha="left", va="top",
                  arrowprops={"arrowstyle": "-", "color": LINE, "linewidth": 0.6})  # fmt: skip


def _title(actuator: Actuator, magnet: MagnetKind) -> str:
    kind = getattr(magnet, "kind", type(magnet).__name__)
    return f"{actuator.name}: {kind}, dimensions as in the file"


def _summary(magnet: MagnetKind) -> str:
    """Turns, resistance and copper, and how deep a stack is."""
    parts = [
        f"{magnet.turns} turns, fill factor {magnet.coil.fill_factor:g}, "
        f"{format_quantity(magnet.winding_resistance, 'ohm')} at 20 °C by its copper"
    ]
    depth = getattr(magnet, "stack_depth", None)
    parts.append("body of revolution" if depth is None else f"stack depth {format_quantity(depth, 'm')}")
    return "; ".join(parts)
