"""Closed-loop runs of the coupled model with a controller that is handed in."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from coupled_twin import changed
from effect_sets import EffectValues

from msl_fem.actuator import Actuator
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.excitation import Inputs, Reference, parse_excitation, reference
from msl_fem.plant.sampled_plant import simulate_closed
from msl_fem.plant.simulate import NamedRun, simulate, simulation_record
from msl_fem.table.magnetic_table import MagneticTable

RATE = 1e4
WANTED = reference(
    parse_excitation("sine:frequency=20 Hz,amplitude=20 um,duration=0.1 s,loop=closed"), rate=RATE
)  # fmt: skip


@dataclass
class Proportional:
    """Bias currents and a PD law on the position; remembers when it was asked."""

    rate: float = 2.5e3
    delay_samples: int = 1
    bias: float = 0.6
    gain: float = 300.0
    before: float = 0.0
    current_loop_rate: float | None = None
    asked: list[tuple[float, float]] = field(default_factory=list)

    def start(self) -> None:
        self.before, self.asked = 0.0, []

    def rows(self, samples: np.ndarray, *, period: float) -> np.ndarray:
        assert period > 0
        return samples

    def command(self, reference: np.ndarray, measured: float) -> np.ndarray:
        self.asked.append((float(reference[0]), measured))
        error = reference[0] - measured
        push = self.gain * error + 4.0 * (error - self.before)
        self.before = error
        return np.array([self.bias + push, self.bias - push])

    def voltage(self, wanted: np.ndarray, read: np.ndarray, measured: float) -> np.ndarray:
        return 2.0 * wanted + 20.0 * (wanted - read)


@pytest.mark.parametrize(
    "values",
    [None, EffectValues({"time_delay": {"position": 2.6e-4, "command": 3e-5}, "sensor_drift": {"rate": 1e-5}})],
)
def test_the_same_commands_in_open_loop_make_the_same_run(
    servo: Actuator, table: MagneticTable, values: EffectValues | None
) -> None:
    controller = Proportional()
    run = simulate_closed(servo, table, WANTED, controller, effects=values, generator=np.random.default_rng(1))
    assert run.complete
    assert np.ptp(run.position) > 1e-6
    again = simulate(servo, table, Inputs(run.command, RATE), effects=values, generator=np.random.default_rng(1))
    for name in ("measured_position", "measured_current", "position", "velocity", "current", "voltage"):
        ours, theirs = getattr(run, name), getattr(again, name)
        assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-12 * np.abs(theirs).max()), name
    assert run.audit == again.audit
    assert [m for _, m in controller.asked] == run.measured_position[::4].tolist(), "asked at its rate, as read"
    assert [r for r, _ in controller.asked] == WANTED.position[::4].tolist()


def test_a_command_acts_a_period_after_it_was_computed(servo: Actuator, table: MagneticTable) -> None:
    run = simulate_closed(servo, table, WANTED, Proportional(delay_samples=1))
    prompt = simulate_closed(servo, table, WANTED, Proportional(delay_samples=0))
    assert (run.command[:4] == 0).all()
    assert (run.command[4:8] == 0.6).all()
    assert (prompt.command[:4] == 0.6).all()
    assert (np.ptp(run.command.reshape(-1, 4, 2), axis=1) == 0).all(), "held for a period"


def test_a_record_of_it_holds_the_reference_and_the_controller(servo: Actuator, table: MagneticTable) -> None:
    run = simulate_closed(servo, table, WANTED, Proportional())
    section = {"rate": "2.5 kHz", "law": "PD", "delay_samples": 1}
    record = simulation_record(servo, [NamedRun("a", "b", "fit", run, WANTED.position)], controller=section)
    assert record.runs[0]["reference_m"].tolist() == WANTED.position.tolist()
    assert record.runs[0]["command_1_A"].tolist() == run.command[:, 0].tolist()
    assert record.controller == section


def test_a_loop_that_does_not_hold_says_so(servo: Actuator, table: MagneticTable) -> None:
    with pytest.raises(ComputationError, match=r"after t = 0\.\d+ s.*the loop does not hold it"):
        simulate_closed(servo, table, WANTED, Proportional(bias=3.0, gain=0.0))


def test_what_cannot_be_looped_is_refused(servo: Actuator, table: MagneticTable) -> None:
    with pytest.raises(InputError, match="whole multiple of the controller's"):
        simulate_closed(servo, table, WANTED, Proportional(rate=3e3))
    with pytest.raises(InputError, match="the controller commands currents"):
        simulate_closed(changed(servo, drive={"kind": "voltage"}), table, WANTED, Proportional())
    with pytest.raises(InputError, match="the controller commands currents"):
        simulate_closed(servo, table, WANTED, Proportional(current_loop_rate=RATE))


def test_amplitudes_of_a_closed_loop_are_lengths() -> None:
    one = parse_excitation("sine:frequency=20 Hz,amplitude=20 um,duration=0.1 s,loop=closed", unit="A")
    assert (one.unit, one.amplitude) == ("m", pytest.approx(2e-5))
    assert parse_excitation(one.spec) == one
    assert isinstance(WANTED, Reference)
    with pytest.raises(InputError, match="amplitude: unit 'A' has the wrong dimension"):
        parse_excitation("sine:frequency=20 Hz,amplitude=1 A,duration=0.1 s,loop=closed")
