"""The map's band: seeded, the same in any number of processes, linearised against solved, resumable."""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_magnets import HERE, job, nominal_of

from msl_fem.actuator import Actuator
from msl_fem.computing.jobs import Executor, Workers
from msl_fem.computing.row_cache import RowCache
from msl_fem.design.tolerances.manufactured import NAMES, tolerances_of
from msl_fem.design.tolerances.sensitivity import RowRun, answers, sensitivities
from msl_fem.design.tolerances.study import (
    ToleranceSettings,
    direct_band,
    draw,
    linearised_answers,
    linearised_band,
    tolerance_study,
)
from msl_fem.errors import ComputationError, InputError

GAP = 0.4e-3
JOB = job(nominal_of("fast_tool_servo", GAP), GAP, current=3.0, levels=(1.2,), sections=("centre_leg", "outer_leg"))


@pytest.fixture(scope="module")
def study(servo: Actuator):  # type: ignore[no-untyped-def]
    """(nominal, sensitivities) of the reference actuator at one gap, with the default tolerances."""
    return sensitivities(JOB, tolerances_of(servo), HERE)


def test_deviations_are_seeded_uniform_and_within_their_limits(servo: Actuator) -> None:
    wanted = tolerances_of(servo)
    drawn = draw(wanted, 4000, 7)
    assert drawn == draw(wanted, 4000, 7)
    assert drawn[:100] != draw(wanted, 100, 8)
    assert drawn[:50] == draw(wanted, 50, 7), "the checks are the first of the samples"
    for tolerance in wanted:
        values = np.array([d[tolerance.name] for d in drawn])
        assert np.abs(values).max() <= tolerance.limit
        assert values.std() == pytest.approx(tolerance.limit / np.sqrt(3), rel=0.05)
        assert abs(values.mean()) < 0.05 * tolerance.limit


def test_the_linearised_map_is_the_solved_one(study, servo: Actuator) -> None:  # type: ignore[no-untyped-def]
    """Sample by sample, and so the bands; half a band is about 4 % of the current."""
    nominal, found = study
    wanted = [s.tolerance for s in found]
    direct = answers(JOB, draw(wanted, 12, 3), HERE)
    linear = linearised_answers(nominal, found, draw(wanted, 12, 3), gap=GAP)
    solved = np.stack([row["current"] for row in direct])
    assert linear["current"] == pytest.approx(solved, rel=3e-3)
    assert np.std(solved) > 10 * np.abs(linear["current"] - solved).max()
    assert linear["force"] == pytest.approx(np.array([row["force"] for row in direct]), rel=1.5e-2)
    bands = (
        linearised_band(nominal, found, gap=GAP, samples=12, seed=3),
        direct_band(JOB, wanted, HERE, samples=12, seed=3),
    )
    width = bands[1].high - bands[1].low
    for side in ("low", "high"):
        assert np.abs(getattr(bands[0], side) - getattr(bands[1], side)).max() < 0.05 * width.min()
    assert bands[0].method == "linearised"
    assert bands[1].method == "direct"


def test_one_uniform_deviation_gives_a_band_in_closed_form(study) -> None:  # type: ignore[no-untyped-def]
    """5 and 95 % of a uniform deviation lie at -+0.9 of its limit."""
    nominal, found = study
    gap = next(s for s in found if s.tolerance.name == "gap")
    band = linearised_band(nominal, (gap,), gap=GAP, samples=20_000, seed=2)
    centre, slope = nominal["section_current"][0, 0, 0], gap.current_slope[0, 0, 0]
    half = 0.9 * slope * gap.tolerance.limit
    assert band.low[0, 0] == pytest.approx(centre - half, abs=0.02 * half)
    assert band.high[0, 0] == pytest.approx(centre + half, abs=0.02 * half)
    force = 0.9 * abs(gap.force) * float(nominal["force"]) * gap.tolerance.limit / GAP
    assert band.force == pytest.approx((nominal["force"] - force, nominal["force"] + force), abs=0.02 * force)


def test_each_section_is_linear_where_their_minimum_has_a_kink(study) -> None:  # type: ignore[no-untyped-def]
    """A wider centre leg hands over to the outer ones: one straight line through the nominal map would be far off."""
    nominal, found = study
    off = [dict.fromkeys(NAMES, 0.0) | {"centre_leg_width": d} for d in (-3e-4, 6e-4)]
    solved = [float(row["current"][0, 0]) for row in answers(JOB, off, HERE)]
    linear = linearised_answers(nominal, found, off, gap=GAP)["current"][:, 0, 0]
    assert linear == pytest.approx(np.array(solved), rel=2e-3)
    nominal_current = float(nominal["section_current"].min())
    assert solved[0] < 0.99 * nominal_current
    assert solved[1] < 1.01 * nominal_current, "the outer legs govern"


def test_processes_and_order_do_not_matter(study) -> None:  # type: ignore[no-untyped-def]
    wanted = [s.tolerance for s in study[1]]
    one = direct_band(JOB, wanted, HERE, samples=6, seed=5)
    two = direct_band(JOB, wanted, RowRun(Executor(2)), samples=6, seed=5)
    assert np.array_equal(one.low, two.low)
    assert np.array_equal(one.high, two.high)
    assert one.force == two.force


def test_finished_magnets_are_taken_up_again(tmp_path: Path) -> None:
    """An interrupted run goes on with what is missing, and with nothing else; without resume, all is solved anew."""
    deviations = [{"gap": k * 1e-6} for k in range(4)]
    solved: list[Any] = []

    class Interrupted(Executor):
        @contextlib.contextmanager
        def start(self, job: Any, most: int) -> Iterator[Workers[Any, Any]]:
            with super().start(job, most) as workers:

                def wait(waiting: list[Any]) -> list[Any]:
                    if len(solved) == 2:
                        raise KeyboardInterrupt
                    solved.extend(workers.wait(waiting))
                    return solved[-1:]

                yield replace(workers, wait=wait)

    cache = RowCache(tmp_path / "rows")
    with pytest.raises(KeyboardInterrupt):
        answers(JOB, deviations, RowRun(Interrupted(), cache))
    told: list[tuple[int, int]] = []

    class Counted(Executor):
        def start(self, job: Any, most: int) -> Any:
            told.append((-1, most))
            return super().start(job, most)

    resumed = answers(JOB, deviations, RowRun(Counted(), cache, True, lambda done, total: told.append((done, total))))
    assert told == [(-1, 2), (2, 4), (3, 4), (4, 4)]
    fresh = answers(JOB, deviations, HERE)
    assert [float(r["force"]) for r in resumed] == [float(r["force"]) for r in fresh]
    other = job(nominal_of("fast_tool_servo", GAP), GAP, current=3.1, levels=(1.2,))
    assert other.key != JOB.key, "another question is another job"


def test_a_magnet_that_fails_is_named() -> None:
    with pytest.raises(ComputationError, match=r"centre_leg_width off by -0\.00999.* failed"):
        answers(JOB, [{"centre_leg_width": -9.99e-3}], HERE)


def test_tolerances_come_from_the_call_the_file_or_the_defaults(servo: Actuator) -> None:
    content = servo.model_dump(by_alias=True, exclude_none=True)
    content["tolerances"] = {"gap": 5e-6, "stack_depth": 1e-4}
    stated = Actuator.model_validate(content | {"sources": {"tolerances.gap": "measured"}})
    found = {t.name: t for t in tolerances_of(stated, stated={"stack_depth": 2e-4})}
    assert (found["gap"].limit, found["gap"].source) == (5e-6, "measured")
    assert (found["stack_depth"].limit, found["stack_depth"].source) == (2e-4, "given")
    assert found["centre_leg_width"].limit == pytest.approx(0.1e-3), "ISO 2768-1 f, over 6 up to 30 mm"
    assert found["yoke_thickness"].limit == pytest.approx(0.05e-3), "over 3 up to 6 mm"
    assert all(t.source for t in found.values())
    with pytest.raises(InputError, match="tolerance 'legs' is unknown"):
        tolerances_of(servo, stated={"legs": 1e-4})
    with pytest.raises(InputError, match=r"stacking_factor = 0\.05 is not allowed; it must be 0 \.\.\. 0\.04"):
        tolerances_of(servo, stated={"stacking_factor": 0.05})


def test_the_study_of_the_reference_actuator(servo: Actuator) -> None:
    settings = ToleranceSettings(gaps=(0.3e-3, 0.6e-3), levels=(1.2,), samples=500, checks=3)
    told: list[int] = []
    found = tolerance_study(servo, settings=settings, running=RowRun(progress=lambda done, _: told.append(done)))
    assert found.sections == ("centre_leg", "outer_leg")
    assert found.point[0] == pytest.approx(3.39, abs=0.02)
    assert found.current[0, 1] == pytest.approx(found.point[0], rel=1e-3)
    assert [s.tolerance.name for s in found.sensitivities] == [t.name for t in tolerances_of(servo)]
    assert (found.band.low < found.current).all()
    assert (found.current < found.band.high).all()
    assert found.band.checked == 3
    assert 0 < found.band.linearisation_error < 5e-3
    assert told[-1] == 3


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"gaps": (0.03e-3, 0.6e-3)}, "tolerance gap = 20 µm must be below half the smallest gap, 15 µm"),
        ({"levels": (1.6, 1.2)}, "levels must be positive and increasing"),
        ({"levels": (1.2, 99.0)}, "level 99 T is not allowed"),
        ({"samples": 3}, "samples 3 is not allowed; it must be 20 ..."),
        ({"tolerances": {"gap": -1e-6}}, "tolerance gap"),
    ],
)
def test_what_cannot_be_studied_is_refused(servo: Actuator, settings: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        tolerance_study(servo, settings=ToleranceSettings(**settings))


def test_a_magnet_without_travel_needs_gaps(servo: Actuator) -> None:
    with pytest.raises(InputError, match="give --gaps"):
        tolerance_study(servo.model_copy(update={"motion": None}))
