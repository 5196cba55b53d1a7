"""Causes that users state by a law (`computing.laws`), as entries of the catalogue and as functions of the kernel.

Their laws are compiled by themselves and called by their address, so that a new law compiles no kernel. What is
declared holds for this process, as an import does; a name keeps its law.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import RowLayout, Rows, call_at, first, width
from msl_fem.computing.laws import UNIT_OF, LawExpression, LawParameter
from msl_fem.computing.laws.calculus import derivative, value_of
from msl_fem.computing.laws.expression import MOST_PARAMETERS
from msl_fem.computing.laws.grammar import Node
from msl_fem.computing.laws.source import Places, made, sum_of_laws
from msl_fem.errors import InputError
from msl_fem.plant.effects import sensing
from msl_fem.plant.effects.entry import (
    FINE,
    DesignChange,
    Effect,
    Group,
    KernelSetting,
    MoverMotion,
    Need,
    Parameter,
    Part,
    Values,
)
from msl_fem.plant.plant import PlantParameters

LAYOUT = RowLayout(after=sensing.LAYOUT)
LAWS = LAYOUT.row()  # 1 where there are laws
# Addresses of the laws of voltages, and of force and reading: for one run, then for lanes
VOLTAGES_AT, VOLTAGES_OF_LANES_AT, MOTION_AT, MOTION_OF_LANES_AT = LAYOUT.rows(4)
PARAMETERS = LAYOUT.row(MOST_PARAMETERS)  # of all laws, one cause after the other

ROWS = RowLayout()  # of the workspace: what laws look at, and what they give
LAW_X, LAW_V, LAW_I1, LAW_I2, LAW_G1, LAW_G2 = ROWS.rows(6)
LAW_FORCE, LAW_READING, LAW_VOLTAGE_1, LAW_VOLTAGE_2 = ROWS.rows(4)

_OF_MOTION = {"x": LAW_X, "v": LAW_V, "i1": LAW_I1, "i2": LAW_I2, "g1": LAW_G1, "g2": LAW_G2}
_OF_SIDE = ({"i": LAW_I1, "g": LAW_G1, "x": LAW_X, "v": LAW_V}, {"i": LAW_I2, "g": LAW_G2, "x": LAW_X, "v": LAW_V})
_GROUP: dict[str, Group] = {"force": "mechanical", "voltage": "electrical", "position_reading": "sensing and timing"}
_TERM = {"force": "m x'' = ... + ", "voltage": "v_j = R i_j + d lambda_j/dt + ", "position_reading": "reading = ... + "}
_USUAL = 30.0  # of an amount's range, what its usual scale is: ten of them are a third of it
_DECADE = 10.0  # of a shape's range, that one start of a search covers
_TRIED_SPEED = 2 * math.pi * 100.0  # rad/s, of a travel's amplitude where no spring says how fast a mover is
DECLARED: dict[str, LawExpression] = {}


def effect_of(expression: LawExpression) -> Effect:
    """The catalogue's entry of a user's cause."""
    believed, undone = _believed_amounts(expression), _undone_amounts(expression)
    of_force = expression.equation == "force"
    return Effect(
        name=expression.effect,
        group=_GROUP[expression.equation],
        sentence=f"a law of one's own, {expression.equation} = {expression.text}",
        equation=_TERM[expression.equation] + expression.text,
        source="stated by the user",
        parameters=tuple(_parameter(p) for p in expression.parameters),
        design=Part(
            believed, "a design believes what a law does about the middle at rest; the feedback takes the rest"
        ),
        inverse=Part(undone, "the inverse dynamics of a rig know laws of force over position and velocity"),
        static=Part(declined="a static map is not asked for laws of one's own"),
        advice="look at what the law stands for",
        believe=_believe(expression) if believed else None,
        needed_force=_needed_force(expression) if of_force and undone else None,
        needs=_needs(expression),
        steps=FINE,
    )


def _parameter(p: LawParameter) -> Parameter:
    """Of the catalogue: an amount is neutral at 0, a shape in the middle of its range on a logarithmic scale."""
    meaning = f"{p.low:g} to {p.high:g}"
    if p.amount:
        return Parameter(p.name, p.unit, 0.0, (p.low, p.high), max(-p.low, p.high) / _USUAL, meaning)
    ratio = math.log(p.high / p.low)
    count = max(1, math.ceil(ratio / math.log(_DECADE)))
    starts = tuple(p.low * math.exp(ratio * (k + 0.5) / count) for k in range(count))
    middle = p.low if ratio == 0.0 else math.sqrt(p.low * p.high)
    spread = max(ratio / (2 * count), 1e-3)
    return Parameter(
        p.name, p.unit, middle, (p.low, p.high), abs(middle), meaning, shape=True, tried=starts, width=spread
    )


def _needs(expression: LawExpression) -> tuple[Need, ...]:
    if expression.equation == "voltage":
        return ("magnets",)
    if expression.variables & {"i2", "g2"}:
        return ("magnets", "two sides")
    return ("magnets",) if expression.variables & {"i1", "g1"} else ()


def _middle(expression: LawExpression) -> tuple[Node, Node, Node] | None:
    """(law, its slopes over position and velocity) where a design can believe them; else None."""
    if expression.equation != "force" or not expression.variables <= {"x", "v"}:
        return None
    return expression.law, derivative(expression.law, "x"), derivative(expression.law, "v")


def _at_rest(nodes: tuple[Node, ...], values: Mapping[str, float]) -> list[float]:
    """Values of laws in the middle at rest, 0 where a law is not defined there."""
    found = [float(value_of(node, {"x": 0.0, "v": 0.0, **values})) for node in nodes]
    return [value if math.isfinite(value) else 0.0 for value in found]


def _believed_amounts(expression: LawExpression) -> tuple[str, ...]:
    nodes = _middle(expression)
    if nodes is None:
        return ()
    shapes = {p.name: _parameter(p).neutral for p in expression.parameters}
    return tuple(
        p.name for p in expression.parameters if p.amount and any(_at_rest(nodes, shapes | {p.name: p.high or p.low}))
    )


def _believe(expression: LawExpression) -> Callable[[DesignChange, Values], None]:
    nodes = _middle(expression)
    assert nodes is not None

    def believe(change: DesignChange, v: Values) -> None:
        constant, over_x, over_v = _at_rest(
            nodes, {p.name: v[expression.effect, p.name] for p in expression.parameters}
        )
        change.constant_force += constant
        change.stiffness -= over_x
        change.damping -= over_v

    return believe


def _undone_amounts(expression: LawExpression) -> tuple[str, ...]:
    if _middle(expression) is None:
        return ()
    return tuple(p.name for p in expression.parameters if p.amount)


def _needed_force(expression: LawExpression) -> Callable[[Values, PlantParameters, MoverMotion], Array | float]:
    def force(v: Values, plant: PlantParameters, motion: MoverMotion) -> Array | float:
        parameters = {p.name: v[expression.effect, p.name] for p in expression.parameters}
        if not any(parameters[p.name] for p in expression.parameters if p.amount):
            return 0.0
        values = {"x": motion.position, "v": motion.velocity, **parameters}
        return -np.broadcast_to(np.asarray(value_of(expression.law, values), dtype=float), motion.time.shape)

    return force


def steepest(expression: LawExpression, plant: PlantParameters, values: Mapping[str, float]) -> dict[str, float]:
    """The largest slopes of a law, by variable in SI units, over where a plant can go: on a grid of five a variable."""
    reach = {"x": plant.travel if math.isfinite(plant.travel) else 1e-3}
    speed = max(math.sqrt(plant.stiffness / plant.mass), _TRIED_SPEED)
    reach["v"] = reach["x"] * speed
    limit = plant.current_limit if math.isfinite(plant.current_limit) else 10.0
    reach |= dict.fromkeys(("i", "i1", "i2"), limit)
    grid = {name: np.linspace(-reach[name], reach[name], 5) for name in expression.variables if name in reach}
    near = plant.nominal_gap if math.isfinite(plant.nominal_gap) else 1e-3
    grid |= {name: near * np.array([0.25, 0.5, 1.0, 1.5, 2.0]) for name in expression.variables if name not in reach}
    points = np.array(list(product(*grid.values()))).T.reshape(len(grid), -1)
    at = dict(zip(grid, points, strict=True)) | dict(values)
    slopes = {name: np.abs(np.asarray(value_of(derivative(expression.law, name), at))) for name in grid}
    return {name: float(np.max(s, where=np.isfinite(s), initial=0.0)) for name, s in slopes.items()}


def parameter_rows(expressions: Iterable[LawExpression]) -> dict[tuple[str, str], int]:
    """Rows of the coefficients by cause and parameter, of these causes alone."""
    names = [(one.name, p.name) for one in expressions for p in one.parameters]
    return {key: PARAMETERS + n for n, key in enumerate(names)}


def check_room(expressions: Mapping[str, LawExpression]) -> None:
    """Returns where the kernel has rows for all parameters.

    Raises
    ------
    InputError : there are too many
    """
    count = sum(len(one.parameters) for one in expressions.values())
    if count > MOST_PARAMETERS:
        raise InputError(
            f"the causes {', '.join(expressions)} have {count} parameters together; at most {MOST_PARAMETERS} are taken"
        )


def law_functions() -> tuple[Callable[..., None], Callable[..., None], Callable[..., None]]:
    """Python functions of all declared laws: (the rule that sets coefficients, voltages, force and reading)."""
    return _functions(tuple(DECLARED.values()))


@cache
def _functions(
    expressions: tuple[LawExpression, ...],
) -> tuple[Callable[..., None], Callable[..., None], Callable[..., None]]:
    rows = parameter_rows(expressions)
    by = {equation: [one for one in expressions if one.equation == equation] for equation in UNIT_OF}
    sides = [(by["voltage"], Places(_OF_SIDE[j], LAW_VOLTAGE_1 + j)) for j in range(2)]
    voltages = sum_of_laws("voltages_of_laws", "Voltages (V) of the sides that users' laws take.", sides, rows)
    outputs = (("force", LAW_FORCE), ("position_reading", LAW_READING))
    groups = [(by[equation], Places(_OF_MOTION, row)) for equation, row in outputs]
    motion = sum_of_laws("motion_of_laws", "Force (N) and reading (m) of users' laws.", groups, rows)
    lines = [f"e[{LAWS}] = 1.0"] if expressions else ["pass"]
    lines += [f"e[{row}] = values['expression:{cause}', '{name}']" for (cause, name), row in rows.items()]
    rule = made("set_laws", ("e", "values", "setting"), "Parameters of users' laws.", lines, {})
    return rule, voltages, motion


def set_laws(e: Array, values: Values, setting: KernelSetting) -> None:
    """Parameters of the declared laws into the coefficients."""
    if DECLARED:
        law_functions()[0](e, values, setting)


def set_addresses(e: Array) -> None:
    """Where the laws' machine code stands, into the coefficients."""
    if DECLARED:
        (one, _), (lanes, _), (motion, _), (motion_of_lanes, _) = _machine_code(tuple(DECLARED.values()))
        e[VOLTAGES_AT], e[VOLTAGES_OF_LANES_AT], e[MOTION_AT], e[MOTION_OF_LANES_AT] = (
            one,
            lanes,
            motion,
            motion_of_lanes,
        )


@cache
def _machine_code(expressions: tuple[LawExpression, ...]) -> tuple[tuple[float, Any], ...]:
    """(address, what keeps it alive) of the laws: voltages for one run and for lanes, motion alike.

    Where no law gives a voltage, or none gives a motion, that part is the one of no laws at all, compiled once.
    """
    from msl_fem.computing.lanes import LANES

    of_voltage = [one.equation == "voltage" for one in expressions]
    voltages = _functions(expressions if any(of_voltage) else ())[1]
    motion = _functions(() if all(of_voltage) else expressions)[2]
    return tuple(_address(function, count) for function in (voltages, motion) for count in (1, LANES))


@cache
def _address(function: Callable[..., None], count: int) -> tuple[float, Any]:
    from msl_fem.computing.addresses import address_of

    return address_of(function, count)


@compiled
def voltage_laws(e: Rows, work: Rows) -> None:
    """Voltages of the sides from the rows that laws look at, into theirs."""
    if width(work) == 1:
        call_at(first(e[VOLTAGES_AT]), e, work)
    else:
        call_at(first(e[VOLTAGES_OF_LANES_AT]), e, work)


@compiled
def motion_laws(e: Rows, work: Rows) -> None:
    """Force and reading from the rows that laws look at, into theirs."""
    if width(work) == 1:
        call_at(first(e[MOTION_AT]), e, work)
    else:
        call_at(first(e[MOTION_OF_LANES_AT]), e, work)
