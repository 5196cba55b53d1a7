"""The least size of each effect that a record of 4 s can show, before anything is measured: docs/diagnosis.md.

    python benchmarks/least_sizes.py

Records are planned ones: the usual excitations of the virtual bench, simulated by the believed model itself.

An effect whose amount is a changes the readings, beyond all that is not known of the rig, by the noncentrality a'G a
(`diagnosis.search`). From 17.8 on a test that is wrong in one of a hundred records without the effect finds it in 95 of
a hundred with it ((2.576 + 1.645)^2; Kay, Statistical Signal Processing II, 1998, ch. 2). Its size is that of the
record's formats: RMS change over RMS of a channel, the largest over the channels. The measured data enter by the noise
alone, so the same holds for a record that is only planned.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from marked_text import rewrite
from study_rigs import ROOT, servo_in

from msl_fem.bench import BenchOptions, sealed_record
from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.decision import COINCIDING, TOLERANCES
from msl_fem.diagnosis.fit import fit
from msl_fem.diagnosis.likelihood import Fit, Likelihood
from msl_fem.diagnosis.runs import prepared_runs
from msl_fem.diagnosis.scores import Score, scores
from msl_fem.diagnosis.unknowns import EffectUnknown
from msl_fem.diagnosis.variants import possible, record_features, variants
from msl_fem.files.quantity import format_quantity
from msl_fem.plant.effects import CATALOGUE, find_parameter
from msl_fem.prediction import ModelHypothesis, run_data
from msl_fem.table.magnetic_table import read_table

DOCUMENT = ROOT / "docs" / "diagnosis.md"
IDENTIFIABLE = 0.03
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
    assert score.signature is not None
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


def of_drive(drive: str) -> dict[str, LeastSize]:
    """Least sizes in a drive, by effect."""
    actuator, table = servo_in(drive), read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    record = sealed_record(actuator, table, (), BenchOptions(seed=1)).record
    belief = ModelHypothesis(record.actuator, table)
    likelihood, unknowns = prepared_runs(belief, [run_data(record, record.runs[0])], record.tolerance)
    base = fit(likelihood, unknowns, np.zeros(unknowns.size))
    plant = likelihood.problem.plant.parameters
    tried = [v for e in possible(plant) for v in variants(e, record_features(likelihood, base), plant)]
    return {one.effect: one for one in least_sizes(likelihood, base, scores(base, tried))}


def table_of(found: dict[str, dict[str, LeastSize]]) -> str:
    head = ["effect", *(f"{drive}: least size | by other shapes | amount | all else known" for drive in found)]
    lines = ["| " + " | ".join(head) + " |", "| --- " * (1 + 4 * len(found)) + "|"]
    for effect in CATALOGUE:
        cells = [f"`{effect}`"]
        for drive in found:
            one = found[drive].get(effect)
            cells += ["-"] * 4 if one is None else _cells(one)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def not_seen(sizes: dict[str, LeastSize]) -> list[str]:
    """Effects that a drive cannot show at 3 %, or not by all shapes."""
    gone = [effect for effect in CATALOGUE if effect not in sizes or sizes[effect].size > IDENTIFIABLE]
    half = [effect for effect, one in sizes.items() if one.size <= IDENTIFIABLE < one.slowest]
    return [*gone, *(f"{effect} by some of its shapes" for effect in half)]


def _cells(one: LeastSize) -> list[str]:
    unit = find_parameter(one.effect, one.name).unit
    amount = format_quantity(one.amount, unit, digits=2) if unit else f"{one.amount:.2g}"
    slowest = f"to {100 * one.slowest:.2g} %" if one.slowest > 1.05 * one.size else ""
    return [f"{100 * one.size:.2g} %", slowest, f"{one.name} {amount}", f"{100 * one.alone:.1g} %"]


def main() -> None:
    found = {drive: of_drive(drive) for drive in ("voltage", "current")}
    text = table_of(found)
    said = "; ".join(f"{drive} drive: {', '.join(not_seen(sizes)) or 'all can'}" for drive, sizes in found.items())
    text += f"\n\nNot to be found at 3 % on such a record: {said}."
    print(text)
    rewrite(DOCUMENT, {"least sizes": text})


if __name__ == "__main__":
    main()
