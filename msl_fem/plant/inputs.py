"""What drives a run: sampled commands and disturbance, held between samples."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.plant.excitation import samples
from msl_fem.plant.excitation_kinds import Excitation, Unit

Array = NDArray[np.float64]
DRIVE_UNIT: dict[str, Unit] = {"current": "A", "voltage": "V", "force": "N"}


@dataclass(frozen=True, eq=False)
class Inputs:
    """Commands to the drive and the disturbance, each held for one sample (zero-order hold).

    Attributes
    ----------
    commands : (n_sample, n_side) in A, V or N by the drive's kind; a force drive has one column
    rate : samples a second, Hz
    disturbance : (n_sample,) N on the mass, or one number for all samples
    """

    commands: Array
    rate: float
    disturbance: ArrayLike = 0.0

    def __post_init__(self) -> None:
        commands = np.asarray(self.commands, dtype=float)
        commands = commands[:, None] if commands.ndim == 1 else commands
        if commands.ndim != 2 or commands.shape[0] < 1 or commands.shape[1] not in (1, 2):
            raise InputError(f"commands have the shape {commands.shape}, expected (n_sample, 1) or (n_sample, 2)")
        disturbance = np.asarray(self.disturbance, dtype=float)
        if disturbance.shape not in ((), commands.shape[:1]):
            raise InputError(
                f"disturbance has the shape {disturbance.shape}, expected ({commands.shape[0]},) or one number"
            )
        disturbance = np.broadcast_to(disturbance, commands.shape[:1]).copy()
        for name, values in (("commands", commands), ("disturbance", disturbance)):
            if not np.isfinite(values).all():
                row = int(np.argwhere(~np.isfinite(values))[0][0])
                raise InputError(f"{name} are not finite at sample {row}; give numbers")
        if not (self.rate > 0 and np.isfinite(self.rate)):
            raise InputError(f"rate {self.rate:g} Hz must be positive and finite")
        object.__setattr__(self, "commands", commands)
        object.__setattr__(self, "disturbance", disturbance)

    @property
    def time(self) -> Array:
        """Instants of the samples in s, (n_sample,)."""
        return np.arange(self.commands.shape[0]) / self.rate

    def for_sides(self, n_side: int) -> Array:
        """The commands as the kernel takes them, (n_sample, 2).

        Raises
        ------
        InputError : they are for another number of sides
        """
        if self.commands.shape[1] != n_side:
            raise InputError(
                f"commands have {self.commands.shape[1]} columns, the actuator's drive has {n_side}; give one a side"
            )
        padded = np.zeros((self.commands.shape[0], 2))
        padded[:, :n_side] = self.commands
        return padded


def excitation_inputs(
    actuator: Actuator, excitation: Excitation, *, rate: float, generator: np.random.Generator | None = None
) -> Inputs:
    """The inputs that an excitation gives to an actuator's drive, sampled at `rate` (Hz).

    Raises
    ------
    InputError : the excitation's unit is not the drive's; as `excitation.samples`
    """
    kind = actuator.drive.kind if actuator.drive else "none"
    if DRIVE_UNIT.get(kind) != excitation.unit:
        raise InputError(
            f"{excitation.name}: amplitude is in {excitation.unit}, the drive of {actuator.name} is of the kind "
            f"'{kind}'; read the excitation with the unit {DRIVE_UNIT.get(kind, 'of a drive')}"
        )
    sides = actuator.sides.count if kind != "force" and actuator.sides else 1
    return Inputs(samples(excitation, rate=rate, sides=sides, generator=generator), rate)
