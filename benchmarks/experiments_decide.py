"""Records whose diagnosis names a cause with others beside it, and how many proposed runs decide them.

    python benchmarks/experiments_decide.py [FIRST [LAST]] [--results FILE]

Each record is one of the virtual bench with an effect so small that its diagnosis cannot tell it from another. What
`experiments` proposes is run on the same rig with the same effect and joins the record, up to three times, until the
first cause has no effect beside it. Whether it is the hidden one then is told too. Each case is a line of
`experiments_decide.jsonl` and a run goes on where the last one stopped; some ten CPU minutes a case.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from study_rigs import ROOT, servo_in

from msl_fem.actuator import Actuator
from msl_fem.bench import INSIDE, BenchOptions, sealed_record
from msl_fem.bench.catalogue import Request
from msl_fem.bench.sealed import prepared_setting
from msl_fem.bench.setting import changes, channels, effect_of_size, runs_of
from msl_fem.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from msl_fem.diagnosis.planning.expected import ExpectedCause, expected_causes
from msl_fem.diagnosis.planning.experiments import RigToPlan, RunOption, experiments
from msl_fem.plant.believed import PLAIN_BELIEF
from msl_fem.plant.effects import CATALOGUE, EffectValues
from msl_fem.plant.excitation import parse_excitation
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.prediction import ModelHypothesis
from msl_fem.record import Record
from msl_fem.table.magnetic_table import MagneticTable, read_table

RESULTS = Path(__file__).parent / "experiments_decide.jsonl"
MOST_RUNS, RATE = 3, 1e4
FIRST_RUNS = (
    "band-limited-noise:bias=0.6 A,amplitude=50 mA,band=500 Hz,duration=1.2 s,seed=2,role=fit",
    "swept-sine:bias=0.6 A,amplitude=12 mA,start=5 Hz,stop=300 Hz,duration=1 s,role=held-out",
)
HIDDEN = ("time_delay", "amplifier_bandwidth", "position_sensor_lag", "eddy_currents", "gap_offset")
SIZES = (0.03, 0.02, 0.015, 0.01)
Case = tuple[str, float, int]
CASES: list[Case] = [(effect, size, 101 + 7 * n) for n, size in enumerate(SIZES) for effect in HIDDEN]


class HiddenCause:
    """A rig of a seed with an effect at one strength, whatever runs it makes."""

    def __init__(self, actuator: Actuator, table: MagneticTable, case: Case) -> None:
        name, size, seed = case
        self.actuator, self.table = actuator, table
        self.effect, self.options = INSIDE[name], BenchOptions(seed=seed, rate=RATE, exact=True)
        first = prepared_setting(actuator, table, _excitations(FIRST_RUNS), self.options)
        self.strength = effect_of_size(first, self.effect, size, exact=True).strength

    def record(self, specs: Sequence[str]) -> Record:
        """The record of some runs."""
        excitations = _excitations(specs)
        setting = prepared_setting(self.actuator, self.table, excitations, self.options)
        rig, _ = self.effect.hide(setting, setting.rig, self.strength)
        responses = runs_of(rig, setting.commands, setting.leads, rate=RATE)
        of_all = max(changes(channels(rig, responses), channels(setting.rig, setting.responses)).values())
        options = replace(self.options, excitations=excitations)
        return sealed_record(self.actuator, self.table, [Request(self.effect, of_all)], options).record


def _excitations(specs: Sequence[str]) -> tuple[Excitation, ...]:
    return tuple(parse_excitation(spec, unit="A") for spec in specs)


def rivals(found: Diagnosis) -> list[str]:
    """Effects that the diagnosis cannot tell from its first cause."""
    return [name for name in found.causes[0].rivals if name in CATALOGUE] if found.causes else []


def proposal(found: Diagnosis, rig: HiddenCause) -> RunOption:
    """The run that `experiments` proposes after a diagnosis."""
    assert found.extended is not None
    assert found.extended.effects is not None
    stated = {name: dict(of) for name, of in found.extended.effects.stated.items()}
    first = found.causes[0].effect
    fitted = ExpectedCause(first, stated.pop(first), "the diagnosis")
    belief = ModelHypothesis(found.extended.actuator, found.extended.table, EffectValues(stated) if stated else None)
    tolerance = rig.record(FIRST_RUNS[:1]).tolerance
    every = expected_causes(rig.actuator, PLAIN_BELIEF, tolerance=tolerance, rate=RATE)
    beside = [one for one in every if one.effect in rivals(found)]
    plan = experiments(RigToPlan(belief, RATE), [fitted, *beside])
    return next(run for run in plan.runs if not run.locked)


def decided(case: Case) -> dict[str, Any]:
    """A case: what was named first and beside what, before and after each further run, and how it ended."""
    table = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    rig = HiddenCause(servo_in("current"), table, case)
    specs, stages = list(FIRST_RUNS), []
    for n in range(MOST_RUNS + 1):
        found = diagnose(rig.record(specs), DiagnosisSettings(table=table))
        first, beside = found.names[0] if found.names else "", rivals(found)
        stages.append({"verdict": found.verdict, "first": first, "beside": beside})
        if not beside or n == MOST_RUNS:
            break
        run = proposal(found, rig)
        stages[-1]["proposed"] = run.words
        print(f"{case}: {first} beside {beside}; {run.words}", file=sys.stderr, flush=True)
        specs.append(parse_excitation(run.excitation, unit="A").model_copy(update={"role": "fit"}).spec)
    return {"decided": not beside, "right": first == case[0], "further_runs": n, "stages": stages}


def told(row: dict[str, Any]) -> str:
    """A line on a case."""
    began, last = row["stages"][0], row["stages"][-1]
    beside = ", ".join(began["beside"]) or "none"
    words = f"{row['effect']} {row['size']:.1%}: {began['first'] or began['verdict']}, beside it {beside}"
    if not began["beside"]:
        return f"{words}: was not undecided"
    name = f"{last['first'] or last['verdict']}, {'right' if row['right'] else 'WRONG'}"
    ended = name if row["decided"] else "undecided"
    return f"{words}; after {row['further_runs']} further runs {ended} ({row['cpu_seconds']:.0f} CPU s)"


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
    known = {row["case"]: row for row in done(options.results)}
    for n in range(options.first, options.last):
        if n not in known:
            began = time.process_time()
            effect, size, seed = CASES[n]
            row = {"case": n, "effect": effect, "size": size, "seed": seed, **decided(CASES[n])}
            known[n] = row | {"cpu_seconds": round(time.process_time() - began)}
            with options.results.open("a", encoding="utf-8") as out:
                out.write(json.dumps(known[n]) + "\n")
        print(told(known[n]), flush=True)


if __name__ == "__main__":
    main()
