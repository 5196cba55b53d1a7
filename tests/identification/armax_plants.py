"""Simulated ARMAX plants with known coefficients, and the Cramer-Rao bound of their estimates by a plain time loop."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from msl_fem.identification import ArmaxOrders, SampledRun


def mode_polynomial(natural_frequency, damping_ratio, sampling_period):
    """1 + a1 q^-1 + a2 q^-2 with the poles of a sampled oscillator (frequency in Hz)."""
    w = 2 * np.pi * natural_frequency * sampling_period
    radius = np.exp(-damping_ratio * w)
    return np.array([1.0, -2 * radius * np.cos(w * np.sqrt(1 - damping_ratio**2)), radius**2])


@dataclass(frozen=True, eq=False)
class Case:
    """A true ARMAX plant; `bandwidth` (Hz) of its inputs, white when None; `feedback` gains on y(t-1), y(t-2)."""

    name: str
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    sampling_period: float = 1.0
    bandwidth: float | None = None
    feedback: tuple[float, float] | None = None
    noise_ratio: float = 0.1  # rms of the noise part of y over rms of the input part

    @property
    def orders(self):
        return ArmaxOrders(na=2, nb=2, nc=2, nk=1)

    @property
    def theta(self):
        return np.concatenate([self.a[1:], self.b.ravel(), self.c[1:]])

    def simulate(self, n_samples, rng):
        """Inputs (n_inputs, n_samples), output and the true innovations."""
        n_inputs = self.b.shape[0]
        u = rng.standard_normal((n_inputs, n_samples))
        if self.bandwidth is not None:
            sos = butter(4, self.bandwidth, fs=1 / self.sampling_period, output="sos")
            u = sosfilt(sos, rng.standard_normal((n_inputs, n_samples + 2000)))[:, 2000:]
            u = u / u.std(axis=1, keepdims=True)
        e = rng.standard_normal(n_samples)
        if self.feedback is not None:
            return self._closed_loop(u, 0.1 * e)
        forced = sum(lfilter(np.r_[0, b], self.a, row) for b, row in zip(self.b, u, strict=True))
        noise = lfilter(self.c, self.a, e)
        scale = self.noise_ratio * forced.std() / noise.std()
        return u, forced + scale * noise, scale * e

    def _closed_loop(self, excitation, e):
        a, c, gain = self.a, self.c, self.feedback
        y, u = np.zeros(e.size), excitation.copy()
        for t in range(2, e.size):
            u[0, t - 1] -= gain[0] * y[t - 1] + gain[1] * y[t - 2]
            y[t] = -a[1] * y[t - 1] - a[2] * y[t - 2] + e[t] + c[1] * e[t - 1] + c[2] * e[t - 2]
            for k in range(u.shape[0]):
                y[t] += self.b[k, 0] * u[k, t - 1] + self.b[k, 1] * u[k, t - 2]
        return u[:, :-1], y[:-1], e[:-1]

    def run(self, n_samples, rng):
        """A SampledRun and the true innovations."""
        u, y, e = self.simulate(n_samples, rng)
        inputs = {f"u{k + 1}": row for k, row in enumerate(u)}
        return SampledRun(y, inputs, self.sampling_period, name=self.name), e


TS = 1e-4
CASES = [
    Case(
        "well damped",
        a=np.array([1.0, -1.2, 0.5]),
        b=np.array([[1.0, 0.5], [0.4, -0.7]]),
        c=np.array([1.0, -0.6, 0.2]),
    ),
    Case(
        "lightly damped",
        a=mode_polynomial(0.3 / (2 * np.pi), 0.01, 1.0),
        b=np.array([[0.5, 0.4], [-0.3, 0.2], [0.6, -0.1], [0.2, 0.3]]),
        c=np.array([1.0, -1.1, 0.4]),
    ),
    Case(
        "unstable under feedback",
        a=np.poly([1.04, 0.96]),
        b=np.array([[0.1, 0.09]]),
        c=np.array([1.0, -0.9, 0.3]),
        feedback=(1.5, -0.9),
    ),
    Case(
        "oversampled",
        a=mode_polynomial(58.0, 0.01, TS),
        b=1e-6 * np.array([[1.0, 1.0], [-0.9, -0.8], [0.5, 0.6], [0.3, 0.2]]),
        c=mode_polynomial(60.0, 0.05, TS),
        sampling_period=TS,
        bandwidth=200.0,
    ),
]


def fisher_information(case, run, innovations):
    """Fisher matrix of the coefficients from the true ones, by complex steps through a plain time loop.

    The loop is the definition of the predictor, e = A y - B u - (C - 1) e, sample by sample, with the true past;
    it shares nothing with the filters, delays and factors of the estimator.
    """
    theta = case.theta
    n, step = theta.size, 1e-30
    scale = np.maximum(np.abs(theta), 1e-9)
    p = theta[None, :] + 1j * step * np.diag(scale)
    a1, a2, c1, c2 = p[:, 0], p[:, 1], p[:, -2], p[:, -1]
    b = p[:, 2:-2]
    y = run.output
    u = np.vstack(list(run.inputs.values()))
    lagged = np.stack([u[:, 1:-1], u[:, :-2]], axis=1).reshape(-1, y.size - 2)  # u1(t-1), u1(t-2), u2(t-1), ...
    without_past = y[2:] + np.outer(a1, y[1:-1]) + np.outer(a2, y[:-2]) - b @ lagged
    past_1 = np.full(n, innovations[1], dtype=complex)
    past_2 = np.full(n, innovations[0], dtype=complex)
    gradient = np.zeros((y.size, n))
    for t, known in enumerate(without_past.T.copy(), start=2):
        e = known - c1 * past_1 - c2 * past_2
        gradient[t] = e.imag
        past_1, past_2 = e, past_1
    gradient /= step * scale
    return gradient.T @ gradient / np.mean(innovations**2)


def efficiency(case, estimate, information):
    """Squared parameter error over the bound: 1 on average for an efficient estimate."""
    error = estimate - case.theta
    return float(error @ information @ error) / error.size
