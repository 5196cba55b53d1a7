"""Mass, damping, stiffness and force constants as polynomials A and B, and back from these with intervals.

A mass on a spring under held forces, m x'' + c x' + k x = sum K_j u_j, sampled with period h, has poles z = exp(s h)
with s the roots of m s^2 + c s + k, and static gains B_j(1)/A(1) = K_j/k (K. J. Astrom and B. Wittenmark,
Computer-Controlled Systems, 3rd ed., sec. 2.3). So A and B hold k/m, c/m and K_j/m; one absolute scale is needed for
the rest: a believed mass, or an input whose force constant is known (1 for a measured external force). Intervals by the
delta method.

Rational inputs hold the position of the sample's beginning while the true force follows the motion within the step,
half a step ahead of the held one on average: with the force's slope dF/dx that is a force h/2 dF/dx x', and it stands
in the damping of A. It is taken out again with the mean slope over the data.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import mul

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.statespace import StateSpace
from msl_fem.errors import InputError
from msl_fem.identification.likelihood import CoefficientPrior
from msl_fem.identification.model import ArmaxEstimate
from msl_fem.identification.prediction_error import ArmaxOrders, Polynomials, polynomials_of
from msl_fem.identification.regression import r_factor

TOLERANCE_STEP = 1e-3  # relative, of the central differences by which tolerances become a covariance of A and B
GAIN_TOLERANCE = 1e-3  # relative, of a gain that is called known
_A_SLACK = 1e-9  # of a_1 and a_2, so that a stiffness of exactly 0 is believed to some mN/m only
STEP = 0.01  # standard deviations, of the central differences along the principal axes of the covariance
NORMAL_95 = 1.959964


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
    """KnownMass mass (kg), damping (N s/m) and stiffness (N/m) of m x'' + c x' + k x = sum of gain * input.

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


def discretised_oscillator(prior: OscillatorPrior, sampling_period: float) -> tuple[Array, Array]:
    """A (3,) and B (2,) of x for a force held between samples: A(q) x = (B[0] q^-1 + B[1] q^-2) f, in m/N.

    Exact for a zero-order hold (K. J. Astrom and B. Wittenmark, Computer-Controlled Systems, 3rd ed., sec. 2.3).
    """
    state = np.array([[0.0, 1.0], [-prior.stiffness / prior.mass, -prior.damping / prior.mass]])
    drive = np.array([[0.0], [1.0 / prior.mass]])
    read = np.array([[1.0, 0.0]])
    held = StateSpace(state, drive, read, np.zeros((1, 1))).sampled(sampling_period)
    phi, gamma = held.A, held.B
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
) -> CoefficientPrior:
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
        step = TOLERANCE_STEP * getattr(prior, name)
        ahead, behind = (
            _believed(replace(prior, **{name: getattr(prior, name) + s}), sampling_period, gains) for s in (step, -step)
        )
        columns.append(share * (ahead - behind) / (2.0 * TOLERANCE_STEP))
    root = np.column_stack(columns)
    own = np.concatenate([_A_SLACK * np.ones(2), GAIN_TOLERANCE * np.abs(centre[2:])])
    choice = _selection(orders, list(gains))
    # The triangular factor of [root, own]' is one of the covariance root root' + own^2, taken without forming it.
    lower = r_factor(np.vstack([root.T, np.diag(own)])).T
    weight = np.sqrt(noise_variance) * np.linalg.solve(lower, np.column_stack([choice, centre]))
    return CoefficientPrior(weight[:, :-1], weight[:, -1])


def _believed(prior: OscillatorPrior, sampling_period: float, gains: Mapping[int, float]) -> Array:
    """a_1, a_2 and the sums of B of the inputs with known gains."""
    a, b = discretised_oscillator(prior, sampling_period)
    return np.concatenate([a[1:], [gain * b.sum() for gain in gains.values()]])


def _selection(orders: ArmaxOrders, inputs: Sequence[int]) -> Array:
    """Rows that pick a_1, a_2 and the sums of B of some inputs from the coefficients."""
    rows = np.zeros((2 + len(inputs), orders.n_parameters))
    rows[0, 0] = rows[1, 1] = 1.0
    firsts = orders.na + np.cumsum([0, *map(len, orders.input_lags)])
    for row, k in enumerate(inputs, start=2):
        rows[row, firsts[k] : firsts[k + 1]] = 1.0
    return rows


@dataclass(frozen=True)
class KnownMass:
    """A value with its relative standard deviation, from outside the data."""

    value: float
    tolerance: float = 0.0


@dataclass(frozen=True)
class PhysicalParameter:
    """A value, its standard error and unit."""

    value: float
    standard_error: float
    unit: str

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval."""
        half = NORMAL_95 * self.standard_error
        return self.value - half, self.value + half


def physical_parameters(
    model: ArmaxEstimate, *, mass: KnownMass | None = None, gains: Mapping[str, float] | None = None
) -> dict[str, PhysicalParameter]:
    """Physical parameters by name: what the data alone give, and with a scale the absolute ones.

    Without a scale: "stiffness/mass", "damping/mass", "<input>/mass", and of an oscillating pair of poles
    "natural_frequency" (undamped, Hz) and "damping_ratio". `gains` names inputs whose force constant is known (N per
    unit): then also "mass", "stiffness", "damping" and the "force_constant[...]" of the other inputs; else a believed
    `mass` gives all but itself, its tolerance counted in. "gap_offset" (m) where it was estimated.

    Raises
    ------
    InputError : na is not 2, a pole that no sampled oscillator has, or an unknown input among `gains`
    """
    if model.orders.na != 2:
        raise InputError(f"na = {model.orders.na}: mass, damping and stiffness follow from a model with na = 2")
    known = dict(gains or {})
    unknown = set(known) - set(model.input_names)
    if unknown:
        raise InputError(f"known gain of {sorted(unknown)}: the inputs are {', '.join(model.input_names)}")
    n = model.orders.n_parameters

    def found_at(vector: Array) -> dict[str, float]:
        by_mass = _by_mass(model, polynomials_of(vector[:n], model.orders))
        if known:
            return by_mass | _absolute(by_mass, _mass_of(by_mass, known), known)
        return by_mass if mass is None else by_mass | _absolute(by_mass, float(vector[-1]), known)

    point = np.append(model.parameters[:n], 1.0 if mass is None else mass.value)
    covariance = np.zeros((n + 1, n + 1))
    covariance[:n, :n] = model.covariance[:n, :n]
    covariance[-1, -1] = 0.0 if mass is None else (mass.tolerance * mass.value) ** 2
    parameters = found_at(point)

    def values(vector: Array) -> Array:
        moved = found_at(vector)
        return np.array([moved.get(name, np.nan) for name in parameters])

    result = {
        name: PhysicalParameter(value, float(error), _unit(model, name))
        for (name, value), error in zip(parameters.items(), _delta_method(values, point, covariance), strict=True)
        if np.isfinite(error)
    }
    if model.delta_standard_error is not None:
        result["gap_offset"] = PhysicalParameter(float(model.parameters[-1]), model.delta_standard_error, "m")
    return result


def _by_mass(model: ArmaxEstimate, polynomials: Polynomials) -> dict[str, float]:
    """k/m, c/m, K_j/m and the mode; B(1) K/(m A(1)) is written with s/(1 - exp(s h)), smooth also where k = 0."""
    period = model.sampling_period
    poles = np.roots(polynomials.a).astype(complex)
    if np.any(np.abs(poles) == 0.0) or np.any((np.abs(poles.imag) < 1e-14) & (poles.real <= 0.0)):
        raise InputError(
            f"A has the poles {poles[0]:.3g}, {poles[1]:.3g}: no sampled oscillator has a pole on the negative real "
            "axis; other orders or a finer sampling may help"
        )
    s = np.log(poles) / period
    stiffness = float((s[0] * s[1]).real)
    damping = float(-(s[0] + s[1]).real)
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = np.where(np.abs(s * period) < 1e-12, -1.0 / period, s / (-np.expm1(s * period)))
    from_sum = float((factors[0] * factors[1]).real)
    constants = [float(b.sum()) * from_sum for b in polynomials.b]
    damping += 0.5 * period * sum(map(mul, constants, model.input_slopes))
    ratios = {"stiffness/mass": stiffness, "damping/mass": damping}
    if stiffness > 0.0:
        ratios["natural_frequency"] = float(np.sqrt(stiffness) / (2.0 * np.pi))
        ratios["damping_ratio"] = float(damping / (2.0 * np.sqrt(stiffness)))
    return ratios | {f"{name}/mass": value for name, value in zip(model.input_names, constants, strict=True)}


def _mass_of(by_mass: Mapping[str, float], known: Mapping[str, float]) -> float:
    """The mass at which the inputs of known force constant have it, their mean where there are several."""
    return float(np.mean([gain / by_mass[f"{name}/mass"] for name, gain in known.items()]))


def _absolute(by_mass: Mapping[str, float], mass: float, known: Mapping[str, float]) -> dict[str, float]:
    ratios = {name.removesuffix("/mass"): value for name, value in by_mass.items() if name.endswith("/mass")}
    absolute = {"mass": mass, "stiffness": mass * ratios.pop("stiffness"), "damping": mass * ratios.pop("damping")}
    return absolute | {f"force_constant[{name}]": mass * v for name, v in ratios.items() if name not in known}


def _unit(model: ArmaxEstimate, name: str) -> str:
    fixed = {
        "stiffness/mass": "1/s^2",
        "damping/mass": "1/s",
        "natural_frequency": "Hz",
        "damping_ratio": "1",
        "mass": "kg",
        "stiffness": "N/m",
        "damping": "N s/m",
    }
    if name in fixed:
        return fixed[name]
    terms = {} if model.rational is None else {str(term): term for term in model.rational.terms}
    term = terms.get(name.removesuffix("/mass").removeprefix("force_constant[").removesuffix("]"))
    force = "N/unit" if term is None else f"N m^{term.gap_power}/A^{term.current_power}"
    return f"{force}/kg" if name.endswith("/mass") else force


def _delta_method(values: Callable[[Array], Array], point: Array, covariance: Array) -> Array:
    """Standard errors of `values`, by central differences along the principal axes of the covariance; nan where that is
    none."""
    variances = np.diag(covariance)
    if np.any(variances < 0.0):  # of a fit that leaves nothing, where rounding made them
        return np.full(values(point).size, np.nan)
    scale = np.sqrt(variances)
    used = scale > 0.0
    correlation = covariance[np.ix_(used, used)] / np.outer(scale[used], scale[used])
    sizes, axes = np.linalg.eigh(correlation)
    variance = np.zeros(values(point).size)
    for size, axis in zip(np.maximum(sizes, 0.0), axes.T, strict=True):
        step = np.zeros(point.size)
        step[used] = STEP * np.sqrt(size) * axis * scale[used]
        with np.errstate(over="ignore", invalid="ignore"):  # errors beyond all numbers are left out by the caller
            variance = variance + ((values(point + step) - values(point - step)) / (2.0 * STEP)) ** 2
    return np.sqrt(variance)
