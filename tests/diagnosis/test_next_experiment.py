"""The next experiment: what separates two effects is preferred, what cannot be seen in motion is asked for at rest."""

from dataclasses import replace

import numpy as np
import pytest

from msl_fem.actuator import Actuator
from msl_fem.diagnosis.next_experiment import DECIDES, Entry, Question, menu, next_experiment, planned
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.runs import prepared_runs
from msl_fem.diagnosis.separation import Hypothesis
from msl_fem.diagnosis.unknowns import EffectUnknown
from msl_fem.plant import NamedRun, bearable_run, simulation_record
from msl_fem.plant.excitation import parse_excitation
from msl_fem.prediction import ModelHypothesis, run_data
from msl_fem.record import Tolerance
from msl_fem.table.magnetic_table import MagneticTable

NOISE = "band-limited-noise:bias=0.5 V,amplitude=0.4 V,band=300 Hz,duration=0.4 s,seed=4"
RATE = 5e3


@pytest.fixture(scope="module")
def question(servo: Actuator, table: MagneticTable) -> Question:
    """A rig in voltage drive that was shaken by noise."""
    assert servo.drive is not None
    drive = servo.drive.model_copy(update={"kind": "voltage", "bandwidth": None})
    actuator = servo.model_copy(update={"drive": drive})
    excitation = parse_excitation(NOISE, unit="V")
    run, _ = bearable_run(actuator, table, excitation, rate=RATE, generator=np.random.default_rng(0))
    record = simulation_record(actuator, [NamedRun("noise", NOISE, "fit", run)])
    belief = ModelHypothesis(actuator, table)
    likelihood, unknowns = prepared_runs(belief, [run_data(record, record.runs[0])], Tolerance())
    return Question(belief, likelihood.problem, unknowns.believed)


def hypothesis(effect: str, name: str, value: float) -> Hypothesis:
    one = EffectUnknown(effect, name)
    return Hypothesis((one,), np.array([one.z_of(value)]))


def some(question: Question, *words: str) -> list[Entry]:
    return [entry for entry in menu(question) if entry.words in ("the same again", *words)]


DELAY_AND_LAG = (
    hypothesis("time_delay", "command", 4e-5),
    hypothesis("amplifier_bandwidth", "lag", 4e-5),
)


def test_delay_and_lag_are_alike_in_first_order_and_what_separates_them_better_is_preferred(question: Question) -> None:
    """exp(-s T) and 1/(1 + s T) differ by (s T)^2/2 and beyond: d^2 goes with T^4 or more, where mass and damping take
    part of it, and with the square of the amplitude; both sides driven alike do not move the mover at all."""
    entries = some(question, "half the amplitude", "one and a half times the amplitude", "common drive")
    found = next_experiment(question, *DELAY_AND_LAG, entries=entries)
    d2 = {option.words: option.noncentrality for option in found.options}
    again = d2["the same again"]
    assert found.options[0].words == "one and a half times the amplitude"
    assert d2["one and a half times the amplitude"] == pytest.approx(1.5**2 * again, rel=0.1)
    assert d2["half the amplitude"] == pytest.approx(again / 4, rel=0.15)
    assert d2["common drive"] < 0.05 * again
    assert "amplitude=600 mV" in found.text
    plan, _ = planned(question, some(question)[0].excitation)
    sizes = [plan.distance(DELAY_AND_LAG[0].scaled(s), DELAY_AND_LAG[1].scaled(s)) for s in (4.0, 2.0)]
    assert 3.7 < np.log2(sizes[0] / sizes[1]) < 6.0


def test_the_size_from_which_it_decides_is_where_the_noncentrality_is_enough(question: Question) -> None:
    found = next_experiment(question, *DELAY_AND_LAG, entries=some(question))
    share = found.decides_from
    plan, _ = planned(question, some(question)[0].excitation)
    there = plan.distance(DELAY_AND_LAG[0].scaled(share), DELAY_AND_LAG[1].scaled(share))
    assert there == pytest.approx(DECIDES, rel=0.35)
    assert found.amount[0] == "command"
    assert found.amount[1] == pytest.approx(4e-5 * share, rel=1e-6)
    assert found.decides == (share <= 1)


def test_what_differs_in_first_order_is_far_apart_and_an_effect_is_not_apart_from_itself(question: Question) -> None:
    delay = hypothesis("time_delay", "command", 4e-5)
    plan, _ = planned(question, some(question)[0].excitation)
    assert plan.distance(delay, delay) < 1e-3
    hum = hypothesis("position_sensor_lag", "lag", 4e-5)
    assert plan.distance(delay, hum) > 20 * plan.distance(delay, hypothesis("amplifier_bandwidth", "lag", 4e-5))


def test_what_a_rival_leaves_does_not_depend_on_where_its_fit_begins(question: Question) -> None:
    """By another route: the lag at amounts in a row, what is uncertain fitted linearly to each; the least of these."""
    delay, lag = DELAY_AND_LAG
    plan, _ = planned(question, some(question)[0].excitation)

    def numbers(one: Hypothesis) -> np.ndarray:
        z = np.concatenate([np.zeros(plan.plain.size), one.z])[None]
        return plan.likelihood.spectra(Points.of(replace(plan.plain, effects=one.effects), z))[0]

    columns, root = plan.nuisance, np.sqrt(plan.weight)
    weighted, target = np.vstack([root * columns, np.eye(columns.shape[1])]), numbers(delay)
    left = []
    for share in np.linspace(0.9, 1.1, 9):
        away = np.append(root * (numbers(lag.scaled(share)) - target), np.zeros(columns.shape[1]))
        left.append(float(np.sum((away - weighted @ np.linalg.lstsq(weighted, away, rcond=None)[0]) ** 2)))
    distance = plan.distance(delay, lag)
    assert min(left) == pytest.approx(distance, rel=0.1)
    far = Hypothesis(lag.effects, 3 * lag.z, np.full(len(question.believed), 5.0))
    assert plan.distance(replace(delay, beside=np.zeros(far.beside.size)), far) == pytest.approx(distance, rel=0.03)


def test_a_gauge_is_told_to_need_a_number_at_rest(question: Question) -> None:
    """Depth and sensor gain are one gauge with mass, stiffness and gap (lambda ~ s, x ~ 1/s): in motion only the
    tolerances tell them apart, whatever the amplitude; a gauge block, a force at rest or the mover's weight does."""
    pair = (
        hypothesis("fringing", "depth_error", 0.0135),
        hypothesis("position_sensor_nonlinearity", "gain_error", -0.0135),
    )
    of_the_rig = tuple((name, sigma) for name, sigma in question.believed if name in Tolerance.OF_THE_RIG)
    question = replace(question, believed=of_the_rig)  # instruments known exactly: theirs are gauges of their own
    found = next_experiment(question, *pair, entries=some(question, "one and a half times the amplitude"))
    at_rest = [o.noncentrality for o in found.options[:3]]
    assert all("beside" in o.words and "resistance" not in o.words for o in found.options[:3])
    assert min(at_rest) > DECIDES
    assert found.decides
    moving = {o.words: o.noncentrality for o in found.options[3:]}
    assert max(moving.values()) < DECIDES
    assert moving["one and a half times the amplitude"] < 1.15 * moving["the same again"]
    assert found.options[0].words in found.text


def test_a_menu_entry_that_the_rig_does_not_bear_is_left_out(question: Question) -> None:
    too_much = parse_excitation("sine:channel=1,frequency=60 Hz,amplitude=5 kV,duration=0.1 s", unit="V")
    entries = [Entry("too much", too_much), *some(question)]
    found = next_experiment(question, *DELAY_AND_LAG, entries=entries)
    assert "too much" not in [option.words for option in found.options]
    assert len(found.options) == 5
