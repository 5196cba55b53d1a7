"""Whether a map's curves rise with the gap, and if not, why."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.files.quantity import format_quantity

Array = NDArray[np.float64]


def monotone_or_why_not(
    levels: Array, gap: Array, current: Array, *, error: Array, section: tuple[tuple[str, ...], ...], cause: str
) -> tuple[str, ...]:
    """One sentence for each two gaps between which a curve falls; a larger gap should need more current.

    A level that is reached at a gap and was not at a smaller one counts as falling. `cause` says where to look if
    neither the currents' error nor a change of the loading section explains it.
    """
    found = []
    for k, level in enumerate(levels):
        filled = np.where(np.isnan(current[k]), np.inf, current[k])
        for m in np.flatnonzero(filled[1:] < filled[:-1]):
            before, after = (section[k][j].replace("_", " ") for j in (m, m + 1))
            if not np.isfinite(filled[m]):
                why = "the level is not reached at the smaller gap"
            elif filled[m] - filled[m + 1] <= error[k, m] + error[k, m + 1]:
                why = "the fall lies within the stated error of the currents"
            elif before != after:
                why = f"the loading section changes from {before} to {after}"
            else:
                why = f"a larger gap should need more current; {cause}"
            found.append(
                f"the {level:g} T curve falls between gaps {format_quantity(gap[m], 'm')} and "
                f"{format_quantity(gap[m + 1], 'm')} ({filled[m]:.4g} to {filled[m + 1]:.4g} A): {why}"
            )
    return tuple(found)
