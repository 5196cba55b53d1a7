"""The command `size`: from what a magnet has to do to an actuator file."""

from pathlib import Path
from typing import Annotated, Any

import typer

from msl_fem.actuator import load_actuator
from msl_fem.cli.options import Json, SectionEnds
from msl_fem.cli.output import print_columns, print_result, progress_bar, say
from msl_fem.cli.polarity import polarity_off_the_middle, polarity_sentence
from msl_fem.cli.sweeping import checked_end_effects, default_workers
from msl_fem.design.sizing import (
    RULE,
    DesignChoice,
    DesignEvaluator,
    EvaluatedTrial,
    Requirement,
    SearchResult,
    SearchSettings,
    choose_design,
    figures,
    load_requirement,
    search_designs,
    sized_actuator,
    write_sized_actuator,
)
from msl_fem.errors import InputError
from msl_fem.files.whole_file import check_target, make_folder
from msl_fem.losses import CLASS_130_RISE
from msl_fem.report.field_picture import save_picture
from msl_fem.report.pictures import FrontPoints, draw_front

FIELD_NAMES = {"mass": "mass_kg", "loss": "loss_W", "force": "force_N", "inductance": "inductance_H"}


def command(
    requirement: Annotated[Path, typer.Argument(metavar="REQUIREMENT", help="Requirement file (TOML).")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Actuator file to write; without, NAME.toml here.")
    ] = None,
    trials: Annotated[int, typer.Option(min=1, max=100_000, help="Designs to judge, earlier runs' counted.")] = 50,
    storage: Annotated[
        str | None, typer.Option(metavar="URL", help="Optuna storage URL; without, a sqlite file beside the output.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the search's random numbers.")] = 1,
    workers: Annotated[int, typer.Option(min=0, max=256, help="Processes; 0: one a core.")] = 0,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Judge designs on a dask.distributed cluster.")
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="PNG of the Pareto front; without, beside the output.")] = None,
    end_effects: SectionEnds = None,
    json: Json = False,
) -> None:
    """Size a magnet: closed equations, then a search whose designs fields judge; the best becomes an actuator file.

    The search goes on where an earlier run with the same storage ended; several commands may share a storage.
    """
    if scheduler is not None and workers:
        raise InputError("give --workers or --scheduler, not both")
    wanted, corrected = load_requirement(requirement), checked_end_effects(end_effects)
    target = output or Path(f"{wanted.name}.toml")
    drawn = picture or target.with_name(f"{target.stem}_pareto.png")
    _check_files(requirement, target, drawn)
    if storage is None:
        make_folder(target.parent)
        storage = f"sqlite:///{target.with_name(f'.{target.name}.trials.sqlite3')}"
    settings = SearchSettings(storage, trials, seed, workers or default_workers(), scheduler)
    evaluator = DesignEvaluator(wanted, corrected)
    with progress_bar("designs judged by fields") as progress:
        found = search_designs(evaluator, settings, progress=progress)
    with progress_bar("verified at fine accuracy") as progress:
        choice = choose_design(evaluator, found, progress=progress)
    assert choice.evaluation.performance is not None
    sized = sized_actuator(choice.evaluation.performance, wanted, target=target, end_effects=corrected)
    write_sized_actuator(sized, target)
    save_picture(draw_front(_points(choice, found, wanted), wanted.objectives, title=wanted.name), drawn)
    _say_warm(choice, wanted)
    costs = polarity_off_the_middle(load_actuator(target), choice.evaluation.performance.current)
    if costs:
        say(f"note: {polarity_sentence(costs['polarity'])}")
    if found.failed:
        say(f"note: {found.failed} designs had no field solution and were left out")
    result = sizing_to_json(choice, found, wanted) | {
        "geometry": str(target), "picture": str(drawn), "storage": storage, "rule": RULE,
        **costs,
    }  # fmt: skip
    if json:
        print_result(result, as_json=True, title="")
        return
    _print_front(choice, wanted)
    print_result({k: v for k, v in result.items() if k != "pareto"}, as_json=False, title=f"{wanted.name}: {target}")


def _say_warm(choice: DesignChoice, requirement: Requirement) -> None:
    """A winding that gets hot because nothing forbids it is worth a line."""
    heat, found = requirement.heat, choice.evaluation.performance
    if heat.temperature_rise is None and found is not None and not found.temperature_rise <= CLASS_130_RISE:
        say(
            f"note: the winding's temperature rise is {found.temperature_rise:.0f} K at full force for {heat.duty:g} "
            "of the time; state heat.duty, or limit heat.temperature_rise"
        )


def _check_files(requirement: Path, target: Path, drawn: Path) -> None:
    """InputError, before the work begins, where a file cannot be written or would replace the requirement."""
    for path in (target, drawn):
        check_target(path)
        if path.resolve() == requirement.resolve():
            raise InputError(f"{path} is the requirement itself; give another output with -o")


def sizing_to_json(choice: DesignChoice, found: SearchResult, requirement: Requirement) -> dict[str, Any]:
    """The JSON fields of `size` that do not name files."""
    best = figures(choice.evaluation)
    fields: dict[str, Any] = {name: best[name] for name in ("force_N", "mass_kg", "loss_W")}
    fields |= {name: value for name, value in best.items() if name not in fields}
    fields |= {
        "gap_m": requirement.force.gap,
        "objectives": list(requirement.objectives),
        "constraints": [c.to_json() for c in choice.evaluation.constraints],
        "trial": choice.trial.number,
        "trials": len(found.trials) + found.failed,
        "trials_reused": found.reused,
        "trials_failed": found.failed,
        "trials_not_solved": sum(t.solves == 0 for t in found.trials),
        "field_solutions": sum(t.solves for t in found.trials),
        "pareto": [{"trial": t.number, **t.figures} for t in choice.front],
    }
    if choice.guess is not None:
        guess = figures(choice.guess)
        fields["first_guess"] = {name: guess[name] for name in ("force_N", "mass_kg", "loss_W", "flux_density_T")}
    return fields


def _values(trial: EvaluatedTrial, requirement: Requirement) -> dict[str, float]:
    return {name: trial.figures[FIELD_NAMES[name]] for name in requirement.objectives}


def _points(choice: DesignChoice, found: SearchResult, requirement: Requirement) -> FrontPoints:
    numbers = {t.number for t in choice.front}
    solved = [t for t in found.trials if t.figures and t.solves]
    chosen = figures(choice.evaluation)
    guess = figures(choice.guess) if choice.guess is not None else None
    return FrontPoints(
        front=[_values(t, requirement) for t in choice.front],
        others=[_values(t, requirement) for t in solved if t.feasible and t.number not in numbers],
        infeasible=[_values(t, requirement) for t in solved if not t.feasible],
        chosen={name: chosen[FIELD_NAMES[name]] for name in requirement.objectives},
        guess=None if guess is None else {name: guess[FIELD_NAMES[name]] for name in requirement.objectives},
    )


def _print_front(choice: DesignChoice, requirement: Requirement) -> None:
    front = [t.figures for t in choice.front]
    columns = {"trial": [str(t.number) for t in choice.front]}
    for title, name, scale in (
        ("mass in kg", "mass_kg", 1.0), ("loss in W", "loss_W", 1.0), ("force in N", "force_N", 1.0),
        ("inductance in mH", "inductance_H", 1e3), ("iron in T", "flux_density_T", 1.0), ("turns", "turns", 1),
        ("current in A", "current_A", 1.0), ("stack in mm", "stack_depth_m", 1e3),
    ):  # fmt: skip
        columns[title] = ["-" if one[name] is None else f"{one[name] * scale:.4g}" for one in front]
    objectives = ", ".join(requirement.objectives)
    print_columns(columns, title=f"{requirement.name}: Pareto front over {objectives}, one magnet")
