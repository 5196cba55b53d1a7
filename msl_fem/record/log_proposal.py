"""A file of columns proposed from a look at a log: which signal is which column, in which unit and sign."""

import contextlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import QuantityError, RecordError
from msl_fem.files.quantity import parse_quantity
from msl_fem.files.schema import LARGEST
from msl_fem.files.toml_text import toml_text
from msl_fem.record.columns import CHANNELS, Channel, Quantity
from msl_fem.record.log_signals import signals_and_units
from msl_fem.record.reader import known_columns

WORDS: dict[Quantity, str] = {
    "time": r"time|t|ms|us|seconds?|zeit|x-axis|timestamp",
    "reference": r"ref\w*|target|soll|desired",
    "command": r"set\d*|cmd\w*|command\w*|i_?ref\w*",
    "position": r"x|y|z|q|q?m?pos\w*|probe|gap|laser|lvdt|displ\w*|dist\w*|weg|stroke|lage|sensor",
    "velocity": r"vel\w*|speed|geschw\w*",
    "current": r"i|il|current|curr|amps?|strom|shunt|i_coil|coil_i",
    "voltage": r"u|v|volt\w*|voltage|spannung|v_coil|u_coil|out",
    "force": r"f|fx|force\w*|load\w*|kraft|motor|thrust",
    "temperature": r"temp\w*",
    "flux_linkage": r"lambda|psi|flux\w*|linkage",
}
"""Usual names of signals, without units and numbers, tried in this order."""
UNITS_IN_NAMES = ("ms", "us", "s", "mm", "um", "nm", "m", "ma", "a", "mv", "v", "n", "kn", "mn", "degc", "k", "wb")
SPELLED = {
    "volt": "V", "volts": "V", "second": "s", "seconds": "s", "sec": "s", "amp": "A", "ampere": "A", "amps": "A",
    "newton": "N", "ma": "mA", "mv": "mV", "v": "V", "a": "A", "n": "N", "kn": "kN", "mn": "mN", "µm": "um", "µs": "us",
    "wb": "Wb", "k": "K", "s": "s", "ms": "ms", "us": "us", "mm": "mm", "um": "um", "nm": "nm", "m": "m",
}  # fmt: skip
CLEAR = 0.1
"""Share of the sum of amounts that a sum with signs has, to tell a sign."""


@dataclass(frozen=True)
class ProposedColumn:
    """A source for a column; `remarks` are why, and what to look at."""

    source: str
    unit: str = ""
    scale: float = 1.0
    remarks: tuple[str, ...] = field(default_factory=tuple)


def proposed_columns(log: str | Path, actuator: Actuator | None = None) -> dict[str, ProposedColumn]:
    """Sources by column, as names, units and values of a log's signals tell, for the columns of an actuator.

    Raises
    ------
    RecordError : the log cannot be read, or nothing in it looks like a column
    """
    signals, units = signals_and_units(log)
    plain = {name: v for name, v in signals.items() if v.ndim == 1 and not name.endswith(".time")}
    known = known_columns(actuator) if actuator is not None else list(CHANNELS)
    columns: dict[str, ProposedColumn] = {}
    for name, values in plain.items():
        column = _column_of(name, values, known, columns)
        if column:
            columns[column] = _with_unit(name, units.get(name, ""), column, values, actuator)
    if "time_s" in known and "time_s" not in columns:
        columns |= _time_by_values(plain, columns)
    if not columns:
        listed = ", ".join(list(signals)[:20])
        raise RecordError(f"{log}: no signal looks like a column; write the file by hand from {listed}")
    return _with_signs({name: columns[name] for name in known if name in columns}, plain)


def proposal_text(log: str | Path, columns: Mapping[str, ProposedColumn], known: list[str]) -> str:
    """The file of columns as TOML, with the reasons as comments, the columns without a signal, and the signals left."""
    lines = [
        f"# Proposed from a look at {Path(log).name}: check units, zeros and signs, then: import --columns this file"
    ]
    for column, it in columns.items():
        entry: dict[str, object] = {"source": it.source}
        if it.unit:
            entry["unit"] = it.unit
        if it.scale != 1.0:
            entry["scale"] = it.scale
        lines += ["", f"[{column}]", *(f"# {remark}" for remark in it.remarks), toml_text(entry).rstrip()]
    missing = [name for name in known if name not in columns]
    if missing:
        lines += ["", f"# without a source: {', '.join(missing)}"]
    used = {it.source for it in columns.values()}
    for name, values in signals_and_units(log)[0].items():
        if name not in used:
            shown = values[np.isfinite(values)]
            extent = f"{shown.min():.6g} ... {shown.max():.6g}" if shown.size else "no numbers"
            lines.append(f"# not used: {name}, {values.shape[-1]} values, {extent}")
    return "\n".join(lines) + "\n"


def _bare(name: str) -> tuple[str, str, str]:
    """(words, unit, side) in a signal's name: `I1 (mA)` has i, mA, 1."""
    text = name.rpartition(".")[2] if re.search(r"\.[A-Za-z]\w*$", name) else name
    match = re.search(r"[(\[]([^)\]]+)[)\]]", text)
    unit = match[1] if match else ""
    text = re.sub(r"[(\[].*?[)\]]", "", text).strip().lower()
    word, _, last = text.rpartition("_")
    if not unit and word and last in UNITS_IN_NAMES:
        text, unit = word, last
    side = re.search(r"([12])\D*$", text)
    words = re.sub(r"[\s_-]*\d+", "", text).strip(" _-")
    return words, unit, side[1] if side else ""


def _column_of(name: str, values: Array, known: list[str], taken: Mapping[str, object]) -> str:
    """The column that a name means; empty where none does or it is taken."""
    words, _, side = _bare(name)
    for quantity, pattern in WORDS.items():
        if not re.fullmatch(pattern, words) or (quantity == "time" and not _is_time(values)):
            continue
        for column in (Channel(quantity).column, *(Channel(quantity, s).column for s in _sides(side))):
            if column in known and column not in taken:
                return column
    return ""


def _sides(side: str) -> tuple[int, ...]:
    return (int(side),) if side else (1, 2)


def _is_time(values: Array) -> bool:
    step = np.diff(values[np.isfinite(values)])
    return bool(step.size and step.min() >= 0 and step.max() > 0)


def _time_by_values(signals: Mapping[str, Array], taken: Mapping[str, ProposedColumn]) -> dict[str, ProposedColumn]:
    used = {it.source for it in taken.values()}
    for name, values in signals.items():
        if name not in used and _is_time(values):
            step = float(np.median(np.diff(values)))
            return {
                "time_s": ProposedColumn(name, remarks=(f"it never falls, in steps of {step:.4g}: in which unit?",))
            }
    return {}


def _with_unit(name: str, told: str, column: str, values: Array, actuator: Actuator | None) -> ProposedColumn:
    unit = CHANNELS[column].unit
    for text in (told, _bare(name)[1]):
        spelled = SPELLED.get(text.lower().strip(), text.strip())
        with contextlib.suppress(QuantityError):
            if spelled and parse_quantity(f"1 {spelled}", unit):
                return ProposedColumn(name, spelled if spelled != unit else "")
    if told:
        remark = (
            f'the log says {told}, which is no {CHANNELS[column].quantity}: write scale = "... {unit}" for one {told}'
        )
        return ProposedColumn(name, remarks=(remark,))
    return _unit_by_size(name, column, values, actuator)


def _unit_by_size(name: str, column: str, values: Array, actuator: Actuator | None) -> ProposedColumn:
    """A position's unit as the one in which its travel fits the gap; others are taken in SI units, which is said."""
    gap = actuator.motion.nominal_gap if actuator is not None and actuator.motion is not None else None
    quantity = CHANNELS[column].quantity
    if quantity in ("position", "reference") and gap and _readings(values).size:
        travel = float(np.ptp(_readings(values)))
        for unit, factor in (("m", 1.0), ("mm", 1e-3), ("um", 1e-6)):
            if travel * factor <= 2 * gap:
                remark = f"no unit in the log: the travel of {travel:.4g} fits the gap in {unit}"
                return ProposedColumn(name, "" if unit == "m" else unit, remarks=(remark,))
    return ProposedColumn(name, remarks=(f"no unit in the log: taken in {CHANNELS[column].unit}",))


def _with_signs(columns: dict[str, ProposedColumn], signals: Mapping[str, Array]) -> dict[str, ProposedColumn]:
    """Signs that physics tells: a coil takes power, a current follows its command, a force works on a damped mover."""
    pairs = []
    for side in (1, 2):
        pairs.append((f"voltage_{side}_V", f"current_{side}_A", "a coil takes power, so u i is positive in the mean"))
        pairs.append((f"command_{side}_A", f"current_{side}_A", "a current follows its command"))
    for first, second, why in pairs:
        if first in columns and second in columns:
            one, other = (_as_read(signals[columns[name].source]) for name in (first, second))
            columns[second] = _turned(columns[second], one * other, why)
    if "force_N" in columns and "position_m" in columns and "current_1_A" not in columns:
        force, position = (_as_read(signals[columns[name].source]) for name in ("force_N", "position_m"))
        work = 0.5 * (force[1:] + force[:-1]) * np.diff(position)
        columns["position_m"] = _turned(columns["position_m"], work, "a force does work on a damped mover")
    return columns


def _as_read(values: Array) -> Array:
    """The values, nan where no sensor shows them."""
    return np.where(np.abs(values) <= LARGEST, values, np.nan)


def _readings(values: Array) -> Array:
    """The values that a sensor can show."""
    return values[np.abs(values) <= LARGEST]


def _turned(column: ProposedColumn, product: Array, why: str) -> ProposedColumn:
    product = product[np.isfinite(product)]
    total, amounts = float(np.sum(product)), float(np.sum(np.abs(product)))
    if total < -CLEAR * amounts:
        return replace(column, scale=-1.0, remarks=(*column.remarks, f"turned round: {why}"))
    return column
