"""The excitations of a record for which none are stated: noise to fit to and a swept sine held out, both borne."""

import math

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.bench.plant import Array
from msl_fem.bench.rig import Rig, true_rig
from msl_fem.bench.running import run_rig
from msl_fem.bench.stability import stability_limit
from msl_fem.errors import ActuatorError, ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.plant.excitation import parse_excitation, samples
from msl_fem.plant.excitation_kinds import Excitation, Unit
from msl_fem.table.magnetic_table import MagneticTable

DRIVE_UNIT: dict[str, Unit] = {"current": "A", "voltage": "V", "force": "N"}
REACH = 0.2
"""Share of the range that the mover uses at most."""
_HALVINGS = 14


def usual_unit(actuator: Actuator) -> Unit:
    """The unit of what the actuator's drive takes; ActuatorError without a drive."""
    if actuator.drive is None:
        raise ActuatorError(f'{actuator.name} has no [drive]; add one with kind = "current", "voltage" or "force"')
    return DRIVE_UNIT[actuator.drive.kind]


def commands_of(actuator: Actuator, excitation: Excitation, *, rate: float) -> Array:
    """The commands (n_sample, n_column) of an excitation to the actuator's drive; InputError where it does not fit."""
    kind = actuator.drive.kind if actuator.drive else "none"
    sides = actuator.sides.count if kind != "force" and actuator.sides else 1
    return samples(excitation, rate=rate, sides=sides)


def usual_excitations(actuator: Actuator, table: MagneticTable | None, *, rate: float) -> tuple[Excitation, ...]:
    """Band-limited noise (fit) and a swept sine (held-out), 4 s each, chosen by what is believed of the actuator alone.

    The bias is half the current up to which the open loop is stable; the amplitudes are the largest halvings with which
    the believed rig uses a fifth of its range.

    Raises
    ------
    InputError : there is neither spring nor range to choose them by
    """
    rig = true_rig(actuator, table)
    kind = actuator.drive.kind if actuator.drive else "none"
    motion = rig.plant.motion
    if motion.stiffness <= 0 or not math.isfinite(motion.travel):
        raise InputError(
            f"{actuator.name}: without stiffness and range there are no usual excitations; state --excitation"
        )
    band = format_quantity(min(500.0, rate / 20), "Hz", digits=2)
    stop = format_quantity(min(300.0, rate / 30), "Hz", digits=2)
    bias, first = _bias(rig, kind)
    unit = usual_unit(actuator)
    held = f"bias={_text(bias, unit)}," if bias else ""
    noise = f"band-limited-noise:{held}band={band},duration=4 s,seed=1,role=fit"
    sweep = f"swept-sine:{held}start=5 Hz,stop={stop},duration=4 s,role=held-out"
    return tuple(_borne(actuator, rig, spec, (first, unit), rate=rate) for spec in (noise, sweep))


def _text(value: float, unit: str) -> str:
    return f"{value:.2g} {unit}"


def _bias(rig: Rig, kind: str) -> tuple[float, float]:
    """(bias, the first amplitude to try) in the drive's unit."""
    motion = rig.plant.motion
    if kind == "force":
        return 0.0, motion.stiffness * motion.travel
    assert rig.table is not None
    limit = min(stability_limit(rig), rig.plant.circuit.current_limit, float(rig.table.current[-1]))
    current = 0.5 * limit
    if kind == "current":
        return current, current / 3.2  # three RMS of noise leave the current positive
    return current * rig.plant.circuit.resistance, 2 * current * rig.plant.circuit.resistance


def _borne(actuator: Actuator, rig: Rig, spec: str, start: tuple[float, Unit], *, rate: float) -> Excitation:
    amplitude, unit = start
    for _ in range(_HALVINGS):
        excitation = parse_excitation(f"{spec},amplitude={_text(amplitude, unit)}", unit=unit)
        commands = commands_of(actuator, excitation, rate=rate)
        try:
            response = run_rig(rig, commands, rate=rate, lead_in=excitation.bias)
        except ComputationError:
            amplitude /= 2
            continue
        if np.abs(response.position).max() <= REACH * rig.plant.motion.travel:
            return excitation
        amplitude /= 2
    raise InputError(f"{actuator.name}: no amplitude of '{spec}' is borne; state --excitation")
