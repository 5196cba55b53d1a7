"""The MAP fit against problems whose posterior is known; the descent on a valley that it can overshoot."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import minimize

from msl_fem.computing import gauss_newton
from msl_fem.computing.gauss_newton import (
    HALVING,
    MOST_FAILED,
    ROWS_AT_ONCE,
    Damping,
    DescentSettings,
    FitSettings,
    add_outer,
    bounded_step,
    descend,
    fit_map,
    halved,
    normal_equations,
)
from msl_fem.errors import ComputationError


def linear_problem(n=200, p=4, seed=5):
    rng = np.random.default_rng(seed)
    design, truth = rng.standard_normal((n, p)) * 3, rng.standard_normal(p)
    return design, design @ truth + rng.standard_normal(n)


def test_a_linear_problem_has_its_exact_posterior_and_evidence() -> None:
    design, data = linear_problem()
    found = fit_map(lambda z: z @ design.T - data, np.zeros(4))
    precision = design.T @ design + np.eye(4)
    assert found.converged
    assert found.parameters == pytest.approx(np.linalg.solve(precision, design.T @ data), abs=0.02)
    assert found.covariance == pytest.approx(np.linalg.inv(precision), rel=1e-6)
    # marginal likelihood of the data, N(0, I + X X'), by the other route
    marginal = np.eye(data.size) + design @ design.T
    exact = -0.5 * data @ np.linalg.solve(marginal, data) - 0.5 * np.linalg.slogdet(marginal)[1]
    assert found.log_evidence == pytest.approx(exact, abs=0.02)


def test_evidence_prefers_the_model_that_made_the_data() -> None:
    """An idle column costs its Occam factor, a needed one is missed by far more."""
    design, data = linear_problem()
    idle = np.random.default_rng(9).standard_normal(200) * 3
    score = {
        name: fit_map(lambda z, x=x: z @ x.T - data, np.zeros(x.shape[1])).log_evidence
        for name, x in (("right", design), ("idle", np.c_[design, idle]), ("missing", design[:, :3]))
    }
    assert score["idle"] < score["right"]
    assert score["missing"] < score["right"] - 20


def decay(z, t):
    """A decay whose rate and size are believed to 20 and 10 %."""
    rate, size = 3.0 * (1 + 0.2 * z[:, :1]), 1.0 * (1 + 0.1 * z[:, 1:])
    return size * np.exp(-rate * t)


def test_a_nonlinear_problem_from_far_away_and_its_intervals() -> None:
    """From 4 sigma off: the minimum is found, and over 200 data sets 95 % intervals hold the truth 95 % of the time."""
    t, sigma = np.linspace(0, 1, 80), 0.02
    rng, inside = np.random.default_rng(11), 0
    for _ in range(200):
        truth = rng.standard_normal(2)
        data = decay(truth[None], t)[0] + sigma * rng.standard_normal(t.size)
        found = fit_map(lambda z, d=data: (decay(z, t) - d) / sigma, np.array([4.0, -4.0]))
        assert found.converged
        off = np.abs(found.parameters - truth) / np.sqrt(np.diag(found.covariance))
        inside += int((off < 1.96).sum())
    assert 0.92 < inside / 400 < 0.975


def test_the_gradient_vanishes_where_it_ends() -> None:
    t, sigma = np.linspace(0, 1, 80), 0.02
    data = decay(np.array([[1.5, -0.7]]), t)[0] + 0.02 * np.cos(37 * t)
    found = fit_map(lambda z: (decay(z, t) - data) / sigma, np.zeros(2), settings=FitSettings(enough=1e-8))
    slope = found.jacobian.T @ found.residual + found.parameters
    assert np.abs(slope).max() < 1e-2
    assert found.log_evidence < -found.objective


def test_a_run_that_fails_to_one_side_is_taken_from_the_other() -> None:
    t = np.linspace(0, 1, 40)

    def fragile(z):
        out = decay(z, t) - decay(np.array([[-1.0, 0.5]]), t)
        out[z[:, 0] > 0.0] = np.nan
        return out / 0.02

    found = fit_map(fragile, np.zeros(2))
    assert found.parameters == pytest.approx([-1.0, 0.5], abs=0.1)


def test_failures_are_said() -> None:
    with pytest.raises(ComputationError, match="fails at the start"):
        fit_map(lambda z: np.full((len(z), 5), np.nan), np.zeros(2))

    def alone(z):
        return np.where((z == 0).all(axis=1)[:, None], 1.0, np.nan) * np.ones((len(z), 5))

    with pytest.raises(ComputationError, match="to both sides of parameter number 0"):
        fit_map(alone, np.zeros(2))
    flat = fit_map(
        lambda z: 1 + np.abs(z[:, :1]) * np.ones((len(z), 5)), np.zeros(1), settings=FitSettings(most_steps=3)
    )
    assert not flat.converged
    assert "no end after 3 steps" in flat.reason


@dataclass(frozen=True)
class Height:
    """A point on log cosh, whose whole Gauss-Newton step overshoots far out."""

    x: float

    @property
    def objective(self) -> float:
        return float(np.log(np.cosh(self.x))) if abs(self.x) < 50.0 else float("inf")


class Valley:
    """log cosh; `skew` is a factor of the slope of models that take it over from a neighbour."""

    def __init__(self, skew: float = 1.0) -> None:
        self.skew, self.models = skew, []

    def moved(self, point: Height, move: np.ndarray) -> Height:
        return Height(point.x + float(move[0]))

    def model(self, point: Height, neighbour: "Tangent | None") -> "Tangent":
        self.models.append(neighbour is not None)
        return Tangent(point.x, 1.0 if neighbour is None else self.skew, stale=neighbour is not None)


class Tangent:
    def __init__(self, x: float, skew: float, *, stale: bool) -> None:
        self.slope, self.curvature, self.stale = skew * np.tanh(x), 1.0 / np.cosh(x) ** 2, stale
        self.promised = self.slope**2 / self.curvature / 2

    def step(self, damping: float) -> tuple[np.ndarray, float]:
        return halved(np.array([-self.slope / self.curvature]), damping), self.promised


def test_steps_are_halved_until_they_lead_down() -> None:
    end = descend(Valley(), Height(1.5), DescentSettings(HALVING, enough=1e-12))
    assert end.ending == "converged"
    assert end.point.x == pytest.approx(0.0, abs=1e-5)
    assert end.steps < 10
    stuck = descend(Valley(), Height(8.0), DescentSettings(HALVING, enough=1e-12))
    assert stuck.ending == "no descent"
    assert stuck.point == Height(8.0)
    assert descend(Valley(), Height(1.5), DescentSettings(HALVING, enough=0.0, most_steps=2)).steps == 2
    far = DescentSettings(HALVING, enough=0.0)
    assert (
        descend(Valley(), Height(1.5), far, reached=lambda point, _: point.objective < Height(1.5).objective).steps == 1
    )


def test_a_model_taken_over_is_renewed_before_it_is_believed() -> None:
    """A slope of the wrong sign leads nowhere; with renewal it costs one more model each time it is asked."""
    settings = DescentSettings(HALVING, enough=1e-12)
    astray = descend(Valley(skew=-1.0), Height(1.0), settings)
    assert astray.ending == "no descent"
    valley = Valley(skew=-1.0)
    end = descend(valley, Height(1.0), replace(settings, renewal=0.0))
    assert end.ending == "converged"
    assert not end.model.stale
    assert end.point.x == pytest.approx(0.0, abs=1e-5)
    assert valley.models.count(True) == end.steps


def test_a_model_that_promises_nothing_is_renewed_before_the_search_ends() -> None:
    valley = Valley(skew=0.0)
    end = descend(valley, Height(1.0), DescentSettings(HALVING, enough=1e-12, renewal=0.0))
    assert end.point.x == pytest.approx(0.0, abs=1e-5)
    assert descend(Valley(skew=0.0), Height(1.0), DescentSettings(HALVING, enough=1e-12)).steps == 1


@dataclass(frozen=True)
class Kinked:
    """A point whose models promise a hundred times what a step brings."""

    objective: float


class Promises:
    """Models of `Kinked`, and which of them were taken over from a neighbour."""

    promised = 1.0

    def __init__(self, *, stale: bool = False) -> None:
        self.stale, self.models = stale, []

    def step(self, damping: float) -> tuple[np.ndarray, float]:
        return np.array([-0.01]), self.promised

    def moved(self, point: Kinked, move: np.ndarray) -> Kinked:
        return Kinked(point.objective + float(move[0]))

    def model(self, point: Kinked, neighbour: "Promises | None") -> "Promises":
        self.models.append(neighbour is not None)
        return Promises(stale=neighbour is not None)


def test_models_are_renewed_no_more_where_new_ones_bring_nothing() -> None:
    promises = Promises()
    end = descend(promises, Kinked(1.0), DescentSettings(renewal=0.6, most_trials=20))
    assert end.steps == 20
    assert promises.models == [False, False, *[True] * 19]


def test_a_descent_ends_where_promises_are_not_kept() -> None:
    """Two new models whose steps bring a hundredth of what they promise, then two steps that are not worth a trial."""
    settings = DescentSettings(enough=0.02, renewal=0.6, most_trials=20)
    end = descend(Promises(), Kinked(1.0), settings)
    assert (end.ending, end.steps) == ("in vain", 3)
    assert descend(Promises(), Kinked(1.0), replace(settings, enough=0.005)).ending == "no more steps"


class Damped(Promises):
    """Models whose step, as damped as it has to be, promises and brings little of what one without would."""

    def step(self, damping: float) -> tuple[np.ndarray, float]:
        return np.array([-0.01]), 0.01

    def model(self, point: Kinked, neighbour: Promises | None) -> "Damped":
        return Damped(stale=neighbour is not None)


@pytest.mark.parametrize(("enough", "ending"), [(0.02, "in vain"), (0.005, "no more steps")])
def test_a_descent_ends_where_damped_steps_promise_too_little(enough: float, ending: str) -> None:
    end = descend(Damped(), Kinked(1.0), DescentSettings(enough=enough, renewal=0.6, most_trials=20))
    assert end.ending == ending
    assert end.steps == (1 if ending == "in vain" else 20)


def test_products_made_of_some_rows_at_a_time_are_those_of_the_whole() -> None:
    chance = np.random.default_rng(2)
    n = ROWS_AT_ONCE + 100
    jacobian, residual, root = chance.standard_normal((n, 3)), chance.standard_normal(n), chance.uniform(1, 2, n)
    weighted, row = jacobian * root[:, None], np.array([1.0, -2.0, 3.0])
    gram, slope = normal_equations(jacobian, root, residual)
    assert gram == pytest.approx(weighted.T @ weighted, rel=1e-12)
    assert slope == pytest.approx(weighted.T @ (root * residual), rel=1e-12)
    expected = jacobian + np.outer(residual, row)
    add_outer(jacobian, residual, row)
    assert jacobian == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("n", [0, 1, ROWS_AT_ONCE, 7 * ROWS_AT_ONCE + 5])
def test_sums_over_rows_are_the_same_to_the_last_bit_by_any_number_of_threads(n: int) -> None:
    jacobian, residual = np.random.default_rng(3).standard_normal((n, 4)), np.random.default_rng(4).standard_normal(n)
    each = [normal_equations(jacobian, np.ones(n), residual, threads=threads) for threads in (1, 2, 3)]
    for gram, slope in each[1:]:
        assert np.array_equal(gram, each[0][0])
        assert np.array_equal(slope, each[0][1])
    assert each[0][0] == pytest.approx(jacobian.T @ jacobian, rel=1e-11, abs=1e-9)
    assert each[0][1] == pytest.approx(jacobian.T @ residual, rel=1e-11, abs=1e-9)


class Misled:
    """Models whose steps all lead up, however short; counts them."""

    def __init__(self) -> None:
        self.trials = 0

    def moved(self, point: Kinked, move: np.ndarray) -> Kinked:
        self.trials += 1
        return Kinked(point.objective + 1.0)

    def model(self, point: Kinked, neighbour: Promises | None) -> Promises:
        return Promises(stale=False)


@pytest.mark.parametrize(("little", "trials"), [(0.0, 8), (np.inf, MOST_FAILED)])
def test_where_little_is_promised_a_descent_does_not_try_for_long(little: float, trials: int) -> None:
    misled = Misled()
    end = descend(misled, Kinked(1.0), DescentSettings(most_trials=8, little=little))
    assert misled.trials == trials
    assert end.steps == 0
    assert (end.ending == "in vain") == (little > 0.0)


@pytest.mark.parametrize("seed", range(20))
def test_a_step_within_bounds_is_the_least_there_and_one_cut_off_is_not(seed: int) -> None:
    """Against a general minimiser; and a move that is merely cut off may even lead uphill."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((5, 5))
    matrix, slope = root @ root.T + 0.01 * np.eye(5), rng.standard_normal(5)
    bounds = np.array([[-np.inf, -np.inf, 0.0, -0.1, -1.0], [np.inf, np.inf, np.inf, 0.1, 0.0]])

    def cost(move: np.ndarray) -> float:
        return float(slope @ move + move @ matrix @ move / 2)

    found = bounded_step(matrix, slope, bounds)
    other = minimize(
        cost, np.clip(found, *bounds), jac=lambda d: slope + matrix @ d, bounds=bounds.T, method="L-BFGS-B",
        options={"ftol": 1e-15, "gtol": 1e-10, "maxiter": 10_000},
    )  # fmt: skip
    assert np.all((bounds[0] <= found) & (found <= bounds[1]))
    assert cost(found) == pytest.approx(other.fun, rel=1e-6)
    free = np.full((2, 5), [[-np.inf], [np.inf]])
    assert bounded_step(matrix, slope, free) == pytest.approx(np.linalg.solve(matrix, -slope))


def test_a_step_cut_off_at_a_bound_leads_uphill_where_the_one_within_leads_down() -> None:
    """Two amounts that make up for each other, of which one is at nothing and may not go below."""
    matrix, slope = np.array([[1.0, 0.99], [0.99, 1.0]]), np.array([-0.1, -0.2])
    bounds = np.array([[0.0, -np.inf], [np.inf, np.inf]])
    whole = np.linalg.solve(matrix, -slope)
    cut, within = np.clip(whole, *bounds), bounded_step(matrix, slope, bounds)
    assert whole[0] < 0
    assert slope @ cut + cut @ matrix @ cut / 2 > 0
    assert within == pytest.approx([0.0, 0.2])


def test_a_step_within_bounds_bears_a_matrix_that_rounding_made_indefinite() -> None:
    turn = np.linalg.qr(np.random.default_rng(2).standard_normal((4, 4)))[0]
    matrix = turn @ np.diag([1e11, 1e6, 1.0, -1e-6]) @ turn.T
    bounds = np.array([[0.0, -np.inf, -0.5, 0.0], [np.inf, 0.0, 0.5, 1.0]])
    slope = matrix @ np.array([1.0, 1.0, 3.0, -1.0])
    move = bounded_step((matrix + matrix.T) / 2, slope, bounds)
    assert np.all((bounds[0] <= move) & (move <= bounds[1]))
    assert slope @ move + move @ matrix @ move / 2 < 0


def test_damping_is_kept_behind_a_failure_and_lowered_behind_two_successes() -> None:
    """With less of it than has just been found the step before failed."""
    damping = Damping(first=1.0, least=1e-4, rise=1e-2, most=1e8)
    assert damping.after_success(100.0, raised=True) == 100.0
    assert damping.after_success(100.0, raised=False) == 10.0
    assert damping.after_success(1e-5, raised=True) == 0.0


def test_a_stale_model_whose_step_was_too_long_is_damped_before_it_is_made_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settings = DescentSettings(HALVING, enough=1e-12, renewal=0.0)
    fresh = []
    for first in (0, 1):
        monkeypatch.setattr(gauss_newton, "DAMPED_FIRST", first)
        valley = Valley(skew=3.0)
        assert descend(valley, Height(1.0), settings).point.x == pytest.approx(0.0, abs=1e-5)
        fresh.append(valley.models.count(False))
    assert fresh[1] < fresh[0]


class Stiff:
    """x^2/2 with models that take it for `times` as stiff, as beside a large rest that bends."""

    stale = False

    def __init__(self, times: float = 20.0) -> None:
        self.times, self.moves, self.tried, self.models = times, 0, [], []

    def moved(self, point: Height, move: np.ndarray) -> Height:
        self.moves += 1
        return Parabola(point.x + float(move[0]))

    def further(self, before: Height, point: Height) -> Height:
        self.tried.append((before.x, point.x))
        return Parabola(2 * point.x - before.x)

    def model(self, point: Height, neighbour: "Stiffly | None") -> "Stiffly":
        self.models.append(neighbour is not None)
        return Stiffly(point.x, self.times, stale=neighbour is not None)


class Parabola(Height):
    @property
    def objective(self) -> float:
        return self.x**2 / 2


class Stiffly:
    def __init__(self, x: float, times: float, *, stale: bool) -> None:
        self.x, self.stale, self.times = x, stale, times
        self.promised = x**2 / self.times / 2

    def step(self, damping: float) -> tuple[np.ndarray, float]:
        return np.array([-self.x / self.times]), self.promised


def test_where_each_step_is_nearly_as_good_as_the_last_the_way_is_tried_again() -> None:
    """Twice as far each time as it leads down; models are new then, for taken over ones may be why."""
    settings = DescentSettings(Damping(first=0.0), enough=1e-6, most_trials=500, renewal=0.1)
    slow, fast = Stiff(), Stiff()
    assert descend(slow, Parabola(1.0), settings).ending == "converged"
    end = descend(fast, Parabola(1.0), settings, further=fast.further)
    assert end.ending == "converged"
    assert fast.moves + len(fast.tried) < slow.moves / 2
    three = 0.95**3
    assert fast.tried[0] == (1.0, pytest.approx(three))
    assert fast.tried[1] == (1.0, pytest.approx(2 * three - 1.0)), "twice as far"
    assert len(fast.tried) < 2 * fast.moves / 3 + 1, "twice at most behind three steps"
    assert fast.models[:4] == [False, True, True, False]


def test_a_descent_that_is_not_slow_tries_nothing_further() -> None:
    quick = Stiff(times=1.5)
    end = descend(quick, Parabola(1.0), DescentSettings(Damping(first=0.0), enough=1e-9), further=quick.further)
    assert end.steps > 6
    assert not quick.tried


def test_a_share_counts_of_what_is_above_the_least_that_can_be_left() -> None:
    """A step promises a twentieth of what is left: less than a share of all of it, more than of what is above 0.4."""
    settings = DescentSettings(Damping(first=0.0), 1e-3, 0.06, renewal=0.1)
    assert descend(Stiff(), Parabola(1.0), settings).steps == 0
    assert descend(Stiff(), Parabola(1.0), replace(settings, least=0.4)).steps > 10
