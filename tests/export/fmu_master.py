"""Actuators for the FMU's tests, and a master that steps one of its instances."""

from collections.abc import Iterable
from ctypes import c_void_p
from pathlib import Path
from typing import Any

import fmpy.fmi2
import numpy as np
from c_programs import compiler
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from msl_fem.actuator import Actuator
from msl_fem.export import fmu
from msl_fem.export.formats import ModelSource
from msl_fem.plant import Inputs, Options, Simulation, plant_parameters, simulate
from msl_fem.plant.effects import CATALOGUE, EffectValues
from msl_fem.plant.step_count import STEP_OF_FASTEST, fastest_rate
from msl_fem.table.magnetic_table import MagneticTable

RATE = 1e4
PAIRS = {"current": "current", "voltage": "voltage", "flux_linkage": "flux_linkage"}
SINGLE = {"position": "position", "velocity": "velocity", "position_measured": "measured_position"}


def changed(actuator: Actuator, **sections: dict[str, Any]) -> Actuator:
    """The actuator with keys of its sections changed."""
    return actuator.model_copy(
        update={name: getattr(actuator, name).model_copy(update=new) for name, new in sections.items()}
    )


def cases(servo: Actuator) -> dict[str, tuple[Actuator, list[float]]]:
    """Actuators of all kinds of drive, with commands under which a mover pulls in and meets its end stop."""
    stop = changed(servo, motion={"end_stop": 5e-4, "end_stop_restitution": 0.4})
    rig = stop.model_copy(update={"magnet": None, "sides": None})
    return {
        "current": (stop, [6.0, 0.0]),
        "at its voltage limit": (changed(stop, drive={"voltage_limit": 20.0}), [9.0, 1.0]),
        "ideal current": (changed(stop, drive={"bandwidth": None}), [-5.0, 1.0]),
        "voltage": (changed(stop, drive={"kind": "voltage", "bandwidth": 2e3, "current_limit": 3.0}), [1.0, 9.0]),
        "ideal voltage": (changed(stop, drive={"kind": "voltage", "bandwidth": None}), [9.0, -2.0]),
        "one side, parallel": (changed(stop, sides={"count": 1, "connection": "parallel"}), [11.0]),
        "force": (changed(rig, drive={"kind": "force", "bandwidth": 200.0}), [90.0]),
        "ideal force, a hard stop": (
            changed(rig, drive={"kind": "force", "bandwidth": None}, motion={"end_stop_restitution": 1.0}),
            [-200.0],
        ),
    }


class Fmi3Slave(FMU3Slave):
    """An instance of FMI 3.0 under the names of FMI 2.0 that a `Master` calls."""

    getReal, setReal = FMU3Slave.getFloat64, FMU3Slave.setFloat64  # noqa: N815 (the standard's names)
    getInteger = FMU3Slave.getInt32  # noqa: N815

    def setupExperiment(self, startTime: float) -> None:  # noqa: N802
        self.start = startTime

    def enterInitializationMode(self) -> None:  # noqa: N802
        super().enterInitializationMode(startTime=self.start)


class Master:
    """One instance of an FMU: what it says goes into `said`."""

    def __init__(self, archive: Path, *, name: str = "one", guid: str | None = None) -> None:
        self.description = read_model_description(str(archive))
        self.reference = {v.name: v.valueReference for v in self.description.modelVariables}
        self.said: list[tuple[int, str]] = []
        self.folder = extract(str(archive))
        stated: dict[str, Any] = {
            "guid": guid or self.description.guid, "unzipDirectory": self.folder, "instanceName": name,
            "modelIdentifier": self.description.coSimulation.modelIdentifier,
        }  # fmt: skip
        if self.description.fmiVersion == "3.0":
            self.slave: Any = Fmi3Slave(**stated)
            self.slave.instantiate(logMessage=self._log3)
            return
        self.slave = FMU2Slave(**stated)
        self._callbacks = fmpy.fmi2.fmi2CallbackFunctions()
        self._callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(self._log)
        self._callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.fmi2.calloc)
        self._callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.fmi2.free)
        self.slave.instantiate(callbacks=self._callbacks)

    def _log(self, environment: c_void_p, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        assert category == b"logStatusError"
        self.said.append((status, message.decode()))

    def _log3(self, environment: c_void_p, status: int, category: bytes, message: bytes) -> None:
        self._log(environment, b"", status, category, message)

    def initialise(self, **start: float) -> "Master":
        """Start values set, initialised: ready to step."""
        self.slave.setupExperiment(startTime=0.0)
        for name, value in start.items():
            self.put(name, value)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()
        return self

    def put(self, name: str, value: float) -> None:
        if isinstance(value, bool):
            self.slave.setBoolean([self.reference[name]], [value])
        else:
            self.slave.setReal([self.reference[name]], [value])

    def get(self, *names: str) -> list[float]:
        return list(self.slave.getReal([self.reference[name] for name in names]))

    def read(self, names: Iterable[str]) -> dict[str, float]:
        names = list(names)
        return dict(zip(names, self.get(*names), strict=True))

    def neutral(self) -> dict[str, float]:
        """All effects that the unit has at their neutral values, by the names of its parameters."""
        every = {f"{e.name}_{p.name}": p.neutral for e in CATALOGUE.values() for p in e.parameters}
        return {name: value for name, value in every.items() if name in self.reference}

    def counts(self, name: str, n: int) -> list[int]:
        return [self.slave.getInteger([self.reference[f"{name}_{j + 1}"]])[0] for j in range(n)]

    def run(
        self, commands: np.ndarray, *, sides: int, disturbance: float = 0.0, start: int = 0, measured: bool = False
    ) -> dict[str, np.ndarray]:
        """What `simulate` records, (n_sample,) or (n_sample, n_side); `measured`: with the readings of currents."""
        of_sides = [*PAIRS, "current_measured"] if measured else [*PAIRS]
        names = [*SINGLE, *(f"{name}_{j + 1}" for name in of_sides for j in range(sides))]
        voltages = [f"voltage_{j + 1}" for j in range(sides)]
        rows = []
        for k, command in enumerate(commands, start=start):
            row = dict(zip(names, self.get(*names), strict=True))
            for j, value in enumerate(command):
                self.put(f"command_{j + 1}", float(value))
            self.put("disturbance", disturbance)
            self.slave.doStep(k / RATE, 1 / RATE)
            rows.append(row | dict(zip(voltages, self.get(*voltages), strict=True)))
        columns = {name: np.array([row[name] for row in rows]) for name in SINGLE}
        names = {p: [f"{p}_{j + 1}" for j in range(sides)] for p in of_sides}
        pairs = {p: np.array([[row[n] for n in names[p]] for row in rows]).reshape(len(rows), sides) for p in of_sides}
        return columns | pairs


def exported(
    actuator: Actuator,
    table: MagneticTable,
    folder: Path,
    *,
    effects: EffectValues | None = None,
    fmi: fmu.Interface = fmu.FMI_2,
) -> Path:
    """The FMU of an actuator, its library compiled."""
    compiler("gcc")
    archive = folder / f"model{fmi.version[0]}.fmu"
    fmu.write(ModelSource(actuator, table if actuator.magnet else None, effects), archive, fmi=fmi)
    return archive


def steps(levels: list[float], *, n: int = 500) -> np.ndarray:
    """(n, n_side) commands: up to their levels at once, then a tenth, so that what was pulled in comes off again."""
    return np.where(np.arange(n)[:, None] < 0.7 * n, 1.0, 0.1) * np.array(levels)


def run_in_python(
    actuator: Actuator, table: MagneticTable, commands: np.ndarray, options: Options | None = None
) -> Simulation:
    """The run in as many steps as the unit takes, which does not know its excitation beforehand."""
    magnets = table if actuator.magnet else None
    largest = STEP_OF_FASTEST / fastest_rate(plant_parameters(actuator), magnets)
    options = options or Options(substeps=max(1, int(np.ceil(1 / RATE / largest - 1e-9))))
    return simulate(actuator, magnets, Inputs(commands, RATE, 3.0), options=options)


def assert_equal_runs(found: dict[str, np.ndarray], wanted: Simulation, *, within: float) -> None:
    """All channels agree, each to a share of its largest value."""
    for name, attribute in (SINGLE | PAIRS).items():
        reference = getattr(wanted, attribute)
        assert found[name].shape == reference.shape, name
        if reference.size:
            scale = np.abs(reference).max() or 1.0
            np.testing.assert_allclose(found[name], reference, rtol=0, atol=within * scale, err_msg=name)
