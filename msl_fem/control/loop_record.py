"""The run of a closed loop as a record."""

from collections.abc import Mapping
from typing import Any

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.control.closed_loop import ClosedLoopRun
from msl_fem.errors import InputError
from msl_fem.record import Noise, Record, Run, Sampling


def closed_loop_record(
    actuator: Actuator,
    run: ClosedLoopRun,
    *,
    excitation: str,
    controller: Mapping[str, Any] | None = None,
    injection: Array | None = None,
) -> Record:
    """The record (origin "simulated", one run, role fit) at the loop's rate; commands are those that act.

    `controller` is what rig.toml states of the law, see `stepper.stated`; `injection` the test signal (n_sample,) m.

    Raises
    ------
    InputError : the actuator has no controller or no sides
    """
    if actuator.controller is None or actuator.sides is None:
        raise InputError(f"{actuator.name} has no [controller] or no [sides]; a closed-loop record needs both")
    sides = range(actuator.sides.count)
    columns = {"time_s": run.time, "reference_m": run.reference, "position_m": run.measured}
    columns |= {} if injection is None else {"injection_m": injection}
    columns |= {f"command_{j + 1}_A": run.acting[:, j] for j in sides}
    columns |= {f"voltage_{j + 1}_V": run.voltage[:, j] for j in sides}
    columns |= {f"current_{j + 1}_A": run.current_read[:, j] for j in sides}
    noise = Noise(position=actuator.position_sensor.noise, current=actuator.current_sensor.noise)
    runs = (Run("closed_loop", excitation, "fit", columns),)
    sampling = Sampling(rate=actuator.controller.rate)
    return Record("simulated", actuator, sampling=sampling, noise=noise, runs=runs, controller=controller)
