"""A frequency response and its variance from one run, by rational functions that hold near a frequency.

The spectra of a finite run obey E = S W + T, where S is the response and T, smooth like S, what the run's beginning
and end leave. Within a window both are polynomials over one denominator, S = B/A and T = C/A. A of first degree with a
complex root follows a resonance where polynomials do not (McKelvey and Guerin, IFAC SYSID 2012; Geerardyn and Oomen,
Control Engineering Practice 68, 2017, on the peak of a response). It is taken where Schwarz's criterion wants it, and
wherever its pole is broad: of a broad resonance in noise the criterion takes polynomials until they miss it by about a
standard error, which no interval of theirs tells (Leeb and Poetscher, Econometric Theory 21, 2005, on inference after a
choice of model), while a broad pole costs little variance. What the fit leaves is the noise with all that is not
linear, and states the variance (Pintelon and Schoukens, System Identification, 2nd ed., 2012, ch. 7).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array

Complex = NDArray[np.complex128]

MOST_PARAMETERS = 8  # four of B, three of C, one of A
_STEPS = 6
_SETTLED = 1e-5  # of the parameters
_NARROWEST = 2.0  # bins: a resonance must be wider to be seen
_BROAD = 0.3  # of a window's half width: a pole as far from the real axis is taken anyway
_B, _C, _A = slice(0, 4), slice(4, 7), slice(7, None)  # of the parameters


@dataclass(frozen=True, eq=False)
class LocalResponse:
    """S near a frequency.

    Attributes
    ----------
    centre, half_width : Hz, of the window
    parameters : (n_parameter,) coefficients of B and C in x = (f - centre)/half_width, and A's of x where it has one
    covariance : (n_parameter, n_parameter) of the parameters' circular errors
    freedom : real numbers that the fit left over
    misfit : Schwarz's criterion, of real numbers
    """

    centre: float
    half_width: float
    parameters: Complex
    covariance: Complex
    freedom: int
    misfit: float

    def response(self, frequency: Array) -> Complex:
        """(n_frequency,) S."""
        numerator, _, denominator = _parts(self.parameters, self._powers(frequency))
        return np.asarray(numerator / denominator)

    def deviation(self, frequency: Array) -> Array:
        """(n_frequency,) one sigma of |S|; so do the real and the imaginary part of S err."""
        return self._sigma(self._size_slopes(frequency))

    def excess(self, frequency: float, *, curvature: float, step: float) -> float:
        """What noise adds to the largest |S| of the fit, near its peak at a frequency with a second derivative there.

        The peak is where an erring slope is zero; of slopes with the variance v it is too large by v/(2 |curvature|).
        """
        around = self._size_slopes(np.array([frequency - step, frequency + step]))
        slope = self._sigma(np.diff(around, axis=0))[0] / (2 * step)
        return float(slope**2 / (2 * abs(curvature)))

    def _sigma(self, slopes: Complex) -> Array:
        variance = np.einsum("fi,ij,fj->f", slopes, self.covariance, slopes.conj()).real
        return np.asarray(np.sqrt(0.5 * variance))

    def _size_slopes(self, frequency: Array) -> Complex:
        """(n_frequency, n_parameter) z with d|S| = Re(z d theta)."""
        without = self.parameters.copy()
        without[_C] = 0.0
        slopes = _slopes(without, self._powers(frequency), 1.0)
        slopes[:, _C] = 0.0
        response = self.response(frequency)
        return np.asarray((response.conj() / np.abs(response))[:, None] * slopes)

    def narrowest(self) -> float:
        """Hz from the real axis to the pole; inf without one."""
        pole = self.parameters[_A]
        return abs(float((-1 / pole[0]).imag)) * self.half_width if pole.size else np.inf

    def _powers(self, frequency: Array) -> Array:
        return _powers(frequency, self.centre, self.half_width)


def fit_local_response(
    frequency: Array, given: Complex, answer: Complex, *, centre: float, half_width: float
) -> LocalResponse:
    """S of the bins (n_bin,) of a window: spectra `given` W and `answer` E at frequencies in Hz.

    Least squares of (E - S W - T)/|S| (Gauss and Newton): what disturbs a loop reaches its signals through S, so the
    quotient errs alike over the window.
    """
    window = _Window(frequency, given, answer, centre, half_width, _powers(frequency, centre, half_width))
    columns = np.column_stack([given[:, None] * window.powers, window.powers[:, :3]])
    plain = window.fitted(_least_squares(columns, answer))
    columns = np.column_stack([columns, -answer * window.powers[:, 1]])
    rational = window.fitted(_least_squares(columns, answer))
    spacing = (frequency[-1] - frequency[0]) / (frequency.size - 1)
    width = rational.narrowest()
    broad = width > _BROAD * half_width
    return rational if width > _NARROWEST * spacing and (broad or rational.misfit < plain.misfit) else plain


@dataclass(frozen=True, eq=False)
class _Window:
    frequency: Array
    given: Complex
    answer: Complex
    centre: float
    half_width: float
    powers: Array

    def fitted(self, start: Complex) -> LocalResponse:
        """The least squares from a start, as far as they fall."""
        theta, size = start, self._size(start)
        jacobian, residual = self._linearised(theta, size)
        cost = _power(residual)
        for _ in range(_STEPS):
            step = _least_squares(jacobian, residual)
            tried = self._linearised(theta + step, size)
            if not _power(tried[1]) <= cost:
                break
            theta = theta + step
            size = self._size(theta)
            jacobian, residual = self._linearised(theta, size)
            cost = _power(residual)
            if np.abs(step).max() <= _SETTLED * np.abs(theta).max():
                break
        n = self.frequency.size
        covariance = cost / (n - theta.size) * np.linalg.inv(jacobian.conj().T @ jacobian)
        unweighted = _power(residual * size)
        misfit = 2 * n * np.log(unweighted / n) + 2 * theta.size * np.log(2 * n)
        freedom = 2 * (n - theta.size)
        return LocalResponse(self.centre, self.half_width, theta, np.asarray(covariance), freedom, float(misfit))

    def _size(self, theta: Complex) -> Array:
        numerator, _, denominator = _parts(theta, self.powers)
        return np.abs(numerator / denominator)

    def _linearised(self, theta: Complex, size: Array) -> tuple[Complex, Complex]:
        """Slopes of S W + T over the parameters, and what it leaves of E; both over |S|."""
        numerator, transient, denominator = _parts(theta, self.powers)
        left = self.answer - (numerator * self.given + transient) / denominator
        return _slopes(theta, self.powers, self.given) / size[:, None], left / size


def _powers(frequency: Array, centre: float, half_width: float) -> Array:
    """(n_bin, 4) of x."""
    x = (frequency - centre) / half_width
    return np.stack([np.ones_like(x), x, x * x, x * x * x], axis=1)


def _parts(theta: Complex, powers: Array) -> tuple[Complex, Complex, Complex]:
    """B, C, A at the powers of x."""
    denominator = 1 + powers[:, 1] * theta[-1] if theta[_A].size else np.ones(powers.shape[0])
    return powers @ theta[_B], powers[:, :3] @ theta[_C], np.asarray(denominator, dtype=complex)


def _slopes(theta: Complex, powers: Array, given: Complex | float) -> Complex:
    """(n_bin, n_parameter) of (B W + C)/A over the parameters."""
    numerator, transient, denominator = _parts(theta, powers)
    weight = np.broadcast_to(given, denominator.shape)
    model = (numerator * weight + transient) / denominator
    columns = [weight[:, None] * powers, powers[:, :3]]
    if theta[_A].size:
        columns.append(-(model * powers[:, 1])[:, None])
    return np.asarray(np.column_stack(columns) / denominator[:, None])


def _least_squares(columns: Complex, values: Complex) -> Complex:
    """By the normal equations: powers of |x| <= 1 up to the third are well apart."""
    adjoint = columns.conj().T
    return np.asarray(np.linalg.solve(adjoint @ columns, adjoint @ values))


def _power(values: Complex) -> float:
    return float(np.sum(values.real**2 + values.imag**2))
