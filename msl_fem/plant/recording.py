"""Simulated runs as a record, as an experimenter on that rig would have written it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.plant.simulate import Array, Simulation
from msl_fem.record import Noise, Record, Role, Run, Sampling


@dataclass(frozen=True, eq=False)
class NamedRun:
    """A simulation with what rig.toml says about a run: its name (also the file's), excitation in words, and role.

    `reference` is what a closed loop was to follow, (n_sample,) m.
    """

    name: str
    excitation: str
    role: Role
    simulation: Simulation
    reference: Array | None = None


def simulation_record(
    actuator: Actuator, runs: Sequence[NamedRun], *, controller: Mapping[str, Any] | None = None
) -> Record:
    """The record (origin "simulated") of runs of one actuator, all sampled at one rate.

    Currents and position are the sensors' readings, voltages (and the force of a force drive) means over the sample;
    what no instrument reads, such as flux linkage, is left out. The noise is that of the actuator's sensors. Commands
    are those that act from their sample on. `controller` is what rig.toml is to state of one.

    Raises
    ------
    InputError : no runs, or runs of different rates
    RecordError : as `write_record`, when it is written
    """
    rates = {run.simulation.rate for run in runs}
    if len(rates) != 1:
        raise InputError(
            f"the runs of a record have one sampling rate, these have {sorted(rates) or 'none'} Hz; simulate them alike"
        )
    noise = Noise(position=actuator.position_sensor.noise)
    if any(run.simulation.current.shape[1] for run in runs):
        noise = Noise(position=actuator.position_sensor.noise, current=actuator.current_sensor.noise)
    made = tuple(Run(run.name, run.excitation, run.role, _columns(actuator, run)) for run in runs)
    sampling = Sampling(rate=rates.pop())
    return Record("simulated", actuator, sampling=sampling, noise=noise, controller=controller, runs=made)


def _columns(actuator: Actuator, run: NamedRun) -> dict[str, Array]:
    """Columns of a run file, by RECORDS' names; commands where they are not what a column has already."""
    simulation = run.simulation
    kind = actuator.drive.kind if actuator.drive else "force"
    sides = range(simulation.current.shape[1])
    columns = {"time_s": simulation.time}
    if kind == "current":
        columns |= {f"command_{j + 1}_A": simulation.command[:, j] for j in sides}
    columns |= {f"voltage_{j + 1}_V": simulation.voltage[:, j] for j in sides}
    columns |= {f"current_{j + 1}_A": simulation.measured_current[:, j] for j in sides}
    if kind == "force":
        columns["force_N"] = simulation.force
    columns["position_m"] = simulation.measured_position
    return columns if run.reference is None else columns | {"reference_m": run.reference}
