"""Starts along a row, and when Newton's iteration from a near start ends."""

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.magnetics.field.magnet_field import magnet_mesh
from msl_fem.magnetics.reduced.online import same_way
from msl_fem.magnetics.solver.magnetostatics import FieldSolution, NewtonSettings, expected_error
from msl_fem.magnetics.sweep.predictor import RowPredictor, RowsPredictor
from msl_fem.magnetics.sweep.rows import SweepJob


def solution(potential: np.ndarray) -> FieldSolution:
    return FieldSolution(potential, 0.0, 0.0, ())


def test_two_fields_with_their_slopes_lead_on_along_a_cubic() -> None:
    cubic = np.polynomial.Polynomial([1.0, -2.0, 0.5, 3.0])
    predictor = RowPredictor()
    assert predictor.at(1.0) is None
    predictor.take(7.0, solution(np.array([99.0])), np.array([0.0]))  # older ones do not count
    for current in (1.0, 1.7):
        predictor.take(current, solution(np.array([cubic(current)])), np.array([cubic.deriv()(current)]))
    np.testing.assert_allclose(predictor.at(2.9), [cubic(2.9)], rtol=1e-12)
    predictor.forget()
    assert predictor.at(2.9) is None


def test_the_error_of_a_prediction_goes_with_the_fourth_power_of_the_step() -> None:
    errors = []
    for step in (0.2, 0.1):
        predictor = RowPredictor()
        for current in (1.0, 1.0 + step):
            predictor.take(current, solution(np.array([np.exp(current)])), np.array([np.exp(current)]))
        predicted = predictor.at(1.0 + 2 * step)
        assert predicted is not None
        errors.append(abs(float(predicted[0]) - np.exp(1.0 + 2 * step)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.4)


def test_what_a_prediction_missed_in_the_row_before_is_added() -> None:
    """A = exp(j) + 3 i: every row's prediction misses the same, and the first field of a row follows by its slope."""
    rows, currents = RowsPredictor(), (0.0, -0.3, 0.5, -0.8, 1.1)
    for n, current_1 in enumerate((0.0, 0.4, 1.0)):
        rows.begin(current_1)
        for current in currents:
            exact, expected = np.exp(current) + 3 * current_1, rows.at(current)
            if n:
                assert expected == pytest.approx(exact, abs=1e-12)
            elif expected is not None:
                assert abs(expected - exact) > 1e-3
            rows.take(current, solution(np.array([exact])), (np.array([3.0]), np.array([np.exp(current)])))
    rows.begin(2.0)
    assert rows.at(7.0) is None


@pytest.mark.parametrize(
    ("trail", "left"),
    [
        ((5e-9,), 5e-9),  # one step tells no more than its size
        ((1.0, 1e-5), 1e-5),  # two from nothing neither
        ((9e-3, 1e-5), 100 * 1e-5 * (1e-5 / 9e-3) ** 2),  # two from a near start do
        ((9e-3, 5e-3), 5e-3),  # if they fall fast
        ((1.0, 1e-2, 1e-5), 10 * 1e-5 * 1e-6),
        ((1e-2, 9e-3, 1e-5), 1e-5),
    ],
)
def test_what_newton_s_steps_tell(trail: tuple[float, ...], left: float) -> None:
    assert expected_error(trail) == pytest.approx(left, rel=1e-12)


@pytest.mark.parametrize("name", ["fast_tool_servo", "pot_core_holding"])
def test_what_is_expected_to_be_left_is_no_less_than_what_is(name: str) -> None:
    """Iterations that end after two steps, against the step that would follow."""
    actuator = load_actuator(ROOT / "geometries" / f"{name}.toml")
    magnet = actuator.magnet_kind()
    gap = 0.02 * magnet.half_width
    field = SweepJob(magnet, magnet_mesh(magnet, gap), actuator.folder, 2).field()
    predictor, early = RowPredictor(), 0
    for current in 1.6 * 2 * gap / (4e-7 * np.pi * magnet.turns) * np.linspace(0.05, 1, 14):
        done = field.solve(current, gap, start=predictor.at(current))
        predictor.take(current, done, field.slope(done))
        if len(done.trail) == 2:
            early += 1
            residual = field.model.assemble(done.potential, gap)[0] - current * field.model.source
            field.model.tangent.factor(done.tangent)
            follows = float(residual @ field.model.tangent.substitute(residual)) ** 0.5
            left = follows / float(done.potential @ (current * field.model.source)) ** 0.5
            assert left <= expected_error(done.trail) <= NewtonSettings().tolerance
    assert early >= 3


def test_steps_of_currents_along_one_line() -> None:
    first, second = np.array([1.0, 2.0]), np.array([1.5, 1.0])
    assert same_way(first, second, second + 0.7 * (second - first)) == pytest.approx(0.7)
    assert same_way(first, second, second - 0.7 * (second - first)) == 0.0
    assert same_way(first, second, second + np.array([0.1, 0.1])) == 0.0
    assert same_way(first, first, second) == 0.0
