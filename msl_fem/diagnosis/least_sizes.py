"""How large an effect has to be to be found on a record: from the model's slopes along it alone.

An effect whose amount is a changes the readings, beyond all that is not known of the rig, by the noncentrality a'G a
(`scoring`). From 17.8 on a test that is wrong in one of a hundred records without the effect finds it in 95 of a
hundred with it ((2.576 + 1.645)^2; Kay, Statistical Signal Processing II, 1998, ch. 2). Its size is that of the
record's formats: RMS change over RMS of a channel, the largest over the channels. The measured data enter by the noise
alone, so the same holds for a record that is only planned.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.decision import COINCIDING, TOLERANCES
from msl_fem.diagnosis.fit import Fit, Likelihood
from msl_fem.diagnosis.scoring import Score
from msl_fem.diagnosis.unknowns import EffectUnknown
from msl_fem.plant.effects import CATALOGUE

Array = NDArray[np.float64]
NONCENTRALITY = 17.8


@dataclass(frozen=True)
class LeastSize:
    """The least amount of an effect that a record tells from nothing.

    Attributes
    ----------
    amount : SI, of the parameter `name`
    size : RMS change over RMS of the channel that shows it most
    alone : the size that would do were everything else known exactly
    slowest : the size by the shapes (time constants, frequencies) that show the same amounts last
    """

    effect: str
    name: str
    amount: float
    size: float
    alone: float
    slowest: float = np.inf


def least_sizes(likelihood: Likelihood, found: Fit, scored: Sequence[Score]) -> list[LeastSize]:
    """Of every effect its first parameter, by the shapes that show it soonest; smallest sizes first."""
    made: dict[str, list[tuple[tuple[str, ...], LeastSize]]] = {}
    for score in scored:
        amounts = tuple(one.name for one in score.variant.amounts)
        first = CATALOGUE[score.variant.effect].parameters[0].name
        if amounts[0] == first and np.linalg.eigvalsh(score.own)[0] > 0:
            made.setdefault(score.variant.effect, []).append((amounts, _least(likelihood, found, score)))
    best = []
    for every in made.values():
        amounts, soonest = min(every, key=lambda pair: pair[1].size)
        best.append(replace(soonest, slowest=max(one.size for same, one in every if same == amounts)))
    return sorted(best, key=lambda one: one.size)


def _least(likelihood: Likelihood, found: Fit, score: Score) -> LeastSize:
    """The first amount of a variant, its others unknown too."""
    unknown, column = score.variant.amounts[0], score.signature[:, 0]
    z = float(np.sqrt(NONCENTRALITY * np.linalg.inv(score.own)[0, 0]))
    z = max(z, _tolerated(likelihood, found, unknown))
    per_z = _size_of(likelihood, column / found.weights.root)
    alone = float(np.sqrt(NONCENTRALITY / (column @ column))) * per_z
    amount = float(unknown.value(np.array(z))) - float(unknown.value(np.array(0.0)))
    return LeastSize(unknown.effect, unknown.name, amount, z * per_z, alone)


def _tolerated(likelihood: Likelihood, found: Fit, unknown: EffectUnknown) -> float:
    """z at which a parameter that acts as a believed one is so far out that it is named; 0 of others."""
    believed = COINCIDING.get((unknown.effect, unknown.name))
    sigmas = dict(found.unknowns.believed)
    if believed is None or believed not in sigmas:
        return 0.0
    value = TOLERANCES * sigmas[believed]
    if unknown.name == "offset":
        value *= likelihood.problem.plant.parameters.nominal_gap
    return abs(unknown.z_of(value))


def _size_of(likelihood: Likelihood, raw: Array) -> float:
    """RMS over RMS, the largest over channels, of a change (n_number,) over the white sigma."""
    change: dict[str, float] = {}
    whole: dict[str, float] = {}
    at = 0
    for run, data in enumerate(likelihood.problem.runs):
        for name in likelihood.problem.channels(run):
            n = 2 * likelihood.bands.lines[run]
            change[name] = change.get(name, 0.0) + float(raw[at : at + n] @ raw[at : at + n])
            whole[name] = whole.get(name, 0.0) + float(np.sum((data.measured[name] / data.noise[name].sigma) ** 2))
            at += n
    return max(float(np.sqrt(change[name] / whole[name])) for name in change)
