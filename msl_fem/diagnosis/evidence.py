"""What a diagnosis rests on, for those who want to look: residuals of each model, all that was tried, sizes of causes.

A diagnosis itself says what is wrong and how sure that is; this record holds what a page of it draws.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.outside import Dependence
from msl_fem.diagnosis.search import Stage
from msl_fem.plant.effects import EffectValues
from msl_fem.prediction import ModelHypothesis, RunData, free_run, kernel_plant, measured_start
from msl_fem.prediction.free_run import counted
from msl_fem.prediction.run_data import POSITION_COLUMN

Array = NDArray[np.float64]
SMOOTH = 0.5e-3  # s over which a velocity is taken, at least three samples


@dataclass(frozen=True, eq=False)
class Models:
    """The model as believed, within its tolerances, and with the effects that are named (the same, where none is)."""

    nominal: ModelHypothesis
    refitted: ModelHypothesis
    extended: ModelHypothesis


@dataclass(frozen=True)
class Tried:
    """A way in which an effect was tried.

    Attributes
    ----------
    stage : 1 for the first effect, 2 for a second beside it, and so on
    linear : nats of log evidence in the linear model around the fit without it
    refitted : nats of log evidence with everything fitted anew; None where the linear figure was too low for that
    taken : it is named
    """

    stage: int
    effect: str
    variant: str
    linear: float
    refitted: float | None
    taken: bool


@dataclass(frozen=True, eq=False)
class ChannelResiduals:
    """Measured less modelled of a channel of a run, SI units, (n_sample,) each; nan where a model ended early.

    Attributes
    ----------
    sigma : of the noise
    """

    run: str
    role: str
    channel: str
    rate: float
    sigma: float
    nominal: Array
    refitted: Array
    extended: Array

    @property
    def time(self) -> Array:
        return np.arange(self.nominal.size) / self.rate


@dataclass(frozen=True)
class Size:
    """How much an effect changes a run at equal input: RMS change over the channel's own RMS, its largest channel."""

    effect: str
    run: str
    channel: str
    share: float
    change: float


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a diagnosis rests on.

    Attributes
    ----------
    tried : all effects of all stages, the best of each stage first
    residuals : every run and channel
    variables : run to name (with unit) to (n_sample,): what a residual may depend on
    sizes : of the named effects
    dependences : of what is left on each variable in each equation, the most probable first
    """

    tried: tuple[Tried, ...]
    residuals: tuple[ChannelResiduals, ...]
    variables: Mapping[str, Mapping[str, Array]]
    sizes: tuple[Size, ...]
    dependences: tuple[Dependence, ...] = ()


def gathered(
    data: Sequence[RunData], models: Models, stages: Sequence[Stage], *, causes: Sequence[str],
    left: Sequence[Dependence] = (),
) -> Evidence:  # fmt: skip
    """The evidence of a diagnosis with these models, whose search went through these stages.

    Parameters
    ----------
    causes : effects that are named, in the order of the stages
    left : what the rest depends on
    """
    residuals, variables = [], {}
    for run in data:
        three = [_left(model, run) for model in (models.nominal, models.refitted, models.extended)]
        variables[run.name] = variables_of(run)
        for name in counted(run):
            parts = [left[name] for left in three]
            residuals.append(ChannelResiduals(run.name, run.role, name, run.rate, run.noise[name].sigma, *parts))
    sizes = [_size(models.extended, data, effect) for effect in causes]
    return Evidence(
        tried_of(stages, len(causes)), tuple(residuals), variables, tuple(s for s in sizes if s), tuple(left)
    )


def tried_of(stages: Sequence[Stage], taken: int) -> tuple[Tried, ...]:
    """All variants of all stages; those that were refitted come first, by their gain, then by the linear figure."""
    found: list[Tried] = []
    for n, stage in enumerate(stages):
        refits = {refit.variant.name: refit.gain for refit in stage.refits}
        best = stage.best.variant.name if stage.best is not None and n < taken else ""
        of_stage = [
            Tried(n + 1, s.variant.effect, s.variant.name, s.gain, refits.get(s.variant.name), s.variant.name == best)
            for s in stage.scores
        ]
        found += sorted(of_stage, key=lambda t: (t.refitted is None, -(t.linear if t.refitted is None else t.refitted)))
    return tuple(found)


def variables_of(run: RunData) -> dict[str, Array]:
    """What a residual of a run may depend on, from its readings: position, velocity, currents, time."""
    x = run.measured[POSITION_COLUMN]
    width = max(3, round(SMOOTH * run.rate) | 1)
    smooth = np.convolve(np.pad(x, width // 2, mode="edge"), np.ones(width) / width, "valid")
    found = {"position_m": x, "velocity_m_per_s": np.gradient(smooth) * run.rate}
    for j in (1, 2):
        name = f"current_{j}_A"
        if name in run.measured:
            found[name] = run.measured[name]
    found["time_s"] = run.time
    return found


def _left(model: ModelHypothesis, run: RunData) -> dict[str, Array]:
    readings = _readings(model, run)
    return {name: run.measured[name] - readings[name] for name in counted(run)}


def _readings(model: ModelHypothesis, run: RunData) -> Mapping[str, Array]:
    plant = kernel_plant(model, rate=run.rate, ideal_current=run.ideal_current)
    return free_run(plant, run, measured_start(plant, run)).readings


def _size(extended: ModelHypothesis, data: Sequence[RunData], effect: str) -> Size | None:
    """The largest size of an effect over the runs; None where the model does not bear its absence."""
    assert extended.effects is not None
    rest = {name: dict(values) for name, values in extended.effects.stated.items() if name != effect}
    without = replace(extended, effects=EffectValues(rest) if rest else None)
    found = []
    for run in data:
        present, absent = _readings(extended, run), _readings(without, run)
        for name in counted(run):
            change = float(np.sqrt(np.mean((present[name] - absent[name]) ** 2)))
            found.append(Size(effect, run.name, name, change / float(np.sqrt(np.mean(absent[name] ** 2))), change))
    return max((s for s in found if np.isfinite(s.share)), key=lambda s: s.share, default=None)
