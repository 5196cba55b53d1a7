"""All of a pair's grid from the part that is solved.

Exchanging the sides and reversing both currents are exact. What each side does alone is that of the accurate mesh, what
both have in common that of the coarse one.
"""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.row_cache import Arrays
from msl_fem.magnetics.sweep.pair_rows import PairSweepRow
from msl_fem.table.magnetic_table import SECTION
from msl_fem.table.pair_surface import DERIVATIVES
from msl_fem.table.pair_table import MIRRORED, PAIR_NODES

_KEYS = dict(zip(PAIR_NODES, DERIVATIVES, strict=True))


def needed(position: float, current_1: float, both: Array) -> tuple[float, ...]:
    """The currents of side 2 that no symmetry gives: in the middle the sides may be exchanged, too."""
    if current_1 == 0.0:
        kept = both >= 0
    elif position == 0.0:
        kept = np.abs(both) <= current_1
    else:
        kept = np.ones(both.size, dtype=bool)
    return tuple(both[kept].tolist())


def by_symmetry(half_x: Array, half_i: Array, rows: list[PairSweepRow], answers: list[Arrays]) -> dict[str, Array]:
    """The arrays over all positions and both signs of both currents; nan where no answer has a quantity."""
    n_x, n_i = half_x.size, half_i.size
    told = [name for name in answers[0] if name in PAIR_NODES or name.startswith(SECTION)]
    names = dict.fromkeys([*told, *PAIR_NODES])
    shape = 2 * n_x - 1, 2 * n_i - 1, 2 * n_i - 1
    arrays = {name: np.full(shape, np.nan) for name in names}
    both = np.r_[-half_i[:0:-1], half_i]
    place = {float(v): k for k, v in enumerate(both)}
    at_x = {float(v): k for k, v in enumerate(np.r_[-half_x[:0:-1], half_x])}
    for row, answer in zip(rows, answers, strict=True):
        x, i = row.position, row.current_1
        for k, j in enumerate(row.currents_2):
            for name in told:
                value = answer[name][k]
                # as solved, with both currents reversed, with the sides exchanged, and both
                odd = -1.0 if name.startswith("flux_linkage") or name.startswith("force_current") else 1.0
                other, sign = _exchanged(name)
                arrays[name][at_x[x], place[i], place[j]] = value
                arrays[name][at_x[x], place[_negative(i)], place[_negative(j)]] = odd * value
                arrays[other][at_x[_negative(x)], place[j], place[i]] = sign * value
                arrays[other][at_x[_negative(x)], place[_negative(j)], place[_negative(i)]] = odd * sign * value
    return arrays


def _negative(value: float) -> float:
    return -value if value else 0.0


def _exchanged(name: str) -> tuple[str, float]:
    """What a quantity is called, and its sign, when the sides are exchanged."""
    pairs = MIRRORED | {other: (name, sign) for name, (other, sign) in MIRRORED.items()}
    if name in pairs:
        return pairs[name]
    for here, there in (("_1", "_2"), ("_2", "_1")):
        if name.startswith(SECTION) and name.endswith(here):
            return name[: -len(here)] + there, 1.0
    return name, 1.0


def with_each_alone(coarse: dict[str, Array], alone: dict[str, Array]) -> dict[str, Array]:
    """The arrays (n_x, n_1, n_2) of a coarse mesh, whose sides alone are those of an accurate one.

    `alone` has numbers where one of the currents, the middle one, is 0. With e their difference, the coenergy gets
    e(x, i, 0) + e(x, 0, j) - e(x, 0, 0), and the others the derivatives of that; flux densities are scaled by what the
    sections have of either side alone.
    """
    middle = next(iter(coarse.values())).shape[1] // 2
    nothing = np.zeros(1)
    made = {}
    for name, values in coarse.items():
        first, second = ((a[:, :, middle, None], a[:, None, middle]) for a in (alone[name], values))
        if name.startswith(SECTION):
            exact, found = first[0] + first[1], second[0] + second[1]
            made[name] = values * np.divide(exact, found, out=np.ones_like(found), where=found > 0)
            continue
        of_1, of_2 = (exact - found for exact, found in zip(first, second, strict=True))
        key = _KEYS[name]
        of_both = of_1 + of_2 - of_1[:, middle, None]
        along = {(True, True): nothing, (True, False): of_1, (False, True): of_2, (False, False): of_both}
        made[name] = values + along["1" in key, "2" in key]
    return made
