"""A mover that is held: its coil's resistance and inductance, and what a probe reads of the current, from such runs."""

from dataclasses import replace

import levitator as coil
import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.comparison import CompareSettings, compare
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.errors import RecordError
from msl_fem.identification import identify
from msl_fem.record import Noise, Record, Run, Sampling, load_record, write_record

N, RATE, RESISTANCE = 3000, 2e3, 1.03 * coil.RESISTANCE
HELD = (2e-3, 5e-3)  # m of position_m
HOW = DiagnosisSettings(table=coil.table())


def held(name: str, role: str, position: float, seed: int, *, crosstalk: float = 0.0) -> Run:
    """Voltage steps on a coil of constant inductance: i' = (u - R i)/L, exact from step to step."""
    rng = np.random.default_rng(seed)
    voltage = np.repeat(rng.uniform(0.5, 6.0, N // 100), 100)
    inductance = coil.L0 + coil.K / (coil.GAP - position + coil.A)
    left, current = np.exp(-RESISTANCE / inductance / RATE), np.zeros(N)
    current[0] = voltage[0] / RESISTANCE
    for n in range(N - 1):
        current[n + 1] = left * current[n] + (1 - left) * voltage[n] / RESISTANCE
    noise = rng.standard_normal((2, N))
    columns = {
        "time_s": np.arange(N) / RATE,
        "voltage_1_V": voltage,
        "current_1_A": current + coil.CURRENT_NOISE * noise[0],
        "position_m": position + crosstalk * current + coil.POSITION_NOISE * noise[1],
    }
    return Run(name, "steps", role, columns, mover="locked")


def record(base: Actuator, *, crosstalk: float = 0.0) -> Record:
    runs = tuple(held(f"held_{n}", ("fit", "held-out")[n], at, n, crosstalk=crosstalk) for n, at in enumerate(HELD))
    noise = Noise(position=coil.POSITION_NOISE, current=coil.CURRENT_NOISE)
    return Record("measured", coil.actuator(base), Sampling(rate=RATE), noise, runs=runs)


@pytest.fixture(scope="module")
def base() -> Actuator:
    return load_actuator(ROOT / "measurements" / "levitation_rig" / "actuator.toml")


def test_a_held_coil_tells_its_resistance(base) -> None:
    """3 % more than stated, within its interval, and no cause is made of it."""
    found = diagnose(record(base), HOW)
    assert (found.verdict, found.names) == ("nothing-found", ())
    told = found.parameters["coil_resistance"]
    assert told.low < RESISTANCE < told.high
    assert told.value > 1.01 * coil.RESISTANCE


def test_a_probe_that_sees_the_current_is_told_where_nothing_moves(base) -> None:
    found = diagnose(record(base, crosstalk=20e-6), HOW)
    assert found.names == ("position_sensor_crosstalk",)
    told = found.causes[0].parameters["per_current_1"]
    assert told.low < 20e-6 < told.high
    assert told.value == pytest.approx(20e-6, rel=0.03)


def test_a_position_that_was_set_and_not_read(base) -> None:
    """One value throughout, a gauge's: the current alone is compared, and no sensor is said to be stuck."""
    whole = record(base)
    runs = []
    for run, position in zip(whole.runs, HELD, strict=True):
        runs.append(replace(run, columns={**run.columns, "position_m": np.full(N, position)}))
    found = diagnose(replace(whole, runs=tuple(runs)), HOW)
    assert found.verdict == "nothing-found"
    assert {one.extended.channel for one in found.accuracy} == {"current_1_A"}
    assert found.parameters["coil_resistance"].value > 1.01 * coil.RESISTANCE


def test_what_follows_a_free_mover_says_that_it_is_locked(base) -> None:
    for command in (lambda one: compare(one, CompareSettings(table=HOW.table)), identify):
        with pytest.raises(RecordError, match="the mover is locked in all runs"):
            command(record(base))


def test_it_is_written_and_read(base, tmp_path) -> None:
    write_record(record(base), tmp_path / "held")
    there = load_record(tmp_path / "held")
    assert [run.mover for run in there.runs] == ["locked", "locked"]
    assert not [told for told in there.warnings if "position_m" in told]
