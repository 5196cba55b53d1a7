"""Printed C is its Python, in bits: the language on toys, functions of the kernel; test_fmu_effects has whole runs."""

import math

import numpy as np
import pytest
from c_programs import assert_same_bits
from printed_library import KINDS, PrintedLibrary

from msl_fem.computing import lanes
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import keep, rows_of
from msl_fem.export.c_printer import Printer
from msl_fem.export.c_types import REAL, Pointer, PrintError, Values
from msl_fem.export.plant_model import plant_record, setting_record
from msl_fem.plant import drive, equations, plant_parameters, poles, side
from msl_fem.plant.effects import CATALOGUE, N_COEFFICIENT, PARAMETER_INDEX, KernelSetting, set_coefficients, values_of
from msl_fem.plant.effects.mechanisms import fall_stages
from msl_fem.plant.instruments import _between

ROWS = Pointer()
TWO = 2
WEIGHTS = (0.3, -1.7, 5.0)


def swap(a, b):
    """Several at once: none sees what another has become."""
    a_, b_ = a, b
    a_, b_ = b_ + a_, a_ - b_
    (c, d), e = (b_, a_), a_ * b_
    return c, d, e


def order(a, b, c):
    """Brackets where Python has them."""
    return a - (b - c), a / (b / c), a - b - c, -(a + b) * c, a * -b, (a + b) * ((a - b) * TWO)


def whole(n, m):
    """Whole numbers divide downwards."""
    return n // m, n % m, n / m, n - m // TWO


def conditions(a, b, n):
    """Chains, truth of numbers, choices, what is not evaluated."""
    if (a < b <= TWO * a and n != 3) or (n > 5 and b != a):
        return 1.0
    elif n:
        return 2.0 if b else 3.0
    return min(a, b) + max(a, 0.5) + abs(b)


def loops(a, n):
    """Upwards, downwards, over constants, until broken off; what is left of a loop."""
    total, last = 0.0, 0
    for k in range(n):
        for _ in range(2):
            total += a / (k + 1)
        last = k
    for k in range(n, 0, -1):
        total = total * 0.5 + k
    for k, weight in enumerate(WEIGHTS):
        total -= weight * k
    while total > 1.0:
        total *= 0.25
        if total < 2.0:
            break
    return total, last


def rows(x, n):
    """Rows, parts of them, one that stands for a part, an array of its own, several targets."""
    kept = np.zeros(3)
    kept[0] = kept[2] = x[n]
    x[n] = x[n + 1] = kept[0] + 1.0
    x[0], x[1] = x[1], x[0]
    x[4:7] = x[2]
    x[7:9] = _pair(x[3])
    x[9] += kept[1] + kept[2]


def _pair(a):
    return a * 3.0, a / 3.0


def _bump(x):
    x[0] = x[0] * 1.5 + 1.0
    return x[0]


def in_order(x, a):
    """What changes rows is called where Python calls it."""
    first = a + _bump(x)
    second = _bump(x) - x[0] * a
    return first, second, _less(_bump(x), _bump(x))


def _less(a, b):
    return a - b * 0.1


def mathematics(a, b):
    """Functions of the mathematical library."""
    far = np.isinf(a / 0.5) or math.isinf(b)
    sines = np.cos(a), np.sin(b), np.sqrt(abs(a)), math.exp(-abs(b)), math.expm1(a), np.sign(b)
    return *sines, np.nextafter(a, np.inf), math.floor(b), np.round(3.0 * a), int(b * 10.0), float(int(a)), far


TOYS = {
    swap: "rr", order: "rrr", whole: "nn", conditions: "rrn", loops: "rn", rows: "Rn", in_order: "Rr",
}  # fmt: skip


def kinds(function, letters):
    names = getattr(function, "py_func", function).__code__.co_varnames
    return {name: KINDS.get(letter, ROWS) for name, letter in zip(names, letters, strict=False)}


@pytest.fixture(scope="module")
def toys(tmp_path_factory):
    return PrintedLibrary(tmp_path_factory.mktemp("toys"), {f: kinds(f, letters) for f, letters in TOYS.items()})


def drawn(letters, rng):
    """Random arguments: numbers of several sizes, small whole numbers that are not 0, rows."""
    some = {
        "r": lambda: float(rng.choice([-1, 1]) * 10.0 ** rng.uniform(-3, 3)) if rng.random() > 0.1 else 0.0,
        "n": lambda: int(rng.integers(1, 7) * rng.choice([-1, 1])),
        "b": lambda: bool(rng.random() < 0.5),
        "R": lambda: rng.standard_normal(64),
    }
    return [some[letter]() for letter in letters]


def flat(value):
    """The numbers of a result."""
    if value is None:
        return []
    return [x for one in value for x in flat(one)] if isinstance(value, tuple) else [float(value)]


@pytest.mark.parametrize("function", TOYS, ids=lambda f: f.__name__)
def test_the_language(toys, function):
    rng = np.random.default_rng(4)
    for _ in range(200):
        arguments = drawn(TOYS[function], rng)
        if function in (rows, loops):
            arguments[1] = abs(arguments[1])
        mine = [a.copy() if isinstance(a, np.ndarray) else a for a in arguments]
        with np.errstate(all="ignore"):
            wanted = flat(function(*arguments)) if not _divides_by_zero(function, arguments) else None
        if wanted is None:
            continue
        assert_same_bits(np.array(toys.call(function, *mine)), np.array(wanted))
        for one, other in zip(mine, arguments, strict=True):
            if isinstance(one, np.ndarray):
                assert_same_bits(one, other)


def _divides_by_zero(function, arguments):
    return function is order and 0.0 in arguments


KERNEL = {
    lanes.within: "rr",
    _between: "rrrrr",
    lanes.exponential: "r",
    lanes.logarithm: "r",
    lanes.hyperbolic_sine: "r",
    lanes.hyperbolic_cosine: "r",
    lanes.inverse_hyperbolic_sine: "r",
    poles.fall_rows: "rrRnn",
    poles.lag_weights: "rrRnn",
    poles.fall_moments: "rrr",
    poles.fall_for_squares: "rrrr",
    poles.slopes_of_fall: "rrrr",
    poles.limited_line: "rrrr",
    drive._slew: "rrrr",
    drive._left: "rrr",
    drive._limited: "Rrrrrr",
    drive._turned: "Rrr",
    drive._straight: "Rnrr",
    side.cell_values: "Rnrr",
    equations.series_iron: "Rr",
    equations.stop_sum: "RRnnnnr",
    equations.settle_stops: "RRnnnnr",
    equations.settle_broadened_stops: "RRrnrr",
}
"""Functions that take numbers and rows alone; those above them are compared in whole runs."""


PLAIN = {fall_stages: "rr"}
"""Functions that Python runs."""


@pytest.fixture(scope="module")
def kernel_library(tmp_path_factory):
    printed = {f: kinds(f, letters) for f, letters in (KERNEL | PLAIN).items()}
    return PrintedLibrary(tmp_path_factory.mktemp("kernel"), printed)


def on_rows(function, letters):
    """The compiled function as Python can call it: arrays as rows."""
    names = [f"a{n}" for n in range(len(letters))]
    inner = ", ".join(f"rows_of({n})" if kind == "R" else n for n, kind in zip(names, letters, strict=True))
    kept = "; ".join(f"keep({n})" for n, kind in zip(names, letters, strict=True) if kind == "R") or "pass"
    source = f"def outer({', '.join(names)}):\n    found = function({inner})\n    {kept}\n    return found\n"
    scope = {"function": function, "rows_of": rows_of, "keep": keep}
    exec(source, scope)
    from numba import njit

    assert all(value._numba_type_ for name, value in scope.items() if name != "__builtins__" and name != "outer")
    return njit(error_model="numpy")(scope["outer"])


@pytest.mark.parametrize("function", KERNEL, ids=lambda f: f.py_func.__name__)
def test_each_function_of_the_kernel(kernel_library, function):
    """On random input, nothing or all of it physical: the same bits from numba and from gcc."""
    rng, letters = np.random.default_rng(7), KERNEL[function]
    outer = on_rows(function, letters)
    for _ in range(100):
        arguments = [abs(a) if isinstance(a, int) else a for a in drawn(letters, rng)]
        arguments = [0 if kind == "n" and n == len(letters) - 1 else a
                     for n, (kind, a) in enumerate(zip(letters, arguments, strict=True))]  # fmt: skip
        arguments = [np.resize(a, 400) if isinstance(a, np.ndarray) else a for a in arguments]
        mine = [a.copy() if isinstance(a, np.ndarray) else a for a in arguments]
        wanted = flat(outer(*arguments))
        assert_same_bits(np.array(kernel_library.call(function, *mine)), np.array(wanted))
        for one, other in zip(mine, arguments, strict=True):
            if isinstance(one, np.ndarray):
                assert_same_bits(one, other)


@pytest.mark.parametrize("function", PLAIN, ids=lambda f: f.__name__)
def test_each_function_that_python_runs(kernel_library, function):
    rng = np.random.default_rng(8)
    for _ in range(200):
        arguments = rng.random(len(PLAIN[function])).tolist()
        arguments[1] = float(rng.choice([1e-3, 1.0, 30.0, 1e4, np.inf])) if function is fall_stages else arguments[1]
        assert_same_bits(np.array(kernel_library.call(function, *arguments)), np.array(flat(function(*arguments))))


@pytest.mark.parametrize("sides", [1, 2])
def test_the_coefficients_of_all_effects(servo, tmp_path, sides):
    """Parameters from all over their bounds, neutral ones among them."""
    p = plant_parameters(servo)._replace(sides=sides, end_stop=None)
    record = plant_record(p)
    setting = setting_record(record)
    library = PrintedLibrary(
        tmp_path, {set_coefficients: {"e": ROWS, "values": Values(PARAMETER_INDEX), "setting": setting}}
    )
    rng = np.random.default_rng(5)
    parameters = [q for effect in CATALOGUE.values() for q in effect.parameters]
    for _ in range(100):
        vector = np.array([q.neutral if rng.random() < 0.3 else q.neutral + q.scale * rng.random() for q in parameters])
        step, n_step = float(10.0 ** rng.uniform(-6, -4)), float(rng.integers(1, 20))
        wanted, found = np.zeros(N_COEFFICIENT), np.zeros(N_COEFFICIENT)
        set_coefficients(wanted, values_of(vector), KernelSetting(p, 0.01, step, n_step))
        plant = [getattr(p, name) if name != "end_stop" else (0.0, 0.0, 0.0) for name, _ in record.fields]
        numbers = np.array([*flat(tuple(plant)), 0.01, step, n_step])
        library.call(set_coefficients, found, vector, numbers)
        assert_same_bits(found, wanted)


def numba_alone(x):
    return sorted(x)


def text(a):
    return f"{a}" + "m"


def grown(a):
    a = [a]
    return a[0]


def of_two_kinds(x, n):
    kept = n
    if n > 3:
        kept = x
    return kept


def endless(a):
    return endless(a)


def late(x, a):
    return x[0] + _bump(x) * a


def power(a):
    return a**2


def unknown(a):
    return a + not_there  # noqa: F821


@pytest.mark.parametrize(
    ("function", "types", "said"),
    [
        (numba_alone, "R", r"numba_alone, line \d+: 'sorted\(x\)' is not printed as C"),
        (text, "r", "is not printed as C"),
        (grown, "r", r"'\[a\]' is not printed as C"),
        (of_two_kinds, "Rn", "a name is"),
        (endless, "r", "calls itself"),
        (late, "Rr", "it changes rows that were read before in the same statement"),
        (power, "r", "write the product"),
        (unknown, "r", "the name is not known there"),
    ],
)
def test_what_it_does_not_know_is_refused(function, types, said):
    """With the function, the line, what it is and the way out."""
    with pytest.raises(PrintError, match=said):
        Printer().add(function, kinds(function, types))


def test_a_compiled_function_without_source_is_refused():
    scope = {"__name__": "made"}
    exec("def made(a):\n    return a\n", scope)
    with pytest.raises(PrintError, match="has no Python source"):
        Printer().add(compiled(scope["made"]), {"a": REAL})


def test_the_same_functions_give_the_same_text():
    texts = []
    for _ in range(2):
        printer = Printer()
        for function, letters in (KERNEL | TOYS).items():
            printer.add(function, kinds(function, letters))
        texts.append(printer.declarations + printer.definitions)
    assert texts[0] == texts[1]
    assert texts[0].isascii()
