"""Prior knowledge of the moving mass, its suspension and the rates of the forces, as polynomials A and B."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import cont2discrete

from msl_fem.errors import InputError
from msl_fem.identification.data import FloatArray
from msl_fem.identification.polynomials import ArmaxOrders
from msl_fem.identification.problem import Belief
from msl_fem.identification.regression import r_factor

STEP = 1e-3  # relative, of the central differences by which tolerances become a covariance of A and B
GAIN_TOLERANCE = 1e-3  # relative, of a gain that is called known
_A_SLACK = 1e-9  # of a_1 and a_2, so that a stiffness of exactly 0 is believed to some mN/m only


@dataclass(frozen=True)
class OscillatorTolerance:
    """Relative standard deviations of the believed mass, damping and stiffness."""

    mass: float = 0.005
    damping: float = 0.2
    stiffness: float = 0.02

    def __post_init__(self) -> None:
        for name, value in (("mass", self.mass), ("damping", self.damping), ("stiffness", self.stiffness)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"tolerance of the prior {name} {value!r}: give a positive relative deviation")


@dataclass(frozen=True)
class OscillatorPrior:
    """Believed mass (kg), damping (N s/m) and stiffness (N/m) of m x'' + c x' + k x = sum of gain * input.

    `force_gains` holds what is known of each input's gain (N per unit of the input, 1 for an external force); an
    input that is not named has its B fitted by least squares, given A and C. Without `tolerance` this is a first guess
    only; with it, also a Gaussian prior, and the estimate is the most probable one (maximum a posteriori).
    """

    mass: float
    damping: float = 0.0
    stiffness: float = 0.0
    force_gains: Mapping[str, float] = field(default_factory=dict)
    tolerance: OscillatorTolerance | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mass) and self.mass > 0.0):
            raise InputError(f"prior mass {self.mass!r} kg: give a positive one")
        for name, value in (("damping", self.damping), ("stiffness", self.stiffness)):
            if not np.isfinite(value):
                raise InputError(f"prior {name} {value!r} is not finite; leave it out when it is unknown")


def discretised_oscillator(prior: OscillatorPrior, sampling_period: float) -> tuple[FloatArray, FloatArray]:
    """A (3,) and B (2,) of x for a force held between samples: A(q) x = (B[0] q^-1 + B[1] q^-2) f, in m/N.

    Exact for a zero-order hold (K. J. Astrom and B. Wittenmark, Computer-Controlled Systems, 3rd ed., sec. 2.3).
    """
    state = np.array([[0.0, 1.0], [-prior.stiffness / prior.mass, -prior.damping / prior.mass]])
    drive = np.array([[0.0], [1.0 / prior.mass]])
    read = np.array([[1.0, 0.0]])
    phi, gamma, *_ = cont2discrete((state, drive, read, np.zeros((1, 1))), sampling_period, method="zoh")
    a = np.array([1.0, -np.trace(phi), np.linalg.det(phi)])
    markov_1 = float(gamma[0, 0])
    markov_2 = float((phi @ gamma)[0, 0])
    return a, np.array([markov_1, markov_2 + a[1] * markov_1])


def oscillator_belief(
    prior: OscillatorPrior,
    orders: ArmaxOrders,
    *,
    names: Sequence[str],
    sampling_period: float,
    noise_variance: float,
) -> Belief:
    """The prior as equations of a_1, a_2 and the sum of B of every input of known gain.

    The tolerances of mass, damping and stiffness reach them to first order. The sum of B is believed, not its parts:
    a delay of a fraction of a sample moves weight between them. InputError if na is not 2 or there is no tolerance.
    """
    if orders.na != 2:
        raise InputError(f"na = {orders.na}: a prior of mass, damping and stiffness needs na = 2")
    if prior.tolerance is None:
        raise InputError("the prior states no tolerance: give one for mass, damping and stiffness")
    gains = {names.index(name): gain for name, gain in prior.force_gains.items()}
    tolerance = prior.tolerance
    centre = _believed(prior, sampling_period, gains)
    columns = []
    for name, share in (("mass", tolerance.mass), ("damping", tolerance.damping), ("stiffness", tolerance.stiffness)):
        step = STEP * getattr(prior, name)
        ahead, behind = (
            _believed(replace(prior, **{name: getattr(prior, name) + s}), sampling_period, gains) for s in (step, -step)
        )
        columns.append(share * (ahead - behind) / (2.0 * STEP))
    root = np.column_stack(columns)
    own = np.concatenate([_A_SLACK * np.ones(2), GAIN_TOLERANCE * np.abs(centre[2:])])
    choice = _selection(orders, list(gains))
    # The triangular factor of [root, own]' is one of the covariance root root' + own^2, taken without forming it.
    lower = r_factor(np.vstack([root.T, np.diag(own)])).T
    weight = np.sqrt(noise_variance) * np.linalg.solve(lower, np.column_stack([choice, centre]))
    return Belief(weight[:, :-1], weight[:, -1])


def _believed(prior: OscillatorPrior, sampling_period: float, gains: Mapping[int, float]) -> FloatArray:
    """a_1, a_2 and the sums of B of the inputs with known gains."""
    a, b = discretised_oscillator(prior, sampling_period)
    return np.concatenate([a[1:], [gain * b.sum() for gain in gains.values()]])


def _selection(orders: ArmaxOrders, inputs: Sequence[int]) -> FloatArray:
    """Rows that pick a_1, a_2 and the sums of B of some inputs from the coefficients."""
    rows = np.zeros((2 + len(inputs), orders.n_parameters))
    rows[0, 0] = rows[1, 1] = 1.0
    firsts = orders.na + np.cumsum([0, *map(len, orders.input_lags)])
    for row, k in enumerate(inputs, start=2):
        rows[row, firsts[k] : firsts[k + 1]] = 1.0
    return rows
