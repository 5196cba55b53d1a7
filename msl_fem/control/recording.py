"""A closed-loop run as a record, as an experimenter on that rig would have written it."""

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.control.closed_loop import ClosedLoopRun
from msl_fem.coupled_model.sensors import current_reading
from msl_fem.errors import InputError
from msl_fem.record import Noise, Record, Run, Sampling


def closed_loop_record(
    actuator: Actuator, run: ClosedLoopRun, *, excitation: str, generator: np.random.Generator | None = None
) -> Record:
    """The record (origin "simulated", one run, role fit) at the loop's rate; current readings are noisy by `generator`.

    Raises
    ------
    InputError : the actuator has no controller or no sides
    """
    if actuator.controller is None or actuator.sides is None:
        raise InputError(f"{actuator.name} has no [controller] or no [sides]; a closed-loop record needs both")
    sides = range(actuator.sides.count)
    current = current_reading(actuator, run.current, generator=generator)
    columns = {"time_s": run.time, "reference_m": run.reference, "position_m": run.measured}
    columns |= {f"command_{j + 1}_A": run.command[:, j] for j in sides}
    columns |= {f"voltage_{j + 1}_V": run.voltage[:, j] for j in sides}
    columns |= {f"current_{j + 1}_A": current[:, j] for j in sides}
    noise = Noise(position=actuator.position_sensor.noise, current=actuator.current_sensor.noise)
    runs = (Run("closed_loop", excitation, "fit", columns),)
    return Record("simulated", actuator, sampling=Sampling(rate=actuator.controller.rate), noise=noise, runs=runs)
