"""A mover that a force drives and no spring holds, or whose motion is imposed: the likelihood of its inverse dynamics,
in the equation's band.

A free run of such a rig drifts with every error of the force, and one whose motion a machine or a hand imposes obeys no
equation but the machine's; so the equation is compared and not its solution: the residual is a force, and its lines
below the equation's low-pass are what counts. Of an imposed motion the force is a reading, of another one the drive.
The residual's white sigma is what the instruments say: the force's noise and the position's, which passes the
differences as |s^2 m + s c|.

Errors in variables: the columns of a regression hold the position's noise too, which makes a parameter smaller by the
noise's share of the column's power (Fuller, Measurement Error Models, 1987, ch. 1). `attenuation` states that share;
far below a standard error it needs no other treatment.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.decision import Rule
from msl_fem.diagnosis.inverse_force import ZeroPhaseLowPass, missing_force, usual_low_pass
from msl_fem.diagnosis.kind import ErrorSignal, Kind, without_those_of
from msl_fem.diagnosis.likelihood import Fit, Likelihood, over_chance
from msl_fem.diagnosis.noise import NoiseBands, NoiseWeights, transformed
from msl_fem.diagnosis.problem import FitProblem, Points
from msl_fem.diagnosis.robust_errors import robust_errors
from msl_fem.diagnosis.unknowns import Unknowns, fixed_of
from msl_fem.diagnosis.variants import RecordFeatures, Variant, every_variant, record_features, variables_of
from msl_fem.errors import InputError
from msl_fem.plant import PlantParameters
from msl_fem.plant.effects import CATALOGUE
from msl_fem.prediction import ModelHypothesis, RunData, free_parameters, kernel_plant
from msl_fem.prediction.hypothesis import with_factors
from msl_fem.prediction.run_data import POSITION_COLUMN, highest_band_sigma
from msl_fem.prediction.scheduling import ratios_along, schedule_sigmas
from msl_fem.record import Record, Tolerance

Spectrum = NDArray[np.complexfloating]

FORCE = "force_N"
_FALL = ("stribeck_rise", "stribeck_velocity")
_RISE = "transition_velocity"
FINISHED = 0.5
"""Share of the excess power that a further effect may leave: the inverse model of a real drive never comes down to
the noise of its instruments, and an effect that takes less than half of the rest mimics what no catalogue holds."""
REVERSAL = 1e-3
"""m: the presliding travel is looked for within a fifth of it, however far a rig travels."""


@dataclass(frozen=True, eq=False)
class InverseLikelihood(Likelihood):
    """Runs as the likelihood of the force that they miss; positions and commands are low-passed already.

    Attributes
    ----------
    low_pass : of the equation
    sigmas : of each run, N: white noise that has the power of the instruments' noise in the equation's band
    """

    low_pass: ZeroPhaseLowPass
    sigmas: tuple[float, ...]

    def spectra(self, points: Points) -> Array:
        """Missing forces in the frequency domain over their white sigma, (n_row, n_number)."""
        rows = []
        for z, effects in points.each():
            factors = points.unknowns.factors(z)
            plant = with_factors(self.problem.plant.parameters, factors)
            gain = self.problem.plant.gain * factors.get("position_gain", 1.0)
            runs = [self._of_run(n, plant, effects, factors, gain) for n in range(len(self.sigmas))]
            rows.append(np.concatenate(runs))
        return np.array(rows)

    def _of_run(
        self, run: int, plant: PlantParameters, effects: Array, factors: Mapping[str, float], gain: float
    ) -> Array:
        data = self.problem.runs[run]
        ratios = ratios_along(data.schedules, factors)
        force = missing_force(plant, data, effects, gain=gain, low_pass=self.low_pass, ratios=ratios)
        return transformed(force[self.low_pass.kept(force.size)] / self.sigmas[run], self.bands.lines[run])

    def weights(self, residual: Array, unknowns: Unknowns) -> NoiseWeights:
        """The most probable densities given a residual (n_number,); a wander is no noise of its form in a force."""
        return self.plain_weights(residual)

    def standard_errors(self, found: Fit, along: Array | None = None) -> Array:
        """Of what inverse dynamics leave, which is no white noise: see `robust_errors`."""
        return robust_errors(found, self.bands.lines, np.eye(found.z.size) if along is None else along)

    def nats_of_noise(self, unknowns: Unknowns, z: Array) -> float:
        """None: what is missed of a force has the noise of its sigma."""
        return 0.0

    def excess(self, found: Fit) -> dict[str, float]:
        """RMS missing force in the equation's band over what the instruments' noise makes there, and chance of so few
        lines."""
        return {FORCE: over_chance(found.residual)}


def is_carriage(plant: PlantParameters, runs: Sequence[RunData]) -> bool:
    """Whether a force drives a mover that no spring holds, or that does what is imposed on it."""
    return plant.sides == 0 and (plant.stiffness == 0.0 or any(run.mover == "imposed" for run in runs))


def prepared_carriage(
    belief: ModelHypothesis, runs: Sequence[RunData], tolerance: Tolerance
) -> tuple[InverseLikelihood, Unknowns]:
    """The likelihood of a carriage's runs under a belief, and what it does not know without any effect."""
    low_pass = usual_low_pass(runs)
    plant = kernel_plant(belief, rate=runs[0].rate)
    smooth = tuple(smoothed(run, low_pass) for run in runs)
    kept = [low_pass.kept(len(run.commands)) for run in runs]
    bands = one_band([k.stop - k.start for k in kept], low_pass)
    sigmas = tuple(force_sigma(plant.parameters, run, low_pass) for run in runs)
    problem = FitProblem(plant, smooth, (), (), None)
    believed = (*free_parameters(belief, tolerance).items(), *schedule_sigmas(runs[0].schedules).items())
    unknowns = Unknowns(believed, 0, (0,) * len(runs), fixed=fixed_of(belief))
    return InverseLikelihood(problem, bands, plant.substeps, low_pass, sigmas), unknowns


def one_band(samples: Sequence[int], low_pass: ZeroPhaseLowPass) -> NoiseBands:
    """The equation's band as one: what is left of a real drive is the fine structure of its friction, which comes again
    with every stroke and is no stationary noise, so that a weight by frequency would trade one part of the stroke for
    another."""
    frequencies = [np.fft.rfftfreq(n, 1 / low_pass.rate) for n in samples]
    lines = tuple(int(np.sum(f <= low_pass.equation)) for f in frequencies)
    edges = np.array([0.0, low_pass.equation])
    return NoiseBands(edges, lines, tuple(np.zeros(n, dtype=np.intp) for n in lines))


def smoothed(data: RunData, low_pass: ZeroPhaseLowPass) -> RunData:
    """A run with position and commands low-passed alike, so that the filter bends no side against the other."""
    commands = np.zeros_like(data.commands)
    commands[:, 0] = low_pass.smooth(data.held[:, 0])
    position = low_pass.smooth(data.measured[POSITION_COLUMN])
    return replace(data, commands=commands, measured={POSITION_COLUMN: position})


def force_sigma(plant: PlantParameters, data: RunData, low_pass: ZeroPhaseLowPass) -> float:
    """N, of white noise with the power of the instruments' noise in the band.

    Of the force, where it is not stated, what its highest frequencies hold.
    """
    omega = 2 * np.pi * np.linspace(0, low_pass.equation, 201)
    passes = (plant.mass * omega**2) ** 2 + (plant.damping * omega) ** 2
    by_position = data.noise[POSITION_COLUMN].sigma ** 2 * float(passes.mean())
    return float(np.sqrt(by_position + highest_band_sigma(data.held[:, 0]) ** 2))


def attenuation(data: RunData, low_pass: ZeroPhaseLowPass) -> dict[str, float]:
    """The share of the position's noise in the power of velocity and acceleration in the equation's band."""
    kept = low_pass.kept(len(data.commands))
    found = {}
    signal = smoothed(data, low_pass).measured[POSITION_COLUMN]
    for order, name in ((1, "velocity"), (2, "acceleration")):
        signal = np.gradient(signal, 1 / data.rate)
        power = float(np.mean(low_pass.both_sides(signal)[kept] ** 2))
        highest = 2 * np.pi * low_pass.equation
        density = (
            data.noise[POSITION_COLUMN].sigma ** 2 * 2 / data.rate / (2 * np.pi)
        )  # over angular frequency, one-sided
        found[name] = density * highest ** (2 * order + 1) / (2 * order + 1) / power
    return found


def offered(plant: PlantParameters, features: RecordFeatures) -> list[Variant]:
    """The variants whose amounts the inverse dynamics take, of all effects that a plant can have."""
    tried = every_variant(plant, features)
    offered = []
    for variant in tried:
        taken = CATALOGUE[variant.effect].inverse.parameters
        if all(amount.name in taken for amount in variant.amounts):
            offered.append(variant)
    return offered


@dataclass(frozen=True, eq=False)
class Carriage(Kind):
    """Runs by their inverse dynamics; `runs` are all, those held out too."""

    runs: tuple[RunData, ...] = ()

    prediction: ClassVar[str] = "inverse-dynamics"
    takes_laws: ClassVar[bool] = True

    def rule(self, rule: Rule) -> Rule:
        return replace(super().rule(rule), finished=FINISHED)

    def candidates(self, fit: Fit) -> list[Variant]:
        """The variants of all effects that a carriage can have.

        Its travel says nothing of its friction's presliding; and friction is Coulomb's, without a fall or a slow rise
        over the velocity, which viscous damping and a record of few velocities do not tell apart.
        """
        features = record_features(self.likelihood, fit)
        features = replace(features, position=min(features.position, REVERSAL))
        tried = without_those_of(fit, offered(self.likelihood.problem.plant.parameters, features))
        shaped = []
        for variant in tried:
            if any(shape.name == _RISE for shape in variant.shapes):
                continue
            shapes = tuple(shape for shape in variant.shapes if shape.name not in _FALL)
            shaped.append(replace(variant, shapes=shapes))
        return list(dict.fromkeys(shaped))

    def errors(self, belief: ModelHypothesis, fit: Fit | None) -> list[ErrorSignal]:
        """The force that a model's inverse dynamics miss, both sides low-passed alike; independent are the numbers of
        the equation's band."""
        signals = []
        for run in self.runs:
            plant = kernel_plant(belief, rate=run.rate)
            kept = self._low_pass.kept(len(run.commands))
            smooth = smoothed(run, self._low_pass)
            missing = missing_force(
                plant.parameters, smooth, plant.readings, gain=plant.gain, low_pass=self._low_pass,
                ratios=ratios_along(run.schedules, belief.factors),
            )  # fmt: skip
            missed = self._low_pass.both_sides(missing)[kept]
            force = self._low_pass.both_sides(run.held[:, 0])[kept]
            band = 2 * self._low_pass.equation / run.rate
            floor = force_sigma(plant.parameters, run, self._low_pass) * float(np.sqrt(band))
            samples = round(band * missed.size)
            signals.append(ErrorSignal(run.name, run.role, FORCE, missed, float(force.std()), floor, run.rate, samples))
        return signals

    def variables(self) -> dict[str, Mapping[str, Array]]:
        found: dict[str, Mapping[str, Array]] = {}
        for run in self.runs:
            kept = self._low_pass.kept(len(run.commands))
            found[run.name] = {name: values[kept] for name, values in variables_of(run).items()}
        return found

    @property
    def _low_pass(self) -> ZeroPhaseLowPass:
        assert isinstance(self.likelihood, InverseLikelihood)
        return self.likelihood.low_pass


def carriage(record: Record, belief: ModelHypothesis, runs: Sequence[RunData]) -> Carriage:
    """A carriage's record, made ready.

    Raises
    ------
    InputError : a run is too short for the filters, or has positions that do not count, of which no velocity comes
    """
    for run in runs:
        if POSITION_COLUMN in run.invalid:
            lost = run.invalid[POSITION_COLUMN]
            raise InputError(
                f"run {run.name}: {lost.size} positions do not count, the first at {lost[0] / run.rate:.4g} s, and the "
                "force of a mover without a spring is told by its acceleration; cut the run there by a column valid"
            )
    fitted = [run for run in runs if run.role == "fit"]
    likelihood, unknowns = prepared_carriage(belief, fitted, record.tolerance)
    share = max(attenuation(fitted[0], likelihood.low_pass).values())
    note = (
        f"inverse dynamics in the band up to {likelihood.low_pass.equation:g} Hz; noise of the position makes "
        f"regressors larger by {100 * share:.2g} % of their power at most, so no instruments were needed"
    )
    return Carriage(belief, likelihood, unknowns, (note,), runs=tuple(runs))
