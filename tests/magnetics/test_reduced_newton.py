"""Newton's iteration of made-up reduced problems: balance of forces, slopes by dense tangents, systems by numpy."""

from collections.abc import Callable

import numpy as np
import pytest

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.reduced import online
from msl_fem.magnetics.reduced.linear_systems import SystemsAt, linear_products
from msl_fem.magnetics.reduced.newton import FoundStates, line_search, newton
from msl_fem.magnetics.reduced.online import ReducedProblem, StatesAt
from msl_fem.magnetics.reduced.reduced_iron import IronTerms, ReducedIron
from msl_fem.materials.curves import curves_of
from msl_fem.materials.material import load_iron

N, POINTS = 11, 40
RNG = np.random.default_rng(3)
COORDINATES, CURRENTS = np.geomspace(0.4, 1.6, 7), np.linspace(0.0, 1.0, 6) ** 2


@pytest.fixture
def iron() -> ReducedIron:
    gradients = np.random.default_rng(0).standard_normal((2 * POINTS, N)) / np.arange(1, N + 1)
    return ReducedIron(
        gradients, np.full(POINTS, 1e-2), np.zeros(POINTS, dtype=np.int64), curves_of([load_iron("m19")])
    )


@pytest.fixture
def problem(iron: ReducedIron) -> ReducedProblem:
    """Stiffness falls with the coordinate; the largest current saturates."""
    root = np.random.default_rng(1).standard_normal((N, N))
    unit = 50.0 * (root @ root.T + N * np.eye(N))
    place, order = np.repeat(np.arange(COORDINATES.size), CURRENTS.size), np.tile(CURRENTS, COORDINATES.size)
    stiffness = np.stack([unit / q for q in COORDINATES])
    slope = np.stack([-unit / q**2 for q in COORDINATES])
    source = 3e3 * np.random.default_rng(2).standard_normal((1, N))
    return ReducedProblem(place, COORDINATES, order[:, None], stiffness, slope, source, iron)


def dense_tangent(terms: IronTerms, stiffness: Array, state: Array) -> Array:
    upper = np.zeros((N, N))
    upper[np.triu_indices(N)] = terms.tangents(terms.at(state[None])[1])[0]
    return stiffness + upper + np.triu(upper, 1).T


def ways_of(problem: ReducedProblem) -> list[Array]:
    return [np.flatnonzero(problem.place == k) for k in range(COORDINATES.size)]


def test_systems_are_those_of_numpy() -> None:
    """Products, factors of sums with tangents, and substitutions, in any order of the systems; what is not definite."""
    for size in (1, 3, 4, 13):
        stiffness = RNG.standard_normal((3, size, size))
        stiffness = stiffness @ stiffness.transpose(0, 2, 1) + np.eye(size)
        place, at = np.array([2, 0, 1, 1]), np.array([3, 0, 1])
        tangents, rights = RNG.uniform(0, 0.1, (3, size * (size + 1) // 2)), RNG.standard_normal((3, 2, size))
        full = np.zeros((3, size, size))
        full[:, *np.triu_indices(size)] = tangents
        full += np.triu(full, 1).transpose(0, 2, 1) + stiffness[place[at]] + 3 * np.eye(size)
        systems = SystemsAt(stiffness + 3 * np.eye(size), place)
        assert systems.factor(at, tangents).all()
        expected = np.linalg.solve(full[:, None], rights[..., None])[..., 0]
        assert systems.substitute(at, rights) == pytest.approx(expected, rel=1e-11)
        products = np.einsum("kij,kmj->kmi", stiffness[place[at]], rights)
        assert linear_products(stiffness, place[at], rights) == pytest.approx(products, rel=1e-12)
        assert not systems.factor(at, tangents - 1e3).any()


@pytest.mark.parametrize("many", [False, True])
def test_states_balance_their_loads_whatever_the_factors(problem: ReducedProblem, many: bool) -> None:
    """From starts near and far: the force left over is that of a step below 1e-7, slopes are by the tangents there."""
    load = problem.currents @ problem.sources
    terms = IronTerms(problem.iron, many=many)
    exact = newton(np.zeros_like(load), SystemsAt(problem.stiffness, problem.place), load, terms).states
    for off in (1e-3, 1e-2, 0.3):
        start = exact * (1 + off * np.random.default_rng(4).standard_normal(exact.shape))
        found = newton(start, SystemsAt(problem.stiffness, problem.place), load, terms)
        assert (found.steps > 0).all()
        _check(found, problem, load, terms)
    assert found.steps.max() < 12


def _check(found: FoundStates, problem: ReducedProblem, load: Array, terms: IronTerms) -> None:
    rights = np.random.default_rng(5).standard_normal((len(load), 2, N))
    answer = found.responses(rights, terms)
    for k, (state, place) in enumerate(zip(found.states, problem.place, strict=True)):
        tangent = dense_tangent(terms, problem.stiffness[place], state)
        rest = load[k] - problem.stiffness[place] @ state - terms.at(state[None])[0][0]
        assert rest @ np.linalg.solve(tangent, rest) <= 1e-14 * (state @ load[k])
        expected = np.linalg.solve(tangent, rights[k].T).T
        missed = answer[k] - expected
        size = np.einsum("mi,ij,mj->m", missed, tangent, missed) / np.einsum("mi,mi->m", expected, rights[k])
        assert size.max() <= (1e-5 if found.kept[k] else 1e-4) ** 2
        crossed = answer[k] @ rights[k].T
        assert abs(crossed[0, 1] - crossed[1, 0]) <= 1e-12 * np.abs(crossed).max()


class SlopeAlong(IronTerms):
    """The slope of the energy along a step of 1, in place of an iron's; how often it was asked for."""

    def __init__(self, slope: Callable[[Array], Array]) -> None:
        self.slope, self.asked = slope, 0

    def at(self, states: Array) -> tuple[Array, Array]:
        self.asked += 1
        return self.slope(states), np.zeros((len(states), 3))


@pytest.mark.parametrize(
    ("slope", "most"),
    [
        (lambda t: 1e4 * t**9 - 1, 20),  # the step ends deep in saturation: each chord's root lies before the slope's
        (lambda t: 1.7 * np.tanh(1e4 * t) - 1, 8),  # it begins there: each lies behind
    ],
)
def test_a_line_search_halves_the_weight_of_the_end_that_stays(slope: Callable[[Array], Array], most: int) -> None:
    """Where the slope is far from a straight line, one end of the bracket stays: chords take 3000 steps, or twice 8."""
    terms, one = SlopeAlong(slope), np.ones((1, 1))
    nothing = SystemsAt(np.zeros((1, 1, 1)), np.array([0]))
    found, _, _ = line_search(0 * one, one, np.array([1.0]), nothing, np.array([0]), 0 * one, terms)
    assert abs(slope(found)[0, 0]) <= 0.5
    assert terms.asked <= most


def test_factors_are_kept_where_the_start_is_near(problem: ReducedProblem) -> None:
    """One tangent each from a start that is 2 permille off."""
    load = problem.currents @ problem.sources
    terms = IronTerms(problem.iron, many=True)
    systems = SystemsAt(problem.stiffness, problem.place)
    exact = newton(np.zeros_like(load), systems, load, terms).states
    found = newton(1.002 * exact, systems, load, terms)
    driven = load.any(axis=1)
    assert found.kept[driven].mean() > 0.8
    assert found.steps.mean() < 1.2


def test_states_between_two_coordinates_are_those_gone_along(
    problem: ReducedProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same states and slopes, from starts that take fewer tangents."""
    between, along = StatesAt(problem), StatesAt(problem)
    between.go(ways_of(problem))
    monkeypatch.setattr(online, "APART", 1)
    along.go(ways_of(problem))
    for name in ("states", "by_current", "by_coordinate"):
        one, other = getattr(between, name), getattr(along, name)
        assert np.linalg.norm(one - other) <= 1e-5 * np.linalg.norm(other), name
    assert between.steps.sum() < along.steps.sum()


def test_a_cubic_between_coordinates_is_exact_where_the_field_is_one(problem: ReducedProblem) -> None:
    """Of the coordinate's logarithm, as all are above 0; of the coordinate itself where one is not."""
    for shift, u in ((0.0, np.log), (-1.0, np.asarray)):
        moved = problem._replace(coordinate=problem.coordinate + shift)
        states = StatesAt(moved)
        q = moved.coordinate[moved.place]
        rise = np.array([3 * u(q) ** 2 - 2, 3 * q**2 - 2])[0] / (q if shift == 0.0 else 1.0)
        states.states[:] = (u(q) ** 3 - 2 * u(q))[:, None] * np.arange(N)
        states.by_coordinate[:] = rise[:, None] * np.arange(N)
        ways = ways_of(problem)
        assert states._between(ways[0], ways[3], ways[1]) == pytest.approx(states.states[ways[1]], rel=1e-12, abs=1e-13)
