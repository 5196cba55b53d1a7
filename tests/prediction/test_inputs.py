"""What drives the model along a run: currents as ideal commands, inputs that run straight between samples."""

import numpy as np
import pytest
from shifted_records import in_voltage_drive

from msl_fem.actuator import Actuator
from msl_fem.comparison import nrmse
from msl_fem.plant import Inputs, Options, plant_parameters, simulate
from msl_fem.prediction import ModelHypothesis, Start, free_run, kernel_plant, run_data
from msl_fem.prediction.hypothesis import plant_in_run
from msl_fem.record import Noise, Record, Run, Sampling
from msl_fem.table.magnetic_table import MagneticTable

RATE, FINE, N = 4e3, 10, 3000


def smooth(seed: int, size: float) -> np.ndarray:
    """(FINE N, 2) of noise up to 200 Hz about a level, given at the fine rate and sampled by every FINE-th."""
    rng, count = np.random.default_rng(seed), N * FINE
    spectrum = np.zeros((count // 2 + 1, 2), complex)
    band = np.fft.rfftfreq(count, 1 / (RATE * FINE)) < 200.0
    spectrum[band] = rng.standard_normal((band.sum(), 2)) + 1j * rng.standard_normal((band.sum(), 2))
    signal = np.fft.irfft(spectrum, count, axis=0)
    return 0.5 + size * signal / signal.std()


def straight(coarse: np.ndarray) -> np.ndarray:
    """(FINE N, 2) fine samples of what runs straight between coarse ones (N, 2), each the mean over its fine sample."""
    share = (np.arange(FINE) + 0.5)[None, :, None] / FINE
    after = np.vstack([coarse[1:], coarse[-1:]])
    return ((1 - share) * coarse[:, None] + share * after[:, None]).reshape(-1, 2)


def record_of(actuator: Actuator, columns: dict[str, np.ndarray], hold: str) -> Record:
    time = {"time_s": np.arange(N) / RATE}
    run = Run("a", "noise", "fit", time | columns)
    noise = Noise(position=1e-9, current=1e-4)
    return Record("simulated", actuator, sampling=Sampling(rate=RATE, hold=hold), noise=noise, runs=(run,))


def error_of(record: Record, table: MagneticTable) -> float:
    """Position NRMSE of the true model's free run from the true start."""
    data = run_data(record, record.runs[0])
    plant = kernel_plant(ModelHypothesis(record.actuator, table), rate=RATE, ideal_current=data.ideal_current)
    begin = tuple(float(record.runs[0][f"current_{j}_A"][0]) for j in (1, 2))
    run = free_run(plant, data, Start(begin, float(record.runs[0]["position_m"][0]), 0.0))
    assert run.ended is None
    return nrmse(data.measured["position_m"], run.readings["position_m"])


def coarse_run(actuator: Actuator, table: MagneticTable, commands: np.ndarray, names: str) -> dict[str, np.ndarray]:
    """Columns at the coarse rate of a run under fine commands (FINE N, 2)."""
    begin = tuple(commands[0]) if actuator.drive.kind == "current" else (0.0, 0.0)
    run = simulate(actuator, table, Inputs(commands, RATE * FINE), options=Options(currents=begin))
    at = slice(None, None, FINE)
    columns = {f"current_{j + 1}_A": run.current[at, j] for j in range(2)} | {"position_m": run.measured_position[at]}
    return columns | {names.format(j + 1): commands[at, j] for j in range(2)}


def test_a_linear_hold_is_taken_as_linear(servo: Actuator, table: MagneticTable) -> None:
    """Voltages that run straight between the samples: read as held they are half a sample late."""
    actuator = in_voltage_drive(servo)
    coarse = smooth(1, 0.1)[::FINE]
    columns = coarse_run(actuator, table, straight(coarse), "unused_{}")
    columns = {name: v for name, v in columns.items() if not name.startswith("unused")}
    columns |= {f"voltage_{j + 1}_V": coarse[:, j] for j in range(2)}
    linear = error_of(record_of(actuator, columns, "linear"), table)
    held = error_of(record_of(actuator, columns, "zero-order"), table)
    assert linear < 1e-5, "linear inside the steps, not only in their mean"
    assert held > 1e-3


def test_currents_stand_for_commands_where_there_are_none(servo: Actuator, table: MagneticTable) -> None:
    """Measured currents drive the magnets without a lag; with a linear hold they are what flowed, to second order."""
    columns = coarse_run(servo, table, smooth(2, 0.05), "command_{}_A")
    currents = {name: v for name, v in columns.items() if not name.startswith("command")}
    record = record_of(servo, currents, "linear")
    data = run_data(record, record.runs[0])
    assert data.ideal_current
    assert "current_1_A" not in data.measured, "what drives is no reading"
    assert data.commands[:, 0] == pytest.approx(columns["current_1_A"])
    assert data.held[:-1, 0] == pytest.approx((columns["current_1_A"][1:] + columns["current_1_A"][:-1]) / 2)
    assert error_of(record, table) < 0.01
    late = record_of(servo, currents | commanded(columns), "linear")
    assert not run_data(late, late.runs[0]).ideal_current
    assert error_of(late, table) > 5 * error_of(record, table), "the same currents as commands pass the drive's lag"


def commanded(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {f"command_{j}_A": columns[f"current_{j}_A"] for j in (1, 2)}


@pytest.mark.parametrize(
    ("largest", "times", "acts"),
    [(0.9, 1, False), (1.0, 1, False), (1.01, 400, False), (1.01, 1, True), (1.2, 400, True)],
)
@pytest.mark.parametrize("kind", ["current", "voltage"])
def test_a_drive_limits_no_commands_that_were_recorded_behind_its_limit(
    servo: Actuator, kind: str, largest: float, times: int, acts: bool
) -> None:
    """None is larger, or they stop at a largest one that its reading may make of the limit: a gain of 0.99 of what
    reads them is no reason to hold them once more. What goes on beyond the limit was recorded before it."""
    actuator = in_voltage_drive(servo) if kind == "voltage" else servo
    limit = actuator.drive.voltage_limit if kind == "voltage" else actuator.drive.current_limit
    commands = smooth(5, 0.1)[::FINE] / 2 * limit
    commands[100 : 100 + times, 0] = largest * limit
    unit = "V" if kind == "voltage" else "A"
    word = "voltage" if kind == "voltage" else "command"
    columns = {f"{word}_{j}_{unit}": commands[:, j - 1] for j in (1, 2)} | {"position_m": np.zeros(N)}
    columns |= {f"current_{j}_A": np.zeros(N) for j in (1, 2)}
    record = record_of(actuator, columns, "zero-order")
    plant = plant_in_run(plant_parameters(actuator), run_data(record, record.runs[0]))
    held = plant.voltage_limit if kind == "voltage" else plant.current_limit
    assert held == (limit if acts else np.inf)
