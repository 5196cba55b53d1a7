"""The linear laws of rig.toml: what they compute, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from small_record import RIG, columns, make

from msl_fem.errors import RecordError
from msl_fem.record import PidLaw, StatedLaw, StateSpaceLaw, linear_laws, load_record, write_record

ROOT = Path(__file__).parent.parent.parent
PID = {"kind": "pid", "outputs": ["command_1_A"], "kp": "20 A/mm", "ki": "3e5 A/m/s", "kd": "40 A s/m"}


@pytest.fixture(autouse=True)
def _in_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT / "tests")


def answer(law: StatedLaw, readings: np.ndarray, *, period: float) -> np.ndarray:
    """What a law makes of readings (n, n_in), (n, n_out)."""
    a, b, c, d = law.matrices(period)
    state, made = np.zeros(len(a)), []
    for y in readings:
        made.append(c @ state + d @ y)
        state = a @ state + b @ y
    return np.array(made)


@pytest.mark.parametrize("lag", [None, "2 ms"])
def test_a_pid_is_its_sum_difference_and_lag(lag: str | None) -> None:
    """Against the law written out, with the error e = -y of a reference of nought."""
    law = linear_laws({"linear": [PID | ({"derivative_time": lag} if lag else {})]})[0]
    y, period = np.random.default_rng(1).standard_normal(60), 4e-4
    e = -y
    slope = np.diff(e, prepend=0.0) / period
    if lag:
        keep, lagged, held = np.exp(-period / 2e-3), [], 0.0
        for one in slope:
            held = keep * held + (1 - keep) * one
            lagged.append(held)
        slope = np.array(lagged)
    wanted = 2e4 * e + 3e5 * period * np.cumsum(e) + 40 * slope
    assert answer(law, y[:, None], period=period)[:, 0] == pytest.approx(wanted, rel=1e-9)


def test_a_pid_of_two_sides_pulls_either_way() -> None:
    law = linear_laws({"linear": [PID | {"outputs": ["command_1_A", "command_2_A"], "signs": [1, -1]}]})[0]
    made = answer(law, np.random.default_rng(1).standard_normal((20, 1)), period=4e-4)
    assert (made[:, 0] == -made[:, 1]).all()
    assert np.abs(made).min() > 0


LAWS = """
[controller]
rate = "10 kHz"
[[controller.linear]]
kind = "state-space"
runs = ["sweep"]
inputs = ["position_m", "current_1_A"]
outputs = ["command_1_A"]
a = [[0.5]]
b = [[1, 0.25]]
c = [[-2e3]]
d = [[-1e4, 0.0]]
[[controller.linear]]
kind = "pid"
outputs = ["command_1_A"]
kp = "20 A/mm"
[[run]]
"""


def commanded(tmp_path: Path, rig: str) -> Path:
    table = columns()
    table |= {f"command_{j}_A": table[f"current_{j}_A"] for j in (1, 2)}
    return make(tmp_path / "r", rig=rig, noise=table, sweep=table)


def test_laws_are_read_run_by_run_and_written(tmp_path: Path) -> None:
    record = load_record(commanded(tmp_path, RIG.replace("[[run]]", LAWS, 1)))
    write_record(record, tmp_path / "again")
    for read in (record, load_record(tmp_path / "again")):
        sweep, noise = read.law_of("sweep"), read.law_of("noise")
        assert isinstance(sweep, StateSpaceLaw)
        assert isinstance(noise, PidLaw)
        assert [m.tolist() for m in sweep.matrices(1e-4)] == [[[0.5]], [[1, 0.25]], [[-2e3]], [[-1e4, 0]]]
    assert load_record(make(tmp_path / "plain")).law_of("noise") is None


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('kind = "pid"', 'kind = "fuzzy"', "controller.linear.1.kind: 'fuzzy' is no law; there are state-space, pid"),
        ('kp = "20 A/mm"', 'kp = "20 V/mm"', "controller.linear.1.kp: unit 'V/mm' has the wrong dimension"),
        ('kp = "20 A/mm"', "kp = 20", "controller.linear.1.kp: 20 has no unit"),
        ('kp = "20 A/mm"', "", "controller.linear.1.kp: is missing"),
        ('kp = "20 A/mm"', 'kp = "1 A/m"\ngain = "2"', "controller.linear.1.gain: unknown key"),
        ('kp = "20 A/mm"', 'kp = "1 A/m"\nsigns = [1, 1]', "controller.linear.1.signs: 2 numbers for 1 outputs"),
        ("a = [[0.5]]", "a = [[0.5, 1.0]]", "controller.linear.0.a: is not 1 rows of 1 numbers"),
        ("d = [[-1e4, 0.0]]", "d = [[-1e4]]", "controller.linear.0.d: is not 1 rows of 2 numbers"),
        ("d = [[-1e4, 0.0]]", "d = [[-1e4, nan]]", "controller.linear.0.d: a number is not finite"),
        ('runs = ["sweep"]', 'runs = ["noise", "late"]', "controller.linear.0.runs: no run 'late' in the record"),
        ('"current_1_A"]', '"voltage_1_V"]', "controller.linear.0.inputs: 'voltage_1_V' is not read"),
        ('["command_1_A"]', '["voltage_3_V"]', "controller.linear.0.outputs: 'voltage_3_V' drives nothing"),
        ('outputs = ["command_1_A"]', 'outputs = ["force_N"]', "run sweep has no column force_N"),
        ("[[controller.linear]]", "[controller.linear]", "controller.linear: is no list of laws"),
    ],
)
def test_what_is_no_law_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    laws = LAWS.replace(old, new, 1)
    if new == "[controller.linear]":
        laws = laws.replace("[[controller.linear]]", "").replace('kind = "pid"\noutputs = ["command_1_A"]\nkp', "kpp")
    with pytest.raises(RecordError) as caught:
        load_record(commanded(tmp_path, RIG.replace("[[run]]", laws, 1)))
    message = str(caught.value)
    assert "\n" not in message
    assert "rig.toml" in message
    assert said.split(":")[0] in message
    assert said.split(": ")[-1] in message
