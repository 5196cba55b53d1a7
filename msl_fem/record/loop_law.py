"""Measured loops of a core as a law: a reversible curve, and a memory whose minor loops hold over amplitude.

    i = r(lambda) + p'(lambda) sum_k s_k e_k,   p(lambda) = lambda (1 + widening (lambda/lambda_r)^2)

e_k is a stop of width R_k of p(lambda) (Brokate, Sprekels, Hysteresis and Phase Transitions, 1996, ch. 2), R_k =
p(lambda_r (k/16)^spacing), and its slope s_k goes with R_k^-fall: Rayleigh's loops, the width of the major one and its
growth with the flux have a number each. r is a sum of odd rising functions. The memory takes energy on every closed
path, s_k R_k |slip_k|, whatever the path.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled

STOPS = 16
BENDS = (0.03, 0.1)  # of the bent parts of the reversible curve, over the largest flux linkage
POWERS = (1, 3, 5, 9, 17, 35, 70, 140, 280)  # of its other parts: the highest are knees as sharp as flux can be read
LEAST_SLOPE = 1e-3  # of the reversible curve at no flux, over the largest current by the largest flux linkage
ENERGY_WEIGHT = 5.0  # of a loop's energy beside its rows, which weigh 1 together
LEAST_BOX = 0.01  # share of a loop's box of current and flux below which its area is not held more closely
START = (0.6, 1.5, 0.3, 0.09)
LOWEST, HIGHEST = (0.05, 0.5, 1e-3, 1e-4), (1.5, 5.0, 3.0, 2.0)
"""Of lambda_r over the largest flux linkage, spacing, fall and widening."""


@dataclass(frozen=True, eq=False)
class HysteresisLoopLaw:
    """A law of measured loops.

    Attributes
    ----------
    largest_flux : Wb, of the loops
    amounts : (11,) of the parts of the reversible curve, A
    coercive_current : A, half the width of the major loop at no flux
    reversal_flux : lambda_r, Wb
    spacing, fall, widening : of the stops
    sequence_error : loop by loop, RMS current missed at the measured flux over the RMS current
    energy_error : loop by loop, relative error of the area
    """

    largest_flux: float
    amounts: Array
    coercive_current: float
    reversal_flux: float
    spacing: float
    fall: float
    widening: float
    sequence_error: tuple[float, ...] = ()
    energy_error: tuple[float, ...] = ()

    @property
    def n_parameter(self) -> int:
        """How many numbers of the law the loops have set."""
        return int(np.count_nonzero(self.amounts)) + 5

    def reversible(self, flux: Array) -> tuple[Array, Array, Array]:
        """Current (A), its slope (A/Wb) and its integral over the flux (J) of the reversible part, (n,) each."""
        return tuple(part @ self.amounts for part in _reversible_parts(flux, self.largest_flux))  # type: ignore[return-value]

    def current(self, flux: Array) -> Array:
        """(n,) A: along a path of the flux linkage (n,) Wb that begins demagnetised."""
        memory = _memory(flux, self.reversal_flux, self.spacing, self.fall, self.widening)
        return np.asarray(self.reversible(flux)[0] + self.coercive_current * memory)


def loop_area(current: Array, flux: Array) -> float:
    """J: the integral of the current over the flux along a path that ends where it began."""
    mean = 0.5 * (current + np.roll(current, -1))
    return float(mean @ (np.roll(flux, -1) - flux))


def fit_loops(loops: Sequence[tuple[Array, Array]]) -> HysteresisLoopLaw:
    """The law of loops (current A, flux linkage Wb), each of which began demagnetised.

    Least squares of the current missed at the measured flux over its RMS, loop by loop, so that small loops count as
    much as large ones; the energy of each loop is held beside. What is linear in the law comes from non-negative least
    squares, the four others from a search about usual values.
    """
    from scipy.optimize import least_squares, nnls  # here: all that reads a record imports this module

    largest = max(float(np.abs(flux).max()) for _, flux in loops)
    targets = [_target(current, flux, largest) for current, flux in loops]

    def solved(shape: Array) -> tuple[Array, Array]:
        rows = [target.rows(shape, largest) for target in targets]
        matrix, wanted = np.vstack([m for m, _ in rows]), np.concatenate([y for _, y in rows])
        amounts, _ = nnls(matrix, wanted)
        return amounts, matrix @ amounts - wanted

    def missed(logarithms: Array) -> Array:
        return solved(np.exp(logarithms))[1]

    bounds = (np.log(LOWEST), np.log(HIGHEST))
    found = least_squares(missed, np.log(START), bounds=bounds, diff_step=1e-3, xtol=1e-6, ftol=1e-6)
    shape = np.exp(found.x)
    amounts = solved(shape)[0]
    most = max(float(np.abs(current).max()) for current, _ in loops)
    amounts[1 + len(BENDS)] = max(amounts[1 + len(BENDS)], LEAST_SLOPE * most)
    reversal, spacing, fall, widening = (float(value) for value in shape)
    law = HysteresisLoopLaw(largest, amounts[1:], float(amounts[0]), reversal * largest, spacing, fall, widening)
    missing = [(law.current(flux), current, flux) for current, flux in loops]
    sequence = tuple(float(np.linalg.norm(m - c) / np.linalg.norm(c)) for m, c, _ in missing)
    energy = tuple(loop_area(m, f) / loop_area(c, f) - 1.0 for m, c, f in missing)
    return replace(law, sequence_error=sequence, energy_error=energy)


@dataclass(frozen=True, eq=False)
class _Target:
    """A loop that a law is fitted to, and its reversible parts."""

    current: Array
    flux: Array
    parts: Array
    size: float  # of the current, over which the rows are missed
    area: float
    held: float  # what its area is held over, J

    def rows(self, shape: Array, largest: float) -> tuple[Array, Array]:
        memory = _memory(self.flux, shape[0] * largest, *shape[1:])
        columns = np.column_stack([memory, self.parts]) / self.size
        energy = np.zeros(columns.shape[1])
        energy[0] = ENERGY_WEIGHT * loop_area(memory, self.flux) / self.held
        wanted = np.r_[self.current / self.size, ENERGY_WEIGHT * self.area / self.held]
        return np.vstack([columns, energy]), wanted


def _target(current: Array, flux: Array, largest: float) -> _Target:
    area, box = loop_area(current, flux), float(np.ptp(current) * np.ptp(flux))
    parts = _reversible_parts(flux, largest)[0]
    return _Target(current, flux, parts, float(np.linalg.norm(current)), area, max(abs(area), LEAST_BOX * box))


def _reversible_parts(flux: Array, largest: float) -> tuple[Array, Array, Array]:
    """Parts of the reversible curve, their slopes (1/Wb) and integrals (Wb), (n, 11) each, for 1 A each."""
    y = np.asarray(flux)[:, None] / largest
    bends, powers = np.array(BENDS), np.array(POWERS)
    size, bent = np.abs(y), np.tanh(y / bends)
    log_cosh = size / bends + np.log1p(np.exp(-2 * size / bends)) - np.log(2.0)
    value = np.hstack([bent, np.sign(y) * size**powers])
    slope = np.hstack([(1 - bent**2) / bends, powers * size ** (powers - 1)]) / largest
    integral = np.hstack([bends * log_cosh, size ** (powers + 1) / (powers + 1)]) * largest
    return value, slope, integral


def _memory(flux: Array, reversal_flux: float, spacing: float, fall: float, widening: float) -> Array:
    """(n,) what the stops take along a path for a coercive current of 1 A."""
    y = np.ascontiguousarray(flux, dtype=float) / reversal_flux
    place = (np.arange(1, STOPS + 1) / STOPS) ** spacing
    widths = place * (1 + widening * place**2)
    slopes = widths**-fall
    return (1 + 3 * widening * y**2) * _stops(y * (1 + widening * y**2), widths, slopes / (slopes @ widths))


@compiled
def _stops(path: Array, widths: Array, slopes: Array) -> Array:
    """(n,) sum of slope times stop along a path that begins at 0."""
    total = np.zeros(path.size)
    for k in range(widths.size):
        stop = before = 0.0
        for n in range(path.size):
            stop = min(max(stop + path[n] - before, -widths[k]), widths[k])
            before = path[n]
            total[n] += slopes[k] * stop
    return total
