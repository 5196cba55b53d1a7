"""A record's loop that one of our own designs drove: the controller made again, twice, for a simulation beside it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msl_fem.control.belief import belief_of
from msl_fem.control.design import ControllerDesign
from msl_fem.control.designs import Choice, designed
from msl_fem.control.stepper import Stepper
from msl_fem.errors import InputError
from msl_fem.files.schema import In
from msl_fem.maps import operating_map
from msl_fem.plant.closed_run import clock_of
from msl_fem.plant.excitation import parse_excitation, reference
from msl_fem.prediction import RunData
from msl_fem.prediction.free_run import CallableLaw
from msl_fem.record import Record, Run
from msl_fem.table.magnetic_table import MagneticTable

Array = NDArray[np.float64]
SAME = 1e-6  # of the largest gain: what a search may differ by on another machine


@dataclass(frozen=True, eq=False)
class OwnLoop:
    """The design that a record states; `beside` makes of it what a run's simulation asks."""

    design: ControllerDesign

    def beside(self, run: Run, data: RunData) -> CallableLaw | None:
        """The answer of the controller to the simulated reading, less its answer to the recorded one; None without a
        reference."""
        if "reference_m" not in run:
            return None
        simulated, recorded = Stepper(self.design), Stepper(self.design)
        every, delay = clock_of(simulated, rate=data.rate)
        wanted, measured = _followed(run, data), run["position_m"]
        made = np.zeros(2)

        def answer(k: int, reading: float) -> Array:
            if k == 0:
                simulated.start()
                recorded.start()
            change = simulated.command(wanted[k], reading) - recorded.command(wanted[k], float(measured[k]))
            made[: change.size] = change
            return made

        return CallableLaw(answer, every, delay)


def own_loop(record: Record, table: MagneticTable | None) -> OwnLoop | None:
    """The loop of a record whose `[controller]` states a `design`; None where it states none.

    Raises
    ------
    InputError : a design or a wish that is none; what is made again has other gains than those stated
    """
    stated = record.controller or {}
    if "design" not in stated or table is None:
        return None
    belief = belief_of(record.actuator, table, operating_map(table))
    design = designed(belief, _choice(stated))
    made = {"gain": design.law.gains.state, "filter_gain": design.law.estimator.gain}
    for name, value in made.items():
        if name in stated and not _alike(np.asarray(stated[name]), value):
            raise InputError(
                f"controller.{name}: the design '{stated['design']}' made again from actuator and table has other "
                "gains; it was made for another belief, map or wish"
            )
    return OwnLoop(design)


def _choice(stated: Mapping[str, Any]) -> Choice:
    """The wishes of `[controller]`; InputError for a wrong unit."""
    wishes: dict[str, float | None] = {"bandwidth": None, "overlap": 0.0, "bias": None}
    for name, unit in (("bandwidth", "Hz"), ("overlap", "N"), ("bias", "A")):
        if name in stated:
            try:
                wishes[name] = In(unit).read(stated[name])
            except ValueError as err:
                raise InputError(f"controller.{name}: {err}") from err
    sensitivity, overlap = stated.get("peak_sensitivity"), wishes["overlap"] or 0.0
    return Choice(
        str(stated["design"]),
        wishes["bandwidth"],
        None if sensitivity is None else float(sensitivity),
        bool(stated.get("feedforward", True)),
        overlap,
        wishes["bias"],
    )


def _alike(stated: Array, made: Array) -> bool:
    return stated.shape == made.shape and bool(np.abs(stated - made).max() <= SAME * np.abs(made).max())


def _followed(run: Run, data: RunData) -> Array:
    """(n_sample, 3) of the reference: exact where the excitation says it, else by differences of the column."""
    column = run["reference_m"]
    try:
        wanted = reference(parse_excitation(run.excitation), rate=data.rate)
        if wanted.position.size == column.size and np.abs(wanted.position - column).max() <= 1e-8 * np.ptp(column):
            return np.column_stack([wanted.position, wanted.velocity, wanted.acceleration])
    except InputError:
        pass
    slope = np.gradient(column) * data.rate
    return np.column_stack([column, slope, np.gradient(slope) * data.rate])
