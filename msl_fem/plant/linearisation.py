"""The linear model of a plant at constant currents and a position."""

import math
from dataclasses import dataclass

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.statespace import StateSpace
from msl_fem.plant.operating_point import net_force
from msl_fem.plant.plant import CURRENT_DRIVE, FORCE_DRIVE, VOLTAGE_DRIVE, PlantParameters, plant_parameters
from msl_fem.plant.two_sides import Currents, shared_by_sides
from msl_fem.table.magnetic_table import MagneticTable


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
    model = _assemble(plant, _small_signal(plant, table, currents, position), stiffness)
    natural = math.sqrt(stiffness / plant.mass) / (2 * math.pi) if stiffness > 0 else math.nan
    return Linearisation(model, currents, position, stiffness, natural, force)


@dataclass(frozen=True)
class _SmallSignal:
    """Slopes of flux linkages and force at a point: dlambda_j/dx = dF/di_j (N/A), dlambda_j/di_k (H)."""

    pull: Array  # (n_side,), towards +x
    inductance: Array  # (n_side, n_side)


def _small_signal(
    plant: PlantParameters, table: MagneticTable | None, currents: Currents, position: float
) -> _SmallSignal:
    pull, inductance = np.zeros(plant.sides), np.zeros((plant.sides, plant.sides))
    linkages = plant.magnets * plant.current_share
    for j in range(plant.sides):
        assert table is not None  # net_force saw to it
        toward = 1 - 2 * j
        magnet = table.evaluate(plant.current_share * currents[j], plant.nominal_gap - toward * position)
        pull[j] = toward * linkages * float(magnet["force_current_slope"])
        inductance[j, j] = linkages * plant.current_share * float(magnet["incremental_inductance"])
        inductance[j, j] += plant.leakage_1 if j == 0 else plant.leakage_2
    if plant.sides == 2:
        inductance += plant.mutual * (1.0 - np.eye(2))
    shared = shared_by_sides(plant, table, currents=currents, position=np.array(position))
    if shared is not None:
        turned = np.array([1.0, plant.polarity])
        pull += linkages * turned * [float(shared[name]) for name in ("x1", "x2")]
        both = [[float(shared[name]) for name in row] for row in (("11", "12"), ("12", "22"))]
        inductance += linkages * plant.current_share * np.outer(turned, turned) * both
    return _SmallSignal(pull, inductance)


def _assemble(plant: PlantParameters, point: _SmallSignal, stiffness: float) -> StateSpace:
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
        if plant.drive == CURRENT_DRIVE:
            rate[f"current{c}"] = lag * (row[f"command{c}"] - row[f"current{c}"])
        force = force + point.pull[j] * row[f"current{c}"]
    if plant.drive == VOLTAGE_DRIVE:
        drops = [
            plant.resistance * row[f"current{c}"] + point.pull[j] * row["velocity"] for j, c in enumerate(channels)
        ]
        left = np.array([row[f"output{c}"] - drop for c, drop in zip(channels, drops, strict=True)])
        rate |= dict(zip((f"current{c}" for c in channels), np.linalg.solve(point.inductance, left), strict=True))
    rate["velocity"] = force / plant.mass
    rate["position_sensor"] = sensor_lag * (row["position"] - row["position_sensor"])
    outputs = ["position", "position_sensor"] + [f"current{c}" for c in channels if plant.drive != FORCE_DRIVE]
    dynamics = np.array([rate[s] for s in states])
    reading = np.array([row[o] for o in outputs])
    n = len(states)
    return StateSpace(
        dynamics[:, :n],
        dynamics[:, n:],
        reading[:, :n],
        reading[:, n:],
        states=tuple(states),
        inputs=tuple(inputs),
        outputs=tuple(outputs),
    )


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
