"""Records whose diagnosis names a cause with others beside it, and how many proposed runs decide them.

    python benchmarks/experiments_decide.py [FIRST [LAST]] [--seen] [--results FILE]

Each record is one of the virtual bench, 3.2 s of a tone at 1 kHz and another one held out, with an effect so small that
it is barely named. Where its diagnosis cannot tell it from other effects, the run that `experiments` proposes is made
on the same rig and joins the record, up to three times, until no effect stands beside a cause. Whether the first one is
the hidden one then is told too, and so is whether the plan said before that none of its runs would tell them: then one
run is made to see. Each case is a line of `experiments_decide.jsonl` and a run goes on where the last one stopped; a
case takes some CPU seconds where it is not undecided, and a minute or two where it is.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from study_rigs import study_rig

from msl_fem.bench import INSIDE, BenchOptions
from msl_fem.bench.rig import Rig
from msl_fem.bench.sealed import prepared_setting, recorded
from msl_fem.bench.setting import BenchEffect, BenchSetting, runs_of
from msl_fem.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from msl_fem.diagnosis.planning.absorbed import BelievedRefit
from msl_fem.diagnosis.planning.after import OpenQuestion, effects_of, open_question
from msl_fem.diagnosis.planning.experiments import ExperimentPlan, RunOption
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.excitation import parse_excitation
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.prediction import ModelHypothesis
from msl_fem.prediction.hypothesis import HEAVY
from msl_fem.record import Record, Run

RESULTS = Path(__file__).parent / "experiments_decide.jsonl"
MOST_RUNS, RATE, SECONDS = 3, 1e3, 3.2
FIRST = {
    ("servo", "current"): ("bias=0.5 A", "amplitude=60 mA", "25 Hz", "20 Hz"),
    ("servo", "voltage"): ("bias=1 V", "amplitude=0.6 V", "25 Hz", "20 Hz"),
    ("small", "voltage"): ("bias=0.2 V", "amplitude=50 mV", "30 Hz", "25 Hz"),
    ("large", "current"): ("bias=12 A", "amplitude=2 A", "6 Hz", "5 Hz"),
    ("large", "voltage"): ("bias=9 V", "amplitude=10 V", "6 Hz", "5 Hz"),
}
"""Bias, amplitude and tones of the first runs of each rig and drive, below the mover's own frequency."""
LATE = {"time_delay", "position_sensor_lag", "amplifier_bandwidth"}
CLEAR = {"current_sensor_error", "periodic_disturbance", "position_sensor_crosstalk", "structural_mode"}
"""Effects beside which none stood in any record."""
HAS_TAUGHT = ("large", "current", "mutual_inductance")  # that rivals which no run shows are to be judged too
OF_A_RUN = {"sensor_drift", "drive_limit", "coil_heating", "thermal_history"}
"""Effects that are another one in each run, or need other runs than these to be seen at all."""
FIRST_NATS, SOUGHT = 100.0, (9.0, 25.0)
"""Nats of the first trial by the linear model, and those between which a cause of the first record is to be named."""
TRIALS = 4
WITHIN = 0.1  # of the nats asked for
MOST_TRIALS = 8
TO_SEE = 1
"""Further runs where the plan says that none tells some of the causes in question apart, to see whether that is so."""


@dataclass(frozen=True)
class Case:
    """A rig, its drive, the hidden effect and the seed."""

    rig: str
    drive: str
    effect: str
    seed: int


def cases(*, seen: bool) -> list[Case]:
    """In an order drawn once, each twice: those by which the planner was made better, or those by which it is judged.
    No rig has an effect in both. Lags and delays, which the plan says stay together, are among the first."""
    every = [(rig, drive, effect) for rig, drive in FIRST for effect in INSIDE if effect not in OF_A_RUN]
    drawn = np.random.default_rng(17).permutation(len(every))
    half, first = (drawn[::2], 1000) if seen else (drawn[1::2], 5000)
    left_out = set() if seen else LATE | CLEAR
    chosen = [(k, every[n]) for k, n in enumerate(half) if every[n][2] not in left_out and every[n] != HAS_TAUGHT]
    return [Case(*one, first + 10 * k + again) for again in range(2) for k, one in chosen]


def first_runs(case: Case) -> tuple[Excitation, Excitation]:
    """A tone, and another one held out."""
    bias, amplitude, fit, held_out = FIRST[case.rig, case.drive]
    about, unit = f"{bias},{amplitude},duration={SECONDS} s", "A" if case.drive == "current" else "V"
    tone = parse_excitation(f"sine:{about},frequency={fit},role=fit", unit=unit)
    return tone, parse_excitation(f"sine:{about},frequency={held_out},role=held-out", unit=unit)


class HiddenCause:
    """A rig of a seed with an effect in it, whatever runs it makes.

    Parameters
    ----------
    nats : that the first record, without its noise, tells of the effect once all that is known within tolerances is
        fitted anew, by the linear model

    Raises
    ------
    InputError : no strength is told so much of
    """

    def __init__(self, case: Case, nats: float) -> None:
        rig = study_rig(case.rig)
        self.actuator, self.table = rig.in_drive(case.drive), rig.table
        self.first = first_runs(case)
        self.options = BenchOptions(seed=case.seed, rate=RATE)
        setting = prepared_setting(self.actuator, self.table, self.first, self.options)
        self.strength, self.rig = self._hidden(setting, INSIDE[case.effect], nats)

    def _hidden(self, setting: BenchSetting, effect: BenchEffect, nats: float) -> tuple[float, Rig]:
        options = replace(self.options, noise="none", excitations=self.first)
        plain = recorded(setting, setting.rig, self.first, options, setting.responses)
        refit = BelievedRefit(plain, ModelHypothesis(self.actuator, self.table), every=True)
        strength, largest = effect.start(setting), effect.largest(setting)
        for _ in range(MOST_TRIALS):
            try:
                rig, _ = effect.hide(setting, setting.rig, strength)
                responses = runs_of(rig, setting.commands, setting.leads, rate=RATE)
            except ComputationError:
                strength /= 4
                continue
            change = refit.change(recorded(setting, rig, self.first, options, responses))
            told = (1 - refit.left(change).absorbed) ** 2 * float(change @ change) / 2
            if abs(told / nats - 1) <= WITHIN:
                return strength, rig
            strength = min(strength * float(np.clip(np.sqrt(nats / max(told, 1e-9)), 0.02, 10.0)), largest)
        raise InputError(f"{effect.name}: no strength is told of by {nats:g} nats")

    def bears(self, run: RunOption) -> bool:
        """Whether the rig makes a run, for the bench refuses what leaves its range or its stable currents."""
        try:
            self.record([run])
        except (InputError, ComputationError):
            return False
        return True

    def record(self, further: Sequence[RunOption]) -> Record:
        """The record of the first runs and further ones."""
        unit = self.first[0].unit
        more = [parse_excitation(run.excitation, unit=unit).model_copy(update={"role": "fit"}) for run in further]
        excitations = (*self.first, *more)
        locked = [False] * len(self.first) + [run.locked for run in further]
        free = self._runs(excitations, locked=False)
        held = self._runs(excitations, locked=True) if any(locked) else free
        runs = [(held if it else free).runs[n] for n, it in enumerate(locked)]
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
    usual = None if found.usual_run is None else found.usual_run.excitation
    return open_question(found.extended, named, channels, tolerance=record.tolerance, rate=RATE, usual=usual)


def stage_of(found: Diagnosis) -> dict[str, Any]:
    """What a diagnosis says."""
    causes = [[cause.effect, round(cause.statistic, 1), effects_of(cause.rivals)] for cause in found.causes]
    return {"verdict": found.verdict, "causes": causes}


def plan_of(plan: ExperimentPlan) -> dict[str, Any]:
    """What a plan says, in short."""
    runs = {
        run.words: {" and ".join(p): [float(f"{d:.3g}"), float(f"{run.one_way[p]:.3g}")] for p, d in run.pairs.items()}
        for run in plan.runs
    }
    together = [" and ".join(pair) for pair in plan.together]
    said = {"groups": plan.groups, "unseen": plan.unseen, "together": together, "add": plan.instrument_to_add}
    return said | {"runs": runs}


def barely_seen(case: Case) -> tuple[HiddenCause, Record, Diagnosis]:
    """The rig with the effect at a strength at which it is named by few nats, sought by diagnoses, and the last one."""
    nats = FIRST_NATS
    for trial in range(TRIALS):
        rig = HiddenCause(case, nats)
        record = rig.record([])
        found = diagnose(record, DiagnosisSettings(table=rig.table))
        named = found.causes[0].statistic if found.causes else 0.0
        if SOUGHT[0] <= named <= SOUGHT[1]:
            break
        nats *= 14.0 / named if named else 4.0 if trial == 0 else 2.0
    return rig, record, found


def decided(case: Case) -> dict[str, Any]:
    """What was named first and beside what, before and after each further run, and how it ended."""
    try:
        rig, record, found = barely_seen(case)
    except InputError as err:
        return {"ended": str(err), "open_at_first": False, "said_to_stay": False, "further_runs": 0, "stages": []}
    further: list[RunOption] = []
    stages: list[dict[str, Any]] = []
    most = MOST_RUNS
    while True:
        if further:
            record = rig.record(further)
            found = diagnose(record, DiagnosisSettings(table=rig.table))
        stages.append(stage_of(found))
        question = question_of(found, record)
        print(f"{case}: {stages[-1]}", file=sys.stderr, flush=True)
        if question is None or len(further) == most:
            break
        plan = question.plan()
        if not further and plan.together:
            most = TO_SEE
        run = next(run for run in plan.runs if rig.bears(run))
        further.append(run)
        refused = [one.words for one in plan.runs[: plan.runs.index(run)]]
        stages[-1] |= {"plan": plan_of(plan), "proposed": [run.words, run.excitation], "refused": refused}
        print(f"   {stages[-1]['plan']}\n   {stages[-1]['proposed']}", file=sys.stderr, flush=True)
    return {
        "strength": rig.strength,
        "open_at_first": len(stages) > 1,
        "said_to_stay": most == TO_SEE,
        "ended": ended(case, stages[-1]),
        "further_runs": len(further),
        "stages": stages,
    }


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
    case, stages = Case(**row["case"]), row["stages"]
    words = f"{case.rig} {case.drive} {case.effect}, seed {case.seed}: "
    if not stages:
        return words + row["ended"]
    words += "; ".join(f"{name}, beside it {', '.join(beside) or 'none'}" for name, _, beside in stages[0]["causes"])
    if not row["open_at_first"]:
        return f"{words or stages[0]['verdict']}; was not undecided ({row['cpu_seconds']} CPU s)"
    names = ", ".join(name for name, _, _ in stages[-1]["causes"])
    if row["said_to_stay"]:
        words += "; said to stay together"
    return f"{words}; after {row['further_runs']} runs {row['ended']}: {names} ({row['cpu_seconds']} CPU s)"


def done(path: Path) -> list[dict[str, Any]]:
    """The lines that are there."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return [json.loads(line) for line in lines]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("last", type=int, nargs="?", default=None)
    parser.add_argument("--seen", action="store_true", help="the cases by which the planner was made better")
    parser.add_argument("--results", type=Path, default=RESULTS)
    options = parser.parse_args()
    run_cases(cases(seen=options.seen)[options.first : options.last], options.results)


def run_cases(asked: Sequence[Case], results: Path) -> None:
    """The cases that are not yet among the results, each told."""
    known = {Case(**row["case"]): row for row in done(results)}
    for case in asked:
        if case not in known:
            began = time.process_time()
            row = {"case": vars(case), **decided(case)}
            known[case] = row | {"cpu_seconds": round(time.process_time() - began)}
            with results.open("a", encoding="utf-8") as out:
                out.write(json.dumps(known[case]) + "\n")
        print(told(known[case]), flush=True)


if __name__ == "__main__":
    main()
