"""The products of which a formula for an unknown law is made: their texts, units, and sizes on a record.

A term is a product of one factor of the position, one of the velocity and, where there are magnets, one of the
currents, or a function with a shape (a knee, a bump, a period). Every term is a law as users state them
(`computing.laws`), with the amount `a` in front, whose range is `LARGEST` times what makes it as large as the usual
terms of its equation on the record.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.laws import UNIT_OF, LawExpression, expression
from msl_fem.computing.laws.calculus import value_of
from msl_fem.computing.laws.grammar import parse_law
from msl_fem.diagnosis.variants import variables_of
from msl_fem.plant import PlantParameters
from msl_fem.plant.plant import FORCE_DRIVE, VOLTAGE_DRIVE
from msl_fem.prediction import RunData

LARGEST = 3.0
MOST_FACTORS = 4  # powers of position and velocity in a product, together
SPAN = (0.05, 2.0)
"""Range of a shape, over the RMS of what it is about."""

Powers = tuple[int, int, int]
"""Of position, velocity and current in a product."""
_POSITION = {"": 0, "x": 1, "x**2": 2, "abs(x)": 1, "x**3": 3}
_VELOCITY = {"": 0, "v": 1, "abs(v)": 1, "v*abs(v)": 2, "v**2": 2, "v**3": 3}
_OF_TWO_SIDES = {
    "i1*i2": (0, 0, 2),
    "(i1 - i2)": (0, 0, 1),
    "(i1*abs(i1) - i2*abs(i2))": (0, 0, 2),
    "(i1**2/g1 - i2**2/g2)": (-1, 0, 2),
    "i1*i2*x": (1, 0, 2),
    "(i1 + i2)*x": (1, 0, 1),
    "(i1**2 + i2**2)*x": (1, 0, 2),
    "(i1**2 + i2**2)*v": (0, 1, 2),
}
_OF_ONE_SIDE = {
    "i1": (0, 0, 1),
    "i1*abs(i1)": (0, 0, 2),
    "i1**2/g1": (-1, 0, 2),
    "i1**2*x": (1, 0, 2),
    "i1**2*v": (0, 1, 2),
}
_OF_VOLTAGE = {
    "i*abs(i)": (0, 0, 2),
    "i**3": (0, 0, 3),
    "i*x": (1, 0, 1),
    "v": (0, 1, 0),
    "i*v": (0, 1, 1),
    "i**2*v": (0, 1, 2),
    "abs(i)*v": (0, 1, 1),
    "i*abs(v)": (0, 1, 1),
    "i/g": (-1, 0, 1),
    "i**2/g": (-1, 0, 2),
    "x": (1, 0, 0),
}
_OF_READING = {"x*abs(x)": (2, 0, 0), "abs(x)": (1, 0, 0), "v": (0, 1, 0), "v*abs(v)": (0, 2, 0), "x*v": (1, 1, 0)}
_SHAPED_FORCE = {
    "tanh(v/w)": "v",
    "v/w*exp(-(v/w)**2)": "v",
    "exp(-abs(v)/w)*sign(v)": "v",
    "tanh(x/w)": "x",
    "x/w*exp(-(x/w)**2)": "x",
    "sin(x/w)": "x",
    "cos(x/w)": "x",
    "max(x - w, 0)/w": "x",
    "max(-x - w, 0)/w": "x",
}
_SHAPED_VOLTAGE = {"tanh(i/w)": "i", "i/w*exp(-(i/w)**2)": "i"}
_SHAPED_READING = {"tanh(x/w)": "x", "sin(x/w)": "x", "cos(x/w)": "x"}
_UNIT = {"x": "m", "v": "m/s", "i": "A"}


@dataclass(frozen=True)
class Term:
    """A term without its amount: text, unit of the amount, and of its shapes the texts of their ranges."""

    equation: str
    product: str
    unit: str
    shapes: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class LawSizes:
    """Of a record what laws look at, values by name (n,), and of each equation the usual size of its terms, SI."""

    variables: Mapping[str, Array]
    equations: Mapping[str, float]


def law_sizes(plant: PlantParameters, runs: Sequence[RunData]) -> LawSizes:
    """What laws look at on runs, by their readings, and how large the equations' terms are there."""
    found = {name: np.concatenate(parts) for name, parts in _readings(plant, runs).items()}
    x, v = float(np.std(found["x"])), float(np.std(found["v"]))
    inertia = plant.mass * v**2 / max(x, 1e-12)
    command = float(np.std(np.concatenate([run.commands[:, 0] for run in runs])))
    force = max(inertia, plant.damping * v, plant.stiffness * x, command if plant.drive == FORCE_DRIVE else 0.0)
    current = float(np.std(found["i"])) if "i" in found else 0.0
    voltage = max(plant.resistance * current, command if plant.drive == VOLTAGE_DRIVE else 0.0)
    return LawSizes(found, {"force": force, "voltage": voltage, "position_reading": x})


def _readings(plant: PlantParameters, runs: Sequence[RunData]) -> dict[str, list[Array]]:
    parts: dict[str, list[Array]] = {}
    for run in runs:
        read = variables_of(run)
        x = read["position_m"]
        values = {"x": x, "v": read["velocity_m_per_s"]}
        for j in range(plant.sides):
            current = read.get(f"current_{j + 1}_A", run.commands[:, j])
            gap = np.maximum(plant.nominal_gap + (x if j else -x), 0.05 * plant.nominal_gap)
            values |= {f"i{j + 1}": current, f"g{j + 1}": gap}
        if plant.sides:
            values |= {"i": values["i1"], "g": values["g1"]}
        for name, value in values.items():
            parts.setdefault(name, []).append(value)
    return parts


def library(plant: PlantParameters, sizes: LawSizes) -> list[LawExpression]:
    """All terms that a plant can have and a record can show, as laws with ranges."""
    laws: list[LawExpression] = []
    for term in _terms(plant, sizes):
        law = _law(term, f"term_{len(laws)}", sizes)
        if law is not None:
            laws.append(law)
    return laws


def _terms(plant: PlantParameters, sizes: LawSizes) -> Iterator[Term]:
    yield from _products(plant)
    yield Term("force", "sign(v)*sqrt(abs(v)/w)", "N", {"w": "1 m/s"})
    yield Term("force", "max(v, 0)", "N s/m")
    yield from _shaped("force", _SHAPED_FORCE, sizes)
    if plant.drive == FORCE_DRIVE and not plant.sides:
        return
    yield from _powers("force", _OF_TWO_SIDES if plant.sides == 2 else _OF_ONE_SIDE)
    yield from _powers("voltage", _OF_VOLTAGE)
    yield from _shaped("voltage", _SHAPED_VOLTAGE, sizes)
    yield from _powers("position_reading", _OF_READING)
    yield from _shaped("position_reading", _SHAPED_READING, sizes)


def _products(plant: PlantParameters) -> Iterator[Term]:
    """Products of position and velocity; what stiffness and damping are already is left out."""
    known = {"x", "v"} if plant.stiffness else {"v"}
    for (of_x, m), (of_v, n) in product(_POSITION.items(), _VELOCITY.items()):
        text = "*".join(part for part in (of_x, of_v) if part)
        if text and text not in known and m + n <= MOST_FACTORS:
            yield Term("force", text, amount_unit("force", (m, n, 0)))


def _powers(equation: str, products: Mapping[str, Powers]) -> Iterator[Term]:
    for text, powers in products.items():
        yield Term(equation, text, amount_unit(equation, powers))


def _shaped(equation: str, products: Mapping[str, str], sizes: LawSizes) -> Iterator[Term]:
    for text, about in products.items():
        if about in sizes.variables:
            usual = float(np.std(sizes.variables[about]))
            span = f"{SPAN[0] * usual!r}..{SPAN[1] * usual!r} {_UNIT[about]}"
            yield Term(equation, text, UNIT_OF[equation], {"w": span})


def amount_unit(equation: str, powers: Powers) -> str:
    """The unit of an amount before a product with these powers of position, velocity and current."""
    of_x, of_v, of_i = powers
    text = UNIT_OF[equation]
    text += _factor("s", of_v)
    text += _factor("m", -of_x - of_v)
    return text + _factor("A", -of_i)


def _factor(unit: str, power: int) -> str:
    if power == 0:
        return ""
    number = "" if abs(power) == 1 else str(abs(power))
    return f" {unit}{number}" if power > 0 else f"/{unit}{number}"


def _law(term: Term, name: str, sizes: LawSizes) -> LawExpression | None:
    """The term with its amount's range; None where the record does not show it."""
    size = _size(term, sizes)
    if not (np.isfinite(size) and size > 0 and sizes.equations[term.equation] > 0):
        return None
    most = LARGEST * sizes.equations[term.equation] / size
    parameters = {"a": f"{-most!r}..{most!r} {term.unit}", **term.shapes}
    return expression(name, term.equation, f"a*{term.product}", parameters)


def _size(term: Term, sizes: LawSizes) -> float:
    """RMS of a term without its amount over the record, its shape in the middle of its range."""
    shapes = {}
    for name, text in term.shapes.items():
        ends = [float(part) for part in text.split(" ")[0].split("..")]
        shapes[name] = float(np.sqrt(ends[0] * ends[-1]))
    tree = parse_law(term.product, frozenset(sizes.variables) | shapes.keys())
    return float(np.sqrt(np.mean(np.square(value_of(tree, {**sizes.variables, **shapes})))))
