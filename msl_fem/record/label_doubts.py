"""What a table's readings say against its labels: blocks copied, labels exchanged, labels that other blocks' readings
contradict. Warnings, never refusals; no check knows a file.

A label is what was set (a position, a temperature, an on-time), a reading what was measured there. A block holds the
rows that differ in one label alone.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.record.log_noise import resolution_of

Labels = Mapping[str, NDArray[Any]]
Blocks = dict[tuple[object, ...], NDArray[np.intp]]
FEWEST_TABLE_ROWS = 20
FEWEST_BLOCKS = 3
FEWEST_LABELS = 5
MANY_ALIKE = 10
"""Rows of equal readings above which they prove no copy."""
CHANCE_BITS = 20.0
"""Bits by which a block's agreement has to be less likely than chance: 1 in a million."""
MOST = 0.9
"""Share of blocks that have to agree."""
ALIKE = 2.0
"""Factor within which readings span what they span at other levels: a wrong label leaves the span, physics does not."""
FAR = 0.2
"""Share of a label's range by which readings have to tell another one."""


def copied_blocks(labels: Labels, measured: Mapping[str, Array]) -> list[str]:
    """Blocks of a table's rows with different labels and equal readings in every digit.

    A row's readings are compared together. That two blocks agree by chance has the product of their readings'
    frequencies as its probability; doubted is what is less likely than one in a million over all pairs of rows.
    """
    rows = list(zip(*[v.tolist() for v in measured.values()], strict=True))
    if len(rows) < FEWEST_TABLE_ROWS:
        return []
    places = defaultdict(list)
    for k, row in enumerate(rows):
        places[row].append(k)
    by_lag: dict[int, list[int]] = defaultdict(list)
    for at in places.values():
        if len(at) <= MANY_ALIKE:
            for first, second in combinations(at, 2):
                by_lag[second - first].append(first)
    doubts = []
    for lag, firsts in sorted(by_lag.items()):
        for start, length in _stretches(sorted(firsts)):
            bits = sum(np.log2(len(rows) / len(places[rows[k]])) for k in range(start, start + length))
            if bits > 2 * np.log2(len(rows)) + CHANCE_BITS and length >= 4:
                doubts.append(_copy_told(labels, start, start + lag, length))
    return doubts


def _stretches(firsts: Sequence[int]) -> list[tuple[int, int]]:
    """(start, length) of consecutive numbers."""
    stretches: list[tuple[int, int]] = []
    for k in firsts:
        if stretches and stretches[-1][0] + stretches[-1][1] == k:
            stretches[-1] = (stretches[-1][0], stretches[-1][1] + 1)
        else:
            stretches.append((k, 1))
    return stretches


def _copy_told(labels: Labels, first: int, second: int, length: int) -> str:
    changed = [
        f"{name} {values[first]:g} and {values[second]:g}" if values.dtype.kind == "f" else name
        for name, values in labels.items()
        if values[first] != values[second]
    ]
    where = f" ({', '.join(changed)})" if changed else ""
    return f"rows {first} to {first + length - 1} and {second} to {second + length - 1} are equal in every digit{where}"


def _blocks(labels: Labels, along: str) -> Blocks:
    """Rows of each block: equal labels but the one along which it runs, which has five values or more, each once."""
    others = [values for name, values in labels.items() if name != along]
    rows: dict[tuple[object, ...], list[int]] = defaultdict(list)
    for k in range(labels[along].size):
        rows[tuple(values[k] for values in others)].append(k)
    blocks = {}
    for key, at in rows.items():
        x = labels[along][at]
        if np.unique(x).size == x.size >= FEWEST_LABELS:
            blocks[key] = np.array(at)[np.argsort(x)]
    return blocks


def exchanged_labels(labels: Labels, measured: Mapping[str, Array]) -> list[str]:
    """Pairs of labels that make readings monotone in nine of ten blocks when exchanged, in one of ten at most as they
    stand: neighbours in a list that were written in the wrong order."""
    doubts = []
    for along, values in labels.items():
        if values.dtype.kind != "f":
            continue
        blocks = _blocks(labels, along)
        if len(blocks) < FEWEST_BLOCKS:
            continue
        for name, readings in measured.items():
            pair = _exchange_of(values, [readings[at] for at in blocks.values()], list(blocks.values()))
            if pair is not None:
                first, second, count = pair
                doubts.append(
                    f"{name} is monotone over {along} in {count} of {len(blocks)} blocks if its labels {first:g} and "
                    f"{second:g} are exchanged, and in hardly any as they stand"
                )
    return doubts


def _exchange_of(x: Array, series: list[Array], rows: list[NDArray[np.intp]]) -> tuple[float, float, int] | None:
    slacks = [2 * resolution_of(values) for values in series]
    as_given = sum(_monotone(values, slack) for values, slack in zip(series, slacks, strict=True))
    if as_given > (1 - MOST) * len(series):
        return None
    gained: dict[tuple[float, float], int] = defaultdict(int)
    for values, at, slack in zip(series, rows, slacks, strict=True):
        for first, second in combinations(range(values.size), 2):
            turned = values.copy()
            turned[[first, second]] = values[[second, first]]
            if _monotone(turned, slack):
                gained[float(x[at[first]]), float(x[at[second]])] += 1
    pair, count = max(gained.items(), key=lambda item: item[1], default=((0.0, 0.0), 0))
    return (*pair, count) if count >= MOST * len(series) else None


def _monotone(values: Array, slack: float) -> bool:
    """Whether values rise or fall throughout, but for the slack."""
    step = np.diff(values)
    return bool(np.all(step >= -slack) or np.all(step <= slack)) and float(np.ptp(values)) > 4 * slack


def contradicted_labels(labels: Labels, measured: Mapping[str, Array]) -> list[str]:
    """Levels of a label at which readings tell other values of a second label than those written there.

    The curve over the second label at the other levels, at equal other labels, is turned round: which label has this
    reading? Readings are stretched to the curve's range first, and labels told in their own order are another curve,
    no error. Doubted are three labels or more that are a fifth of their range off, alike in all blocks, where
    all readings span what they do elsewhere.
    """
    doubts = []
    for along, values in labels.items():
        if values.dtype.kind != "f":
            continue
        names = [name for name in labels if name != along]
        blocks = _blocks(labels, along)
        senses = {(name, int(at[0])): _sense(v[at]) for name, v in measured.items() for at in blocks.values()}
        for k, other in enumerate(names):
            families = _families(blocks, k)
            for level in sorted({key[k] for key in blocks}, key=str):
                told = _told(families, level, np.asarray(values, dtype=np.float64), measured, senses)
                shown = f"{level:g}" if isinstance(level, float) else str(level)
                doubts += _contradiction(told, along, f"{other} is {shown}")
    return doubts


def _families(blocks: Blocks, k: int) -> list[dict[object, NDArray[np.intp]]]:
    """Blocks that differ in the label k alone, by its level."""
    families: dict[tuple[object, ...], dict[object, NDArray[np.intp]]] = defaultdict(dict)
    for key, rows in blocks.items():
        families[key[:k] + key[k + 1 :]][key[k]] = rows
    return list(families.values())


def _told(
    families: Sequence[Mapping[object, NDArray[np.intp]]],
    level: object,
    x: Array,
    measured: Mapping[str, Array],
    senses: Mapping[tuple[str, int], int],
) -> dict[float, list[float]]:
    """Label written to labels told by the readings less it, of blocks at a level; in shares of the block's range."""
    told: dict[float, list[float]] = defaultdict(list)
    for family in families:
        if level not in family:
            continue
        at = family[level]
        alike = [rows for other, rows in family.items() if other != level and _same_values(x[rows], x[at])]
        if len(alike) < 2:
            continue
        place = (x[at] - x[at][0]) / (x[at][-1] - x[at][0])
        curves = {name: np.median([v[rows] for rows in alike], axis=0) for name, v in measured.items()}
        if not all(_spans_alike(v[at], curves[name]) for name, v in measured.items()):
            continue
        for name, readings in measured.items():
            if {senses[name, int(rows[0])] for rows in alike} in ({1}, {-1}):
                off = _place_of(readings[at], curves[name], place) - place
                for label, deviation in zip(x[at], off, strict=True):
                    told[float(label)].append(float(deviation))
    return {label: shares for label, shares in told.items() if len(shares) >= FEWEST_BLOCKS}


def _same_values(first: Array, second: Array) -> bool:
    return first.size == second.size and bool(np.allclose(first, second, rtol=1e-9, atol=1e-9 * np.ptp(second)))


def _spans_alike(readings: Array, curve: Array) -> bool:
    """Whether readings span what they span at other levels, within a factor."""
    own, other = float(np.ptp(readings)), float(np.ptp(curve))
    return other / ALIKE < own < other * ALIKE


def _place_of(readings: Array, curve: Array, place: Array) -> Array:
    """Where on a curve over `place` the readings lie, both from 0 to 1 of their range."""
    own, other = ((v - v.min()) / np.ptp(v) for v in (readings, curve))
    if curve[-1] < curve[0]:
        own, other = 1 - own, 1 - other
    return np.asarray(np.interp(own, np.maximum.accumulate(other), place), dtype=np.float64)


def _contradiction(told: Mapping[float, Sequence[float]], along: str, where: str) -> list[str]:
    if len(told) < FEWEST_LABELS:
        return []
    span = max(told) - min(told)
    off = []
    for label, deviations in sorted(told.items()):
        median = float(np.median(deviations))
        scatter = float(np.median(np.abs(np.array(deviations) - median))) / 0.6745
        if abs(median) > FAR and scatter < 0.5 * abs(median):
            off.append((label, label + median * span))
    if len(off) < 3 or _ranks_correlate([says for _, says in off]) > 0:  # told in their own order: another curve
        return []
    shown = ", ".join(f"{says:.3g} at {label:.3g}" for label, says in off[:3])
    count = f"{len(off)} of {len(told)} labels of {along}"
    return [f"where {where}, readings contradict {count}: by the other blocks they tell {shown}"]


def doubtful_table(labels: Labels, measured: Mapping[str, Array]) -> list[str]:
    """All that a table's readings (n_row,) say against its labels."""
    by_blocks = (copied_blocks, exchanged_labels, contradicted_labels)
    return [doubt for check in by_blocks for doubt in check(labels, measured)]


def _ranks_correlate(values: Sequence[float] | Array) -> float:
    """Spearman's rank correlation of values with their order; 0 of equal ones."""
    ranks = np.argsort(np.argsort(values))
    return float(np.corrcoef(ranks, np.arange(ranks.size))[0, 1]) if np.ptp(values) else 0.0


def _sense(values: Array) -> int:
    """1 where values rise with their order, -1 where they fall, 0 where neither is clear."""
    correlation = _ranks_correlate(values)
    return int(np.sign(correlation)) if abs(correlation) > 0.9 else 0
