"""Runs that could be made: the standard excitations of an actuator, and its record with and without a cause."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.plant import NamedRun, bearable_run, plant_parameters, simulate, simulation_record, stability_limit
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import DRIVE_UNIT, Inputs, excitation_inputs, parse_excitation
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.plant.plant import FORCE_DRIVE, VOLTAGE_DRIVE, PlantParameters
from msl_fem.record import Record, Run
from msl_fem.table.magnetic_table import MagneticTable

REACH = 0.2
"""Share of the travel that the mover uses at most."""
SECONDS = 1.0  # of a standard run
_SETTLED = 4.0  # time constants of the mover's decay, before a run begins
_LONGEST_LEAD = 1.0  # s
_MOST_HALVINGS = 14


def standard_excitations(
    actuator: Actuator, table: MagneticTable | None, *, rate: float, seconds: float = SECONDS
) -> tuple[Excitation, Excitation]:
    """Band-limited noise to fit to and a swept sine held out, about half the current that the open loop bears.

    The amplitudes are the largest halvings with which the mover uses a fifth of its travel.

    Raises
    ------
    InputError : there is no spring, or no travel to choose them by
    """
    plant = plant_parameters(actuator)
    if plant.stiffness <= 0 or not math.isfinite(plant.travel):
        raise InputError(f"{actuator.name}: without stiffness and range there is no standard run; state --excitation")
    bias, first = _bias(actuator, plant, table)
    unit = DRIVE_UNIT[actuator.drive.kind] if actuator.drive else "N"
    held = f"bias={bias:.2g} {unit}," if bias else ""
    band = format_quantity(min(500.0, rate / 20), "Hz", digits=2)
    stop = format_quantity(min(300.0, rate / 30), "Hz", digits=2)
    noise = f"band-limited-noise:{held}band={band},duration={seconds} s,seed=1,role=fit"
    sweep = f"swept-sine:{held}start=5 Hz,stop={stop},duration={seconds} s,role=held-out"
    borne = [_borne(actuator, table, f"{spec},amplitude={first:.2g} {unit}", rate=rate) for spec in (noise, sweep)]
    return borne[0], borne[1]


def _bias(actuator: Actuator, plant: PlantParameters, table: MagneticTable | None) -> tuple[float, float]:
    """(bias, the first amplitude to try) in the drive's unit."""
    if plant.drive == FORCE_DRIVE or table is None:
        return 0.0, plant.stiffness * plant.travel
    largest = min(plant.current_limit, float(table.current[-1]) / plant.current_share)
    current = 0.5 * min(stability_limit(actuator, table), largest)
    if plant.drive == VOLTAGE_DRIVE:
        return current * plant.resistance, 2 * current * plant.resistance
    return current, current / 3.2  # three RMS of noise leave the current positive


def _borne(actuator: Actuator, table: MagneticTable | None, spec: str, *, rate: float) -> Excitation:
    travel = plant_parameters(actuator).travel
    excitation = parse_excitation(spec, unit=DRIVE_UNIT[actuator.drive.kind] if actuator.drive else "N")
    for _ in range(_MOST_HALVINGS):
        run, excitation = bearable_run(actuator, table, excitation, rate=rate)
        if np.abs(run.position).max() <= REACH * travel:
            return excitation
        excitation = excitation.model_copy(update={"amplitude": excitation.amplitude / 2})
    raise InputError(f"{actuator.name}: no amplitude of '{spec}' keeps to {REACH:g} of the travel; state --excitation")


@dataclass(frozen=True, eq=False)
class PlannedRuns:
    """Runs of an actuator with what is believed of it, each after a lead-in at its bias in which the mover settles.

    Attributes
    ----------
    believed : effects beside the table; None: none
    seed : of the instruments' noise, which is the same in all records
    """

    actuator: Actuator
    table: MagneticTable | None
    excitations: Sequence[Excitation]
    rate: float
    believed: EffectValues | None = None
    seed: int = 1

    @cached_property
    def plant(self) -> PlantParameters:
        return plant_parameters(self.actuator)

    @property
    def lead(self) -> int:
        """Samples of the lead-in."""
        decay = 2 * self.plant.mass / self.plant.damping if self.plant.damping else math.inf
        return round(min(_SETTLED * decay, _LONGEST_LEAD) * self.rate)

    def record(self, effects: EffectValues | None = None) -> Record:
        """The runs without noise, with these effects in place of those believed.

        Raises
        ------
        InputError : the plant cannot have one of the effects
        ComputationError : the runs leave the table or the travel
        """
        runs = []
        for n, excitation in enumerate(self.excitations):
            inputs = self._with_lead(excitation_inputs(self.actuator, excitation, rate=self.rate), excitation.bias)
            done = simulate(self.actuator, self.table, inputs, effects=effects or self.believed)
            runs.append(NamedRun(f"run_{n + 1}", excitation.spec, excitation.role, done))
        record = simulation_record(self.actuator, runs)
        return replace(record, runs=tuple(self._without_lead(run) for run in record.runs))

    def with_noise(self, record: Record) -> Record:
        """A record of these runs as the instruments would read it; the noise is the same for every record."""
        generator = np.random.default_rng(self.seed)
        sigmas = {"position": record.noise.position, "current": record.noise.current}
        runs = []
        for run in record.runs:
            columns = dict(run.columns)
            for name in columns:
                sigma = sigmas.get(name.partition("_")[0])
                drawn = generator.standard_normal(columns[name].size)
                columns[name] = columns[name] + drawn * sigma if sigma else columns[name]
            runs.append(replace(run, columns=columns))
        return replace(record, runs=tuple(runs))

    def _with_lead(self, inputs: Inputs, bias: float) -> Inputs:
        lead = np.full((self.lead, inputs.commands.shape[1]), bias)
        return Inputs(np.concatenate([lead, inputs.commands]), inputs.rate)

    def _without_lead(self, run: Run) -> Run:
        columns: dict[str, Array] = {name: values[self.lead :] for name, values in run.columns.items()}
        return replace(run, columns=columns | {"time_s": columns["time_s"] - columns["time_s"][0]})
