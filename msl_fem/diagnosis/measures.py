"""Numbers that can be measured beside a run, as functions of what a fit does not know."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.separation import Measure
from msl_fem.diagnosis.simulator import Problem
from msl_fem.plant import static_map
from msl_fem.plant.effects import PARAMETER_INDEX, from_vector

Array = NDArray[np.float64]
GAUGE_BLOCK, SCALES, OHMMETER, LOAD_CELL = 2e-4, 2e-4, 1e-3, 2e-3
"""One sigma of each, relative: a block of 1 mm read to 0.2 um; workshop scales; a bench meter with four wires; a load
cell and a gap set by shims."""


def beside_a_run(problem: Problem) -> Iterator[Measure]:
    """The measurements that a rig allows."""
    gain = PARAMETER_INDEX["position_sensor_nonlinearity", "gain_error"]

    def reading(factors: dict[str, float], table: Array, effects: Array) -> float:
        return float(np.log(factors.get("position_gain", 1.0) * (1 + effects[gain])))

    yield Measure("a gauge block under the position sensor", reading, GAUGE_BLOCK)
    yield Measure("the mover weighed", lambda factors, t, e: float(np.log(factors.get("moving_mass", 1.0))), SCALES)
    if problem.plant.parameters.sides:
        yield Measure(
            "the coils' resistance", lambda factors, t, e: float(np.log(factors.get("coil_resistance", 1.0))), OHMMETER
        )
        yield Measure("one force at rest, by a load cell", _static_force(problem), LOAD_CELL)


def _static_force(problem: Problem) -> Callable[[dict[str, float], Array, Array], float]:
    """The log of a magnet's force at rest, at the nominal gap and the mean current of the runs."""
    plant = problem.plant
    p = plant.parameters
    run = problem.runs[0]
    current = float(np.sqrt(np.mean(run.measured.get("current_1_A", run.commands[:, 0]) ** 2))) * p.current_share

    def force(factors: dict[str, float], table: Array, effects: Array) -> float:
        coefficients = plant.surface.coefficients
        if problem.table_error is not None:
            coefficients = coefficients + np.tensordot(table, problem.table_error.modes, axes=1)
        surface = plant.surface._replace(coefficients=factors.get("magnetic_scale", 1.0) * coefficients)
        gap = p.nominal_gap * factors.get("nominal_gap", 1.0)
        found, _ = static_map(surface, p, from_vector(effects), gap=[gap], current=[current])
        return float(np.log(found[0]))

    return force
