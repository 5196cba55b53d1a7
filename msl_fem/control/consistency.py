"""Whether the Kalman filter meets what it expects: normalised innovations of a run.

With S the variance that the filter states, nu^2/S has the mean 1 (Bar-Shalom, Li, Kirubarajan, Estimation with
Applications to Tracking and Navigation, 2001, sec. 5.4). The reduced-order filter's innovations are correlated by
construction (the noise of a sample enters two of them), so the interval counts the effective number of samples.
"""

from dataclasses import dataclass

import numpy as np

from msl_fem.control.closed_loop import ClosedLoopRun
from msl_fem.control.design import ControllerDesign
from msl_fem.control.kalman import FilterNoise, filter_of_gain
from msl_fem.errors import InputError

_NORMAL_95 = 1.959964
_LAGS = 50
_FEWEST = 200
_NEARLY_NOTHING = 1e-12  # N


@dataclass(frozen=True)
class Consistency:
    """Normalised innovations of a run.

    Attributes
    ----------
    ratio : mean of nu^2 over the variance that the filter states; below 1 the filter expects more than there is
    over_sensor : mean of nu^2 over the variance that the sensor's noise alone gives; nan without noise. The filter
        allows for errors of the force, so this one grows first where the plant is not the believed one
    interval : 95 % of either if what it is compared with were right, from the innovations' own correlation
    mean : of nu over its stated standard deviation
    correlation : of neighbouring innovations
    """

    ratio: float
    over_sensor: float
    interval: tuple[float, float]
    mean: float
    correlation: float

    @property
    def exceeded(self) -> bool:
        """Whether there is more than the filter expects."""
        return self.ratio > self.interval[1]

    @property
    def more_than_noise(self) -> bool:
        """Whether there is more than the sensor's noise."""
        return self.over_sensor > self.interval[1]


def innovation_consistency(design: ControllerDesign, run: ClosedLoopRun, *, settled: float = 0.2) -> Consistency:
    """The normalised innovations from `settled` seconds on.

    Raises
    ------
    InputError : too few samples; a design without a Kalman filter
    """
    stated = design.law.estimator.innovation_variance
    if not np.isfinite(stated):
        raise InputError(f"the design {design.kind} has no Kalman filter; its innovations have no stated variance")
    nu = run.innovation[run.time >= settled] / np.sqrt(stated)
    if nu.size < _FEWEST:
        raise InputError(f"{nu.size} samples after {settled:g} s are too few; at least {_FEWEST} are needed")
    centred = nu - nu.mean()
    power = float(np.mean(centred**2))
    rho = np.array([np.mean(centred[lag:] * centred[:-lag]) for lag in range(1, _LAGS)]) / max(power, 1e-300)
    effective = nu.size / (1 + 2 * float(np.sum(rho**2)))  # of squares of a Gaussian signal, Bartlett
    half = _NORMAL_95 * np.sqrt(2 / effective)
    ratio, sensor = float(np.mean(nu**2)), _variance_by_sensor(design) / stated
    return Consistency(ratio, ratio / sensor, (1 - float(half), 1 + float(half)), float(nu.mean()), float(rho[0]))


def _variance_by_sensor(design: ControllerDesign) -> float:
    """m^2 of the innovations where the plant is as believed and the sensor's noise is all there is; nan without."""
    sensor, estimator = design.belief.position_sensor, design.law.estimator
    sigma = float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12)))
    if sigma == 0:
        return float("nan")
    alone = FilterNoise(position=sigma, force=_NEARLY_NOTHING, disturbance=_NEARLY_NOTHING)
    return filter_of_gain(design.law.plant, estimator.gain, alone).innovation_variance
