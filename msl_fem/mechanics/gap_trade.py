"""What a larger nominal gap buys and costs: range, bandwidth, current (Gutierrez and Ro 1998).

All else stays: magnet, moving mass, suspension, the clearance that remains at the end of the travel. Definitions:

- range: nominal gap less clearance;
- current limit at a gap: what brings the level of flux density (1.2 T: the preferred region), or the drive's limit;
- bandwidth at an amplitude: the frequency up to which x = X sin(2 pi f t) can be followed: at every phase the force
  m x'' + c x' + k x + k_3 x^3 - F_const is there, from the side that pulls that way, within the current limit at its
  gap. One side pulls at a time (the paper's law). Voltage and loop rate are not asked;
- current for a force: of the side at rest at the nominal gap.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from msl_fem.actuator import Actuator, Motion
from msl_fem.computing.arrays import Array
from msl_fem.errors import ActuatorError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.maps import operating_map
from msl_fem.table.magnetic_table import MagneticTable

N_GAP, N_LIMIT, N_PHASE, N_FREQUENCY = 25, 48, 181, 400
HIGHEST_FREQUENCY = 1e5  # Hz; what no flexure-guided mover of this kind follows


@dataclass(frozen=True)
class TradeSettings:
    """What the trade is computed for.

    Attributes
    ----------
    level : T, flux density in the iron that bounds the current
    clearance : m, the smallest gap at the end of the travel; by default that of the actuator
    amplitude : m, of the bandwidth at a fixed amplitude; by default a tenth of the actuator's range
    force : N, of one side; by default what holds the actuator's range against its stiffness
    """

    level: float = 1.2
    clearance: float | None = None
    amplitude: float | None = None
    force: float | None = None


@dataclass(frozen=True, eq=False)
class GapTrade:
    """The trade over the nominal gap, arrays (n_gap,) in SI units.

    Attributes
    ----------
    range : m, plus and minus
    bandwidth_full, bandwidth_fixed : Hz, at the full range and at `amplitude`; 0 where not even rest at the end can
        be held, nan where the amplitude does not fit the range
    level_current : A of a side, that brings `level` at the nominal gap, or the largest known where none does
    force_current : A of a side, for `force` at the nominal gap; nan beyond the largest known
    gap_limit : m, the largest nominal gap whose travel the table covers
    """

    nominal_gap: Array
    range: Array
    bandwidth_full: Array
    bandwidth_fixed: Array
    level_current: Array
    force_current: Array
    level: float
    clearance: float
    amplitude: float
    force: float
    gap_limit: float


class _Side:
    """The magnets of one side: the force that it can give at a gap, and the current that a force takes."""

    def __init__(self, actuator: Actuator, table: MagneticTable, level: float) -> None:
        sides = actuator.sides
        drive = actuator.drive
        self.table = table
        self.magnets = sides.magnets_per_side if sides else 1
        self.share = 1 / self.magnets if sides and sides.connection == "parallel" else 1.0  # magnet over side current
        limit = drive.current_limit * self.share if drive and drive.current_limit else math.inf
        self.most = min(limit, float(table.current[-1]))
        self.gap = np.geomspace(table.gap[0], table.gap[-1], N_LIMIT)
        reached = operating_map(table, levels=(level,), gap=self.gap).current[0]
        self.limit = np.minimum(np.where(np.isnan(reached), self.most, reached), self.most)

    def current_limit(self, gap: Array) -> Array:
        """A of a magnet."""
        return np.interp(gap, self.gap, self.limit)

    def largest_force(self, gap: Array) -> Array:
        return self.magnets * self.table.force(self.current_limit(gap), gap)

    def current_for(self, force: float, gap: float) -> float:
        """A of the side; nan beyond the largest known."""

        def excess(current: float) -> float:
            return self.magnets * float(self.table.force(current, gap)) - force

        return brentq(excess, 0.0, self.most) / self.share if excess(self.most) >= 0 else math.nan


def gap_trade(actuator: Actuator, table: MagneticTable, *, settings: TradeSettings | None = None) -> GapTrade:
    """The trade of an actuator's nominal gap, as far as the table covers the travel.

    Raises
    ------
    ActuatorError : no moving mass, nominal gap or range
    InputError : a clearance outside the table, or a setting that is not positive
    """
    motion = actuator.motion
    if motion is None or motion.nominal_gap is None or motion.range is None:
        raise ActuatorError(f"{actuator.name} states no motion with nominal_gap and range, whose trade is asked")
    if actuator.sides is not None and actuator.sides.count != 2:
        raise ActuatorError(f"{actuator.name} has one side; the trade is that of two opposing ones")
    given = settings or TradeSettings()
    clearance = _or(given.clearance, motion.nominal_gap - motion.range)
    amplitude = _or(given.amplitude, motion.range / 10)
    force = _or(given.force, motion.stiffness * motion.range)
    for name, value in (("clearance", clearance), ("amplitude", amplitude), ("force", force)):
        if not 0 < value < math.inf:
            raise InputError(f"{name} {value:g} is not allowed; it must be above 0")
    largest = (float(table.gap[-1]) + clearance) / 2
    if not table.gap[0] <= clearance < largest * (1 - 1e-6):
        raise InputError(
            f"clearance {format_quantity(clearance, 'm')} must lie within the table's gaps, "
            f"{table.gap[0] * 1e3:.4g} ... {table.gap[-1] * 1e3:.4g} mm; extend the table"
        )
    side = _Side(actuator, table, given.level)
    gaps = np.linspace(clearance + (largest - clearance) / N_GAP, largest * (1 - 1e-12), N_GAP)
    travel = gaps - clearance
    full = [_bandwidth(motion, side, gap, reach) for gap, reach in zip(gaps, travel, strict=True)]
    fixed = [_bandwidth(motion, side, gap, amplitude) for gap in gaps[travel >= amplitude]]
    return GapTrade(
        nominal_gap=gaps,
        range=travel,
        bandwidth_full=np.array(full),
        bandwidth_fixed=np.r_[np.full(gaps.size - len(fixed), math.nan), fixed],
        level_current=side.current_limit(gaps) / side.share,
        force_current=np.array([side.current_for(force, float(g)) for g in gaps]),
        level=given.level,
        clearance=clearance,
        amplitude=amplitude,
        force=force,
        gap_limit=largest,
    )


def _or(given: float | None, default: float) -> float:
    return default if given is None else given


def _bandwidth(motion: Motion, side: _Side, nominal_gap: float, amplitude: float) -> float:
    """Hz up to which every phase of a sine has its force; 0 where rest at an end has not."""
    phase = np.linspace(0.0, 2 * math.pi, N_PHASE)
    x = amplitude * np.sin(phase)
    pull = side.largest_force(nominal_gap - x), side.largest_force(nominal_gap + x)
    cubic = motion.flexure.cubic_stiffness if motion.flexure is not None else 0.0
    restoring = motion.stiffness * x + cubic * x**3 - motion.constant_force

    def short_of(frequency: float) -> float:
        """The largest lack of force over the cycle, in N; negative where there is none."""
        omega = 2 * math.pi * frequency
        force = restoring - motion.moving_mass * omega**2 * x + motion.damping * omega * amplitude * np.cos(phase)
        return float(np.maximum(force - pull[0], -force - pull[1]).max())

    if short_of(0.0) > 0:
        return 0.0
    followed = 0.0
    for frequency in np.geomspace(1e-2, HIGHEST_FREQUENCY, N_FREQUENCY):
        if short_of(float(frequency)) > 0:
            return float(brentq(short_of, followed, frequency, rtol=1e-10))
        followed = frequency
    return HIGHEST_FREQUENCY
