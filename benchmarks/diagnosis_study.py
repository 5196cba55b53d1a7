"""The diagnosis put to the test: records of the virtual bench with something hidden, or nothing, diagnosed one by one.

    python benchmarks/diagnosis_study.py                 # goes on where it stopped; --limit N cases, --processes N
    python benchmarks/diagnosis_study.py --compare ROWS --keys FILE

The second makes cases anew and says which verdicts differ from those of ROWS.

Each case is one line of `diagnosis_study.jsonl`; the answer of the bench is compared with the diagnosis here, after it
has been made. Cases come in an order in which any beginning of the list is a fair share of each kind. The figures are
written to docs by `diagnosis_study_tables.py`.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.bench import BenchOptions, parse_requests, sealed_record, usual_excitations
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.jobs import Executor, run_jobs
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.result import Diagnosis
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.effects import CATALOGUE
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.table.magnetic_table import read_table

HERE = Path(__file__).parent
ROOT = HERE.parent
TABLE = ROOT / "lookup_tables/fast_tool_servo.nc"
RESULTS = HERE / "diagnosis_study.jsonl"
DRIVES = ("voltage", "current")
VERSION = 3
"""Of search and rule: lines of another one are left out and made anew."""
CLEAN, SINGLES, SMALL, PAIRS, OUTSIDE = 300, 10, 5, 40, 40
FIRST = {"clean": 150, "single": 5, "small": 3, "pair": 20, "outside": 20}
"""Of each drive so many (of each effect) come among the others: with both drives what is the least; the rest comes
behind."""
DYNAMIC = (
    "magnetic_hysteresis", "eddy_currents", "cross_coupling", "coil_heating", "amplifier_bandwidth",
    "stiffness_nonlinearity", "coulomb_friction", "squeeze_film", "structural_mode", "flexure_relaxation",
    "position_sensor_nonlinearity", "position_sensor_lag", "time_delay", "periodic_disturbance",
)  # fmt: skip
"""Effects that are also tried at 0.3 %: those that coincide with no believed parameter and show in the motion."""


NATS, PART = 0.05, 0.002
"""By which a gain may differ from its row, absolute and relative, before `--compare` says so."""


@dataclass(frozen=True)
class Case:
    """A record of the study: its drive, what is hidden, how it is disturbed."""

    drive: str
    kind: str
    hidden: tuple[str, ...]
    seed: int
    noise: str = "coloured"
    cost = 1  # all about the same: cases are taken in their order

    @property
    def key(self) -> str:
        return f"{self.drive}/{self.kind}/{'+'.join(self.hidden) or 'nothing'}/{self.seed}/{self.noise}"


def cases() -> list[Case]:
    """All cases, in an order of which each beginning is a fair share."""
    found: list[tuple[float, Case]] = []
    names = list(CATALOGUE)
    chance = np.random.default_rng(20261120)
    pairs = [tuple(sorted(chance.choice(names, 2, replace=False))) for _ in range(PAIRS)]
    for drive in DRIVES:
        found += [((n + 0.5) / FIRST["clean"], Case(drive, "clean", (), 10_000 + n, _noise(n))) for n in range(CLEAN)]
        for kind, seed, size, effects, count in (
            ("single", 20_000, "3%", names, SINGLES), ("small", 30_000, "0.3%", DYNAMIC, SMALL),
        ):  # fmt: skip
            for k, name in enumerate(effects):  # each record with a seed of its own: a rig and noise of its own
                made = [Case(drive, kind, (f"{name}={size}",), seed + 100 * k + n) for n in range(count)]
                place = k / (len(effects) + 8)
                found += [((n + place) / FIRST[kind], case) for n, case in enumerate(made)]
        for n, (a, b) in enumerate(pairs):
            found.append(((n + 0.3) / FIRST["pair"], Case(drive, "pair", (f"{a}=3%", f"{b}=3%"), 40_000 + n)))
        for n in range(OUTSIDE):
            found.append(((n + 0.6) / FIRST["outside"], Case(drive, "outside", ("outside=3%",), 50_000 + n)))
    return [case for _, case in sorted(found, key=lambda pair: pair[0])]


def _noise(n: int) -> str:
    """Of a clean record: every fourth is white."""
    return "white" if n % 4 == 3 else "coloured"


def actuator_of(drive: str) -> Actuator:
    """The reference actuator with a drive of this kind."""
    it = load_actuator(ROOT / "geometries/fast_tool_servo.toml")
    if drive == "current":
        return it
    return it.model_copy(update={"drive": it.drive.model_copy(update={"kind": "voltage", "bandwidth": None})})


@cache
def excitations_of(drive: str) -> tuple[Excitation, ...]:
    """The usual ones: they are chosen by what is believed, so they are the same for all records of a drive."""
    return usual_excitations(actuator_of(drive), read_table(TABLE), rate=BenchOptions(seed=0).rate)


@one_blas_thread
def tried(case: Case) -> dict[str, Any]:
    """A case made and diagnosed."""
    row: dict[str, Any] = {"key": case.key, "version": VERSION, **asdict(case)}
    actuator, table = actuator_of(case.drive), read_table(TABLE)
    try:
        options = BenchOptions(seed=case.seed, noise=case.noise, excitations=excitations_of(case.drive))
        sealed = sealed_record(actuator, table, parse_requests(case.hidden), options)
    except (InputError, ComputationError) as err:  # not every effect can be as large in every drive
        return row | {"bench": str(err)}
    begin = time.process_time()
    try:
        found = diagnose(sealed.record, DiagnosisSettings(table=table))
    except (InputError, ComputationError) as err:
        return row | {"failed": f"{type(err).__name__}: {err}"}
    row["cpu_seconds"] = round(time.process_time() - begin, 1)
    return row | _outcome(found) | {"truth": _truth(sealed.answer), "covered": _covered(found, sealed.answer)}


def _outcome(found: Diagnosis) -> dict[str, Any]:
    held_out = [a for a in found.accuracy if a.nominal.role == "held-out"]
    return {
        "verdict": found.verdict,
        "reason": found.reason,
        "causes": [
            {
                "effect": c.effect, "statistic": round(c.statistic, 2), "rivals": list(c.rivals),
                "gain": _finite(c.gain),
                "parameters": {k: [e.value, e.low, e.high] for k, e in c.parameters.items()},
            }
            for c in found.causes
        ],
        "statistics": [[[name, round(value, 2)] for name, value in one] for one in found.statistics],
        "unexplained": {"equation": found.unexplained.equation, "depends_on": list(found.unexplained.depends_on)},
        "held_out": {
            a.nominal.channel: [_finite(f.rms / f.floor) for f in (a.nominal, a.refitted, a.extended)] for a in held_out
        },
        "notes": list(found.notes),
    }  # fmt: skip


def _truth(answer: dict[str, Any]) -> dict[str, Any]:
    return {"effects": [{k: e[k] for k in ("effect", "size", "parameters")} for e in answer["effects"]]}


def _covered(found: Diagnosis, answer: dict[str, Any]) -> dict[str, bool]:
    """Believed parameters: whether the true value lies in the 95 % interval."""
    inside = {}
    for name, e in found.parameters.items():
        if name in answer["true_parameters"] and e.believed:
            true = e.believed * (1 + answer["true_parameters"][name]["relative_error"])
            inside[name] = bool(e.low <= true <= e.high)
    return inside


def _finite(value: float) -> float | None:
    return round(value, 4) if np.isfinite(value) else None


def done(path: Path) -> Iterator[dict[str, Any]]:
    """The lines that are there; a last one that was cut off is left out."""
    if not path.is_file():
        return
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        if row.get("version", 1) == VERSION:
            yield row


def differences(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    """What a case made anew says otherwise than its row: verdict, names, and the best gain of each stage in nats."""
    told = []
    for what, of_row in (
        ("verdict", lambda row: row.get("verdict", row.get("failed", row.get("bench")))),
        ("causes", lambda row: [cause["effect"] for cause in row.get("causes", [])]),
        ("rivals", lambda row: [sorted(cause["rivals"]) for cause in row.get("causes", [])]),
        ("unexplained", lambda row: row.get("unexplained")),
    ):
        old, new = of_row(before), of_row(after)
        if old != new:
            told.append(f"{what}: {old} -> {new}")
    for n, (old, new) in enumerate(zip(_best(before), _best(after), strict=False), 1):
        if old[0] != new[0] or abs(new[1] - old[1]) > NATS + PART * abs(old[1]):
            told.append(f"stage {n}: {old} -> {new}")
    return told


def _best(row: dict[str, Any]) -> list[tuple[str, float]]:
    return [tuple(stage[0]) for stage in row.get("statistics", []) if stage]


class Study:
    """The job, and what solves its cases."""

    def solver(self) -> "Study":
        return self

    def solve(self, case: Case) -> dict[str, Any]:
        return {"row": tried(case)}


class EachRow:
    """A cache that keeps nothing: it hands on each row as soon as it is there."""

    def __init__(self, take: Callable[[dict[str, Any]], None]) -> None:
        self._take = take

    def get(self, key: str) -> dict[str, Any] | None:
        return None

    def put(self, key: str, answer: dict[str, Any]) -> None:
        self._take(answer["row"])


def run_cases(chosen: list[Case], processes: int, take: Callable[[dict[str, Any]], None]) -> None:
    """The cases in processes; each row is taken as soon as it is there."""
    executor = Executor(processes, work="study", item="case", go_on="finished cases are kept: run it again")
    run_jobs(Study(), chosen, executor=executor, cache=EachRow(take))


def compare_with(rows: Path, keys: Path | None, *, limit: int | None, processes: int) -> int:
    """Cases of a file of rows made anew, all or those of `keys` (one a line); how many verdicts or names differ."""
    known = {row["key"]: row for row in done(rows)}
    wanted = keys.read_text(encoding="utf-8").split("\n") if keys is not None else list(known)
    chosen = [case for case in cases() if case.key in wanted and case.key in known][:limit]
    moved = 0

    def compare(row: dict[str, Any]) -> None:
        nonlocal moved
        told = differences(known[row["key"]], row)
        moved += any(text.startswith(("verdict", "causes")) for text in told)
        print(f"{row['key']}: {'; '.join(told) or 'the same'} ({row.get('cpu_seconds')} s)", flush=True)

    run_cases(chosen, processes, compare)
    print(f"{moved} of {len(chosen)} differ in verdict or names")
    return moved


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--limit", type=int, default=None, help="cases of this run at most")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--only", default="", help="cases whose key holds this text")
    parser.add_argument("--compare", type=Path, default=None, metavar="ROWS", help="make cases of these rows anew")
    parser.add_argument("--keys", type=Path, default=None, help="of --compare: a file with the keys of the cases")
    options = parser.parse_args()
    if options.compare is not None:
        moved = compare_with(options.compare, options.keys, limit=options.limit, processes=options.processes)
        sys.exit(1 if moved else 0)
    known = {row["key"] for row in done(options.results)}
    left = [case for case in cases() if case.key not in known and options.only in case.key][: options.limit]
    print(f"{len(known)} cases are there, {len(left)} to do", file=sys.stderr)
    begin, written = time.monotonic(), 0
    with options.results.open("a", encoding="utf-8") as out:

        def write(row: dict[str, Any]) -> None:
            nonlocal written
            out.write(json.dumps(row) + "\n")
            out.flush()
            written += 1
            rest = (time.monotonic() - begin) / written * (len(left) - written)
            names = [c["effect"] for c in row.get("causes", [])]
            print(
                f"{written}/{len(left)}, {rest / 60:.0f} min left: {row['key']}: {row.get('verdict')} {names}",
                file=sys.stderr,
            )

        run_cases(left, options.processes, write)


if __name__ == "__main__":
    main()
