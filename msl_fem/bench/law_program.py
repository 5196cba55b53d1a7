"""Laws that users state, evaluated by the bench in its own way: a program for a stack of numbers, walked step by step.

The plant compiles such a law to machine code; here each operation of the checked tree is a row of a table that one
loop reads. Nothing of the two is shared but the tree.
"""

import numpy as np

from msl_fem.bench.plant import LONGEST_PROGRAM, Array, BenchPlant, UserLaws, V, X
from msl_fem.computing.compiled import compiled
from msl_fem.computing.laws import LawExpression
from msl_fem.computing.laws.grammar import Node

FORCE, VOLTAGE, READING = 0.0, 1.0, 2.0
_EQUATIONS = {"force": FORCE, "voltage": VOLTAGE, "position_reading": READING}
NUMBER, VARIABLE, PLUS, MINUS, TIMES, OVER, POWER, NEGATIVE = range(8)
ABS, SIGN, SQRT, EXP, LOG, SIN, COS, TANH, MIN, MAX = range(8, 18)
_OPERATIONS = {
    "+": PLUS, "-": MINUS, "*": TIMES, "/": OVER, "**": POWER, "negative": NEGATIVE, "abs": ABS, "sign": SIGN,
    "sqrt": SQRT, "exp": EXP, "log": LOG, "sin": SIN, "cos": COS, "tanh": TANH, "min": MIN, "max": MAX,
}  # fmt: skip
_PLACES = {"x": 0, "v": 1, "i1": 2, "i2": 3, "g1": 4, "g2": 5, "i": 2, "g": 4}
_ONE_VALUE = (NEGATIVE, MAX)  # operations between them, but for MIN, take one value


@compiled
def law_sum(laws: UserLaws, equation: float, at: Array) -> float:
    """The sum of the laws of an equation where x, v, i1, i2, g1, g2 are `at` (6,); nan outside their domain."""
    total = 0.0
    stack = np.empty(LONGEST_PROGRAM)
    for n in range(laws.number_of_laws):
        if laws.equation[n] == equation:
            total += _value(laws.code[n], laws.number[n], stack, at)
    return total


@compiled
def law_of_motion(plant: BenchPlant, equation: float, y: Array, gap: float, sides: Array, currents: int) -> float:
    """The sum of the laws of force or reading at a state; `gap` is side 1's, the sides' currents stand in the column
    `currents` of their rows. 0 without laws."""
    if plant.laws.number_of_laws == 0:
        return 0.0
    at = np.empty(6)
    at[0], at[1] = y[X], y[V]
    at[2], at[3] = sides[0, currents], sides[1, currents]
    at[4], at[5] = gap, 2.0 * plant.magnets.nominal_gap - gap
    return law_sum(plant.laws, equation, at)


@compiled
def law_of_side(plant: BenchPlant, y: Array, gap: float, current: float) -> float:
    """The voltage (V) that users' laws take from a side of that gap and current; 0 without laws."""
    if plant.laws.number_of_laws == 0:
        return 0.0
    at = np.zeros(6)
    at[0], at[1], at[2], at[4] = y[X], y[V], current, gap
    return law_sum(plant.laws, VOLTAGE, at)


@compiled
def _value(code: Array, numbers: Array, stack: Array, at: Array) -> float:
    top = 0
    for k in range(code.size):
        operation = int(code[k])
        if operation < 0:
            break
        if operation == NUMBER:
            stack[top] = numbers[k]
            top += 1
        elif operation == VARIABLE:
            stack[top] = at[int(numbers[k])]
            top += 1
        elif operation <= POWER or operation >= MIN:
            top -= 1
            stack[top - 1] = _of_two(operation, stack[top - 1], stack[top])
        else:
            stack[top - 1] = _of_one(operation, stack[top - 1])
    return float(stack[0])


@compiled
def _of_two(operation: int, a: float, b: float) -> float:
    if operation == PLUS:
        return a + b
    if operation == MINUS:
        return a - b
    if operation == TIMES:
        return a * b
    if operation == OVER:
        return a / b
    if operation == POWER:
        return a**b
    return min(a, b) if operation == MIN else max(a, b)


@compiled
def _of_one(operation: int, a: float) -> float:
    if operation == NEGATIVE:
        return -a
    if operation == ABS:
        return abs(a)
    if operation == SIGN:
        return np.sign(a)
    if operation == SQRT:
        return np.sqrt(a)
    if operation == EXP:
        return np.exp(a)
    if operation == LOG:
        return np.log(a)
    if operation == SIN:
        return np.sin(a)
    return np.cos(a) if operation == COS else np.tanh(a)


def program_of(law: Node, values: dict[str, float]) -> tuple[list[float], list[float]]:
    """(operations, numbers) of a law with values of its parameters, the operands before their operation."""
    if law.kind == "number":
        return [NUMBER], [law.value]
    if law.kind == "name" and law.name in values:
        return [NUMBER], [values[law.name]]
    if law.kind == "name":
        return [VARIABLE], [_PLACES[law.name]]
    code: list[float] = []
    numbers: list[float] = []
    for inner in law.inner:
        more_code, more_numbers = program_of(inner, values)
        code += more_code
        numbers += more_numbers
    return [*code, _OPERATIONS[law.kind]], [*numbers, 0.0]


def with_law(laws: UserLaws, expression: LawExpression, values: dict[str, float]) -> UserLaws:
    """The laws and one more."""
    code, numbers = program_of(expression.law, values)
    n = laws.number_of_laws
    new = UserLaws(n + 1, laws.equation.copy(), laws.code.copy(), laws.number.copy())
    new.equation[n] = _EQUATIONS[expression.equation]
    new.code[n] = -1.0
    new.code[n, : len(code)], new.number[n, : len(code)] = code, numbers
    return new
