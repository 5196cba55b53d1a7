"""Runs of the bench in closed loop: the loop's own commands, replayed, make the same run; noise is in the loop."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from bench_rigs import SERVO, SERVO_TABLE, VOLTAGE_SERVO

from msl_fem.bench import BenchOptions, ClosedLoop, parse_requests, sealed_record
from msl_fem.bench.instruments import readings
from msl_fem.bench.rig import true_rig
from msl_fem.bench.running import Following, follow, run_rig
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.excitation import parse_excitation, reference

RATE = 1e4
SPEC = "multisine:start=5 Hz,stop=60 Hz,amplitude=5 um,duration=0.4 s,periods=2,seed=1,loop=closed"


@dataclass
class Proportional:
    """Bias currents and a PD law on the position."""

    rate: float = 2.5e3
    delay_samples: int = 1
    bias: float = 0.6
    gain: float = 300.0
    before: float = 0.0
    current_loop_rate: float | None = None

    def start(self) -> None:
        self.before = 0.0

    def rows(self, samples: np.ndarray, *, period: float) -> np.ndarray:
        assert period > 0
        return samples

    def command(self, reference: np.ndarray, measured: float) -> np.ndarray:
        error = reference[0] - measured
        push = self.gain * error + 4.0 * (error - self.before)
        self.before = error
        return np.array([self.bias + push, self.bias - push])

    def voltage(self, wanted: np.ndarray, read: np.ndarray, measured: float) -> np.ndarray:
        return 2.0 * wanted + 20.0 * (wanted - read)


def asked(**changes: object) -> Following:
    wanted = reference(parse_excitation(SPEC), rate=RATE)
    followed = np.column_stack([wanted.position, wanted.velocity, wanted.acceleration])
    return Following(followed, changes.pop("controller", Proportional()), **changes)


@pytest.mark.parametrize("late", [0.0, 1.7e-4])
def test_the_same_commands_in_open_loop_make_the_same_run(late: float) -> None:
    rig = replace(true_rig(SERVO, SERVO_TABLE), delay=late, random_force=0.05)
    run = follow(rig, asked(), rate=RATE, seed=3)
    again = run_rig(rig, run.command, rate=RATE, seed=3)
    assert np.ptp(run.position) > 1e-6
    for name in ("position", "velocity", "current", "voltage", "reading"):
        assert (getattr(run, name) == getattr(again, name)).all(), name
    assert (run.measured == run.reading).all()


def test_around_a_voltage_drive_a_current_loop_gives_voltages_a_period_later() -> None:
    """Its own voltages in open loop make the same run; the currents are those wanted, but for R i/(R + 20 ohm)."""
    rig = true_rig(VOLTAGE_SERVO, SERVO_TABLE)
    run = follow(rig, asked(controller=Proportional(current_loop_rate=RATE / 2)), rate=RATE, seed=3)
    again = run_rig(rig, run.command, rate=RATE, seed=3)
    assert np.ptp(run.position) > 1e-6
    for name in ("position", "current", "reading"):
        whole = getattr(run, name)
        assert np.ptp(whole - getattr(again, name)) < 1e-3 * np.ptp(whole), name
    assert (np.ptp(run.command.reshape(-1, 2, 2), axis=1) == 0).all()
    assert (run.command[:6] == 0).all(), "a period of the controller, then one of its current loop"
    assert (run.command[6:8] != 0).all()
    assert run.current[1000:].mean() == pytest.approx(0.6, rel=0.05)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((4000, 2))
    noisy = follow(rig, asked(controller=Proportional(current_loop_rate=RATE), current_noise=noise), rate=RATE, seed=3)
    plain = follow(rig, asked(controller=Proportional(current_loop_rate=RATE)), rate=RATE, seed=3)
    assert np.std((noisy.command - plain.command)[1:] + 20.0 * noise[:-1]) < 0.5 * np.std(20.0 * noise)


def test_errors_and_noise_of_the_reading_are_in_the_loop() -> None:
    rig = true_rig(SERVO, SERVO_TABLE)
    rig = replace(rig, instruments=replace(rig.instruments, play=2e-7, drift=1e-6, drift_seed=4))
    noise = 1e-7 * np.random.default_rng(1).standard_normal(4000)
    plain, run = follow(rig, asked(), rate=RATE, seed=2), follow(rig, asked(noise=noise), rate=RATE, seed=2)
    assert plain.measured == pytest.approx(readings(rig, plain, run=2)["position_m"], rel=1e-12)
    assert run.measured - readings(rig, run, run=2)["position_m"] == pytest.approx(noise, abs=1e-18)
    assert np.abs(run.position - plain.position).max() > 1e-9, "the noise moves the mover"
    stepped = follow(rig, asked(resolution=1e-7), rate=RATE, seed=2).measured
    assert np.abs(stepped / 1e-7 - np.round(stepped / 1e-7)).max() < 1e-6


def sealed(*hide: str, noise: str = "coloured", loop: bool = True):
    section = {"rate": "2.5 kHz", "delay_samples": 1, "law": "PD"}
    options = BenchOptions(
        seed=4, excitations=(parse_excitation(SPEC),), noise=noise,
        loop=ClosedLoop(Proportional(), section) if loop else None,
    )  # fmt: skip
    return sealed_record(SERVO, SERVO_TABLE, parse_requests(hide), options)


def test_a_record_in_closed_loop() -> None:
    made = sealed("eddy_currents=2%")
    run = made.record.runs[0]
    assert run["reference_m"] == pytest.approx(reference(parse_excitation(SPEC), rate=RATE).position)
    assert made.record.controller == {"rate": "2.5 kHz", "delay_samples": 1, "law": "PD"}
    assert made.answer["effects"][0]["size"] == pytest.approx(0.02, rel=0.006)
    assert made.answer["changes_together"] == pytest.approx(made.answer["effects"][0]["size_by_channel"])
    held = run["command_1_A"].reshape(-1, 4)
    assert (np.ptp(held, axis=1) == 0).all()
    assert (sealed("eddy_currents=2%").record.runs[0]["position_m"] == run["position_m"]).all(), "the same seed"


def test_sizes_are_at_the_same_reference() -> None:
    plain, hidden = sealed("none", noise="none"), sealed("force_offset=3%", noise="none")
    one, two = plain.record.runs[0], hidden.record.runs[0]
    found = max(
        np.sqrt(np.mean((two[c] - one[c]) ** 2) / np.mean(one[c] ** 2))
        for c in ("position_m", "current_1_A", "current_2_A", "voltage_1_V", "voltage_2_V")
    )
    assert found == pytest.approx(0.03, rel=0.02)


def test_what_cannot_be_looped_is_refused() -> None:
    rig = true_rig(SERVO, SERVO_TABLE)
    with pytest.raises(InputError, match="whole multiple"):
        follow(rig, asked(controller=Proportional(rate=3e3)), rate=RATE)
    with pytest.raises(InputError, match="the controller commands currents"):
        follow(true_rig(VOLTAGE_SERVO, SERVO_TABLE), asked(), rate=RATE)
    with pytest.raises(InputError, match="the controller commands currents"):
        follow(rig, asked(controller=Proportional(current_loop_rate=RATE)), rate=RATE)
    with pytest.raises(InputError, match="whole multiple of the current loop's 20 kHz"):
        follow(true_rig(VOLTAGE_SERVO, SERVO_TABLE), asked(controller=Proportional(current_loop_rate=2e4)), rate=RATE)
    with pytest.raises(ComputationError, match="the loop does not hold it"):
        follow(rig, asked(controller=Proportional(bias=3.0, gain=-300.0)), rate=RATE)
    with pytest.raises(InputError, match="loop=closed needs a controller"):
        sealed("none", loop=False)
