"""Records like a given one of a rig that lacks nothing: its inputs, other true parameters and other noise."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.bench.instruments import noise_of_instruments, run_columns, with_noise
from msl_fem.bench.nuisances import NAMES, draw_nuisances, spoilt_columns, with_stray_flux
from msl_fem.bench.plant import Array
from msl_fem.bench.rig import draw_truth, true_rig
from msl_fem.bench.running import BenchController, Following, follow, run_rig
from msl_fem.errors import ComputationError, InputError
from msl_fem.record import Record, Run, Tolerance
from msl_fem.table.magnetic_table import MagneticTable

LARGEST = 3.0  # tolerances that an instrument is off
REFERENCE = "reference_m"


def alike(
    record: Record, table: MagneticTable | None, *, seed: int, controller: BenchController | None = None
) -> Record:
    """A simulated record without causes: the true rig lies within the tolerances of the record's belief, what its
    instruments do too; inputs, lengths, roles and noise are the record's.

    Parameters
    ----------
    controller : of runs that hold a reference; without, recorded inputs drive every run

    Raises
    ------
    InputError : no runs, inputs that are missing, or a rig that the recorded inputs alone do not hold
    """
    if not record.runs or record.sampling is None:
        raise InputError("the record has no runs: only runs are simulated for a calibration")
    actuator = as_noisy(record)
    truth = draw_truth(record.tolerance, table, np.random.default_rng([seed, 1]))
    nuisances = draw_nuisances(_sizes(record.tolerance, seed), record.tolerance, seed=seed)
    rig = with_stray_flux(true_rig(actuator, table, truth), actuator, table, nuisances)
    how = noise_of_instruments(actuator)
    runs, rate = [], record.sampling.rate
    for n, run in enumerate(record.runs):
        chance = np.random.default_rng([seed, 2, n])
        try:
            asked = _asked(actuator, run, controller)
            if isinstance(asked, Following):
                response = follow(rig, asked, rate=rate, seed=n)
            else:
                response = run_rig(rig, asked, rate=rate, lead_in=float(asked[0].mean()), seed=n)
        except ComputationError as err:
            raise InputError(
                f"{run.name}: {err}; the recorded inputs alone do not hold this rig, and a calibration needs a "
                f"[controller] with the column {REFERENCE}"
            ) from err
        columns = with_noise(
            spoilt_columns(run_columns(rig, response, run=n), nuisances), how, rate=rate, generator=chance
        )
        runs.append(replace(run, columns={name: values for name, values in columns.items() if name in run.columns}))
    return replace(record, origin="simulated", actuator=actuator, runs=tuple(runs), static=None, warnings=())


def as_noisy(record: Record) -> Actuator:
    """The actuator with its sensors as noisy as the record states."""
    update = {}
    for name, sigma in (("position_sensor", record.noise.position), ("current_sensor", record.noise.current)):
        if sigma:
            update[name] = getattr(record.actuator, name).model_copy(update={"noise": sigma})
    return record.actuator.model_copy(update=update)


def _sizes(tolerance: Tolerance, seed: int) -> Sequence[tuple[str, float]]:
    """How many of their tolerances the instruments are off: half of a normal distribution."""
    chance = np.random.default_rng([seed, 7])
    return [(name, float(min(abs(chance.standard_normal()), LARGEST))) for name in NAMES]


def _asked(actuator: Actuator, run: Run, controller: BenchController | None) -> Array | Following:
    """What drives a run: its reference in a closed loop, else its inputs (n_sample, n_column)."""
    if controller is not None and REFERENCE in run.columns:
        position, time = run.columns[REFERENCE], run.time
        velocity = np.gradient(position, time)
        followed = np.column_stack([position, velocity, np.gradient(velocity, time)])
        rows = controller.rows(followed, period=float(time[1] - time[0]))
        return Following(rows, controller, resolution=actuator.position_sensor.resolution)
    kind = actuator.drive.kind if actuator.drive is not None else "none"
    sides = actuator.sides.count if actuator.sides is not None else 1
    word = {"voltage": "voltage_{}_V", "current": "command_{}_A"}.get(kind, "")
    names = [word.format(j + 1) for j in range(sides)] if word else ["force_N"]
    missing = [name for name in names if name not in run.columns]
    if missing:
        raise InputError(f"{run.name}: has no column {missing[0]}, which a simulation of its drive needs")
    return np.column_stack([run.columns[name] for name in names])
