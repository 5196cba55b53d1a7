"""Position, current and flux sensors that are stuck or clipped, and which readings a clipped one gave."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.record.columns import CHANNELS, Channel
from msl_fem.record.record import Run

STUCK_SHARE = 0.01
FLANK = 4
"""Samples to either side of a flat top that tell the slope of its flanks."""


def doubtful_sensors(run: Run, actuator: Actuator, *, file: Path | str) -> list[str]:
    """One warning for each sensor that is stuck or clipped for more than 1 % of the run, with the samples.

    Stuck is one stretch of equal values that long; clipped is that many samples at the largest or the smallest value,
    five times as many as at the value next to it (the crest of a quantised sine has 2.4 times as many).
    """
    warnings: list[str] = []
    if run.time.size == 0:  # which `check_run` refuses
        return warnings
    sensors = {"position", "current", "flux_linkage"}
    if actuator.drive is None or actuator.drive.kind != "voltage":
        sensors.add("voltage")
    for name, values in run.columns.items():
        channel = CHANNELS.get(name)
        if channel is None or channel.quantity not in sensors:
            continue
        if channel.quantity == "position" and run.mover == "locked":
            continue
        command = None
        if channel.quantity == "current":
            command = run.columns.get(Channel("command", channel.side).column)
        start, end = _equal_stretches(values)
        clipped = np.isin(values[start], _clipped_levels(values, command=command))
        doubtful = _stuck(start, end, command=command) | clipped
        if doubtful.any():
            share = (end - start)[doubtful].sum() / values.size
            warnings.append(
                f"{file}: {name} is stuck or clipped in {share:.2g} of the run, "
                f"samples {_ranges(start[doubtful], end[doubtful])}"
            )
    return warnings


def _equal_stretches(values: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First sample and the sample behind the last one of each stretch of equal values."""
    change = np.flatnonzero(np.diff(values)) + 1
    return np.concatenate(([0], change)), np.concatenate((change, [values.size]))


def _stuck(start: NDArray[np.intp], end: NDArray[np.intp], *, command: Array | None) -> NDArray[np.bool_]:
    """Which stretches are too long for a live sensor; not those in which a standing command tells it to stand still."""
    stuck = end - start > STUCK_SHARE * end[-1]
    for k in np.flatnonzero(stuck):
        stuck[k] = command is None or np.ptp(command[start[k] : end[k]]) > 0
    return stuck


def _clipped_levels(values: Array, *, command: Array | None) -> list[float]:
    """The smallest and the largest value, where a sensor spends so much time there that it seems to be clipped."""
    levels, counts = np.unique(values, return_counts=True)
    if levels.size <= 2:
        return []
    clipped = []
    for edge, beside in ((0, 1), (-1, -2)):
        often = counts[edge] > max(STUCK_SHARE * values.size, 5 * counts[beside])
        if often and (command is None or np.ptp(command[values == levels[edge]]) > 0):
            clipped.append(float(levels[edge]))
    return clipped


def _ranges(start: NDArray[np.intp], end: NDArray[np.intp], *, shown: int = 3) -> str:
    texts = []
    for first, behind in zip(start[:shown], end[:shown], strict=True):
        texts.append(f"{first} ... {behind - 1}" if behind - first > 1 else f"{first}")
    text = ", ".join(texts)
    if start.size > shown:
        text += f" and {start.size - shown} stretches more up to {end[-1] - 1}"
    return text


def clipped_samples(values: Array) -> NDArray[np.intp]:
    """The samples of a reading (n_sample,) that a clipped sensor gave: flat tops at its largest or smallest value whose
    flanks lead beyond it by more than the step to the value beside.

    A mover at rest and the crest of a quantised sine have no such flanks. Half a sine's excursion beyond a level that
    it stays above for a time T with slopes s at either end is s T/4.
    """
    if values.size < 2:
        return np.zeros(0, dtype=np.intp)
    levels = _clipped_levels(values, command=None)
    sorted_levels = np.unique(values)
    start, end = _equal_stretches(values)
    found = [np.zeros(0, dtype=np.intp)]
    for level in levels:
        top = level == sorted_levels[-1]
        beside = sorted_levels[-1] - sorted_levels[-2] if top else sorted_levels[1] - sorted_levels[0]
        outward = values if top else -values
        flat = (values[start] == level) & (end - start > 2) & (start > 0) & (end < values.size)
        for first, behind in zip(start[flat], end[flat], strict=True):
            before, after = max(first - FLANK, 0), min(behind - 1 + FLANK, values.size - 1)
            rise = (outward[first] - outward[before]) / (first - before)
            fall = (outward[behind - 1] - outward[after]) / (after - behind + 1)
            if min(rise, fall) * (behind - first) / 4 > beside:
                found.append(np.arange(first, behind))
    return np.concatenate(found)
