"""The voltage that a reference asks of the coils, and the overlap of both sides that keeps it within the drive's limit.

Along a reference the magnets give F = m r'' + c r' + k r + k_3 r^3. Where F changes its sign one side hands over to the
other, and with i proportional to the root of the force a current that begins from nothing asks for any voltage. With
an overlap o (F_1 F_2 = o^2, see `inverse.hand_over`) the slope is finite. For iron far from saturation, L the
inductance of a side at its gap g and F' = dF/dt there,

    v = R i + L di/dt,   i = sqrt(2 g F_1/L),   v at F = 0 is F' sqrt(L g/(8 o)), at most 1.14 times that nearby

(3^(3/4)/2, where F = 2 o sinh(artanh(1/2))). So the overlap that a voltage needs goes with (F'/v)^2. What is computed
here is the mean voltage of a sample, R i + (lambda[k+1] - lambda[k])/T, on the table along the reference, with motion
and saturation in it: less than this does not bring the current to its next command.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.control.design_model import DesignModel
from msl_fem.control.inverse import Inverse, believed_gap, force_domain, hand_over, magnet_current_limit, side_surface
from msl_fem.control.inverse import magnet_current as current_of_force
from msl_fem.control.preview import known_ahead, smooth_intervals
from msl_fem.table.coenergy_surface import evaluate

SHARE_OF_LIMIT = 0.9
"""Of the voltage limit, that a reference may ask for: the rest is for feedback, and for leakage beside the table."""
MOST_OVERLAP = 0.25  # of what each side can pull with in the middle
_LEAST_OVERLAP = 1e-3  # likewise
_SHIFTS = 8  # instants in a sample, from each of which the sample after it is looked at
_HALVINGS = 12
_DIGITS = 2


@dataclass(frozen=True)
class AskedVoltage:
    """What a reference asks of the coils.

    Attributes
    ----------
    overlap : N, with which both sides pull at zero force
    largest : V, mean of a sample, of a side along the smooth parts of the reference
    limit : V, of the drive
    copper_loss : W, mean over the reference
    needed : N, the least overlap that keeps the voltage within `SHARE_OF_LIMIT` of the limit; 0: none is needed, nan:
        none up to `MOST_OVERLAP` of what a side can pull with does
    """

    overlap: float
    largest: float
    limit: float
    copper_loss: float
    needed: float

    def to_json(self) -> dict[str, Any]:
        """The JSON object."""
        return {
            "overlap_N": self.overlap,
            "largest_V": self.largest,
            "limit_V": self.limit,
            "copper_loss_W": self.copper_loss,
            "needed_overlap_N": None if math.isnan(self.needed) else self.needed,
        }


def asked_voltage(model: DesignModel, samples: Array, *, overlap: float) -> AskedVoltage:
    """What a reference (n, 3) of position, velocity, acceleration at the loop's rate asks with an overlap in N.

    The needed overlap is found by halving and rounded up to two digits; with one side or without a voltage limit none
    is.
    """
    limit = model.coupled.voltage_limit
    shifted = _shifted(samples, model.plant.period)
    largest, loss = _along(model, shifted, overlap)
    needed = 0.0
    if model.inverse.sides > 1 and math.isfinite(limit):
        needed = _needed(model, shifted, SHARE_OF_LIMIT * limit)
    return AskedVoltage(overlap, largest, limit, loss, needed)


def _shifted(samples: Array, period: float) -> Array:
    """(n_shift, n, 3) the reference at its samples and at instants between them."""
    return np.stack([known_ahead(samples, period=period, lead=k / _SHIFTS * period) for k in range(_SHIFTS)])


def _along(model: DesignModel, shifted: Array, overlap: float) -> tuple[float, float]:
    """(largest mean voltage of a sample and side in V, mean copper loss in W) where the reference is smooth."""
    period = model.plant.period
    r, v, a = np.moveaxis(shifted, 2, 0)
    p = model.plant
    force = p.mass * a + p.damping * v + (p.stiffness + model.cubic * r**2) * r - model.coupled.constant_force
    current, linkage = np.empty((2, r.size, 2))
    sides_along(model.inverse, force.ravel(), r.ravel(), overlap, current, linkage)
    current, linkage = (x.reshape(*r.shape, 2) for x in (current, linkage))
    resistance = model.coupled.resistance
    smooth = smooth_intervals(shifted[0], period)
    kept = smooth & np.append(smooth[1:], False)
    voltage = 0.5 * resistance * (current[:, 1:] + current[:, :-1]) + np.diff(linkage, axis=1) / period
    largest = np.abs(voltage[:, kept]).max(initial=0.0)
    return float(largest), float(resistance * np.mean(np.sum(current**2, axis=2)))


def _needed(model: DesignModel, shifted: Array, voltage: float) -> float:
    """N, the least overlap for a voltage."""
    if _along(model, shifted, 0.0)[0] <= voltage:
        return 0.0
    domain = force_domain(model.inverse, 0.0)
    pull = min(domain.highest, -domain.lowest)
    low, high = math.log(_LEAST_OVERLAP * pull), math.log(MOST_OVERLAP * pull)
    if not _along(model, shifted, math.exp(high))[0] <= voltage:
        return math.nan
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        enough = _along(model, shifted, math.exp(middle))[0] <= voltage
        low, high = (low, middle) if enough else (middle, high)
    found = math.exp(high)
    unit = 10.0 ** (math.floor(math.log10(found)) - _DIGITS + 1)
    return float(f"{math.ceil(found / unit) * unit:.{_DIGITS}g}")


@compiled
def sides_along(
    inverse: Inverse, force: Array, position: Array, overlap: float, current: Array, linkage: Array
) -> None:
    """Side currents in A and flux linkages in Wb of both sides into (n, 2) each, for net forces (n,) in N at positions
    (n,) in m; cut where a side can pull no more, the sides taken apart."""
    values = np.empty(6)
    for n in range(force.size):
        pulls = hand_over(force[n], overlap)
        for side in range(2):
            current[n, side] = linkage[n, side] = 0.0
            pull = pulls[0] if side == 0 else pulls[1]
            if side >= inverse.sides or pull <= 0.0:
                continue
            gap, surface = believed_gap(inverse, side, position[n]), side_surface(inverse, side)
            largest = magnet_current_limit(inverse, gap)
            if not largest > 0.0:
                continue
            found = current_of_force(surface, pull / inverse.magnets, gap, largest)
            magnet = found if found == found else largest
            evaluate(surface.gap, surface.current, surface.coefficients, magnet, gap, values)
            current[n, side] = magnet / inverse.current_share
            linkage[n, side] = inverse.magnets * inverse.current_share * values[1]
