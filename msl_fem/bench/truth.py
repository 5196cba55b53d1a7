"""What is true of a bench: parameters drawn within the tolerances of the belief, and a table with a smooth error."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.bench.plant import Array
from msl_fem.bench.table_change import ERROR_TERMS, Factor, error_factor, multiplied, term_errors
from msl_fem.record import Tolerance
from msl_fem.table.magnetic_table import MagneticTable

CUT = 3.0
"""Standard deviations beyond which no parameter lies."""


@dataclass(frozen=True, eq=False)
class Truth:
    """The true parameters over the believed ones, and the coefficients (n_term,) of the table's error.

    Attributes
    ----------
    moving_mass, stiffness, damping, coil_resistance, nominal_gap : true over believed
    position_gain : reading over position
    magnetic_scale : coenergy, flux and force over the table's
    """

    moving_mass: float = 1.0
    stiffness: float = 1.0
    damping: float = 1.0
    coil_resistance: float = 1.0
    nominal_gap: float = 1.0
    position_gain: float = 1.0
    magnetic_scale: float = 1.0
    table: Array | None = None

    def report(self, actuator: Actuator) -> dict[str, Any]:
        """The true values in SI units, and how far each lies from the believed one."""
        ratios = {name: value for name, value in asdict(self).items() if name != "table"}
        believed: dict[str, float] = {"position_gain": 1.0, "magnetic_scale": 1.0}
        if actuator.motion is not None:
            names = ("moving_mass", "stiffness", "damping", "nominal_gap")
            believed |= {name: float(getattr(actuator.motion, name) or 0.0) for name in names}
        if actuator.magnet is not None:
            believed["coil_resistance"] = actuator.coil_resistance()
        found: dict[str, Any] = {
            name: {"value": believed[name] * ratios[name], "relative_error": ratios[name] - 1} for name in believed
        }
        found["table"] = {
            "terms": [list(term) for term in ERROR_TERMS],
            "coefficients": [] if self.table is None else self.table.tolist(),
        }
        return found


def draw_truth(tolerance: Tolerance, table: MagneticTable | None, generator: np.random.Generator) -> Truth:
    """True parameters: each normal about the believed one with its tolerance as sigma, cut at three.

    The coefficients of the table's error fall with the square of the degree; they are scaled such that the expected
    RMS error over the table, of force or flux linkage, whichever is larger, is the tolerance.
    """
    drawn = {
        name: 1 + sigma * _cut_normal(generator) for name, sigma in tolerance.model_dump().items() if name != "table"
    }
    spread = np.array([1.0 / (1 + a + b) ** 2 for a, b in ERROR_TERMS])
    raw = spread * np.array([_cut_normal(generator) for _ in ERROR_TERMS])
    if table is None:
        return Truth(**drawn)
    worst = max(float(spread**2 @ part) for part in term_errors(table))
    return Truth(**drawn, table=tolerance.table * raw / np.sqrt(worst))


def _cut_normal(generator: np.random.Generator) -> float:
    """A standard normal number within three standard deviations."""
    while True:
        value = float(generator.standard_normal())
        if abs(value) <= CUT:
            return value


def true_table(table: MagneticTable, truth: Truth) -> MagneticTable:
    """The magnets' own table: the believed one with its smooth error and the magnetic scale."""
    coefficients = np.zeros(len(ERROR_TERMS)) if truth.table is None else truth.table
    if truth.table is None and truth.magnetic_scale == 1.0:
        return table
    made = multiplied(table, error_factor(table, coefficients))
    return multiplied(made, Factor(np.array(truth.magnetic_scale)))
