"""Copies, look-ups, exchanged and reversed labels are told in made-up data; clean data of the make raise no doubt."""

import numpy as np
import pytest

from msl_fem.actuator import parse_actuator
from msl_fem.record import Run
from msl_fem.record.doubts import affine_copies, coarse, looked_up, piled_up, resistance_told, too_slow
from msl_fem.record.label_doubts import contradicted_labels, copied_blocks, doubtful_table, exchanged_labels
from msl_fem.record.plausibility import doubtful_channels

N = 2000
T = np.arange(N) * 1e-3


@pytest.fixture(params=[1, 2, 3])
def rng(request):
    return np.random.default_rng(request.param)


def signals(rng):
    """A coil's current and a position, each with noise of its own, written to seven digits."""
    current = 1 + 0.3 * np.sin(9 * T) + rng.normal(0, 1e-3, N)
    position = 1e-3 * np.sin(7 * T) + rng.normal(0, 1e-6, N)
    return {"i": np.round(current, 6), "x": np.round(position, 9)}


@pytest.mark.parametrize("digits", [4, 9])
def test_a_copy_in_another_unit_is_told(rng, digits) -> None:
    columns = signals(rng)
    columns["u"] = np.round(4.2 * columns["i"] - 1.7, digits)
    (doubt,) = affine_copies(columns)
    assert doubt.startswith("u is 4.2 i -1.7 in every row: a copy of i") or digits == 4
    columns["u"] = columns["u"] + rng.normal(0, 1e-3, N)
    assert affine_copies(columns) == []


def test_a_column_of_next_to_nothing_is_no_copy(rng) -> None:
    """No line can be laid through numbers whose squares are 0; a damaged file has them."""
    columns = signals(rng)
    columns = {"u": columns["i"] * 1e-310, **columns}
    assert affine_copies(columns) == []


@pytest.mark.filterwarnings("error")
def test_a_column_that_hardly_moves_from_a_large_value_is_compared_without_a_word(rng) -> None:
    columns = signals(rng)
    steps = np.arange(N) % 5 * 2.0**-20
    assert affine_copies({"far": 1e9 + steps, **columns}) == []


def test_few_levels_on_both_sides_are_no_copy(rng) -> None:
    """Two sensors of the same motion that round to a few steps: nothing is proved."""
    motion = 3 * np.sin(0.1 * np.arange(400))
    columns = {name: np.round(motion + rng.normal(0, 0.05, 400)) for name in ("a", "b")}
    assert np.ptp(columns["a"] - columns["b"]) > 0
    assert affine_copies(columns) == []


def test_a_look_up_of_another_column_is_told(rng) -> None:
    counts = np.round(40 + 30 * np.sin(3 * T) + rng.normal(0, 1, N))
    columns = {"counts": counts, "x": 1e-3 / (counts + 5)}
    assert any("x has one value for each" in doubt for doubt in looked_up(columns))
    columns["x"] = columns["x"] * (1 + rng.normal(0, 1e-4, N))
    assert looked_up(columns) == []
    clipped = np.maximum(columns["x"], np.quantile(columns["x"], 0.2))
    assert any("stands at its least value" in doubt for doubt in piled_up({"x": clipped}))
    assert piled_up(signals(rng)) == []


def test_coarse_and_slow_samples_are_told(rng) -> None:
    assert coarse({"x": np.round(20 * np.sin(T))})
    assert coarse(signals(rng)) == []
    slow = np.sin(2 * np.pi * 0.47 * np.arange(500)) + rng.normal(0, 0.1, 500)
    assert too_slow({"x": slow})
    assert too_slow(signals(rng)) == []


def readings(rng, noise=0.05):
    """Readings v0, v1 over 11 positions, 9 on-times and 4 temperatures, of a law of their own."""
    grid = np.meshgrid([20.0, 25.0, 30.0, 40.0], np.linspace(0, 5e-3, 11), np.linspace(1e-3, 9e-3, 9), indexing="ij")
    temperature, position, on_time = (axis.ravel() for axis in grid)
    rise = 1 - np.exp(-on_time / (2e-3 + 0.5 * position))
    v0 = 500 * rise * (1 - 0.004 * (temperature - 20)) + 40 * position / 5e-3
    v1 = v0 + 90 * (1 - position / 8e-3)
    labels = {"temperature": temperature, "position": position, "on_time": on_time}
    return labels, {n: np.round(v + rng.normal(0, noise, v.size), 1) for n, v in (("v0", v0), ("v1", v1))}


def test_a_clean_table_raises_no_doubt(rng) -> None:
    assert doubtful_table(*readings(rng)) == []


def test_a_copied_block_is_told(rng) -> None:
    labels, measured = readings(rng)
    for values in measured.values():
        values[45:54] = values[36:45]
    (doubt,) = copied_blocks(labels, measured)
    assert doubt == "rows 36 to 44 and 45 to 53 are equal in every digit (position 0.002 and 0.0025)"


def test_coarse_readings_that_repeat_are_no_copy(rng) -> None:
    """Of readings with few digits, some rows in a row agree by chance."""
    labels, measured = readings(rng)
    assert copied_blocks(labels, {name: np.round(v / 40) for name, v in measured.items()}) == []


def test_two_neighbours_that_noise_exchanges_are_no_wrong_labels(rng) -> None:
    """Readings that hardly rise from the fourth on-time to the fifth fall there in half of the blocks."""
    labels, measured = readings(rng)
    on_times = np.unique(labels["on_time"])
    fourth, fifth = (labels["on_time"] == on_times[k] for k in (3, 4))
    for values in measured.values():
        values[fifth] = values[fourth] + rng.normal(0, 1.0, fourth.sum()).round(1)
    assert exchanged_labels(labels, measured) == []


def test_exchanged_labels_are_told(rng) -> None:
    labels, measured = readings(rng)
    on_time = labels["on_time"]
    second, fifth = (np.isclose(on_time, value) for value in (2e-3, 5e-3))
    on_time[second], on_time[fifth] = 5e-3, 2e-3
    doubts = exchanged_labels(labels, measured)
    assert doubts
    assert all("on_time" in doubt and "0.002 and 0.005 are exchanged" in doubt for doubt in doubts)


@pytest.mark.parametrize("level", [20.0, 30.0, 40.0])
def test_labels_that_run_backwards_at_one_level_are_told(rng, level) -> None:
    labels, measured = readings(rng)
    there = labels["temperature"] == level
    labels["position"][there] = 5e-3 - labels["position"][there]
    doubts = contradicted_labels(labels, measured)
    assert any(doubt.startswith(f"where temperature is {level:g}, readings contradict") for doubt in doubts)
    assert all(doubt.startswith("where temperature") for doubt in doubts)


def test_another_curve_at_one_level_is_no_contradiction(rng) -> None:
    """A coil that is twice as slow at one temperature, and one whose readings turn their sense at short on-times."""
    labels, measured = readings(rng)
    slow = labels["temperature"] == 30.0
    measured["v0"][slow] = measured["v0"][slow] * np.tanh(labels["on_time"][slow] / 4e-3)
    short = labels["on_time"] == 1e-3
    measured["v1"][short] = 900 - measured["v1"][short]
    assert contradicted_labels(labels, measured) == []


def coil(voltage_of, resistance="4 ohm"):
    actuator = parse_actuator(
        {"schema": 1, "name": "coil", "motion": {"moving_mass": "1 kg", "nominal_gap": "4 mm"},
         "drive": {"kind": "voltage", "coil_resistance": resistance}, "magnet": {"kind": "table", "table": "none.nc"},
         "sides": {"count": 1, "magnets_per_side": 1}}
    )  # fmt: skip
    rng = np.random.default_rng(5)
    current = 1 + 0.5 * np.sin(20 * T) + 0.2 * np.sin(90 * T)
    columns = {"time_s": T, "voltage_1_V": voltage_of(current), "current_1_A": current + rng.normal(0, 1e-3, N),
               "position_m": 1e-3 * np.sin(7 * T) + rng.normal(0, 1e-6, N)}  # fmt: skip
    return Run("run", "", "fit", columns), actuator


@pytest.mark.parametrize("inductance", [0.01, 0.2])
def test_voltage_and_current_tell_the_resistance(inductance) -> None:
    def voltage(current):
        return 4 * current + inductance * np.gradient(current, 1e-3)

    run, actuator = coil(voltage)
    assert resistance_told(run["voltage_1_V"], run["current_1_A"], 1e-3) == pytest.approx(4.0, rel=0.02)
    assert doubtful_channels(run, actuator, file="run.csv") == []
    turned, actuator = coil(lambda current: -voltage(current))
    (doubt,) = doubtful_channels(turned, actuator, file="run.csv")
    assert "voltage_1_V and current_1_A cannot both be true: together they tell a resistance of -4 ohm" in doubt
    (doubt,) = doubtful_channels(run, coil(voltage, "40 mohm")[1], file="run.csv")
    assert "where 0.04 ohm is stated" in doubt


def test_a_short_stretch_that_chance_repeats_is_no_copy(rng) -> None:
    """Five rows in a row that agree have to be less likely than 1 in a million over all pairs of 400 rows: 37.3 bits.

    Of 100 levels a row agrees with 6.6 bits in the mean, of 1000 with 7.6 or more: 33 bits, and 38 or more.
    """
    labels = {"x": np.arange(400.0)}
    for levels, doubted in ((100, False), (1000, True)):
        v = rng.integers(0, levels, 400).astype(float)
        v[105:110] = v[5:10]
        doubts = copied_blocks(labels, {"v": v})
        assert (doubts == ["rows 5 to 9 and 105 to 109 are equal in every digit (x 5 and 105)"]) is doubted


def backwards(rng, factor=1.0):
    """A table whose positions run backwards at 30 degC, with readings that span `factor` of what they do elsewhere."""
    labels, measured = readings(rng)
    there = labels["temperature"] == 30.0
    labels["position"][there] = 5e-3 - labels["position"][there]
    for values in measured.values():
        for on_time in np.unique(labels["on_time"]):
            at = there & (labels["on_time"] == on_time)
            values[at] = values[at].mean() + factor * (values[at] - values[at].mean())
    return contradicted_labels(labels, measured)


@pytest.mark.parametrize(("factor", "doubted"), [(0.6, True), (1.7, True), (0.4, False), (2.5, False)])
def test_a_wrong_label_leaves_the_span_of_the_readings(rng, factor, doubted) -> None:
    """Readings that span less than half or more than twice what they do elsewhere are other physics."""
    assert bool(backwards(rng, factor)) is doubted


@pytest.mark.parametrize(("bend", "doubted"), [(0.4, False), (-1.0, True)])
def test_labels_told_in_their_own_order_are_another_curve(rng, bend, doubted) -> None:
    """At one temperature the readings stand for (x/X)^0.4, far from the written label but in its order."""
    labels, measured = readings(rng)
    there = labels["temperature"] == 30.0
    share = labels["position"][there] / 5e-3
    turned = share**bend if bend > 0 else 1 - share
    for values in measured.values():
        for on_time in np.unique(labels["on_time"]):
            at = labels["on_time"][there] == on_time
            elsewhere = (labels["temperature"] == 20.0) & (labels["on_time"] == on_time)
            curve = values[elsewhere]
            values[np.flatnonzero(there)[at]] = np.interp(turned[at], np.linspace(0, 1, 11), curve)
    assert bool(contradicted_labels(labels, measured)) is doubted
