"""The likelihood of a mover that a force drives and no spring holds: by its inverse dynamics, in the equation's band.

A free run of such a rig drifts with every error of the force, so the equation is compared and not its solution: the
residual is a force, and its lines below the equation's low-pass are what counts. Its white sigma is what the
instruments say: the force's noise and the position's, which passes the differences as |s^2 m + s c|.

Errors in variables: the columns of a regression hold the position's noise too, which makes a parameter smaller by the
noise's share of the column's power (Fuller, Measurement Error Models, 1987, ch. 1). `attenuation` states that share;
far below a standard error it needs no other treatment.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.extension import extended_belief
from msl_fem.diagnosis.fit import Fit, Likelihood
from msl_fem.diagnosis.held_out import Followed
from msl_fem.diagnosis.inverse_force import LowPass, missing_force, usual_low_pass
from msl_fem.diagnosis.noise_bands import Bands, transformed
from msl_fem.diagnosis.other_records import Kind
from msl_fem.diagnosis.scene import scene
from msl_fem.diagnosis.simulator import Points, Problem
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import Scene, Variant, possible, variants
from msl_fem.plant import PlantParameters
from msl_fem.plant.effects import CATALOGUE, neutral_vector
from msl_fem.prediction import ModelHypothesis, RunData, free_parameters, kernel_plant
from msl_fem.prediction.hypothesis import with_factors
from msl_fem.prediction.run_data import POSITION_COLUMN, highest_band_sigma
from msl_fem.record import Record, Tolerance

Array = NDArray[np.float64]
FORCE = "force_N"
_FALL = ("stribeck_rise", "stribeck_velocity")
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

    low_pass: LowPass
    sigmas: tuple[float, ...]

    def spectra(self, points: Points) -> Array:
        """Missing forces in the frequency domain over their white sigma, (n_row, n_number)."""
        vectors = points.effects if points.effects is not None else [neutral_vector()] * len(points.rows)
        found = []
        for z, effects in zip(points.rows, vectors, strict=True):
            factors = points.unknowns.factors(z)
            plant = with_factors(self.problem.plant.parameters, factors)
            gain = self.problem.plant.gain * factors.get("position_gain", 1.0)
            found.append(np.concatenate([self._of_run(n, plant, effects, gain) for n in range(len(self.sigmas))]))
        return np.array(found)

    def _of_run(self, run: int, plant: PlantParameters, effects: Array, gain: float) -> Array:
        data = self.problem.runs[run]
        force = missing_force(plant, data, effects, gain=gain, low_pass=self.low_pass)
        return transformed(force[self.low_pass.kept(force.size)] / self.sigmas[run], self.bands.lines[run])

    def excess(self, found: Fit) -> dict[str, float]:
        """RMS missing force in the equation's band over what the instruments' noise makes there."""
        return {FORCE: float(np.sqrt(np.mean(found.residual**2)))}


def is_carriage(plant: PlantParameters) -> bool:
    """Whether a force drives a mover that no spring holds."""
    return plant.sides == 0 and plant.stiffness == 0.0


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
    problem = Problem(plant, smooth, (), (), None)
    unknowns = Unknowns(tuple(free_parameters(belief, tolerance).items()), 0, (0,) * len(runs))
    return InverseLikelihood(problem, bands, plant.substeps, low_pass, sigmas), unknowns


def one_band(samples: Sequence[int], low_pass: LowPass) -> Bands:
    """The equation's band as one: what is left of a real drive is the fine structure of its friction, which comes again
    with every stroke and is no stationary noise, so that a weight by frequency would trade one part of the stroke for
    another."""
    lines = tuple(int(np.sum(np.fft.rfftfreq(n, 1 / low_pass.rate) <= low_pass.equation)) for n in samples)
    return Bands(np.array([0.0, low_pass.equation]), lines, tuple(np.zeros(n, dtype=np.intp) for n in lines))


def smoothed(data: RunData, low_pass: LowPass) -> RunData:
    """A run with position and commands low-passed alike, so that the filter bends no side against the other."""
    commands = np.zeros_like(data.commands)
    commands[:, 0] = low_pass.smooth(data.commands[:, 0])
    return replace(data, commands=commands, measured={POSITION_COLUMN: low_pass.smooth(data.measured[POSITION_COLUMN])})


def force_sigma(plant: PlantParameters, data: RunData, low_pass: LowPass) -> float:
    """N, of white noise with the power of the instruments' noise in the band.

    Of the force, where it is not stated, what its highest frequencies hold.
    """
    omega = 2 * np.pi * np.linspace(0, low_pass.equation, 201)
    passes = (plant.mass * omega**2) ** 2 + (plant.damping * omega) ** 2
    by_position = data.noise[POSITION_COLUMN].sigma ** 2 * float(passes.mean())
    return float(np.sqrt(by_position + highest_band_sigma(data.commands[:, 0]) ** 2))


def attenuation(data: RunData, low_pass: LowPass) -> dict[str, float]:
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


def candidates_of_carriage(likelihood: Likelihood, found: Fit) -> list[Variant]:
    """The variants of all effects that a carriage can have.

    Its travel says nothing of its friction's presliding; and friction is Coulomb's, without a fall over the velocity,
    which viscous damping and a record of few velocities do not tell apart.
    """
    looked = scene(likelihood, found)
    looked = replace(looked, position=min(looked.position, REVERSAL))
    plant = likelihood.problem.plant.parameters
    have = {one.effect for one in found.unknowns.effects}
    tried = [v for v in offered(plant, looked) if v.effect not in have]
    return list(dict.fromkeys(replace(v, shapes=tuple(s for s in v.shapes if s.name not in _FALL)) for v in tried))


def offered(plant: PlantParameters, looked: Scene) -> list[Variant]:
    """The variants whose amounts the inverse dynamics take, of all effects that a plant can have."""
    tried = [v for effect in possible(plant) for v in variants(effect, looked, plant)]
    return [v for v in tried if all(a.name in CATALOGUE[v.effect].inverse.parameters for a in v.amounts)]


def force_followed(belief: ModelHypothesis, runs: Sequence[RunData]) -> list[Followed]:
    """A model's inverse dynamics along runs: the force that it misses, both sides low-passed alike.

    `samples` are the independent numbers of the equation's band.
    """
    low_pass = usual_low_pass([run for run in runs if run.role == "fit"])
    found = []
    for data in runs:
        plant = kernel_plant(belief, rate=data.rate)
        kept = low_pass.kept(len(data.commands))
        smooth = smoothed(data, low_pass)
        missing = missing_force(plant.parameters, smooth, plant.readings, gain=plant.gain, low_pass=low_pass)
        error, force = (low_pass.both_sides(signal)[kept] for signal in (missing, data.commands[:, 0]))
        rms, deviation = float(np.sqrt(np.mean(error**2))), float(force.std())
        band = 2 * low_pass.equation / data.rate
        floor = force_sigma(plant.parameters, data, low_pass) * np.sqrt(band)
        samples = round(band * error.size)
        found.append(Followed(data.name, data.role, FORCE, rms, rms / deviation, float(floor), samples, deviation))
    return found


FINISHED = 0.5
"""Share of the excess power that a further effect may leave: the inverse model of a real drive never comes down to
the noise of its instruments, and an effect that takes less than half of the rest mimics what no catalogue holds."""


def carriage(
    record: Record, belief: ModelHypothesis, data: Sequence[RunData]
) -> tuple[InverseLikelihood, Unknowns, Kind]:
    """What the diagnosis of a carriage's record needs.

    Raises
    ------
    InputError : a run is too short for the filters
    """
    fitted = [run for run in data if run.role == "fit"]
    likelihood, unknowns = prepared_carriage(belief, fitted, record.tolerance)

    def extend(found: Fit) -> ModelHypothesis:
        return extended_belief(belief, likelihood.problem, found)

    share = max(attenuation(fitted[0], likelihood.low_pass).values())
    kind = Kind(
        "inverse-dynamics", belief, candidates_of_carriage,
        lambda found: force_followed(belief if found is None else extend(found), data), extend, FINISHED,
        notes=(
            f"inverse dynamics in the band up to {likelihood.low_pass.equation:g} Hz; noise of the position makes "
            f"regressors larger by {100 * share:.2g} % of their power at most, so no instruments were needed",
        ),
    )  # fmt: skip
    return likelihood, unknowns, kind
