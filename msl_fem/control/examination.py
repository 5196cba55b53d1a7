"""A design put through the paper's trials: references, degradation beyond range and frequency, responses, margins.

Whether the Kalman filter meets what it expects: With S the variance that the filter states, nu^2/S
has the mean 1 (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, sec. 5.4).
The reduced-order filter's innovations are correlated by construction (the noise of a sample enters two of them), so the
interval counts the effective number of samples.

And the replay of recorded currents through the believed model (the paper's Fig. 10): a free run of the whole model from
the currents alone would leave at once: with held currents the mover is unstable over most of the travel. So the force
is the believed one of the recorded currents at the recorded position, and suspension and mass answer to it:  m x'' + c
x' + k x + cubic x^3 = F_1(i_1, g_1(y)) - F_2(i_2, g_2(y)) + F_const.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.statespace import StateSpace
from msl_fem.control.closed_loop import ClosedLoopRun, PlantUnderTest, run_closed_loop
from msl_fem.control.design import ControllerDesign, FrozenPosition
from msl_fem.control.frequency_response import FrequencyResponse, closed_loop_response
from msl_fem.control.inverse import believed_gap, magnet_force, side_surface
from msl_fem.control.linear_loop import grid
from msl_fem.control.lqg import FilterNoise, filter_of_gain
from msl_fem.control.margins import Margins, margins
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.excitation import Reference, parse_excitation, reference

_NORMAL_95 = 1.959964
_LAGS = 50
_FEWEST = 200
_NEARLY_NOTHING = 1e-12  # N
REFERENCES = {
    "sine": "sine:frequency=2 Hz,amplitude={:.4g} mm,duration=1.5 s",
    "step": "step:frequency=3 Hz,amplitude={:.4g} mm,duration=1 s",
    "ramp": "ramp:frequency=5 Hz,amplitude={:.4g} mm,duration=1 s",
}
"""The paper's Figs. 6, 8 and 9."""
SHARES = {"sine": 0.8, "step": 0.2, "ramp": 0.4}
"""Of what the design holds stably, each reference's amplitude."""
FREQUENCIES = (2.0, 5.0, 10.0, 20.0, 40.0, 60.0, 90.0)
AMPLITUDES = (0.04, 0.2, 0.4, 0.6, 0.8, 0.9, 0.98)
"""Shares of the reach over which tracking is tried."""
_SETTLED = 0.5  # s
_TRIAL = 1.0  # s


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
    ratio = float(np.mean(nu**2))
    sensor = _variance_by_sensor(design) / stated
    return Consistency(ratio, ratio / sensor, (1 - float(half), 1 + float(half)), float(nu.mean()), float(rho[0]))


def _variance_by_sensor(design: ControllerDesign) -> float:
    """m^2 of the innovations where the plant is as believed and the sensor's noise is all there is; nan without."""
    sensor = design.actuator.position_sensor
    estimator = design.law.estimator
    sigma = float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12)))
    if sigma == 0:
        return float("nan")
    alone = FilterNoise(position=sigma, force=_NEARLY_NOTHING, disturbance=_NEARLY_NOTHING)
    return filter_of_gain(design.law.plant, estimator.gain, alone).innovation_variance


@dataclass(frozen=True, eq=False)
class Replay:
    """What the model makes of a run's currents.

    Attributes
    ----------
    position : (n_sample,) m, the model's
    force : (n_sample,) N of the believed magnets; nan outside their table
    nrmse : RMS of position - measured over the standard deviation of measured
    """

    position: Array
    force: Array
    nrmse: float


def replay(design: ControllerDesign, run: ClosedLoopRun) -> Replay:
    """The model's answer to the currents as they were read, from the first sample on.

    Between samples the force runs straight; what it does there is not in the record.
    """
    p, motion = design.parameters, design.actuator.motion
    assert motion is not None
    force = np.zeros(run.time.size)
    for side in range(p.inverse.sides):
        surface = side_surface(p.inverse, side)
        toward = 1.0 - 2.0 * side
        for k in range(run.time.size):
            current = abs(run.current_read[k, side]) * p.inverse.current_share
            gap = believed_gap(p.inverse, side, run.measured[k])
            force[k] += toward * p.inverse.magnets * magnet_force(surface, current, gap)
    push = force + p.constant_force - p.cubic * run.measured**3
    a = np.array([[0.0, 1.0], [-design.suspension / p.mass, -p.damping / p.mass]])
    held = StateSpace(a, np.array([[0.0], [1.0 / p.mass]]), np.eye(2), np.zeros((2, 1)))
    moving = held.sampled(float(run.time[1] - run.time[0]))
    state = np.array([run.measured[0], 0.0])
    position = np.empty(run.time.size)
    for k in range(run.time.size):
        position[k] = state[0]
        later = push[min(k + 1, run.time.size - 1)]
        state = moving.A @ state + moving.B[:, 0] * 0.5 * (push[k] + later)
    error = position - run.measured
    return Replay(position, force, float(np.sqrt(np.mean(error**2)) / np.std(run.measured)))


Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Degradation:
    """RMS tracking error over the amplitude once settled, at amplitudes (n_amplitude,) m and frequencies in Hz.

    Attributes
    ----------
    error : (n_amplitude, n_frequency); nan where refused or lost
    ending : (n_amplitude, n_frequency) "kept", "cut" (guard or drive cut commands), "refused" before the run, "lost"
    """

    amplitude: Array
    frequency: Array
    error: Array
    ending: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class Examination:
    """What the trials gave.

    Attributes
    ----------
    runs, specs : by name of `REFERENCES`; a run that was refused or lost is the reason instead
    integral_alone : m, tracking RMS of the sine where the reference acts by the integral alone, as in the source paper;
        None for a design without a feedforward, or where the plant is not held
    beyond : the run of largest error that was kept in the degradation, its amplitude and frequency
    replays : of the sine and of `beyond`; None where there is no run
    frequency : (n_frequency,) Hz of the linear figures
    sensitivity, complementary : frozen position to (n_frequency,) of |S| and |T|
    frozen_margins : one a frozen position
    consistency : of the sine's innovations; None for a design without a Kalman filter
    """

    design: ControllerDesign
    runs: dict[str, ClosedLoopRun | str]
    specs: dict[str, str]
    integral_alone: float | None
    degradation: Degradation
    beyond: tuple[ClosedLoopRun, float, float] | None
    replays: tuple[Replay | None, Replay | None]
    response: FrequencyResponse
    frequency: Array
    sensitivity: dict[float, Array]
    complementary: dict[float, Array]
    frozen_margins: tuple[Margins, ...]
    consistency: Consistency | None


def examine_design(
    design: ControllerDesign, *, plant: PlantUnderTest, seed: int = 1, progress: Progress | None = None
) -> Examination:
    """All trials of a design on a plant.

    Raises
    ------
    InputError, ComputationError : the small sines of the frequency response are not held
    """
    tell = progress or (lambda *_: None)
    rate = 1 / design.law.plant.period
    amplitude = min(-design.stable_reach[0], design.stable_reach[1])
    if not amplitude > 0:
        amplitude = design.stable_reach[1]  # one side pulls
    tell(0, 4)
    specs = {name: REFERENCES[name].format(share * amplitude * 1e3) for name, share in SHARES.items()}
    runs = {
        name: _tried(design, reference(parse_excitation(spec, unit="m"), rate=rate), plant, seed)
        for name, spec in specs.items()
    }
    tell(1, 4)
    degradation, beyond = _degradation(design, plant, seed)
    tell(2, 4)
    response = closed_loop_response(design, plant=plant)
    tell(3, 4)
    sine = runs["sine"]
    f = grid(design.law.plant.period)
    dense = grid(design.law.plant.period, 2000)
    shown = _shown(design)
    loops = {p.position: design.law_at(p.position).loop_transfer(f, p.at) for p in shown}
    consistent = isinstance(sine, ClosedLoopRun) and np.isfinite(design.law.estimator.innovation_variance)
    tell(4, 4)
    return Examination(
        design=design,
        runs=runs,
        specs=specs,
        integral_alone=_integral_alone(design, specs["sine"], plant, seed),
        degradation=degradation,
        beyond=beyond,
        replays=(
            replay(design, sine) if isinstance(sine, ClosedLoopRun) else None,
            replay(design, beyond[0]) if beyond else None,
        ),
        response=response,
        frequency=f,
        sensitivity={x: np.asarray(1 / np.abs(1 + loop)) for x, loop in loops.items()},
        complementary={x: np.asarray(np.abs(loop) / np.abs(1 + loop)) for x, loop in loops.items()},
        frozen_margins=tuple(
            margins(design.law_at(p.position).loop_transfer(dense, p.at), dense) for p in design.frozen
        ),
        consistency=innovation_consistency(design, sine) if consistent and isinstance(sine, ClosedLoopRun) else None,
    )


def _tried(design: ControllerDesign, track: Reference, plant: PlantUnderTest, seed: int) -> ClosedLoopRun | str:
    try:
        return run_closed_loop(design, track, plant=plant, generator=np.random.default_rng(seed))
    except (InputError, ComputationError) as err:
        return str(err)


def _integral_alone(design: ControllerDesign, spec: str, plant: PlantUnderTest, seed: int) -> float | None:
    if not design.law.feedforward:
        return None
    parameters = design.parameters._replace(feedforward=False)
    plain = replace(design, law=design.law.by_integral_alone(), parameters=parameters)
    run = _tried(plain, reference(parse_excitation(spec, unit="m"), rate=1 / design.law.plant.period), plant, seed)
    return run.tracking_rms if isinstance(run, ClosedLoopRun) else None


@dataclass(frozen=True, eq=False)
class _Trial:
    """One sine: how it ended, its RMS error in m once settled (nan without a run), and the run."""

    ending: str
    error: float
    run: ClosedLoopRun | None = None


def _trial(design: ControllerDesign, plant: PlantUnderTest, spec: str, seed: int) -> _Trial:
    track = reference(parse_excitation(spec, unit="m"), rate=1 / design.law.plant.period)
    try:
        run = run_closed_loop(design, track, plant=plant, generator=np.random.default_rng(seed))
    except InputError:
        return _Trial("refused", float("nan"))
    except ComputationError:
        return _Trial("lost", float("nan"))
    late = run.time >= _SETTLED
    cut = run.guard_violations or run.force_limited
    error = float(np.sqrt(np.mean((run.position - run.reference)[late] ** 2)))
    return _Trial("cut" if cut else "kept", error, run)


def _degradation(
    design: ControllerDesign, plant: PlantUnderTest, seed: int
) -> tuple[Degradation, tuple[ClosedLoopRun, float, float] | None]:
    """The degradation, and of the runs that came to their end the one with the largest error."""
    low, high = design.reach
    amplitudes = (min(-low, high) if low < 0 else high) * np.array(AMPLITUDES)
    frequencies = np.array([f for f in FREQUENCIES if f < 0.1 / design.law.plant.period])
    rows = [
        [
            _trial(design, plant, f"sine:frequency={f} Hz,amplitude={a * 1e3} mm,duration={_TRIAL} s", seed)
            for f in frequencies
        ]
        for a in amplitudes
    ]
    degradation = Degradation(
        amplitudes,
        frequencies,
        np.array([[trial.error for trial in row] for row in rows]) / amplitudes[:, None],
        tuple(tuple(trial.ending for trial in row) for row in rows),
    )
    if np.isnan(degradation.error).all():
        return degradation, None
    m, n = np.unravel_index(np.nanargmax(degradation.error * amplitudes[:, None]), degradation.error.shape)
    run = rows[m][n].run
    return degradation, None if run is None else (run, float(amplitudes[m]), float(frequencies[n]))


def _shown(design: ControllerDesign) -> list[FrozenPosition]:
    """The stable frozen positions nearest to the middle, half, four fifths and the whole of the upper reach."""
    stable = [p for p in design.frozen if np.isfinite(p.peak_sensitivity) and p.position >= -1e-9]
    places = np.array([p.position for p in stable])
    picked = sorted({int(np.argmin(np.abs(places - share * design.reach[1]))) for share in (0.0, 0.5, 0.8, 1.0)})
    return [stable[n] for n in picked]
