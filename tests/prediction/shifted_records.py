"""Short simulated records of the reference actuator, whose truth differs from what the record believes."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.plant import NamedRun, excitation_inputs, simulate, simulation_record
from msl_fem.plant.excitation import parse_excitation
from msl_fem.record import Record
from msl_fem.table.magnetic_table import MagneticTable

RATE = 5e3
SPECS = {
    "fit": "band-limited-noise:channel=independent,band=200 Hz,bias=0.5 A,amplitude=0.05 A,duration=1 s,seed=1",
    "held-out": "band-limited-noise:channel=independent,band=200 Hz,bias=0.5 A,amplitude=0.05 A,duration=1 s,seed=2",
}


def shifted(actuator: Actuator, shift: Mapping[str, float]) -> Actuator:
    """The actuator with entries of [motion] times their factors."""
    motion = actuator.motion
    changed = {name: getattr(motion, name) * factor for name, factor in shift.items()}
    return actuator.model_copy(update={"motion": motion.model_copy(update=changed)})


def in_voltage_drive(actuator: Actuator) -> Actuator:
    """The actuator with an ideal voltage amplifier."""
    drive = actuator.drive.model_copy(update={"kind": "voltage", "bandwidth": None})
    return actuator.model_copy(update={"drive": drive})


def simulated_record(
    believed: Actuator, table: MagneticTable, shift: Mapping[str, float], *, specs: Mapping[str, str] | None = None
) -> Record:
    """A record of the shifted actuator whose rig file states the believed one."""
    truth, runs = shifted(believed, shift), []
    unit = "A" if believed.drive.kind == "current" else "V"
    for n, (role, spec) in enumerate((specs or SPECS).items()):
        excitation = parse_excitation(spec, unit=unit)
        inputs = excitation_inputs(truth, excitation, rate=RATE)
        run = simulate(truth, table, inputs, generator=np.random.default_rng(n))
        runs.append(NamedRun(role.replace("-", "_"), spec, role, run))
    return replace(simulation_record(truth, runs), actuator=believed)
