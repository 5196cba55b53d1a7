"""Current loops in closed form: fewer steps, but where an effect wants fine ones, and nowhere mixed."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import levitator
import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.diagnosis import outside, runs
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.problem import FitProblem, Points, batches
from msl_fem.diagnosis.runs import _alike_in_coarse_steps, _simulated_missed
from msl_fem.diagnosis.scores import signatures
from msl_fem.diagnosis.shooting import Shooting
from msl_fem.diagnosis.stretches import Stretches
from msl_fem.diagnosis.unknowns import STEP_OF_AMOUNTS, EffectUnknown, Unknowns
from msl_fem.plant.effects import CATALOGUE, FINE, EffectValues
from msl_fem.prediction import KernelPlant, ModelHypothesis, kernel_plant, run_data
from msl_fem.prediction.hypothesis import closed_form_steps, plant_of_run

RATE = 5e3
DELAY, FRICTION = EffectUnknown("time_delay", "command"), EffectUnknown("coulomb_friction", "force")
LATE_READING, EDDIES = EffectUnknown("time_delay", "position"), EffectUnknown("eddy_currents", "time_constant")


@pytest.fixture(scope="module")
def one_sided() -> Actuator:
    base = levitator.actuator(load_actuator(ROOT / "measurements" / "levitation_rig" / "actuator.toml"))
    drive = base.drive.model_copy(update={"kind": "current", "bandwidth": 2e3})
    return base.model_copy(update={"drive": drive})


def test_a_current_loop_takes_few_steps(one_sided: Actuator) -> None:
    belief = ModelHypothesis(one_sided, levitator.table())
    plant = kernel_plant(belief, rate=RATE)
    assert (closed_form_steps(plant, belief), plant.substeps) == (2, 11)
    assert closed_form_steps(kernel_plant(belief, rate=RATE, ideal_current=True), belief) is None
    servo = ModelHypothesis(load_actuator(ROOT / "geometries" / "fast_tool_servo.toml"), levitator.table())
    plant = kernel_plant(servo, rate=RATE)
    assert (closed_form_steps(plant, servo), plant.substeps) == (1, 6)


def test_what_changes_a_loop_or_its_target_wants_more_steps_at_nothing_too() -> None:
    wants = {name for name, effect in CATALOGUE.items() if effect.steps == FINE}
    assert {"amplifier_bandwidth", "structural_mode", "time_delay"} <= wants
    assert {name for name, effect in CATALOGUE.items() if effect.steps == 2} == {"eddy_currents"}
    assert wants.isdisjoint(
        {"coulomb_friction", "early_saturation", "leakage_inductance", "magnetic_hysteresis", "mutual_inductance"}
    )
    for one, times in ((DELAY, FINE), (LATE_READING, 1), (EDDIES, 2), (FRICTION, 1)):
        points = Points.of(Unknowns((), 0, (), (one,)), np.zeros((2, 1)))
        assert points.wanted.tolist() == [times, times]
        believed = Unknowns((), 0, (), fixed=((one.place, 1e-5),))
        assert Points.of(believed, np.zeros((1, 0))).wanted.tolist() == [times]
    both = Points.of(Unknowns((), 0, (), (EDDIES, FRICTION)), np.zeros((1, 2)))
    assert both.wanted.tolist() == [2]


@pytest.mark.parametrize(
    ("bandwidth", "coarse", "steps"),
    [(1e4, 1, (1, 2, 11)), (4e3, 1, (1, 11, 11)), (1e4, 3, (3, 11, 11)), (1e5, 6, (6, 11, 11)), (1e4, None, (11,) * 3)],
)
def test_more_steps_are_coarse_ones_as_long_as_the_loop_is_fast(
    bandwidth: float, coarse: int | None, steps: tuple[int, ...]
) -> None:
    """Against half a step: at 5 kHz that is 2500 rad/s for each step a sample."""
    plant = SimpleNamespace(parameters=SimpleNamespace(bandwidth=bandwidth), rate=RATE)
    problem = FitProblem(plant, (), (), (), None, coarse=coarse)  # type: ignore[arg-type]
    assert tuple(problem.steps(11, times) for times in (1, 2, FINE)) == steps


def test_rows_of_different_steps_are_in_groups_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("msl_fem.diagnosis.problem._lane_settings", lambda *_: (None, None, None))
    monkeypatch.setattr("msl_fem.diagnosis.problem.told_apart", lambda *_, **more: np.arange(3))
    problem = FitProblem(None, (SimpleNamespace(rate=RATE),), (), (), None, coarse=2)  # type: ignore[arg-type]
    times = np.array([FINE, 1, FINE, 1, 1, 8])  # of 2 and 11 steps
    points = Points(Unknowns((), 0, ()), np.zeros((6, 0)), None, times)
    groups = batches(problem, points, 0, substeps=11)
    assert [group.tolist() for group in groups] == [[1, 3, 4], [0, 2, 5]]


@pytest.mark.parametrize(("coarse", "times", "steps"), [(2, 1, 2), (2, FINE, 11), (None, 1, 11)])
def test_functions_of_one_variable_are_looked_for_in_the_steps_of_the_fit(
    one_sided: Actuator, monkeypatch: pytest.MonkeyPatch, coarse: int | None, times: int, steps: int
) -> None:
    belief = ModelHypothesis(one_sided, levitator.table())
    seen: list[int] = []

    def trajectory(plant: KernelPlant, *_: object) -> SimpleNamespace:
        seen.append(plant.substeps)
        return SimpleNamespace(out=np.array([np.nan]))

    monkeypatch.setattr(outside, "plant_of_run", lambda *_: kernel_plant(belief, rate=RATE))
    monkeypatch.setattr(outside, "_Trajectory", trajectory)
    problem = FitProblem(None, (None,), (), (), None, coarse=coarse)  # type: ignore[arg-type]
    likelihood: Any = SimpleNamespace(problem=problem)
    found: Any = SimpleNamespace(unknowns=SimpleNamespace(times_steps=times))
    assert outside.dependences(likelihood, found, belief) == []
    assert seen == [steps]


@pytest.mark.parametrize(
    ("count", "threads", "groups"),
    [
        (8, 2, [8]),
        (3, 1, [3]),
        (1, 2, [1]),
        (3, 2, [3]),  # by all threads, in segments where there are such
        (5, 2, [5]),
        (11, 2, [8, 3]),  # beside the eight of the other thread
        (18, 2, [8, 8, 1, 1]),
        (19, 2, [8, 8, 3]),  # which cost less in a block than two by themselves
        (19, 3, [8, 8, 3]),
    ],
)
def test_runs_left_over_are_shared_among_threads_that_have_nothing_else(
    monkeypatch: pytest.MonkeyPatch, count: int, threads: int, groups: list[int]
) -> None:
    monkeypatch.setattr("msl_fem.diagnosis.problem._lane_settings", lambda *_: (None, None, None))
    monkeypatch.setattr("msl_fem.diagnosis.problem.told_apart", lambda *_, **more: np.arange(count))
    problem = FitProblem(None, (SimpleNamespace(rate=RATE),), (), (), None)  # type: ignore[arg-type]
    points = Points(Unknowns((), 0, ()), np.zeros((count, 0)), None)
    found = batches(problem, points, 0, substeps=11, threads=threads)
    assert [group.size for group in found] == groups
    assert np.sort(np.concatenate(found)).tolist() == list(range(count))


def scoring(spectra: Callable[[Points], np.ndarray]) -> SimpleNamespace:
    """A likelihood of 2 coarse or 11 fine steps that tells these spectra."""
    return SimpleNamespace(threads=1, spectra=spectra, steps=lambda times: 2 if times == 1 else 11)


def test_differences_are_of_equal_steps() -> None:
    """Of a likelihood whose numbers are by 1000 larger in fine steps."""

    def spectra(points: Points) -> np.ndarray:
        assert points.effects is not None
        amounts = [STEP_OF_AMOUNTS * (row[one.place] != 0) for row in points.effects for one in (DELAY, FRICTION)]
        return np.array(amounts).reshape(-1, 2) + 1000.0 * (points.wanted[:, None] > 1)

    unknowns = Unknowns((), 0, ())
    found: Any = SimpleNamespace(unknowns=unknowns, z=np.zeros(0), residual=np.zeros(2), likelihood=scoring(spectra))
    columns = signatures(found, [(DELAY, ()), (FRICTION, ())])
    assert columns == pytest.approx(np.eye(2), abs=1e-5)


@dataclass(frozen=True)
class Stepped:
    """A likelihood of one number, which coarse and fine steps miss by these."""

    coarse: float
    fine: float
    substeps: int = 11
    problem: Any = field(default_factory=lambda: SimpleNamespace(coarse=2))

    def spectra(self, points: Points) -> np.ndarray:
        left = self.coarse if points.times is not None else self.fine if self.substeps == 11 else 0.0
        return np.array([[left]])


@pytest.mark.parametrize(
    ("coarse", "fine", "alike"),
    [
        (0.1, 0.0, True),
        (1.0, 0.1, False),
        (1.0, 0.6, False),
        (1.0, 0.8, True),
        (1.0, 2.0, True),
        (np.nan, 0.1, False),
        (1.0, np.nan, False),
    ],
)
def test_coarse_steps_are_taken_where_the_belief_is_that_of_far_finer_ones(
    coarse: float, fine: float, alike: bool
) -> None:
    stepped: Any = Stepped(coarse, fine)
    assert _alike_in_coarse_steps(stepped, Unknowns((), 0, ()), np.zeros(0)) == alike


def test_the_steps_of_stretches_chosen_anew_are_asked_for_where_the_fit_is(
    one_sided: Actuator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The belief may leave the table where the fit does not; runs that were alike in coarse steps there are so here."""
    base = load_actuator(ROOT / "measurements" / "levitation_rig" / "actuator.toml")
    record = levitator.record(base, levitator.Truth(mass=1.05), seconds=0.3)
    belief = ModelHypothesis(levitator.actuator(base), levitator.table())
    asked: list[np.ndarray] = []
    monkeypatch.setattr(runs, "_alike_in_coarse_steps", lambda likelihood, unknowns, z: asked.append(z) or True)
    kind = runs.dynamic_runs(record, belief, [run_data(record, record.runs[0])])
    found = fit(kind.likelihood, kind.unknowns, np.zeros(kind.unknowns.size), plan=FitPlan(most_steps=4))
    kind.renewed(found)
    believed = len(kind.unknowns.believed)
    assert np.any(found.z[:believed])
    assert [z[:believed].tolist() for z in asked] == [[0.0] * believed, found.z[:believed].tolist()]
    asked.clear()
    problem = replace(kind.likelihood.problem, coarse=1)
    alike = replace(kind, likelihood=replace(kind.likelihood, problem=problem))
    alike.renewed(found)
    alike.begun(lambda _: None)
    assert asked == []


@pytest.mark.parametrize(
    ("effects", "steps"),
    [
        (None, 2),
        (EffectValues({"time_delay": {"command": 1e-4}}), 11),
        (EffectValues({"time_delay": {"position": 1e-4}}), 2),
        (EffectValues({"force_offset": {"force": 1e-4}}), 2),
        (EffectValues({"structural_mode": {"mass_share": 0.01, "frequency": 90.0}}), 2),
        (EffectValues({"structural_mode": {"mass_share": 0.01, "frequency": 110.0}}), 4),
    ],
)
def test_what_a_model_misses_on_a_run_is_told_in_the_steps_that_its_effects_want(
    one_sided: Actuator, effects: EffectValues | None, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An extended model has its effects in the plant, and nothing is unknown of it."""
    base = load_actuator(ROOT / "measurements" / "levitation_rig" / "actuator.toml")
    record = levitator.record(base, levitator.Truth(), seconds=0.5)
    voltages = run_data(record, record.runs[0])
    currents = np.column_stack([voltages.measured["current_1_A"], np.zeros(len(voltages.commands))])
    belief = ModelHypothesis(one_sided, levitator.table(), effects)
    cut = Stretches(np.arange(0, 960, 32), np.tile([[0.0, 0.0, 0.0, 0.0]], (30, 1)), ())
    asked = []
    monkeypatch.setattr(Shooting, "followed", lambda shot, cut: asked.append(shot.problem.coarse) or {})
    monkeypatch.setattr(runs, "plant_of_run", lambda *of: replace(plant_of_run(*of), substeps=11))
    _simulated_missed(belief, replace(voltages, commands=currents), cut, record.tolerance, coarse=2)
    assert asked == [steps]


@pytest.mark.parametrize(("frequency", "times"), [(99.0, 1), (101.0, 2), (301.0, 4)])
def test_what_turns_faster_wants_more_steps(frequency: float, times: int) -> None:
    """Searched for, scored or believed, by where its frequency begins."""
    mode, share = (
        EffectUnknown("structural_mode", "frequency", frequency, 0.15),
        EffectUnknown("structural_mode", "mass_share"),
    )
    slow = Unknowns((), 0, (), slow=100.0)
    assert replace(slow, effects=(share, mode)).times_steps == times
    assert replace(slow, effects=(share, mode, DELAY)).times_steps == FINE
    assert replace(slow, fixed=((mode.place, frequency), (share.place, 0.01))).times_steps == times
    assert Unknowns((), 0, (), (share, mode)).times_steps == FINE
    asked: list[list[int]] = []

    def spectra(points: Points) -> np.ndarray:
        asked.append(points.wanted.tolist())
        return np.zeros((len(points.rows), 1))

    found: Any = SimpleNamespace(unknowns=slow, z=np.zeros(0), residual=np.zeros(1), likelihood=scoring(spectra))
    signatures(found, [(share, (mode,)), (FRICTION, ()), (DELAY, ())])
    assert asked == ([[1, 1], [FINE] * 2] if times == 1 else [[1], [FINE] * 3]), "the fit first, and alike together"


def test_coarse_steps_are_those_in_which_a_turn_takes_forty(one_sided: Actuator) -> None:
    plant = kernel_plant(ModelHypothesis(one_sided, levitator.table()), rate=RATE)
    assert runs.slow_turns(plant, 2) == 250.0
    assert runs.slow_turns(plant, None) == 0.0
