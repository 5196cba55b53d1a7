"""Writes bearing_pole_pair.msh: two poles of a radial magnetic bearing and the part of its rotor before them, in mm.

Poles stand at +-22.5 degrees about the y axis, as in an eight-pole bearing; the rotor's centre is at x = y = 0.
"""

import sys
from pathlib import Path

import meshio
import numpy as np
from make_u_core import named

from msl_fem.magnetics.section import Region, Section
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate

ROTOR, BORE, GAP = 24e-3, 12e-3, 0.5e-3  # radii of the rotor's laminations, and the air gap
POLE, LENGTH, BACK, TILT = 10e-3, 18e-3, 10e-3, np.deg2rad(22.5)
COIL, CLEARANCE, COIL_LENGTH, AIR = 4e-3, 0.5e-3, 13e-3, 40e-3
SECTOR, STEPS = np.deg2rad(55.0), 44


def arc(radius: float, start: float, end: float, steps: int = STEPS) -> list[tuple[float, float]]:
    """Points on a circle, angles from the y axis towards x."""
    angles = np.linspace(start, end, steps + 1)
    return [(float(radius * np.sin(t)), float(radius * np.cos(t))) for t in angles]


def turned(points: list[tuple[float, float]], angle: float) -> tuple[tuple[float, float], ...]:
    """Points turned from the y axis towards x."""
    c, s = np.cos(angle), np.sin(angle)
    return tuple((float(c * x + s * y), float(c * y - s * x)) for x, y in points)


def bearing_section() -> Section:
    """Rotor sector, two poles with their back, a coil on each pole; the flux goes down one pole and up the other."""
    face, back = ROTOR + GAP, ROTOR + GAP + LENGTH
    half = np.arcsin(POLE / 2 / face)
    box = AIR + back + BACK
    rotor = Region("armature", tuple(arc(ROTOR, -SECTOR, SECTOR) + arc(BORE, SECTOR, -SECTOR)))
    regions = [Region("air", ((-box, -AIR), (box, -AIR), (box, box), (-box, box))), rotor]
    inside: list[tuple[float, float]] = []
    begin = -SECTOR
    corners: list[tuple[float, float, float]] = []
    low = face + 2e-3
    for side in (-1, 1):
        root = float(np.arcsin(POLE / 2 / back))
        pole = turned(arc(face, -half, half, 8), side * TILT)
        inside += [*arc(back, begin, side * TILT - root, 12), *pole]
        begin = side * TILT + root
        corners += [(*pole[k], 1.0) for k in (0, 8)]
        for edge in (-1, 1):
            near, far = edge * (POLE / 2 + CLEARANCE), edge * (POLE / 2 + CLEARANCE + COIL)
            outline = [(near, low), (far, low), (far, low + COIL_LENGTH), (near, low + COIL_LENGTH)]
            name = "coil+" if side * edge > 0 else "coil-"
            regions.append(Region(name, turned(outline, side * TILT)))
    inside += arc(back, begin, SECTOR, 12)
    regions.append(Region("core", (*inside, *arc(back + BACK, SECTOR, -SECTOR))))
    iron = {"core": ("m19", 1.0), "armature": ("m19", 1.0)}
    return Section(tuple(regions), tuple(corners), (), iron, {}, 40e-3, GAP)


def write(path: Path) -> None:
    """The file of the example."""
    mesh = triangulate(bearing_section(), MeshSize(corner=0.15, gap=1.0, iron=0.4, growth=0.5))
    meshio.write(path, named(mesh), file_format="gmsh22", binary=False, float_fmt=".9g")


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("bearing_pole_pair.msh"))
