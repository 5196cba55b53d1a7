"""The section of a magnet as a DXF drawing for CAD programs: closed outlines in mm, a layer for each region."""

from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.whole_file import whole_file
from msl_fem.magnetics.section import Section, both_halves, is_taken_off

COIL_LAYERS = ("coil_plus", "coil_minus")
"""Of conductors whose current comes out of the plane, and goes into it."""
COLOURS = {"iron": 8, "coil": 30, "other": 7}
"""AutoCAD's colour numbers: grey, orange, the paper's opposite."""
MM = 4
"""$INSUNITS of the format for millimetres."""


def dxf_text(actuator: Actuator, gap: float | None = None) -> str:
    """The drawing at a gap in m, by default the nominal one: R12 (AC1009), which every reader knows, x and y in mm.

    Polylines are drawn in the order in which they cover one another, a window thus cuts the core; the layer is the
    region's name, of a coil coil_plus (current out of the plane) or coil_minus. A body of
    revolution has its axis at x = 0. The surrounding air, which is no part, is left out.

    Source of the group codes: Autodesk, DXF Reference (AC1009: POLYLINE, VERTEX, SEQEND).

    Raises
    ------
    ActuatorError : the magnet is not known by its dimensions
    InputError : no gap is given and the actuator states none, or the magnet is a mesh
    """
    nominal = drawn_gap(actuator, gap)
    magnet = actuator.magnet_kind("a drawing of the section")
    section = magnet.section(nominal)
    solid = dict.fromkeys(section.iron, COLOURS["iron"]) | dict.fromkeys(section.turns_density, COLOURS["coil"])
    drawn = [r for r in section.regions if r.name in solid or is_taken_off(r)]
    colour = {layer: solid.get(r.name, COLOURS["other"]) for r in drawn for layer in _layers(r.name, section)}
    outlines = [
        (layer, ring)
        for r in drawn
        for layer, ring in zip(_layers(r.name, section), both_halves(np.array(r.vertices)), strict=False)
    ]
    lines = _pairs((0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009"), (9, "$INSUNITS"), (70, MM))
    lines += _pairs((0, "ENDSEC"), (0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LAYER"), (70, len(colour)))
    for name, number in colour.items():
        lines += _pairs((0, "LAYER"), (2, name), (70, 0), (62, number), (6, "CONTINUOUS"))
    lines += _pairs((0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES"))
    for name, ring in outlines:
        lines += _outline(name, ring)
    return "\n".join([*lines, *_pairs((0, "ENDSEC"), (0, "EOF"))]) + "\n"


def drawn_gap(actuator: Actuator, gap: float | None) -> float:
    """The gap in m at which a section is drawn: the one given, else the nominal one. Raises as `dxf_text`."""
    if actuator.magnet_kind("a drawing of the section").own_mesh() is not None:
        raise InputError(f"{actuator.name}: a drawing needs [magnet] of a kind with dimensions; this one is a mesh")
    nominal = gap if gap is not None else actuator.motion.nominal_gap if actuator.motion is not None else None
    if nominal is None or not nominal > 0:
        raise InputError(f'{actuator.name} states no motion.nominal_gap; give a gap above 0, like --gap "0.5 mm"')
    return nominal


def _layers(region: str, section: Section) -> tuple[str, str]:
    """The layers of a region's right half and of its image: those of a coil say which way its current goes."""
    turns = section.turns_density.get(region)
    if turns is None:
        return region, region
    way = COIL_LAYERS if turns > 0 else COIL_LAYERS[::-1]
    return way if section.symmetry in ("flux line", "axis") else (way[0], way[0])


def _outline(layer: str, ring: Array) -> list[str]:
    """A closed polyline through the points (n, 2) in m."""
    lines = _pairs((0, "POLYLINE"), (8, layer), (66, 1), (70, 1), (10, 0.0), (20, 0.0), (30, 0.0))
    for x, y in 1e3 * ring:
        lines += _pairs((0, "VERTEX"), (8, layer), (10, float(x)), (20, float(y)), (30, 0.0))
    return [*lines, *_pairs((0, "SEQEND"), (8, layer))]


def _pairs(*pairs: tuple[int, str | int | float]) -> list[str]:
    """Group code and value, a line each."""
    return [text for code, value in pairs for text in (str(code), str(value))]


def write(actuator: Actuator, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The file written at the nominal gap. Raises as `dxf_text`, and InputError where it cannot be written."""
    return write_dxf(dxf_text(actuator), target)


def write_dxf(text: str, target: Path) -> tuple[Path, ...]:
    """The file of a drawing's text, whole or not at all; InputError where it cannot be written."""
    with whole_file(target) as partial:
        partial.write_text(text, encoding="ascii", newline="\n")
    return (target,)
