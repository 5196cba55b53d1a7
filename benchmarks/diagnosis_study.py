"""The diagnosis on four actuators with what real instruments do: rates on seeds that settled no threshold.

    python benchmarks/diagnosis_study.py [--limit N] [--kinds clean,single] [--rigs servo] [--fastest "5 kHz"]
    python benchmarks/diagnosis_study.py --missed
    python benchmarks/diagnosis_study.py --tables [--docs]

Records of the bench hold nothing, one to three effects, or what lies outside the catalogue, and beside it zeros, gains
and stray flux of one to two tolerances; some a wrong statement of the noise (half, twice) or of the hold, a static map
with a zero of its own, steps of half again the amplitude, or "10 MHz" for a drive without a pole. Each case is a
line of `diagnosis_study.jsonl`, and a run goes on where the last one stopped. A case's number says to which half it
belongs: thresholds may be settled on even ones, rates count on odd ones. Cases come in an order in which any beginning
is a fair share. `--seed` draws other cases: those of a seed that nobody has looked at set nothing, odd or even.
`--missed` asks of the cases in which a hidden effect was not named what their records can show: the nats that each of
the hidden effects brings beside the others in a search that tries nothing else, and those that a record brings for them
over as many that were told in their place.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from json_lines import append, rows_in
from marked_text import rewrite
from scipy.stats import beta
from study_rigs import ROOT, StudyRig, excitations_of, loop_of, study_rig

from msl_fem.bench import BenchOptions, ClosedLoop, parse_nuisances, parse_requests, sealed_record
from msl_fem.bench.sealed import SealedRecord
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.laws import LawExpression, parse_expression
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.conclusion import APART
from msl_fem.diagnosis.driver import kind_of
from msl_fem.diagnosis.effect_search import search_effects
from msl_fem.diagnosis.kind import about_belief
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.refits import Refit
from msl_fem.diagnosis.result import Diagnosis
from msl_fem.diagnosis.runs import Runs
from msl_fem.diagnosis.search import search_stage
from msl_fem.diagnosis.variants import Variant
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import parse_quantity
from msl_fem.plant.effects import CATALOGUE, declare, declared
from msl_fem.plant.excitation import parse_excitation

RESULTS = Path(__file__).parent / "diagnosis_study.jsonl"
VERSION = 34
"""Of search and rule: lines of another one are left out and made anew."""
COUNT, SEED = 4000, 20261121
SECONDS = 4.0
RIGS = (
    ("servo", "voltage"), ("servo", "current"), ("small", "voltage"), ("small", "current"), ("large", "voltage"),
    ("large", "current"), ("levitator", "current"),
)  # fmt: skip
LATER_RIGS, LATER = (*RIGS, ("levitator", "voltage")), 6710  # of studies from that seed on
KINDS = {"clean": 0.34, "single": 0.3, "small": 0.1, "pair": 0.1, "triple": 0.08, "outside": 0.08}
EFFECTS_OF = {"clean": 0, "single": 1, "small": 1, "pair": 2, "triple": 3, "outside": 0}
RATES, SHARES = (1e3, 5e3, 20e3), (0.4, 0.5, 0.1)
Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A record of the study: its rig, what is hidden, what its instruments do."""

    seed: int
    kind: str
    rig: str
    drive: str
    rate: float
    hidden: tuple[str, ...]
    nuisance: float
    stated_noise: float
    stated_hold: str
    static: bool
    pulses: bool
    fast_pole: bool
    study: int = SEED

    @property
    def key(self) -> str:
        hidden = "+".join(self.hidden) or "nothing"
        return f"{self.study}/{self.seed}/{self.kind}/{self.rig}/{self.drive}/{self.rate:g}/{hidden}"


def case_of(seed: int, study: int = SEED) -> Case:
    """The case of a seed; kinds and rigs go round, everything else is chance."""
    chance = np.random.default_rng([study, seed])
    kind = str(chance.choice(list(KINDS), p=list(KINDS.values())))
    rigs = LATER_RIGS if LATER <= study < SEED else RIGS
    rig, drive = rigs[(seed // 2) % len(rigs)]
    names = chance.permutation(list(CATALOGUE))[: EFFECTS_OF[kind]]
    hidden = tuple(f"{name}={'0.3' if kind == 'small' else '3'}%" for name in names)
    if kind == "outside":
        hidden = ("outside=3%",)
    samples = float(chance.choice(RATES, p=SHARES))
    if rig == "levitator":
        samples = max(samples, 5e3)
    nuisance = float(np.round(chance.uniform(1.0, 2.0), 2))
    noise = float(chance.choice([0.5, 1.0, 2.0], p=[0.15, 0.7, 0.15]))
    hold = str(chance.choice(["zero-order", "linear"], p=[0.9, 0.1]))
    static, pulses, fast = (bool(chance.random() < share) for share in (0.15, 0.15, 0.2))
    fast &= drive == "voltage"
    return Case(seed, kind, rig, drive, samples, hidden, nuisance, noise, hold, static, pulses, fast, study)


@cache
def rig_of(name: str) -> StudyRig:
    return study_rig(name)


@cache
def loop(name: str, drive: str) -> ClosedLoop | None:
    return loop_of(rig_of(name), drive)


def options_of(case: Case) -> BenchOptions:
    """How the bench makes the record of a case."""
    rig = rig_of(case.rig)
    excitations = excitations_of(rig, case.drive, seconds=SECONDS)
    if case.pulses and not loop(case.rig, case.drive):
        unit = "A" if case.drive == "current" else "V"
        first = excitations[0]
        at = f"step:bias={first.bias:g} {unit},amplitude={1.5 * first.amplitude:g} {unit},frequency=5 Hz,duration=1 s"
        excitations = (*excitations, parse_excitation(at, unit=unit))
    return BenchOptions(
        seed=case.seed if case.study == SEED else case.study + case.seed,
        rate=case.rate,
        excitations=excitations,
        static=case.static,
        loop=loop(case.rig, case.drive),
        nuisances=parse_nuisances([f"all={case.nuisance}"]),
        stated_noise=case.stated_noise,
        stated_hold=case.stated_hold,  # type: ignore[arg-type]
        stated_bandwidth=10e6 if case.fast_pole else None,
    )


def sealed_of(case: Case) -> SealedRecord:
    """The record of a case with its answer."""
    rig = rig_of(case.rig)
    return sealed_record(rig.in_drive(case.drive), rig.table, parse_requests(case.hidden), options_of(case))


@one_blas_thread
def tried(case: Case) -> Row:
    """A case made and diagnosed."""
    row: Row = {"key": case.key, "version": VERSION, **asdict(case)}
    try:
        sealed = sealed_of(case)
    except (InputError, ComputationError) as err:  # not every effect can be as large on every rig
        return row | {"bench": str(err)}
    begin = time.process_time()
    try:
        found = diagnose(sealed.record, DiagnosisSettings(table=rig_of(case.rig).table))
    except (InputError, ComputationError) as err:
        return row | {"failed": f"{type(err).__name__}: {err}"}
    truth = [effect["effect"] for effect in sealed.answer["effects"]]
    return row | {"cpu_seconds": round(time.process_time() - begin, 1), "truth": truth} | outcome(found)


@dataclass(frozen=True, eq=False)
class RunsOf(Runs):
    """Runs beside which stated effects alone are tried."""

    effects: frozenset[str] = frozenset()

    @classmethod
    def of(cls, runs: Runs, effects: Collection[str]) -> "RunsOf":
        own = {one.name: getattr(runs, one.name) for one in fields(runs) if one.init}
        return cls(**own, effects=frozenset(effects))

    def candidates(self, fit: Fit) -> list[Variant]:
        return [variant for variant in super().candidates(fit) if variant.effect in self.effects]


OUTSIDE_LAWS = {
    "current_product_force": "force = a*i1*i2; a: {low:.3g}..{high:.3g} N/A2",
    "quadratic_drag": "force = -a*v*abs(v); a: 0..{high:.3g} N s2/m2",
}
"""What lies outside the catalogue and is a law of the moment, within ten times the hidden amount."""


def law_outside(sealed: SealedRecord) -> LawExpression | None:
    """The law that is hidden outside the catalogue, as a user would state it; None where it is none of the moment."""
    [hidden] = sealed.answer["effects"]
    text = OUTSIDE_LAWS.get(hidden["effect"])
    if text is None:
        return None
    largest = 10 * abs(next(iter(hidden["parameters"].values())))
    return parse_expression(f"{hidden['effect']}: {text.format(low=-largest, high=largest)}")


class OnlyThese:
    """A case's record, in which stated effects alone are looked for, or the law that is hidden outside the catalogue.

    Raises
    ------
    InputError : the record cannot decide anything
    """

    def __init__(self, case: Case) -> None:
        sealed = sealed_of(case)
        self.truth = [effect["effect"] for effect in sealed.answer["effects"]]
        how = DiagnosisSettings(table=rig_of(case.rig).table)
        law = law_outside(sealed) if case.kind == "outside" else None
        if law is not None:
            declare(law)
            self.truth = [law.effect]
        kind = kind_of(sealed.record, how)
        if not isinstance(kind, Runs):
            raise InputError(str(kind))
        self.kind, self.table = kind.settled(how.progress), how.table

    def found(self, effects: Collection[str]) -> list[Refit]:
        """All of these effects, as the whole search finds them where nothing else is tried; those that it leaves out
        follow, what brings most beside those before first."""
        how, kind = DiagnosisSettings(table=self.table), RunsOf.of(self.kind, effects)
        searched = search_effects(kind, how)
        found = [stage.best for stage in searched.stages[: len(searched.fits) - 1] if stage.best is not None]
        base = searched.fits[-1]
        while len(found) < len(effects):
            best = search_stage(base, about_belief(kind, base), tell=how.progress, memory=how.memory).best
            if best is None:
                break
            found.append(best)
            base = best.fit
        return found

    @cached_property
    def hidden(self) -> list[Refit]:
        """The hidden effects."""
        return self.found(self.truth)

    def shown(self) -> dict[str, float]:
        """Of each hidden effect the nats that it brings beside the others, where nothing else is tried."""
        return {one.variant.effect: round(one.gain, 2) for one in self.hidden}

    def apart(self, told: Sequence[str]) -> float:
        """Nats that the record brings on average for its hidden effects over as many that were told in their place:
        below `APART` the best judge of the record alone takes one set for the other once in six times at least."""
        other = self.found(told)
        if len(self.hidden) < len(self.truth) or len(other) < len(told):
            return np.inf
        return round(self.hidden[-1].fit.nats_apart(other[-1].fit), 2)


@one_blas_thread
def asked(row: Row) -> Row:
    """A case that was missed with what its record shows, and how far that is from what was told in its place."""
    case = replace(case_of(row["seed"], row["study"]), stated_hold="zero-order")  # the bench's own
    try:
        with declared():  # a law that is asked for goes behind it
            search = OnlyThese(case)
            row = row | {"shown": row.get("shown") or search.shown()}
            return row | ({"apart": search.apart(row["names"][: len(row["truth"])])} if unasked(row) else {})
    except InputError:
        return row | {"shown": row.get("shown", {})} | ({"apart": np.inf} if unasked(row) else {})


def outcome(found: Diagnosis) -> Row:
    """What a diagnosis says, as a row holds it."""
    hidden = {name: limit.value for name, limit in found.hidden.items()}
    return {
        "verdict": found.verdict,
        "reason": found.reason,
        "names": list(found.names),
        "nats": [round(cause.statistic, 2) for cause in found.causes],
        "rivals": [list(cause.rivals) for cause in found.causes],
        "main": None if found.main_cause is None else found.main_cause.effect,
        "statistics": [[[name, round(value, 2)] for name, value in stage] for stage in found.statistics],
        "hidden_at_most": {name: value for name, value in hidden.items() if np.isfinite(value)},
        "notes": list(found.notes),
    }


def done(path: Path) -> list[Row]:
    """The lines that are there, the last of each case; one that was cut off is left out."""
    return list({row["key"]: row for row in rows_in(path) if row.get("version") == VERSION}.values())


@dataclass(frozen=True)
class Portion:
    """Which cases of a study are made: of these kinds and rigs, sampled at most at `fastest` Hz, so many; `hiding` one
    of these effects where any are stated."""

    study: int
    kinds: Sequence[str]
    rigs: Sequence[str]
    fastest: float
    limit: int
    hiding: frozenset[str] = frozenset()

    def left(self, known: set[int]) -> list[Case]:
        """Those that are not known yet."""
        cases = [case_of(seed, self.study) for seed in range(COUNT) if seed not in known]
        own = [case for case in cases if case.kind in self.kinds and case.rig in self.rigs]
        if self.hiding:
            own = [case for case in own if any(text.partition("=")[0] in self.hiding for text in case.hidden)]
        return [case for case in own if case.rate <= self.fastest][: self.limit]


def run(path: Path, portion: Portion) -> None:
    """Makes the cases of a portion that are not there, each line written as soon as it is known."""
    left = portion.left({row["seed"] for row in done(path) if row.get("study", SEED) == portion.study})
    begin = time.monotonic()
    for n, case in enumerate(left, 1):
        row = tried(case)
        append(path, row)
        minutes = (time.monotonic() - begin) / n * (len(left) - n) / 60
        told = row.get("names", row.get("failed", row.get("bench")))
        print(f"{n}/{len(left)}, {minutes:.0f} min left: {case.key}: {row.get('verdict')} {told}", file=sys.stderr)


def ask_of_missed(path: Path) -> None:
    """Adds to the cases in which a hidden effect was not named the nats that it brings, and where others were told in
    place of the hidden ones, as many, how far they are apart."""
    left = [row for row in done(path) if "truth" in row and is_missed(row) and ("shown" not in row or unasked(row))]
    for row in map(asked, left):
        append(path, row)
        print(f"{row['key']}: {row['names']}, shown {row['shown']}, apart {row.get('apart')}", file=sys.stderr)


def is_missed(row: Row) -> bool:
    """Whether a hidden effect was not named, or a law outside the catalogue not declared."""
    if row["kind"] == "outside":
        return row["truth"][0] in OUTSIDE_LAWS and not declared_unexplained(row)
    return bool(EFFECTS_OF[row["kind"]]) and not whole(row)


def unasked(row: Row) -> bool:
    """Whether others are told in place of the hidden effects, as many, and it is not known how far these are apart."""
    return (
        row["kind"] != "outside"
        and len(row["names"]) >= len(row["truth"])
        and not only_true(row)
        and "apart" not in row
    )


def rate(hits: int, total: int) -> str:
    """ "95.0 % (19/20; 75 to 100 %)": a share with its 95 % interval (Clopper and Pearson)."""
    if total == 0:
        return "-"
    low = beta.ppf(0.025, hits, total - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, total - hits) if hits < total else 1.0
    return f"{100 * hits / total:.0f} % ({hits}/{total}; {100 * low:.0f} to {100 * high:.0f} %)"


def right_first(row: Row) -> bool:
    return row["names"][:1] == row["truth"][:1] or (bool(row["names"]) and row["names"][0] in row["truth"])


def told(row: Row) -> bool:
    """Whether the truth is the first name or in the set that is told with it."""
    return bool(row["names"]) and bool({row["names"][0], *row["rivals"][0]} & set(row["truth"]))


def whole(row: Row) -> bool:
    return set(row["truth"]) <= set(row["names"])


def declared_unexplained(row: Row) -> bool:
    return "unexplained" in row["verdict"]


def nameless(row: Row) -> bool:
    return not row["names"]


def main_right(row: Row) -> bool:
    return row["main"] is None or row["main"] in row["truth"]


def first_or_main(row: Row) -> bool:
    """Whether the truth is the first name, or the main cause of an error of which more is left than names may leave."""
    return right_first(row) or row["main"] in row["truth"]


def only_true(row: Row) -> bool:
    return set(row["names"]) <= set(row["truth"])


def can_be_shown(row: Row) -> bool:
    """Whether a record can show what it holds: each hidden effect was named, or brings enough beside the others where
    nothing else is tried, and differs from what was told in its place. What lies outside the catalogue counts but where
    it is a law of the moment that by itself, as a user states it, does not bring enough."""
    if row["kind"] == "outside":
        nats = row.get("shown", {}).values()
        return declared_unexplained(row) or not nats or max(nats) >= DiagnosisSettings().rule.threshold
    if row.get("apart", APART) < APART:
        return False
    rule = DiagnosisSettings().rule
    nats = sorted((row.get("shown", {}).get(name, 0.0) for name in row["truth"]), reverse=True)
    return whole(row) or (nats[0] >= rule.threshold and all(value >= rule.further for value in nats[1:]))


Judge = Callable[[Row], bool]
FIGURES: tuple[tuple[str, str, Judge, str], ...] = (
    ("clean", "clean: named at all", lambda row: not nameless(row), "at most 1 %"),
    ("clean", "... declared unexplained", declared_unexplained, ""),
    ("single", "one effect of 3 %: named first", right_first, ""),
    ("single", "... of what the record can show", right_first, "95 %"),
    ("single", "... first, or in the set told with it", told, ""),
    ("single", "... of what the record can show, first or the main cause", first_or_main, ""),
    ("single", "... no wrong main cause", main_right, ""),
    ("single", "... no false name", only_true, ""),
    ("small", "one effect of 0.3 %: named first", right_first, ""),
    ("small", "... of what the record can show", right_first, "90 %"),
    ("small", "... first, or in the set told with it", told, ""),
    ("small", "... no false name", only_true, ""),
    ("pair", "two effects of 3 %: both named", whole, ""),
    ("pair", "... of what the record can show", whole, "85 %"),
    ("pair", "... no false name", only_true, ""),
    ("triple", "three effects of 3 %: all named", whole, ""),
    ("triple", "... of what the record can show", whole, "70 %"),
    ("triple", "... no false name", only_true, ""),
    ("outside", "outside the catalogue: declared", declared_unexplained, ""),
    ("outside", "... of what the record can show", declared_unexplained, "95 %"),
    ("outside", "... nothing named", nameless, "95 %"),
)


def judges(row: Row) -> bool:
    """Whether it may judge: all of another seed than the study's own, the odd ones of that."""
    return row.get("study", SEED) != SEED or bool(row["seed"] % 2)


def totals_table(rows: Sequence[Row]) -> str:
    """Every figure on what sets thresholds and on what judges; one column where nothing sets any."""
    columns = {"even seeds": [row for row in rows if not judges(row)], "judging seeds": list(filter(judges, rows))}
    columns = {title: own for title, own in columns.items() if own}
    head = ["all records, whether they can show it or not", *columns, "target"]
    lines = ["| " + " | ".join(head) + " |", "| --- " * len(head) + "|"]
    for kind, what, hit, target in FIGURES:
        cells = []
        for every in columns.values():
            own = [row for row in every if row["kind"] == kind and "verdict" in row]
            own = list(filter(can_be_shown, own)) if "can show" in what else own
            cells.append(rate(sum(map(hit, own)), len(own)))
        lines.append(f"| {what} | {' | '.join(cells)} | {target} |")
    return "\n".join(lines)


def rigs_table(rows: Sequence[Row]) -> str:
    """Single effects and clean records by actuator and drive, of the seeds that judge."""
    lines = [
        "| actuator, drive | single, 3 %: first | ... of what can be shown | clean: named | median CPU s | largest |",
        "| --- " * 6 + "|",
    ]
    for rig, drive in LATER_RIGS:
        own = [row for row in rows if (row["rig"], row["drive"]) == (rig, drive) and "verdict" in row]
        judged = list(filter(judges, own))
        single, clean = ([row for row in judged if row["kind"] == kind] for kind in ("single", "clean"))
        seconds = [row["cpu_seconds"] for row in own] or [np.nan]
        first = [rate(sum(map(right_first, some)), len(some)) for some in (single, list(filter(can_be_shown, single)))]
        cells = (*first, rate(sum(not nameless(row) for row in clean), len(clean)))
        lines.append(f"| {rig}, {drive} | {' | '.join(cells)} | {np.median(seconds):.0f} | {max(seconds):.0f} |")
    return "\n".join(lines)


def causes_table(rows: Sequence[Row]) -> str:
    """Single effects of 3 % by cause, of the seeds that judge: how many their records can show, and of these."""
    lines = ["| cause, 3 % | records | can be shown | named first | first or the main cause |", "| --- " * 5 + "|"]
    judged = [row for row in rows if row["kind"] == "single" and "verdict" in row and judges(row)]
    for cause in sorted({row["truth"][0] for row in judged}):
        own = [row for row in judged if row["truth"] == [cause]]
        shown = list(filter(can_be_shown, own))
        counts = (len(own), len(shown), sum(map(right_first, shown)), sum(map(first_or_main, shown)))
        lines.append("| " + " | ".join(map(str, (cause, *counts))) + " |")
    return "\n".join(lines)


def wrong_names(rows: Sequence[Row]) -> str:
    """What was said in place of the truth, all seeds, most often first."""
    counts: Counter[tuple[str, str]] = Counter()
    for row in rows:
        if "verdict" in row and row["kind"] in {"clean", "single", "small"} and not right_first(row):
            said = " + ".join(row["names"]) or row["verdict"]
            if (row["truth"] or ["nothing"], said) != (["nothing"], "nothing-found"):
                counts[" + ".join(row["truth"]) or "nothing", said] += 1
    lines = ["| hidden | said | records |", "| --- | --- | --- |"]
    return "\n".join([*lines, *(f"| {truth} | {said} | {n} |" for (truth, said), n in counts.most_common(40))])


def extent(rows: Sequence[Row]) -> str:
    made = sum("verdict" in row for row in rows)
    refused, failed = (sum(key in row for row in rows) for key in ("bench", "failed"))
    return (
        f"{made} records were diagnosed; {refused} more cannot be made as large by their rig, {failed} failed. "
        "Even seeds settled thresholds; which of the others later changes had in sight is said behind the tables."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--limit", type=int, default=COUNT, help="cases of this run at most")
    parser.add_argument("--kinds", default=",".join(KINDS), help="of these kinds alone, with commas between them")
    parser.add_argument("--rigs", default=",".join(dict.fromkeys(rig for rig, _ in RIGS)), help="of these rigs alone")
    parser.add_argument("--fastest", default="20 kHz", help="sampled at this rate at most")
    parser.add_argument("--hiding", default="", help="with one of these effects alone")
    parser.add_argument("--seed", type=int, default=SEED, help="from which the cases are drawn")
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--missed", action="store_true", help="ask what the records of missed cases can show")
    parser.add_argument("--tables", action="store_true", help="print the rates of what is there")
    parser.add_argument("--docs", action="store_true", help="with --tables: write them to docs/diagnosis.md")
    options = parser.parse_args()
    if options.missed:
        ask_of_missed(options.results)
        return
    if not options.tables:
        fastest = parse_quantity(options.fastest, "Hz")
        kinds, rigs = options.kinds.split(","), options.rigs.split(",")
        hiding = frozenset(options.hiding.split(",")) - {""}
        run(options.results, Portion(options.seed, kinds, rigs, fastest, options.limit, hiding))
        return
    rows = done(options.results)
    text = "\n\n".join([extent(rows), totals_table(rows), rigs_table(rows), causes_table(rows), wrong_names(rows)])
    print(text)
    if options.docs:
        rewrite(ROOT / "docs" / "diagnosis.md", {"study": text})


if __name__ == "__main__":
    main()
