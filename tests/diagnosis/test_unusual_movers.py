"""Runs in which nothing moves by itself: a magnet on a testing machine, and a coil without its mover."""

from dataclasses import replace

import levitator as coil
import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.without_mover import lone_coil_of, without_absent
from msl_fem.errors import InputError, RecordError
from msl_fem.record import Noise, Record, Run, Sampling, load_record, write_record

RATE, N = 500.0, 6000
FORCE_NOISE, WIDER = 2e-3, 0.6e-3  # N, m
OHM, HENRY = 1.02 * coil.RESISTANCE, 0.031
HOW = DiagnosisSettings(table=coil.table())


@pytest.fixture(scope="module")
def base() -> Actuator:
    return load_actuator(ROOT / "measurements" / "levitation_rig" / "actuator.toml")


def on_a_machine(name: str, role: str, seed: int, *, wider: float) -> Run:
    """A machine moves the ball to and fro under a coil whose current goes up and down; it reads what it pushes with:
    m x'' = F_machine + K i^2/(2 (g + a)^2) - weight."""
    rng, time = np.random.default_rng(seed), np.arange(N) / RATE
    x, acceleration = np.full(N, 3e-3), np.zeros(N)
    for frequency, size in ((0.4, 2e-3), (1.1, 1e-3)):
        w, phase = 2 * np.pi * frequency, rng.uniform(0, 6.28)
        x += size * np.sin(w * time + phase)
        acceleration -= size * w**2 * np.sin(w * time + phase)
    current = 1.0 + 0.6 * np.sin(2 * np.pi * 0.13 * time + seed)
    pull = coil.K * current**2 / 2 / (coil.GAP + wider - x + coil.A) ** 2
    force = coil.MASS * acceleration - pull + coil.WEIGHT
    noise = rng.standard_normal((3, N))
    columns = {
        "time_s": time,
        "current_1_A": current + coil.CURRENT_NOISE * noise[0],
        "position_m": x + coil.POSITION_NOISE * noise[1],
        "force_N": force + FORCE_NOISE * noise[2],
    }
    return Run(name, "sines", role, columns, mover="imposed")


def machine(base: Actuator, *, wider: float = 0.0) -> Record:
    runs = (on_a_machine("a", "fit", 1, wider=wider), on_a_machine("b", "held-out", 2, wider=wider))
    noise = Noise(position=coil.POSITION_NOISE, current=coil.CURRENT_NOISE, force=FORCE_NOISE)
    return Record("measured", coil.actuator(base), Sampling(rate=RATE), noise, runs=runs)


def test_a_magnet_on_a_machine_tells_its_map(base, tmp_path) -> None:
    """As believed nothing is found; with a gap that is wider that is named, its size in its interval; from files."""
    clean = diagnose(machine(base), HOW)
    assert (clean.verdict, clean.names) == ("nothing-found", ())
    assert any("along the imposed motion" in note for note in clean.notes)
    write_record(machine(base, wider=WIDER), tmp_path / "machine")
    found = diagnose(load_record(tmp_path / "machine"), HOW)
    assert found.names == ("gap_offset",)
    told = found.causes[0].parameters["offset"]
    assert told.low < WIDER < told.high
    assert told.value == pytest.approx(WIDER, rel=0.15)


def without_mover(name: str = "coil") -> Run:
    """Voltage steps on what is left without the ball: i' = (u - R i)/L, in steps of a fiftieth of a sample."""
    rng = np.random.default_rng(4)
    voltage = np.repeat(rng.uniform(0.5, 6.0, 60), 50)
    current, i, steps = np.zeros(voltage.size), 0.4, 50
    for n, u in enumerate(voltage):
        current[n] = i
        for _ in range(steps):
            i += (u - OHM * i) / HENRY / coil.RATE / steps
    columns = {"time_s": np.arange(voltage.size) / coil.RATE, "voltage_1_V": voltage}
    columns["current_1_A"] = current + coil.CURRENT_NOISE * rng.standard_normal(voltage.size)
    return Run(name, "steps", "fit", columns, mover="absent")


def test_a_coil_without_its_mover_tells_resistance_and_inductance(base, tmp_path) -> None:
    """Both within their errors, and what the record then believes; written and read without a position."""
    coil_alone = lone_coil_of(without_mover(), 1)
    assert abs(coil_alone.resistance - OHM) < 3 * coil_alone.error
    assert coil_alone.inductance == pytest.approx(HENRY, rel=2e-3)
    assert coil_alone.left == pytest.approx(coil.CURRENT_NOISE, rel=0.05)
    whole = coil.record(base, coil.Truth(), seconds=1.0)
    write_record(replace(whole, origin="measured", runs=(*whole.runs, without_mover())), tmp_path / "both")
    there, told = without_absent(load_record(tmp_path / "both"))
    assert [run.mover for run in there.runs] == ["free", "free"]
    assert there.actuator.coil_resistance() == pytest.approx(OHM, rel=5e-4)
    assert there.tolerance.coil_resistance < 2e-4
    assert "without the mover" in told[0]


def test_movers_that_cannot_be_are_refused(base) -> None:
    still = without_mover()
    still = replace(still, columns={**still.columns, "voltage_1_V": np.ones(still.time.size)})
    with pytest.raises(InputError, match="missing or stands still"):
        lone_coil_of(still, 1)
    record = machine(base)
    for bad, said in (
        (replace(record, runs=(without_mover(),)), "the mover is absent in all runs"),
        (replace(record, runs=tuple(replace(r, columns={k: v for k, v in r.columns.items() if k != "force_N"})
                                    for r in record.runs)), "force_N is missing"),
    ):  # fmt: skip
        with pytest.raises(RecordError, match=said):
            write_record(bad, ROOT / "none")
