"""Runs with the mover taken away: what is left of a magnet is a coil, whose resistance they tell whatever the gap is.

    L i' = v - R i,   v held over a sample:   i_(k+1) = q i_k + (1 - q) v_k/R,   q = exp(-R h/L)

R, L and the current at the beginning are those of least squares of the response; R takes the place of the believed
resistance, with its own standard error, before anything that moves is looked at. L has no gap and is told beside.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.plant import plant_parameters
from msl_fem.record import Record, Run

FOLLOWED = 3.0
"""Times the noise of the current that a resistance and an inductance may leave, beyond which it is said."""


@dataclass(frozen=True)
class LoneCoil:
    """Ohm of a side with one standard error, henry, and the RMS that both leave of the current (A)."""

    resistance: float
    error: float
    inductance: float
    left: float


def without_absent(record: Record) -> tuple[Record, tuple[str, ...]]:
    """The record without the runs whose mover was absent, its resistance and tolerance by what they told, in words too.

    Raises
    ------
    InputError : such a run lacks voltage or current, or its voltage stands still
    """
    absent = [run for run in record.runs if run.mover == "absent"]
    if not absent:
        return record, ()
    p = plant_parameters(record.actuator)
    coils = [lone_coil_of(run, side) for run in absent for side in range(1, p.sides + 1) if f"current_{side}_A" in run]
    believed = np.array([p.resistance, p.resistance * record.tolerance.coil_resistance])
    each = np.array([(believed[0], max(believed[1], 1e-12)), *((coil.resistance, coil.error) for coil in coils)])
    weight = 1.0 / each[:, 1] ** 2
    ohm, error = float(weight @ each[:, 0] / weight.sum()), float(weight.sum() ** -0.5)
    told = [
        f"without the mover: {coil.resistance:.5g} +- {1.96 * coil.error:.2g} ohm and {1e3 * coil.inductance:.4g} mH "
        "of a side" + _badly_followed(coil, record.noise.current)
        for coil in coils
    ]
    told.append(f"its resistance is believed as {ohm:.5g} ohm, {believed[0]:.5g} ohm before")
    drive, runs = record.actuator.drive, tuple(run for run in record.runs if run.mover != "absent")
    assert drive is not None
    own = record.actuator.coil_resistance() * ohm / p.resistance
    actuator = record.actuator.model_copy(update={"drive": drive.model_copy(update={"coil_resistance": own})})
    tolerance = record.tolerance.model_copy(update={"coil_resistance": error / ohm})
    return replace(record, actuator=actuator, tolerance=tolerance, runs=runs), tuple(told)


def lone_coil_of(run: Run, side: int) -> LoneCoil:
    """Resistance and inductance of a side by the response of its current to its voltage.

    Raises
    ------
    InputError : no voltage, or one that stands still
    """
    column = f"voltage_{side}_V"
    if column not in run or np.ptp(run[column]) == 0:
        raise InputError(
            f"run {run.name}: column {column} is missing or stands still; the response to a voltage that changes "
            "tells resistance and inductance"
        )
    voltage, current, period = run[column], run[f"current_{side}_A"], run.sampling_period
    ohm = abs(float(voltage @ current) / float(current @ current))

    def missed(x: Array) -> Array:
        return response(voltage, period, ohm * np.exp(x[0]), np.exp(x[1]), x[2]) - current

    tries = [
        least_squares(missed, [0.0, np.log(ohm * period * n), current[0]], x_scale="jac") for n in (3.0, 30.0, 300.0)
    ]
    found = min(tries, key=lambda one: one.cost)
    left = float(np.sqrt(2 * found.cost / (current.size - 3)))
    error = left * float(np.sqrt(np.linalg.inv(found.jac.T @ found.jac)[0, 0]))
    resistance = ohm * float(np.exp(found.x[0]))
    return LoneCoil(resistance, resistance * error, float(np.exp(found.x[1])), left)


def response(voltage: Array, period: float, resistance: float, inductance: float, begin: float) -> Array:
    """(n_sample,) A of a coil to a voltage that is held over each sample, from `begin` on."""
    stays = np.exp(-resistance * period / inductance)
    held = (1 - stays) / resistance * voltage[:-1]
    later = lfilter([1.0], [1.0, -stays], np.concatenate([[begin], held]))
    return np.asarray(later)


def _badly_followed(coil: LoneCoil, noise: float | None) -> str:
    if not noise or coil.left < FOLLOWED * noise:
        return ""
    return f", which leave {coil.left / noise:.3g} times the current's noise: there are eddy currents or iron about"
