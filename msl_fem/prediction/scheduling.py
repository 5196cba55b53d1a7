"""Parameters that go with a second input: a damper's coil voltage, a temperature that is set.

A scheduling variable (W. Rugh, J. Shamma, Automatica 36, 2000, 1401-1425) is measured beside the drive and changes the
plant's parameters. A parameter is a straight line between its values at some levels of the variable, and beyond them
what it is at the last one; its values over that at the first level, "damping@1", "damping@2" and so on, are believed to
be 1 within the factor that is stated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.plant.effects import CATALOGUE
from msl_fem.record import Record, Run
from msl_fem.record.rig_file import Scheduling

OF_THE_MOVER = ("moving_mass", "stiffness", "damping", "coil_resistance")
"""Believed parameters that may go with a second input, beside the amounts of effects."""
MOST_LEVELS = 6
"""Different values of a variable in the runs that are fitted, up to which each is a level."""
SPACED = 4
"""Levels, equally spaced, of a variable that has more."""
LEVEL = "@"


@dataclass(frozen=True, eq=False)
class Schedule:
    """A parameter along a run.

    Attributes
    ----------
    parameter : "damping", or "effect.parameter"
    column : of the scheduling variable
    at : (n_level,) its levels, ascending
    values : (n_sample,) the variable in this run
    sigma : one sigma of the logarithm of the parameter over its value at the first level
    """

    parameter: str
    column: str
    at: Array
    values: Array
    sigma: float

    @property
    def names(self) -> tuple[str, ...]:
        """Of the ratios at the levels behind the first."""
        return tuple(f"{self.parameter}{LEVEL}{n}" for n in range(1, self.at.size))

    def ratio(self, factors: Mapping[str, float]) -> Array:
        """(n_sample,) the parameter over its value at the first level."""
        return np.interp(self.values, self.at, [1.0, *(factors.get(name, 1.0) for name in self.names)])

    def first(self, n: int) -> "Schedule":
        """Over the first n samples."""
        return replace(self, values=self.values[:n])


def schedules_of(record: Record, run: Run) -> tuple[Schedule, ...]:
    """What goes with a second input in a run.

    Raises
    ------
    InputError : a run lacks the column, it has one value in all that is fitted, or no such parameter may go with it
    """
    found = []
    for entry in record.scheduling:
        at = np.array(entry.at) if entry.at else _levels(record, entry)
        values = _column(run, entry.column)
        for parameter in entry.changes:
            _check(parameter)
            found.append(Schedule(parameter, entry.column, at, values, entry.tolerance))
    return tuple(found)


def schedule_sigmas(schedules: Sequence[Schedule]) -> dict[str, float]:
    """Name to one sigma of the ratios that are unknown."""
    return {name: one.sigma for one in schedules for name in one.names}


def ratios_along(schedules: Sequence[Schedule], factors: Mapping[str, float]) -> dict[str, Array]:
    """Parameter to (n_sample,), over its value at the first level."""
    return {one.parameter: one.ratio(factors) for one in schedules}


def standing_factors(schedules: Sequence[Schedule], factors: Mapping[str, float], *, run: str) -> dict[str, float]:
    """Parameters over their values at the first level in a run in which no scheduling variable changes.

    Raises
    ------
    InputError : one changes
    """
    found = {}
    for one in schedules:
        if np.ptp(one.values) > 0:
            raise InputError(
                f"run {run}: {one.column} goes from {one.values.min():.4g} to {one.values.max():.4g}; a run that is "
                "simulated has one value of what changes its parameters: cut it by a column valid where it changes"
            )
        found[one.parameter] = float(one.ratio(factors)[0])
    return found


def _levels(record: Record, entry: Scheduling) -> Array:
    every = np.unique(np.concatenate([_column(run, entry.column) for run in record.runs_of("fit")]))
    if every.size < 2:
        raise InputError(
            f"scheduling: {entry.column} has one value in all runs that are fitted, so nothing tells what it changes; "
            "fit runs at other values too, or leave the entry out"
        )
    return every if every.size <= MOST_LEVELS else np.linspace(every[0], every[-1], SPACED)


def _column(run: Run, name: str) -> Array:
    found = run.columns.get(name, run.extra.get(name))
    if found is None or found.dtype.kind != "f":
        raise InputError(
            f"run {run.name} has no numbers in a column {name}, which scheduling names; write it, or its one value as "
            f"levels = {{ {name} = 0.5 }} in the run's entry of rig.toml"
        )
    return np.asarray(found)


def _check(parameter: str) -> None:
    effect, _, name = parameter.rpartition(".")
    allowed = parameter in OF_THE_MOVER if not effect else effect in CATALOGUE and name in CATALOGUE[effect].amounts
    if not allowed:
        raise InputError(
            f"scheduling: '{parameter}' cannot go with a second input; there are {', '.join(OF_THE_MOVER)}, and "
            "amounts of effects like coulomb_friction.force"
        )
