"""A design put through the paper's trials: references, degradation beyond range and frequency, responses, margins."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.control.closed_loop import ClosedLoopRun, TruePlant, run_closed_loop
from msl_fem.control.consistency import Consistency, innovation_consistency
from msl_fem.control.design import ControllerDesign, FrozenPosition
from msl_fem.control.frequency_response import FrequencyResponse, frequency_response
from msl_fem.control.linear_loop import grid
from msl_fem.control.margins import Margins, margins
from msl_fem.control.replay import Replay, replay
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.excitation import Reference, parse_excitation, reference

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

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


def examine(
    design: ControllerDesign, *, plant: TruePlant, seed: int = 1, progress: Progress | None = None
) -> Examination:
    """All trials of a design on a plant.

    Raises
    ------
    InputError, ComputationError : the small sines of the frequency response are not held
    """
    tell = progress or (lambda *_: None)
    rate, amplitude = 1 / design.law.plant.period, min(-design.stable_reach[0], design.stable_reach[1])
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
    response = frequency_response(design, plant=plant)
    tell(3, 4)
    sine = runs["sine"]
    f, dense, shown = grid(design.law.plant.period), grid(design.law.plant.period, 2000), _shown(design)
    loops = {p.position: design.law.loop_transfer(f, p.at) for p in shown}
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
        frozen_margins=tuple(margins(design.law.loop_transfer(dense, p.at)) for p in design.frozen),
        consistency=innovation_consistency(design, sine) if consistent and isinstance(sine, ClosedLoopRun) else None,
    )


def _tried(design: ControllerDesign, track: Reference, plant: TruePlant, seed: int) -> ClosedLoopRun | str:
    try:
        return run_closed_loop(design, track, plant=plant, generator=np.random.default_rng(seed))
    except (InputError, ComputationError) as err:
        return str(err)


def _integral_alone(design: ControllerDesign, spec: str, plant: TruePlant, seed: int) -> float | None:
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


def _trial(design: ControllerDesign, plant: TruePlant, spec: str, seed: int) -> _Trial:
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
    design: ControllerDesign, plant: TruePlant, seed: int
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
    found = Degradation(
        amplitudes,
        frequencies,
        np.array([[trial.error for trial in row] for row in rows]) / amplitudes[:, None],
        tuple(tuple(trial.ending for trial in row) for row in rows),
    )
    if np.isnan(found.error).all():
        return found, None
    m, n = np.unravel_index(np.nanargmax(found.error * amplitudes[:, None]), found.error.shape)
    run = rows[m][n].run
    return found, None if run is None else (run, float(amplitudes[m]), float(frequencies[n]))


def _shown(design: ControllerDesign) -> list[FrozenPosition]:
    """The stable frozen positions nearest to the middle, half, four fifths and the whole of the upper reach."""
    stable = [p for p in design.frozen if np.isfinite(p.peak_sensitivity) and p.position >= -1e-9]
    places = np.array([p.position for p in stable])
    picked = sorted({int(np.argmin(np.abs(places - share * design.reach[1]))) for share in (0.0, 0.5, 0.8, 1.0)})
    return [stable[n] for n in picked]
