"""Single readings that stand far from their neighbours: found, counted, and left out of residuals.

A reading y_k is compared with the cubic through its four neighbours, (4 (y_(k-1) + y_(k+1)) - y_(k-2) - y_(k+2))/6. The
scale of such differences is local, the median of their sizes around over that of a normal distribution (Hampel, J. Am.
Stat. Assoc. 69, 1974, 383-393), so that fast motion and noise of any kind raise it. A command that jumps makes corners
of its own, near which nothing is left out. What is left out is the residual of a spike and its neighbours, for which a
straight line stands: a corner that was taken for a spike by mistake, and that the model has, costs nothing.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.left_out import LeftOut
from msl_fem.prediction import RunData
from msl_fem.record.columns import Channel

SPIKE = 8.0
"""Times the local scale, from which a reading is a spike."""
NORMAL_MEDIAN = 0.6745  # of a normal distribution's size, over its sigma
AROUND = 101  # samples that tell the local scale
BEHIND = 5  # samples of a jump of the command in which corners are its own
REACH = 2  # samples to both sides that a spike shows at
WIDEST = 8  # samples at which a spike shows; what is wider moves
MOST = 0.005
"""Share of a run's readings, above which what stands out is no spikes."""


def without_spikes(data: RunData) -> RunData:
    """A run that knows its spikes. Voltages have none: an amplifier's are as sudden as its command."""
    names = [name for name in data.measured if Channel.of(name).quantity != "voltage"]
    calm = ~_jumping(data.commands)
    found = {name: spikes(data.measured[name], calm, _counted(data, name)) for name in names}
    return replace(data, spikes={name: at for name, at in found.items() if at.size})


def about_spikes(runs: Sequence[RunData]) -> tuple[LeftOut, ...]:
    """What is left out of each run."""
    found = []
    for run in runs:
        for name, at in run.spikes.items():
            found.append(LeftOut.of(run, at, f"they lie at {len(_parts(at))} spikes", channel=name))
    return tuple(found)


def spikes(values: Array, calm: NDArray[np.bool_], counted: NDArray[np.bool_] | None = None) -> NDArray[np.intp]:
    """The samples of a reading (n_sample,) at spikes, where `calm` and `counted`; none where more than `MOST`."""
    away = _off_neighbours(values)
    counts = np.ones(values.size, dtype=bool) if counted is None else counted
    scale = np.full(values.size, np.inf)
    if counts.sum() >= AROUND:  # a line in place of readings has no noise, and would tell too small a scale
        scale[counts] = _local_scale(away[counts])
    at = np.flatnonzero((np.abs(away) > SPIKE * scale) & calm)
    narrow = [part for part in _parts(at) if part.size and part[-1] - part[0] < WIDEST]
    found = np.concatenate([at[:0], *narrow])
    return found if found.size <= MOST * values.size else at[:0]


def _parts(at: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Samples in their order, taken apart where nothing shows between them."""
    return np.split(at, np.flatnonzero(np.diff(at) > REACH) + 1)


def _off_neighbours(values: Array) -> Array:
    """(n_sample,) a reading less the cubic through its neighbours, 0 at the ends."""
    away = np.zeros(values.size)
    near, far = values[1:-3] + values[3:-1], values[:-4] + values[4:]
    away[2:-2] = values[2:-2] - (4 * near - far) / 6
    return away


def _local_scale(away: Array) -> Array:
    """(n_sample,) of differences, those at the ends left out."""
    inner = median_filter(np.abs(away[2:-2]), AROUND, mode="reflect") / NORMAL_MEDIAN
    return np.pad(inner, 2, mode="edge")


def _counted(data: RunData, name: str) -> NDArray[np.bool_]:
    """(n_sample,) where a reading counts and is not next to one that does not: a line in its place has corners."""
    invalid = np.zeros(len(data.commands), dtype=bool)
    invalid[data.invalid.get(name, [])] = True
    return np.convolve(invalid, np.ones(2 * REACH + 1), "same") < 0.5


def _jumping(commands: Array) -> NDArray[np.bool_]:
    """(n_sample,) where a command jumps, or has just jumped."""
    jump = np.zeros(len(commands), dtype=bool)
    for column in commands.T:
        away = np.abs(np.diff(column, prepend=column[:1]))
        scale = np.asarray(median_filter(away, AROUND, mode="nearest")) / NORMAL_MEDIAN
        jump |= (away > SPIKE * scale) & (away > 0)
    return np.convolve(jump, np.ones(2 * BEHIND + 1), "same") > 0
