"""Sizing: how fast designs are judged, how far the closed equations are from the fields, which sampler finds better.

    python benchmarks/sizing.py [REQUIREMENT] [--trials 50] [--workers 2] [--samplers] [--docs]

The results are Markdown; with --docs they take their places in docs/sizing.md.
"""

import argparse
import math
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import optuna
from marked_text import rewrite
from optuna.samplers import BaseSampler, NSGAIISampler, TPESampler

from msl_fem.design.sizing import (
    DesignEvaluator,
    SearchResult,
    SearchSettings,
    choose_design,
    figures,
    load_requirement,
    pareto_front,
    search_designs,
)
from msl_fem.design.sizing.closed_form import Factors
from msl_fem.design.sizing.parameters import design_from
from msl_fem.design.sizing.screening import ScreenedSampler

HERE = Path(__file__).parent
EXAMPLE = HERE.parent / "requirements" / "400_newton.toml"
DOCS = HERE.parent / "docs" / "sizing.md"
SHOWN = 7  # designs of the front in the table
SEEDS = (1, 2)
PLAIN = Factors(fringing=False, leakage=False)


def run(evaluator: DesignEvaluator, asked: SearchSettings) -> tuple[SearchResult, str]:
    """A search with a storage of its own, and what it took."""
    with tempfile.TemporaryDirectory() as folder:
        settings = replace(asked, storage=f"sqlite:///{folder}/trials.sqlite3")
        before, started = os.times(), time.perf_counter()
        found = search_designs(evaluator, settings)
        seconds, after = time.perf_counter() - started, os.times()
    cpu = sum(after[:4]) - sum(before[:4])
    solved = sum(t.solves > 0 for t in found.trials)
    solves = sum(t.solves for t in found.trials)
    text = (
        f"{len(found.trials)} designs, {solved} of them judged by {solves} field solutions, {asked.workers} workers: "
        f"{seconds:.1f} s that passed, {cpu:.1f} CPU s in all processes, starts included; "
        f"{solved / cpu:.1f} field-verified designs per CPU second\n"
    )
    return found, text


def errors_table(evaluator: DesignEvaluator, found: SearchResult) -> str:
    """The closed equations over the front, relative to plane fields at accuracy normal."""
    evaluator, rows = replace(evaluator, end_effects=False), []
    for trial in pareto_front(found.trials, evaluator.requirement.objectives):
        design = design_from(trial.parameters, found.space, evaluator)
        field = evaluator.by_field(design, accuracy="normal").performance
        assert field is not None
        row = [trial.number, field.masses.total, field.loss, field.flux_density]
        # at the field's own flux density, so that what is compared is the equations alone
        design = replace(design, flux_density=field.flux_density)
        for factors in (None, PLAIN):
            point = evaluator.circuit(design, factors=factors).point
            evaluation = evaluator.by_closed_form(design, factors=factors).performance
            assert evaluation is not None
            turns = field.current * field.magnet.coil.turns
            force = field.force / field.magnet.stack_depth
            row += [
                point.ampere_turns / turns - 1, point.force / force - 1,
                evaluation.masses.total / field.masses.total - 1, evaluation.loss / field.loss - 1,
            ]  # fmt: skip
        rows.append(row)
    table = np.array(rows)
    lines = [
        "| trial | mass in kg | loss in W | iron in T | N i | force per depth | mass | loss | "
        "N i, plain | force per depth, plain | mass, plain | loss, plain |",
        "| --- " * 12 + "|",
    ]
    for k in np.unique(np.linspace(0, len(table) - 1, SHOWN).round().astype(int)):
        number, mass, loss, iron, *errors = table[k]
        shown = " | ".join(f"{100 * e:+.1f} %" for e in errors)
        lines.append(f"| {number:.0f} | {mass:.3f} | {loss:.2f} | {iron:.3f} | {shown} |")
    largest = " | ".join(f"{100 * e:.1f} %" for e in np.abs(table[:, 4:]).max(axis=0))
    lines.append(f"| largest of {len(table)} | | | | {largest} |")
    return "\n".join(lines) + "\n"


def guess_table(evaluator: DesignEvaluator, found: SearchResult) -> str:
    """The first guess, the closed equations' best designs and the chosen one, at fine accuracy."""
    choice = choose_design(evaluator, found)
    lines = ["| design | mass in kg | loss in W | force in N | iron in T |", "| --- | --- | --- | --- | --- |"]
    rows = {t.first_design: t for t in found.trials if t.first_design is not None}
    for name, trial in rows.items():
        lines.append(_line(f"{name} (trial {trial.number})", evaluator, found, trial.parameters))
    lines.append(_line(f"chosen (trial {choice.trial.number})", evaluator, found, choice.trial.parameters))
    return "\n".join(lines) + "\n"


def _line(name: str, evaluator: DesignEvaluator, found: SearchResult, parameters: dict[str, float]) -> str:
    evaluation = evaluator.by_field(design_from(parameters, found.space, evaluator), accuracy="fine")
    if evaluation.performance is None:
        return f"| {name} | cannot be built | | | |"
    it = figures(evaluation)
    broken = ", ".join(c.name.replace("_", " ") for c in evaluation.constraints if not c.kept)
    name = f"{name}, breaks {broken}" if broken else name
    return f"| {name} | {it['mass_kg']:.4f} | {it['loss_W']:.3f} | {it['force_N']:.2f} | {it['flux_density_T']:.4f} |"


def samplers_table(evaluator: DesignEvaluator, trials: int) -> str:
    """Samplers with the same first designs: least mass, and the volume of objectives that the front beats."""
    makers: dict[str, Callable[..., BaseSampler]] = {
        "screened": ScreenedSampler,
        "TPE": lambda seed, *_: TPESampler(seed=seed, n_startup_trials=20, constant_liar=False),
        "NSGA-II, 20 a generation": lambda seed, *_: NSGAIISampler(seed=seed, population_size=20),
        "random": lambda seed, *_: optuna.samplers.RandomSampler(seed=seed),
    }
    lines = [f"| sampler | first objective, seeds {SEEDS} | log volume beaten |", "| --- | --- | --- |"]
    reference: list[float] | None = None
    for name, make in makers.items():
        best, volumes = [], []
        for seed in SEEDS:
            found, _ = run(evaluator, SearchSettings("", trials, seed, sampler=make))
            front = pareto_front(found.trials, evaluator.requirement.objectives)
            first = next(t for t in found.trials if t.first_design is not None)
            reference = reference or [2.0 * first.values[0], 1.5 * first.values[1]]
            best.append(front[0].values[0])
            volumes.append(_volume([t.values for t in front], reference))
        values = ", ".join(f"{b:.4f}" for b in best)
        lines.append(f"| {name} | {values} | {', '.join(f'{v:.3f}' for v in volumes)} |")
    return "\n".join(lines) + "\n"


def _volume(front: list[tuple[float, ...]], reference: list[float]) -> float:
    """Area in the plane of the logarithms of two minimised objectives that a front dominates, up to a reference."""
    corner = [math.log(r) for r in reference[:2]]
    area, ceiling = 0.0, corner[1]
    for x, y in sorted((math.log(v[0]), math.log(v[1])) for v in front):
        if x < corner[0] and y < ceiling:
            area += (corner[0] - x) * (ceiling - y)
            ceiling = y
    return area


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("requirement", nargs="?", type=Path, default=EXAMPLE)
    parser.add_argument("--trials", type=int, default=SearchSettings.trials)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--samplers", action="store_true", help="compare samplers: eight searches")
    parser.add_argument("--docs", action="store_true")
    given = parser.parse_args()
    evaluator = DesignEvaluator(load_requirement(given.requirement))
    found, speed = run(evaluator, SearchSettings("", given.trials, workers=given.workers))
    texts = {"speed": speed, "designs": guess_table(evaluator, found), "errors": errors_table(evaluator, found)}
    if given.samplers:
        texts["samplers"] = samplers_table(evaluator, given.trials)
    for name, text in texts.items():
        print(text)
        if given.docs and name != "samplers":
            rewrite(DOCS, {name: text})


if __name__ == "__main__":
    main()
