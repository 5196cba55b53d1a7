"""The coupled model near an operating point, as a linear system."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.statespace import StateSpace
from msl_fem.plant.equilibrium import Currents, net_force
from msl_fem.plant.plant import (
    CURRENT_DRIVE,
    FORCE_DRIVE,
    VOLTAGE_DRIVE,
    PlantParameters,
    plant_parameters,
)
from msl_fem.table.magnetic_table import MagneticTable

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Small deviations from (currents, position) at rest.

    Attributes
    ----------
    model : continuous; inputs `command_1`, `command_2` (A, V or N by the drive's kind) and `disturbance` (N); outputs
        `position`, `position_sensor` (before noise), `current_1`, `current_2`; ideal parts have no states. One side,
        or a force drive, has the signals of its sides only
    stiffness : static, at constant currents, N/m
    natural_frequency : of the mover on that stiffness, Hz; nan where the stiffness is not positive
    residual_force : net static force at the point, N; zero at an equilibrium
    """

    model: StateSpace
    currents: Currents
    position: float
    stiffness: float
    natural_frequency: float
    residual_force: float

    @property
    def is_stable(self) -> bool:
        """Whether the open loop returns to the point: all poles in the left half plane."""
        return self.model.is_stable


def linearise(
    actuator: Actuator, table: MagneticTable | None, *, currents: Currents = (0.0, 0.0), position: float = 0.0
) -> Linearisation:
    """The linear model at constant side currents (A) and a position (m), at rest.

    A force that does not vanish at the point (`residual_force`) is taken to be held by a constant one.

    Raises
    ------
    OutOfTable : the point lies outside the table
    InputError : a section of the actuator, or the table of its magnets, is missing
    """
    plant = plant_parameters(actuator)
    force, stiffness = (float(v) for v in net_force(plant, table, currents=currents, position=np.array(position)))
    model = _assemble(plant, [_side(plant, table, j, currents[j], position) for j in range(plant.sides)], stiffness)
    natural = math.sqrt(stiffness / plant.mass) / (2 * math.pi) if stiffness > 0 else math.nan
    return Linearisation(model, currents, position, stiffness, natural, force)


def _side(
    plant: PlantParameters, table: MagneticTable | None, j: int, current: float, position: float
) -> tuple[float, float]:
    """(dF/di N/A, dlambda/di H) of side j; the flux's slope over the gap is the negative of the first."""
    assert table is not None  # net_force saw to it
    gap = plant.nominal_gap - (1 - 2 * j) * position
    magnet = table.evaluate(plant.current_share * current, gap)
    linkages = plant.magnets * plant.current_share
    inductance = linkages * plant.current_share * float(magnet["incremental_inductance"])
    return linkages * float(magnet["force_current_slope"]), inductance


def _assemble(plant: PlantParameters, sides: list[tuple[float, float]], stiffness: float) -> StateSpace:
    """The matrices: every signal is a row over states and inputs, and every state a row of its rate.

    Rates of ideal parts, which are no states, are computed with a bandwidth of zero and not used.
    """
    channels = [f"_{j + 1}" for j in range(1 if plant.drive == FORCE_DRIVE else plant.sides)]
    states, inputs, row = _signals(plant, channels)
    lag, sensor_lag = (w if math.isfinite(w) else 0.0 for w in (plant.bandwidth, plant.sensor_bandwidth))
    force = row["disturbance"] - plant.damping * row["velocity"] - stiffness * row["position"]
    rate = {"position": row["velocity"]}
    for j, c in enumerate(channels):
        rate[f"output{c}"] = lag * (row[f"command{c}"] - row[f"output{c}"])
        if plant.drive == FORCE_DRIVE:
            force = force + row[f"output{c}"]
            continue
        force_slope, inductance = sides[j]
        pull = (1 - 2 * j) * force_slope  # N/A towards +x, and V s/m of back-EMF
        if plant.drive == CURRENT_DRIVE:
            rate[f"current{c}"] = lag * (row[f"command{c}"] - row[f"current{c}"])
        else:
            drop = plant.resistance * row[f"current{c}"] + pull * row["velocity"]
            rate[f"current{c}"] = (row[f"output{c}"] - drop) / inductance
        force = force + pull * row[f"current{c}"]
    rate["velocity"] = force / plant.mass
    rate["position_sensor"] = sensor_lag * (row["position"] - row["position_sensor"])
    outputs = ["position", "position_sensor"] + [f"current{c}" for c in channels if plant.drive != FORCE_DRIVE]
    dynamics, reading = np.array([rate[s] for s in states]), np.array([row[o] for o in outputs])
    n = len(states)
    return StateSpace(
        dynamics[:, :n], dynamics[:, n:], reading[:, :n], reading[:, n:],
        states=tuple(states), inputs=tuple(inputs), outputs=tuple(outputs),
    )  # fmt: skip


def _signals(plant: PlantParameters, channels: list[str]) -> tuple[list[str], list[str], dict[str, Array]]:
    """(states, inputs, row of every signal over both); what is ideal is no state and has the row of its input."""
    lagging = math.isfinite(plant.bandwidth)
    states = [f"output{c}" for c in channels if plant.drive != CURRENT_DRIVE and lagging]
    states += [
        f"current{c}" for c in channels if plant.drive == VOLTAGE_DRIVE or (plant.drive == CURRENT_DRIVE and lagging)
    ]
    states += ["position", "velocity"]
    states += ["position_sensor"] if math.isfinite(plant.sensor_bandwidth) else []
    inputs = [f"command{c}" for c in channels] + ["disturbance"]
    row: dict[str, Array] = dict(zip([*states, *inputs], np.eye(len(states) + len(inputs)), strict=True))
    for c in channels:
        row.setdefault(f"output{c}", row[f"command{c}"])
        row.setdefault(f"current{c}", row[f"command{c}"])
    row.setdefault("position_sensor", row["position"])
    return states, inputs, row
