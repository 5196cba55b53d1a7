"""The figures of the diagnosis study: docs/diagnosis.md and the README's totals.

python benchmarks/diagnosis_study_tables.py
"""

from collections import Counter, defaultdict
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from diagnosis_study import CLEAN, DRIVES, DYNAMIC, OUTSIDE, PAIRS, RESULTS, ROOT, SINGLES, SMALL, done
from marked_text import rewrite
from scipy.stats import beta

from msl_fem.plant.effects import CATALOGUE

VARIABLES = {
    "cogging": ("force", {"position"}),
    "quadratic_drag": ("force", {"velocity"}),
    "relaxing_cushion": ("force", {"memory"}),
    "amplifier_crossover": ("voltage", {"command", "current", "flux linkage's rate"}),
    "current_product_force": ("force", {"current product"}),
    "random_force": ("", set()),
    "position_play": ("position reading", {"position", "memory", "velocity"}),
}
"""Equation and variable of what lies outside the catalogue; none of a random force."""
Row = dict[str, Any]
SIZE, SMALL_SIZE = 3.0, 0.3  # %
QUIET = 1.1  # of the noise


def rate(hits: int, total: int) -> str:
    """ "95.0 % (19/20; 75 to 100 %)": a share with its 95 % interval (Clopper and Pearson)."""
    if total == 0:
        return "-"
    low = beta.ppf(0.025, hits, total - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, total - hits) if hits < total else 1.0
    return f"{100 * hits / total:.1f} % ({hits}/{total}; {100 * low:.0f} to {100 * high:.0f} %)"


def names(row: Row) -> list[str]:
    return [cause["effect"] for cause in row["causes"]]


def reported(row: Row) -> set[str]:
    """The names of a diagnosis with those that it cannot tell from them."""
    return set(names(row)) | {rival for cause in row["causes"] for rival in cause["rivals"]}


def truth(row: Row) -> list[str]:
    return [effect["effect"] for effect in row["truth"]["effects"]]


def worst(row: Row, model: int) -> float:
    """The largest held-out error over the noise of the channels, of nominal, re-fitted, extended (0, 1, 2)."""
    values = [three[model] for three in row["held_out"].values()]
    return max((v if v is not None else np.inf for v in values), default=np.nan)


def of(rows: Sequence[Row], drive: str, kind: str) -> list[Row]:
    return [r for r in rows if r["drive"] == drive and r["kind"] == kind and "verdict" in r]


def totals(rows: Sequence[Row], drive: str) -> list[tuple[str, str, str]]:
    """(what, figure, target) of a drive."""
    clean, single, small = (of(rows, drive, kind) for kind in ("clean", "single", "small"))
    pair, outside = of(rows, drive, "pair"), of(rows, drive, "outside")
    right = [r for r in single if names(r)[:1] == truth(r)]
    told = [r for r in outside if "unexplained" in r["verdict"]]
    covered = [value for r in clean + right for value in r["covered"].values()]
    seen, small_seen = ([r for r in kind if _can_be_seen(r, s)] for kind, s in ((single, SIZE), (small, SMALL_SIZE)))
    return [
        ("clean records in which something is named", rate(sum(bool(names(r)) for r in clean), len(clean)), "1 %"),
        ("one effect at 3 %: its name first", _first(single), ""),
        ("... of those that the record can show, by all their shapes", _first(seen), "95 %"),
        ("... of these, in the reported set", _told(seen), "99 %"),
        ("... alone, of all", rate(sum(names(r) == truth(r) for r in single), len(single)), ""),
        ("one dynamic effect at 0.3 %: in the reported set", _told(small), ""),
        ("... of those whose least size is below 0.3 %", _told(small_seen), "90 %"),
        ("two effects at 3 %: both named", _both(pair), ""),
        ("... of those that the record can show", _both([r for r in pair if _can_be_seen(r, SIZE)]), "85 %"),
        ("... at least one, of all", rate(sum(bool(set(truth(r)) & set(names(r))) for r in pair), len(pair)), ""),
        ("outside the catalogue: declared", rate(len(told), len(outside)), "95 %"),
        ("... and nothing of the catalogue named", rate(sum(not names(r) for r in told), len(outside)), ""),
        ("... equation and variable right", rate(sum(_variable_right(r) for r in outside), len(outside)), "80 %"),
        ("held-out error at most 1.1 of the noise after a right name",
         _quiet(right), ""),
        ("... without `sensor_drift`, which is new in every run",
         _quiet([r for r in right if truth(r) != ["sensor_drift"]]), "all"),
        ("believed parameters inside their 95 % interval", rate(sum(covered), len(covered)), "90 to 98 %"),
    ]  # fmt: skip


def _both(rows: Sequence[Row]) -> str:
    return rate(sum(set(truth(r)) <= set(names(r)) for r in rows), len(rows))


def _quiet(rows: Sequence[Row]) -> str:
    return rate(sum(worst(r, 2) <= QUIET for r in rows), len(rows))


def _told(rows: Sequence[Row]) -> str:
    return rate(sum(truth(r)[0] in reported(r) for r in rows), len(rows))


def _first(rows: Sequence[Row]) -> str:
    return rate(sum(names(r)[:1] == truth(r) for r in rows), len(rows))


@cache
def least_sizes() -> dict[tuple[str, str], tuple[float, float]]:
    """(effect, drive) to the least size in per cent that a record can show, and by the shapes that show it last, as
    docs/diagnosis.md has them from the slopes alone (least_sizes.py)."""
    text = (ROOT / "docs" / "diagnosis.md").read_text(encoding="utf-8")
    block = text.split("<!-- least sizes -->")[1].split("<!-- end of least sizes -->")[0]
    rows = [[cell.strip() for cell in line.split("|")] for line in block.splitlines() if line.startswith("| `")]
    columns = {"voltage": 2, "current": 6}
    found = {}
    for row in rows:
        for drive, n in columns.items():
            least = float(row[n].removesuffix(" %"))
            found[row[1].strip("`"), drive] = (least, float(row[n + 1].strip("to %") or least))
    return found


def _can_be_seen(row: Row, size: float) -> bool:
    """Whether the slopes alone say that the effects show at this size (%)."""
    return all(least_sizes()[effect, row["drive"]][1] < size for effect in truth(row))


def small_table(rows: Sequence[Row]) -> str:
    """Each dynamic effect at 0.3 %: how often it is in the reported set, and from which size on it can be."""
    heads = " | ".join(f"{d}: reported | least size" for d in DRIVES)
    lines = [f"| effect at 0.3 % | {heads} |", "| --- " * (1 + 2 * len(DRIVES)) + "|"]
    for effect in DYNAMIC:
        cells = [f"`{effect}`"]
        for drive in DRIVES:
            found = [r for r in of(rows, drive, "small") if truth(r) == [effect]]
            cells += [
                f"{sum(effect in reported(r) for r in found)}/{len(found)}",
                f"{least_sizes()[effect, drive][0]:g} %",
            ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _variable_right(row: Row) -> bool:
    equation, variables = VARIABLES[truth(row)[0]]
    found = row["unexplained"]
    if not variables:
        return not found["depends_on"]
    first = (found["depends_on"] or [""])[0]
    return found["equation"] == equation and any(first.startswith(v) for v in variables)


def totals_table(rows: Sequence[Row]) -> str:
    columns = {drive: totals(rows, drive) for drive in DRIVES}
    lines = [
        "| | " + " | ".join(f"{drive} drive" for drive in DRIVES) + " | target |",
        "| --- " * (len(DRIVES) + 2) + "|",
    ]
    for n, (what, _, target) in enumerate(columns[DRIVES[0]]):
        lines.append("| " + " | ".join([what, *(columns[drive][n][1] for drive in DRIVES), target]) + " |")
    return "\n".join(lines)


def effects_table(rows: Sequence[Row]) -> str:
    """Each effect at 3 %: how often named first, what else was said, the held-out error."""
    each = " | ".join(f"{d}: first | median nats | held-out error over noise | else" for d in DRIVES)
    lines = [f"| effect | {each} |", "| --- " * (1 + 4 * len(DRIVES)) + "|"]
    for effect in CATALOGUE:
        cells = [f"`{effect}`"]
        for drive in DRIVES:
            cells += _cells([r for r in of(rows, drive, "single") if truth(r) == [effect]], effect)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cells(rows: Sequence[Row], effect: str) -> list[str]:
    if not rows:
        return ["-", "-", "-", "-"]
    first = [r for r in rows if names(r)[:1] == [effect]]
    nats = [r["causes"][0]["statistic"] for r in first]
    held = [worst(r, 2) for r in first]
    other = Counter(" + ".join(names(r)) or r["verdict"] for r in rows if names(r) != [effect])
    said = ", ".join(f"{what} ({n})" for what, n in other.most_common())
    nats_text = f"{np.median(nats):.3g}" if nats else "-"
    held_text = f"{np.median(held):.3g}, worst {max(held):.3g}" if held else "-"
    return [f"{len(first)}/{len(rows)}", nats_text, held_text, said]


def outside_table(rows: Sequence[Row]) -> str:
    lines = ["| hidden | drive | records | declared | equation and variable | named |", "| --- " * 6 + "|"]
    grouped: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for drive in DRIVES:
        for row in of(rows, drive, "outside"):
            grouped[truth(row)[0], drive].append(row)
    for (effect, drive), found in sorted(grouped.items()):
        told = sum("unexplained" in r["verdict"] for r in found)
        right = sum(_variable_right(r) for r in found)
        named = Counter(name for r in found for name in names(r))
        said = ", ".join(f"{name} ({n})" for name, n in named.items())
        lines.append(f"| `{effect}` | {drive} | {len(found)} | {told} | {right} | {said} |")
    return "\n".join(lines)


def extent(rows: Sequence[Row]) -> str:
    """How much of the study there is."""
    wanted = 2 * (CLEAN + SINGLES * len(CATALOGUE) + SMALL * len(DYNAMIC) + PAIRS + OUTSIDE)
    made = sum("verdict" in r for r in rows)
    refused, failed = sum("bench" in r for r in rows), sum("failed" in r for r in rows)
    seconds = [r["cpu_seconds"] for r in rows if "cpu_seconds" in r]
    return (
        f"{made} of {wanted} records were diagnosed ({refused} more cannot be made as large, {failed} failed); "
        f"median {np.median(seconds):.0f} CPU s each, {np.quantile(seconds, 0.95):.0f} s in 19 of 20."
    )


def main() -> None:
    rows = list(done(RESULTS))
    parts = [extent(rows), totals_table(rows), effects_table(rows), small_table(rows), outside_table(rows)]
    text = "\n\n".join(parts)
    short = "\n\n".join([extent(rows), totals_table(rows)])
    rewrite(ROOT / "docs" / "diagnosis.md", {"study": text})
    rewrite(ROOT / "README.md", {"diagnosis": short})
    print(text)


if __name__ == "__main__":
    main()
