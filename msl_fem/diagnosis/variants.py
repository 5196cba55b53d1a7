"""The ways in which each effect of the catalogue can act: which of its parameters, around which shapes.

An effect with many parameters is tried with few of them at a time: each that is not needed would cost evidence. A shape
(a frequency, a time constant) starts at each point of a grid and is free from there.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.likelihood import Fit, Likelihood
from msl_fem.diagnosis.problem import FitProblem
from msl_fem.diagnosis.residual_spectrum import loud_lines, resonances, spectra_of_rest
from msl_fem.diagnosis.unknowns import EffectUnknown
from msl_fem.plant.effects import CATALOGUE, LAGGING, Parameter
from msl_fem.plant.own_scales import over_reference, own_quantities
from msl_fem.plant.plant import FORCE_DRIVE, PlantParameters, drive_lags, own_stiffness
from msl_fem.prediction import RunData
from msl_fem.prediction.run_data import POSITION_COLUMN

MAINS = (50.0, 60.0)
LEAST = 1e-9  # m or m/s, of a mover that stands still
SMOOTH_SECONDS = 0.5e-3  # over which a velocity is taken, at least three samples
SMOOTH = 20  # samples over which a velocity is taken


@dataclass(frozen=True)
class Variant:
    """Parameters of one effect that are searched together: amounts, then shapes with their centres."""

    effect: str
    amounts: tuple[EffectUnknown, ...]
    shapes: tuple[EffectUnknown, ...] = ()

    @property
    def unknowns(self) -> tuple[EffectUnknown, ...]:
        return (*self.amounts, *self.shapes)

    def about(self, believed: Mapping[int, float]) -> "Variant":
        """The same about values, by place, that are believed before."""
        return replace(self, amounts=tuple(replace(a, believed=believed.get(a.place)) for a in self.amounts))

    @property
    def name(self) -> str:
        amounts = ", ".join(amount.name for amount in self.amounts)
        shapes = ", ".join(f"{shape.name} near {shape.centre:.3g}" for shape in self.shapes)
        return f"{self.effect} ({amounts}; {shapes})" if shapes else f"{self.effect} ({amounts})"


@dataclass(frozen=True)
class RecordFeatures:
    """What the grids of shapes need to know of a record: usual sizes and its own frequencies.

    Attributes
    ----------
    position, current, velocity : RMS of what varies, m, A, m/s
    own_frequency : Hz, of the mover on its spring, or where its spectrum is highest
    lines : Hz, the highest lines of the residual
    resonances : Hz, the peaks of its spectrum that are no lines
    rate : samples a second, Hz; None without runs
    command : RMS of what drives the runs, its mean in it, A, V or N
    peak : highest current, that of a map beside the runs included, A
    loops : whether it is of loops of a magnet at rest, which show more of an iron's memory than runs do
    """

    position: float
    current: float
    velocity: float
    own_frequency: float
    lines: tuple[float, ...] = ()
    resonances: tuple[float, ...] = ()
    rate: float | None = None
    command: float = 1.0
    peak: float = 1.0
    loops: bool = False


def possible(plant: PlantParameters) -> tuple[str, ...]:
    """The effects that a plant can have at all."""
    has = {"magnets": plant.sides > 0, "two sides": plant.sides == 2, "drive lag": drive_lags(plant)}
    left = set() if plant.drive != FORCE_DRIVE or drive_lags(plant) else {"amplifier_bandwidth"}
    names = [effect.name for effect in CATALOGUE.values() if all(has[need] for need in effect.needs)]
    return tuple(name for name in names if name not in left)


def every_variant(plant: PlantParameters, features: RecordFeatures) -> list[Variant]:
    """All variants of all effects that a plant can have, for a record of these features."""
    return [variant for effect in possible(plant) for variant in variants(effect, features, plant)]


def variants(effect: str, features: RecordFeatures, plant: PlantParameters) -> list[Variant]:
    """All variants of an effect for a record."""
    entry = CATALOGUE[effect]
    sets = [names for names in entry.sets or (entry.amounts,) if _there(effect, names, plant)]
    shapes = [p for p in entry.parameters if p.shape and (p.over != "loops" or features.loops)]
    own = own_quantities(plant, rate=features.rate)
    sizes = {parameter.name: over_reference(parameter, own) for parameter in entry.parameters}
    found = []
    for names in sets:
        amounts = tuple(EffectUnknown(effect, name, size=sizes[name]) for name in names)
        of_them = [shape for shape in shapes if not shape.belongs_to or shape.belongs_to in names]
        for about in _forms(of_them):
            for centres in product(*(_centres(shape, features) for shape in about)):
                around = zip(about, centres, strict=True)
                unknown = tuple(EffectUnknown(effect, shape.name, centre, shape.width) for shape, centre in around)
                found.append(Variant(effect, amounts, unknown))
    alone = [parameter.name for parameter in entry.parameters if parameter.alone]
    return found + [Variant(effect, (EffectUnknown(effect, name, size=sizes[name]),)) for name in alone]


def _forms(shapes: Sequence[Parameter]) -> list[list[Parameter]]:
    """The shapes that are tried together: those that stand in no other's place and are not optional, then one of the
    others beside them."""
    others = [shape for shape in shapes if shape.instead or shape.optional]
    first = [shape for shape in shapes if shape not in others]
    return [first, *([*(shape for shape in first if shape.name not in one.instead), one] for one in others)]


def _there(effect: str, names: Sequence[str], plant: PlantParameters) -> bool:
    """Whether a plant has what the parameters are about."""
    if any(name.endswith("_2") for name in names) and plant.sides < 2:
        return False
    if plant.sides == 0 and any(name.startswith("current") for name in names):
        return False
    if effect == "gap_offset" and "centring" in names and plant.sides < 2:
        return False
    if "bandwidth_error" in names and math.isinf(plant.bandwidth):
        return False
    return drive_lags(plant) or not any((effect, name) in LAGGING for name in names)


def _centres(shape: Parameter, features: RecordFeatures) -> tuple[float, ...]:
    """The values of a shape at which a search starts."""
    if shape.over == "lines":
        return tuple(dict.fromkeys((*MAINS, *features.lines)))
    unit = float(getattr(features, shape.over)) if shape.over else 1.0
    return (*(unit * factor for factor in shape.tried), *(features.resonances if shape.resonant else ()))


def record_features(likelihood: Likelihood, found: Fit) -> RecordFeatures:
    """The features of a record at a fit without what is looked for."""
    runs = features_of_runs(likelihood.problem)
    peak = max(runs.peak, likelihood.highest_at_rest)
    spectra = spectra_of_rest(likelihood, found)
    return replace(runs, lines=loud_lines(spectra), resonances=resonances(spectra), peak=peak)


def features_of_runs(problem: FitProblem) -> RecordFeatures:
    """The features of runs without the lines of a residual."""
    p = problem.plant.parameters
    currents = [run.measured.get("current_1_A", run.commands[:, 0]) for run in problem.runs]
    return RecordFeatures(
        position=max(_rms([run.measured[POSITION_COLUMN] for run in problem.runs]), LEAST),
        current=_rms(currents) if p.sides else 1.0,
        velocity=max(_rms([_velocity(run) for run in problem.runs]), LEAST),
        own_frequency=float(np.sqrt(own_stiffness(p) / p.mass) / (2 * np.pi)),
        rate=problem.runs[0].rate if problem.runs else None,
        command=_command(problem.runs),
        peak=max(float(np.abs(i).max()) for i in currents) if p.sides else 1.0,
    )


def _command(runs: Sequence[RunData]) -> float:
    power = [float(np.mean(run.commands**2)) for run in runs]
    return float(np.sqrt(np.mean(power))) if any(power) else 1.0


def _rms(values: Sequence[Array]) -> float:
    return float(np.sqrt(np.mean([np.var(v) for v in values])))


def _velocity(run: RunData) -> Array:
    smooth = np.convolve(run.measured[POSITION_COLUMN], np.ones(SMOOTH) / SMOOTH, "valid")
    return (smooth[SMOOTH:] - smooth[:-SMOOTH]) * run.rate / SMOOTH


def variables_of(run: RunData) -> dict[str, Array]:
    """What a residual of a run may depend on, from its readings: position, velocity, currents, time."""
    x = run.measured[POSITION_COLUMN]
    width = max(3, round(SMOOTH_SECONDS * run.rate) | 1)
    smooth = np.convolve(np.pad(x, width // 2, mode="edge"), np.ones(width) / width, "valid")
    variables = {"position_m": x, "velocity_m_per_s": np.gradient(smooth) * run.rate}
    for name in ("current_1_A", "current_2_A"):
        if name in run.measured:
            variables[name] = run.measured[name]
    variables["time_s"] = run.time
    return variables
