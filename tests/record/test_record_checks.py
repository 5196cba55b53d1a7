"""Data that cannot be what they say are refused in their place, doubtful sensors are named with their samples."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from small_record import RATE, columns

from msl_fem.actuator import Actuator, Motion, Sides, parse_actuator
from msl_fem.errors import RecordError
from msl_fem.record.clipping import doubtful_sensors
from msl_fem.record.reader import check_record, check_run
from msl_fem.record.record import Record, Run, Sampling

FILE = Path("r/noise.csv")
FORCE_RIG = parse_actuator(
    {"schema": 1, "name": "cart", "motion": {"moving_mass": "95 kg"}, "drive": {"kind": "force"}}
)


def run_of(table: dict[str, np.ndarray]) -> Run:
    return Run("noise", "noise", "fit", table)


def check(table: dict[str, np.ndarray], actuator: Actuator, *, rate: float = RATE) -> None:
    check_run(run_of(table), actuator, Sampling(rate=rate), file=FILE)


def refused(table: dict[str, np.ndarray], actuator: Actuator, said: str, *, rate: float = RATE) -> None:
    with pytest.raises(RecordError) as caught:
        check(table, actuator, rate=rate)
    assert said in str(caught.value)
    assert str(FILE) in str(caught.value)


def with_drive(actuator: Actuator, kind: str) -> Actuator:
    assert actuator.drive is not None
    return actuator.model_copy(update={"drive": actuator.drive.model_copy(update={"kind": kind})})


def test_a_good_run_passes(servo: Actuator) -> None:
    check(columns(), servo)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["time_s", "current_2_A", "position_m"])
def test_a_value_that_is_not_finite_is_refused(servo: Actuator, name: str, bad: float) -> None:
    table = columns()
    table[name][[17, 500]] = bad
    refused(table, servo, f"noise.csv: row 19 (sample 17), column {name}: ")


def test_fewer_than_1000_samples_are_refused(servo: Actuator) -> None:
    check(columns(1000), servo)
    refused(columns(199), servo, "column time_s: the run has 199 samples, at least 200")


@pytest.mark.parametrize("step", [0.0, -1e-4])
def test_time_that_does_not_increase_is_refused(servo: Actuator, step: float) -> None:
    table = columns()
    table["time_s"][300:] += step - 1e-4
    refused(table, servo, "row 302 (sample 300), column time_s: time does not increase (0.02")


def test_jitter_above_a_hundredth_of_the_period_is_refused(servo: Actuator) -> None:
    table = columns()
    table["time_s"][300:] += 0.9e-6  # 0.9 % of a period
    check(table, servo)
    table["time_s"][300:] += 0.2e-6
    refused(table, servo, "row 302 (sample 300), column time_s: a step of 101.1")


def test_a_lost_sample_is_jitter_and_no_wrong_rate(servo: Actuator) -> None:
    for lost in ([700], range(700, 2000, 30)):  # one; and so many that the mean step is 2 % off
        table = {name: np.delete(values, lost) for name, values in columns(2000).items()}
        refused(table, servo, "row 702 (sample 700), column time_s: a step of 200 µs")


def test_a_rate_that_contradicts_the_time_is_refused(servo: Actuator) -> None:
    check(columns(), servo, rate=RATE * 1.0009)
    refused(
        columns(),
        servo,
        "column time_s: the steps are 10000 Hz, rig.toml states sampling.rate 10011",
        rate=RATE * 1.0011,
    )


def test_a_position_outside_the_gap_is_refused(servo: Actuator) -> None:
    for edge in (0.6e-3, -0.6e-3):
        table = columns()
        table["position_m"][40] = edge
        check(table, servo)
        table["position_m"][40] = edge * 1.001
        refused(table, servo, "row 42 (sample 40), column position_m: ")


def test_one_side_leaves_the_other_direction_open(servo: Actuator) -> None:
    one = servo.model_copy(update={"sides": Sides(count=1, magnets_per_side=2)})
    table = columns()
    table["position_m"][40] = -5e-3
    check(table, one)
    table["position_m"][40] = 0.61e-3
    refused(table, one, "lies outside the mechanical gap, up to 0.6 mm")


def test_without_a_gap_no_position_is_outside(servo: Actuator) -> None:
    table = {"time_s": columns()["time_s"], "position_m": np.linspace(0, 3, 1000), "force_N": np.zeros(1000)}
    check(table, FORCE_RIG)
    stopped = FORCE_RIG.model_copy(update={"motion": Motion(moving_mass=95.0, nominal_gap=2.0)})
    refused(table, stopped, "column position_m")


@pytest.mark.parametrize(
    ("kind", "needed", "redundant"),
    [
        ("current", ["time_s", "position_m", "current_1_A", "current_2_A"], ["voltage_1_V", "voltage_2_V"]),
        ("voltage", ["time_s", "position_m", "voltage_1_V", "voltage_2_V"], ["current_1_A", "current_2_A"]),
    ],
)
def test_columns_are_missing_only_where_the_drive_needs_them(
    servo: Actuator, kind: str, needed: list[str], redundant: list[str]
) -> None:
    actuator = with_drive(servo, kind)
    check({name: values for name, values in columns().items() if name not in redundant}, actuator)
    for name in needed[1:]:
        refused({key: values for key, values in columns().items() if key != name}, actuator, f"column {name}")


def test_a_command_stands_for_a_current_that_was_not_measured(servo: Actuator) -> None:
    table = columns()
    for j in (1, 2):
        table[f"command_{j}_A"] = table.pop(f"current_{j}_A")
    check(table, servo)


def test_a_force_rig_needs_its_force() -> None:
    table = {"time_s": columns()["time_s"], "position_m": columns()["position_m"]}
    refused(table, FORCE_RIG, "row 1: column force_N is missing; the file has time_s, position_m")


def test_columns_of_unequal_length_are_refused() -> None:
    with pytest.raises(RecordError, match=r"column position_m has the shape \(2,\)"):
        Run("noise", "", "fit", {"time_s": np.arange(3.0), "position_m": np.arange(2.0)})
    with pytest.raises(RecordError, match="column time_s is missing"):
        Run("noise", "", "fit", {"position_m": np.arange(2.0)})


def test_a_record_without_rate_or_fit_is_refused(servo: Actuator) -> None:
    good = Record("simulated", servo, Sampling(rate=RATE), runs=(run_of(columns()),))
    check_record(good, rig_file="rig.toml")
    held_out = (dataclasses.replace(good.runs[0], role="held-out"),)
    for change, said in (
        ({"sampling": None}, "sampling: is missing"),
        ({"runs": ()}, 'role "fit"'),
        ({"runs": held_out}, 'role "fit"'),
        ({"runs": good.runs * 2}, "not all different"),
        ({"actuator": servo.model_copy(update={"drive": None})}, r"no \[drive\]"),
    ):
        with pytest.raises(RecordError, match=said):
            check_record(dataclasses.replace(good, **change), rig_file="rig.toml")


def doubts(table: dict[str, np.ndarray], actuator: Actuator) -> list[str]:
    return doubtful_sensors(run_of(table), actuator, file="noise.csv")


def test_good_sensors_are_not_doubted(servo: Actuator) -> None:
    assert doubts(columns(2000), servo) == []


@pytest.mark.parametrize("name", ["position_m", "current_1_A", "voltage_2_V"])
def test_a_stuck_sensor_is_named_with_its_samples(servo: Actuator, name: str) -> None:
    table = columns(2000)
    table[name][500:520] = table[name][500]  # 1 % of the run is still no doubt
    assert doubts(table, servo) == []
    table[name][500:521] = table[name][500]
    (said,) = doubts(table, servo)
    assert f"noise.csv: {name} is stuck or clipped" in said
    assert "samples 500 ... 520" in said


def test_a_clipped_sensor_is_named_with_its_samples(servo: Actuator) -> None:
    """Noise crosses the limit here and there: no stretch is long, and all together are a fifth of the run."""
    table = columns(2000)
    rng = np.random.default_rng(3)
    table["current_1_A"] = np.minimum(0.6 + 0.1 * rng.normal(size=2000), 0.68)
    (said,) = doubts(table, servo)
    first = int(np.argmax(table["current_1_A"] == 0.68))
    assert f"samples {first}" in said
    assert "stretches more up to" in said


@pytest.mark.parametrize("bits", [8, 10, 12])
def test_a_quantised_sine_is_not_clipped(servo: Actuator, bits: int) -> None:
    """The crest of a coarse sine spends percents of the time on its last step, 2.4 times as much as beside it."""
    table = columns(2000)
    steps = 2 ** (bits - 2) + 0.49
    table["position_m"] = 1e-6 * np.round(steps * np.sin(np.arange(2000) * 0.9))
    assert doubts(table, servo) == []


def test_a_standing_command_excuses_a_standing_current(servo: Actuator) -> None:
    table = columns(2000)
    table["current_2_A"][:400] = 0.0
    assert len(doubts(table, servo)) == 1
    table["command_2_A"] = np.where(np.arange(2000) < 400, 0.0, 0.5)
    assert doubts(table, servo) == []
    table["command_2_A"][:400] = np.linspace(0, 0.1, 400)
    assert len(doubts(table, servo)) == 1


def test_inputs_may_stand_still(servo: Actuator) -> None:
    table = columns(2000)
    table["voltage_1_V"][:1000] = 3.0
    assert len(doubts(table, servo)) == 1
    assert doubts(table, with_drive(servo, "voltage")) == []
    cart = {"time_s": table["time_s"], "position_m": table["position_m"], "force_N": np.zeros(2000)}
    assert doubts(cart, FORCE_RIG) == []
