"""Records whose diagnosis names a cause with others beside it, and how many proposed runs decide them.

    python benchmarks/experiments_decide.py [FIRST [LAST]]

Each record is one of the virtual bench with an effect so small that its diagnosis cannot tell it from another. What
`experiments` proposes is run on the same rig with the same effect and joins the record, up to three times, until the
first cause has no effect beside it. Whether it is the hidden one then is told too. A line for each case.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import replace

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

MOST_RUNS, RATE = 3, 1e4
FIRST_RUNS = (
    "band-limited-noise:bias=0.6 A,amplitude=50 mA,band=500 Hz,duration=1.2 s,seed=2,role=fit",
    "swept-sine:bias=0.6 A,amplitude=12 mA,start=5 Hz,stop=300 Hz,duration=1 s,role=held-out",
)
HIDDEN = ("time_delay", "amplifier_bandwidth", "position_sensor_lag", "eddy_currents", "gap_offset")
SIZES = (0.03, 0.02, 0.015, 0.01)
CASES = [(effect, size, 101 + 7 * n) for n, size in enumerate(SIZES) for effect in HIDDEN]


class HiddenCause:
    """A rig of a seed with an effect at one strength, whatever runs it makes."""

    def __init__(self, actuator: Actuator, table: MagneticTable, case: tuple[str, float, int]) -> None:
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


def decided(case: tuple[str, float, int]) -> str:
    """A line on a case: what was named at first, and after each further run."""
    table = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    rig = HiddenCause(servo_in("current"), table, case)
    specs, told = list(FIRST_RUNS), []
    for n in range(MOST_RUNS + 1):
        found = diagnose(rig.record(specs), DiagnosisSettings(table=table))
        told.append(f"{found.names[0] if found.names else found.verdict}{rivals(found) or ''}")
        if not rivals(found):
            right = bool(found.names) and found.names[0] == case[0]
            return f"{'; '.join(told)} -> {n} further runs, {'right' if right else 'WRONG'}"
        if n < MOST_RUNS:
            run = proposal(found, rig)
            specs.append(parse_excitation(run.excitation, unit="A").model_copy(update={"role": "fit"}).spec)
            told.append(run.words)
    return f"{'; '.join(told)} -> undecided"


def main() -> None:
    bounds = [int(text) for text in sys.argv[1:]]
    first, last = [*bounds, 0, len(CASES)][:2] if len(bounds) != 1 else (bounds[0], bounds[0] + 1)
    for case in CASES[first:last]:
        began = time.process_time()
        print(*case, decided(case), f"({time.process_time() - began:.0f} CPU s)", flush=True)


if __name__ == "__main__":
    main()
