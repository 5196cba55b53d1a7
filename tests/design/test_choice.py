"""The front by its definition, and its picture."""

import io

import numpy as np
import pytest

from msl_fem.design.sizing import EvaluatedTrial, pareto_front
from msl_fem.report.pictures import FrontPoints, draw_front


def trial(number: int, values: tuple[float, ...], *, feasible: bool = True) -> EvaluatedTrial:
    return EvaluatedTrial(number, {}, "solved", feasible, values, {}, (), 3)


def test_front_is_what_nothing_beats() -> None:
    rng = np.random.default_rng(3)
    values = rng.random((60, 3)).round(1)
    trials = [trial(n, tuple(v), feasible=n % 5 > 0) for n, v in enumerate(values.tolist())]
    front = {t.number for t in pareto_front(trials, ("mass", "loss", "force"))}
    costs = values * [1, 1, -1]
    feasible = [n for n in range(60) if n % 5 > 0]
    for n in feasible:  # the slow, obvious way
        beaten = any((costs[m] <= costs[n]).all() and (costs[m] < costs[n]).any() for m in feasible)
        twin = any((costs[m] == costs[n]).all() for m in feasible if m < n)
        assert (n in front) == (not beaten and not twin), n
    assert front <= set(feasible)


def test_front_is_best_first() -> None:
    trials = [trial(0, (2.0, 1.0)), trial(1, (1.0, 2.0)), trial(2, (3.0, 3.0))]
    assert [t.number for t in pareto_front(trials, ("mass", "loss"))] == [1, 0]
    assert [t.number for t in pareto_front(trials, ("force", "loss"))] == [2, 0]
    assert pareto_front([trial(0, (1.0, 1.0), feasible=False)], ("mass", "loss")) == []


@pytest.mark.parametrize("objectives", [["mass"], ["mass", "loss"], ["mass", "loss", "force", "inductance"]])
def test_picture_has_a_frame_for_each_pair(objectives: list[str]) -> None:
    rng = np.random.default_rng(1)
    designs = [{name: float(v) for name, v in zip(objectives, rng.random(4) + 0.1, strict=False)} for _ in range(9)]
    points = FrontPoints(designs[:3], designs[3:6], designs[6:], designs[0], designs[1])
    figure = draw_front(points, objectives, title="front")
    n = len(objectives)
    assert len(figure.axes) == max(1, n * (n - 1) // 2)
    assert {axes.get_xscale() for axes in figure.axes} == {"log"}
    assert max(len(axes.get_lines()) for axes in figure.axes) == 5
    figure.savefig(io.BytesIO(), format="png")
