"""Records whose diagnosis names a cause with others beside it, and how many proposed runs decide them.

    python benchmarks/experiments_decide.py [FIRST [LAST]] [--results FILE]

Each record is one of the virtual bench, 3.2 s of noise at 1 kHz and a sweep held out, with an effect so small that it
is barely seen. Where its diagnosis cannot tell it from other effects, the run that `experiments` proposes is made on
the same rig and joins the record, up to three times, until no effect stands beside the first cause. Whether that is
the hidden one then is told too, and so is whether the plan said before that none of its runs would tell them. Each case
is a line of `experiments_decide.jsonl` and a run goes on where the last one stopped.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from study_rigs import excitations_of, study_rig

from msl_fem.bench import INSIDE, BenchOptions
from msl_fem.bench.sealed import prepared_setting, recorded
from msl_fem.bench.setting import effect_of_size, runs_of
from msl_fem.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from msl_fem.diagnosis.planning.after import OpenQuestion, effects_of, open_question
from msl_fem.diagnosis.planning.experiments import ExperimentPlan, RunOption
from msl_fem.plant.excitation import parse_excitation
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.prediction.hypothesis import HEAVY
from msl_fem.record import Record, Run

RESULTS = Path(__file__).parent / "experiments_decide.jsonl"
MOST_RUNS, RATE, SECONDS = 3, 1e3, 3.2


@dataclass(frozen=True)
class Case:
    """A rig, its drive, the hidden effect, its size as the bench has it, and the seed."""

    rig: str
    drive: str
    effect: str
    size: float
    seed: int


CASES: list[Case] = []


class HiddenCause:
    """A rig of a seed with an effect in it, whatever runs it makes."""

    def __init__(self, case: Case) -> None:
        rig = study_rig(case.rig)
        self.actuator, self.table = rig.in_drive(case.drive), rig.table
        self.first = excitations_of(rig, case.drive, seconds=SECONDS)
        self.options = BenchOptions(seed=case.seed, rate=RATE, exact=True)
        setting = prepared_setting(self.actuator, self.table, self.first, self.options)
        effect = INSIDE[case.effect]
        strength = effect_of_size(setting, effect, case.size, exact=True).strength
        self.rig, _ = effect.hide(setting, setting.rig, strength)

    def record(self, further: Sequence[RunOption]) -> Record:
        """The record of the first runs and further ones."""
        unit = self.first[0].unit
        more = [parse_excitation(run.excitation, unit=unit).model_copy(update={"role": "fit"}) for run in further]
        excitations = (*self.first, *more)
        free, held = self._runs(excitations, locked=False), self._runs(excitations, locked=True)
        locked = [False] * len(self.first) + [run.locked for run in further]
        runs = [held.runs[n] if it else free.runs[n] for n, it in enumerate(locked)]
        return replace(free, runs=tuple(runs))

    def _runs(self, excitations: tuple[Excitation, ...], *, locked: bool) -> Record:
        options = replace(self.options, excitations=excitations)
        setting = prepared_setting(self.actuator, self.table, excitations, options)
        rig = self.rig
        if locked:
            rig = rig.with_parts(motion=rig.plant.motion._replace(mass=HEAVY * rig.plant.motion.mass))
        responses = runs_of(rig, setting.commands, setting.leads, rate=RATE)
        record = recorded(setting, rig, excitations, options, responses)
        runs: list[Run] = [replace(run, mover="locked" if locked else "free") for run in record.runs]
        return replace(record, runs=tuple(runs))


def question_of(found: Diagnosis, record: Record) -> OpenQuestion | None:
    """What a diagnosis leaves open; None where its causes have no effects beside them."""
    if found.extended is None:
        return None
    named = [(cause.effect, cause.rivals) for cause in found.causes]
    channels = [entry.nominal.channel for entry in found.accuracy]
    return open_question(found.extended, named, channels, tolerance=record.tolerance, rate=RATE)


def stage_of(found: Diagnosis) -> dict[str, Any]:
    """What a diagnosis says."""
    causes = [[cause.effect, round(cause.statistic, 1), effects_of(cause.rivals)] for cause in found.causes]
    return {"verdict": found.verdict, "causes": causes}


def plan_of(plan: ExperimentPlan) -> dict[str, Any]:
    """What a plan says, in short."""
    runs = {}
    for run in plan.runs:
        left = {" and ".join(pair): float(f"{distance:.3g}") for pair, distance in run.undecided.items()}
        runs[run.words] = {"decided": run.decided, "seen": run.seen, "undecided": left}
    return {"groups": plan.groups, "unseen": plan.unseen, "add": plan.instrument_to_add, "runs": runs}


def decided(case: Case) -> dict[str, Any]:
    """What was named first and beside what, before and after each further run, and how it ended."""
    rig = HiddenCause(case)
    further: list[RunOption] = []
    stages: list[dict[str, Any]] = []
    for n in range(MOST_RUNS + 1):
        record = rig.record(further)
        found = diagnose(record, DiagnosisSettings(table=rig.table))
        stages.append(stage_of(found))
        question = question_of(found, record)
        print(f"{case}: {stages[-1]}", file=sys.stderr, flush=True)
        if question is None or n == MOST_RUNS:
            break
        plan = question.plan()
        further.append(plan.runs[0])
        stages[-1] |= {"plan": plan_of(plan), "proposed": [plan.runs[0].words, plan.runs[0].excitation]}
        print(f"   {stages[-1]['plan']}\n   {stages[-1]['proposed']}", file=sys.stderr, flush=True)
    return {"open_at_first": len(stages) > 1, "ended": ended(case, stages[-1]), "further_runs": n, "stages": stages}


def ended(case: Case, stage: dict[str, Any]) -> str:
    """How a case ended: "right", "wrong", "undecided" or "no name"."""
    causes = stage["causes"]
    if not causes:
        return "no name"
    if any(beside for _, _, beside in causes):
        return "undecided"
    return "right" if causes[0][0] == case.effect else "wrong"


def told(row: dict[str, Any]) -> str:
    """A line on a case."""
    case, began, last = Case(**row["case"]), row["stages"][0], row["stages"][-1]
    words = f"{case.rig} {case.drive} {case.effect} {100 * case.size:.3g} %, seed {case.seed}: "
    words += "; ".join(f"{name}, beside it {', '.join(beside) or 'none'}" for name, _, beside in began["causes"])
    if not row["open_at_first"]:
        return f"{words or began['verdict']}: was not undecided ({row['cpu_seconds']} CPU s)"
    names = ", ".join(name for name, _, _ in last["causes"])
    return f"{words}; after {row['further_runs']} runs {row['ended']}: {names} ({row['cpu_seconds']} CPU s)"


def done(path: Path) -> list[dict[str, Any]]:
    """The lines that are there."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return [json.loads(line) for line in lines]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("last", type=int, nargs="?", default=len(CASES))
    parser.add_argument("--results", type=Path, default=RESULTS)
    options = parser.parse_args()
    run_cases(CASES[options.first : options.last], options.results)


def run_cases(cases: Sequence[Case], results: Path) -> None:
    """The cases that are not yet among the results, each told."""
    known = {Case(**row["case"]): row for row in done(results)}
    for case in cases:
        if case not in known:
            began = time.process_time()
            row = {"case": vars(case), **decided(case)}
            known[case] = row | {"cpu_seconds": round(time.process_time() - began)}
            with results.open("a", encoding="utf-8") as out:
                out.write(json.dumps(known[case]) + "\n")
        print(told(known[case]), flush=True)


if __name__ == "__main__":
    main()
