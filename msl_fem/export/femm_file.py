"""The text of FEMM's magnetics problems (.fem, and the head of .ans): materials, circuits, boundaries, geometry."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.export.plane_graph import Indices
from msl_fem.files.schema import LARGEST_OF_UNIT, reason, small_text

LENGTHS = {
    "inches": 0.0254, "millimeters": 1e-3, "centimeters": 1e-2, "meters": 1.0, "mils": 2.54e-5, "microns": 1e-6,
}  # fmt: skip
"""m of [LengthUnits] of the format."""
FULL_TURN = 360.0  # degrees
MOST_CHORDS = 10_000  # of an arc
PRESCRIBED, MIXED, PERIODIC = 0, 2, (4, 5, 6, 7)
"""<BdryType>: A as stated; an asymptotic condition; halves that repeat each other."""


@dataclass(frozen=True, eq=False)
class FemmMaterial:
    """A block property.

    Attributes
    ----------
    bh : (n, 2) points B in T and H in A/m; none for a constant permeability
    numbers : the other keys of the format, as <Mu_x>, <H_c>, <LamType>, <LamFill>, <J_re>
    """

    name: str
    bh: Array
    numbers: dict[str, float]

    def number(self, key: str, default: float = 0.0) -> float:
        """The value of a key, that of the format where it is not stated."""
        return self.numbers.get(key, default)

    @property
    def magnetic(self) -> bool:
        """Whether it is iron."""
        return bool(self.bh.size) or max(self.number("Mu_x", 1.0), self.number("Mu_y", 1.0)) > 1.0


@dataclass(frozen=True)
class FemmCircuit:
    """A circuit: its current in A, and whether its blocks are in series."""

    name: str
    current: float
    series: bool


@dataclass(frozen=True)
class FemmLabel:
    """A block label: where it stands in m, indices of material and circuit (None: none), group, signed turns."""

    point: tuple[float, float]
    material: int | None
    circuit: int | None
    group: int
    turns: float


@dataclass(frozen=True, eq=False)
class FemmProblem:
    """A problem as it is drawn, in SI units.

    Attributes
    ----------
    head : values of [Frequency], [ProblemType] and their like, as written
    depth : m
    boundaries : the keys of each boundary property
    points : (n, 2) m
    edges : (n_edge, 2) indices of points; arcs are chords of at most the angle that they state, as FEMM meshes them
    edge_boundary : (n_edge,) index of the boundary property, -1 for none
    """

    head: dict[str, str]
    depth: float
    materials: tuple[FemmMaterial, ...]
    circuits: tuple[FemmCircuit, ...]
    boundaries: tuple[dict[str, float], ...]
    points: Array
    edges: Indices
    edge_boundary: Indices
    labels: tuple[FemmLabel, ...]


def read_femm(path: str | Path) -> FemmProblem:
    """The problem of a .fem file, or of a .ans file without its solution.

    Source of the format: D. Meeker, FEMM 4.2 User's Manual, and files written by that program.

    Raises
    ------
    InputError : the file cannot be read, or is not of that format
    """
    try:
        text = small_text(Path(path), encoding="latin-1")
    except (OSError, ValueError) as err:
        raise InputError(f"{path}: cannot be read ({reason(err)}); give a .fem file of FEMM") from err
    try:
        return _checked(_problem(text.splitlines()))
    except (KeyError, ValueError, IndexError, OverflowError, StopIteration) as err:
        why = reason(err) or "it ends early"
        raise InputError(f"{path}: is no magnetics problem of FEMM 4 ({why}); save it in FEMM as .fem") from err


def _problem(lines: list[str]) -> FemmProblem:
    head: dict[str, str] = {}
    blocks: dict[str, list[FemmMaterial]] = {}
    rows: dict[str, Array] = {}
    left = iter(lines)
    for line in left:
        key, _, value = (part.strip() for part in line.partition("="))
        key = key.strip("[]").lower()
        if not line.strip().startswith("["):
            continue
        if key == "solution":
            break
        if key in ("bdryprops", "blockprops", "circuitprops"):
            blocks[key] = [_block(left) for _ in range(int(value))]
        elif key in ("numpoints", "numsegments", "numarcsegments", "numholes", "numblocklabels"):
            rows[key] = np.array([_numbers(next(left)) for _ in range(int(value))], dtype=float)
        else:
            head[key] = value.strip('"')
    unit = LENGTHS[head["lengthunits"].lower()]
    points, edges, boundary = _geometry(rows, unit)
    circuits = tuple(
        FemmCircuit(b.name, b.number("TotalAmps_re"), b.number("CircuitType") == 1) for b in blocks["circuitprops"]
    )
    return FemmProblem(
        head, float(head["depth"]) * unit, tuple(blocks["blockprops"]), circuits,
        tuple(b.numbers for b in blocks["bdryprops"]), points, edges, boundary,
        tuple(_label(row, unit) for row in rows["numblocklabels"]),
    )  # fmt: skip


def _checked(problem: FemmProblem) -> FemmProblem:
    """The problem; ValueError where it names what it has not, or numbers no section has."""
    sizes = [problem.points.ravel(), [problem.depth], *(label.point for label in problem.labels)]
    stated = [*problem.boundaries, *(one.numbers for one in problem.materials)]
    if not all(np.isfinite(np.asarray(one)).all() for one in (*sizes, *(list(known.values()) for known in stated))):
        raise ValueError("a number is not finite")
    if not 0 < problem.depth <= LARGEST_OF_UNIT["m"]:
        raise ValueError(f"the depth {problem.depth:g} m is not above 0, or beyond any machine")
    if problem.points.size and np.abs(problem.points).max() > LARGEST_OF_UNIT["m"]:
        raise ValueError(f"a point lies {np.abs(problem.points).max():g} m away, beyond any machine")
    float(problem.head.get("frequency", "0"))
    if any("BdryType" not in one for one in problem.boundaries):
        raise ValueError("a boundary has no <BdryType>")
    named = [
        ("point", problem.edges.ravel().tolist(), len(problem.points)),
        ("boundary", problem.edge_boundary.tolist(), len(problem.boundaries)),
        ("material", [label.material for label in problem.labels], len(problem.materials)),
        ("circuit", [label.circuit for label in problem.labels], len(problem.circuits)),
    ]
    for what, places, count in named:
        least = -1 if what == "boundary" else 0
        beyond = [place for place in places if place is not None and not least <= place < count]
        if beyond:
            raise ValueError(f"there is no {what} {beyond[0] + 1}, but {count}")
    ends = problem.points[problem.edges]
    if not (ends[:, 0] != ends[:, 1]).any(axis=1).all():
        raise ValueError("a segment has no length")
    return problem


def _numbers(line: str) -> list[float]:
    return [float(word) for word in line.split()[:9]]


def _block(left: Iterator[str]) -> FemmMaterial:
    """The next property of any list: its name, its numbers, its points."""
    name, bh = "", np.empty((0, 2))
    numbers: dict[str, float] = {}
    for line in left:
        key, _, value = (part.strip() for part in line.partition("="))
        key = key.strip("<>")
        if key.startswith("End"):
            return FemmMaterial(name, bh, numbers)
        if key.endswith("Name"):
            name = value.strip('"')
        elif key == "BHPoints":
            bh = np.array([_numbers(next(left))[:2] for _ in range(int(value))], dtype=float).reshape(-1, 2)
        elif value:
            numbers[key] = float(value)
    raise ValueError("a property does not end")


def _geometry(rows: dict[str, Array], unit: float) -> tuple[Array, Indices, Indices]:
    """Points in m, edges, and the boundary property of each."""
    points = [tuple(row[:2] * unit) for row in rows["numpoints"]]
    edges, boundary = [], []
    for row in rows["numsegments"]:
        edges.append((int(row[0]), int(row[1])))
        boundary.append(int(row[3]) - 1)
    for row in rows["numarcsegments"]:
        start, end, angle, largest = int(row[0]), int(row[1]), row[2], row[3]
        if not (0 < angle < FULL_TURN and angle / MOST_CHORDS < largest < FULL_TURN):
            raise ValueError(f"an arc of {angle:g} degrees has chords of {largest:g} degrees")
        n = max(1, math.ceil(angle / largest - 1e-9))
        chain = [start, *range(len(points), len(points) + n - 1), end]
        points += _arc(np.array(points[start]), np.array(points[end]), math.radians(angle), n)
        edges += list(zip(chain[:-1], chain[1:], strict=True))
        boundary += n * [int(row[4]) - 1]
    shape = np.array(edges, dtype=np.int64).reshape(-1, 2)
    return np.array(points), shape, np.array(boundary, dtype=np.int64)


def _arc(start: Array, end: Array, angle: float, n: int) -> list[tuple[float, float]]:
    """The n - 1 points inside an arc that turns left from start to end, at equal angles."""
    chord = complex(*(end - start))
    centre = complex(*start) + chord / 2 + 1j * chord / (2 * math.tan(angle / 2))
    turned = (complex(*start) - centre) * np.exp(1j * angle * np.arange(1, n) / n) + centre
    return [(float(p.real), float(p.imag)) for p in turned]


def _label(row: Array, unit: float) -> FemmLabel:
    material, circuit = int(row[2]) - 1, int(row[4]) - 1
    return FemmLabel(
        (row[0] * unit, row[1] * unit), material if material >= 0 else None, circuit if circuit >= 0 else None,
        int(row[6]), float(row[7]) if len(row) > 7 else 1.0,
    )  # fmt: skip
