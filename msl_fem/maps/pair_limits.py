"""The operating map of a pair: how much current side 1 bears, by the armature's position and the other side's current.

Both magnets' fluxes meet in the armature. With opposing currents they add there, and two currents that either side
bears alone can drive it far beyond its level; so the limit of one current is a function of the other one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.maps.level_currents import LARGEST_CURRENT, LARGEST_GAP, LEVELS, checked_levels
from msl_fem.table.magnetic_table import SECTION
from msl_fem.table.pair_table import PairTable

OPPOSING, AIDING = 0, 1
RELATIONS = ("opposing", "aiding")
"""How the fluxes of both currents meet in the armature: currents of different signs oppose, equal signs aid."""
FINE = 401  # currents at which a level is looked for
FINE_SHARES = np.linspace(0.0, 1.0, 2001)
THINNING_GAIN = 3.0  # on nodes twice as far apart a spline's error is 8 to 16 times as large; counted as 3
SAG_MARGIN = 1.25  # the largest sag in a cell over that at its middles
INNER = 2  # of the points at which the sag is looked for, a cell of the map
N_POSITION, N_OTHER = 33, 41  # nodes of the map
SAME = 1e-9


@dataclass(frozen=True, eq=False)
class PairMap:
    """Currents of side 1 up to which its own iron and the armature stay below each level of flux density.

    Side 2 follows by exchanging the sides: position and currents change places.

    Attributes
    ----------
    levels : (n_level,) T, increasing
    position : (n_x,) m, of the armature towards side 1, in equal steps, the same on both sides of 0
    other : (n_j,) A, size of the current of a magnet of the other side, in equal steps from 0
    current : (2, n_level, n_x, n_j) A, for opposing and for aiding currents; below 0 where the other side alone
        overloads the armature, the end of the table where the level is not reached
    allowance : the same shape, A, what a guard takes off so that it stays below between the nodes
    polarity : how positive currents of the actuator's sides meet: opposing or aiding
    actuator, digest : its name and the hash of its content; empty where not known
    provenance : how the map was made
    """

    levels: Array
    position: Array
    other: Array
    current: Array
    allowance: Array
    polarity: str = "opposing"
    actuator: str = ""
    digest: str = ""
    provenance: Mapping[str, object] | None = None

    def __post_init__(self) -> None:
        _check(self)

    @property
    def current_max(self) -> float:
        """A: the largest current that the map judges."""
        return float(self.other[-1])

    def equal_currents(self, position: float = 0.0) -> Array:
        """(2, n_level) A: the largest current that both sides may carry at once at a position; 0 where there is none.

        What a polarity costs: with opposing currents the armature carries the sum of both fluxes.
        """
        found = np.zeros((len(RELATIONS), self.levels.size))
        for relation, k in np.ndindex(found.shape):
            bears = []
            for x in (position, -position):
                along_x = [np.interp(x, self.position, column) for column in self.current[relation, k].T]
                bears.append(np.interp(FINE_SHARES * self.current_max, self.other, along_x))
            within = np.min(bears, axis=0) >= FINE_SHARES * self.current_max
            found[relation, k] = FINE_SHARES[np.flatnonzero(within)[-1]] * self.current_max if within.any() else 0.0
        return found


def _check(record: PairMap) -> None:
    axes = (record.levels, record.position, record.other)
    for name, nodes in zip(("levels", "positions", "other currents"), axes, strict=True):
        fewest = 1 if name == "levels" else 2
        if nodes.ndim != 1 or nodes.size < fewest or not np.isfinite(nodes).all() or not (np.diff(nodes) > 0).all():
            raise InputError(f"{name} of a pair's map must be {fewest} or more increasing numbers")
    checked_levels(record.levels)
    if record.other[0] != 0 or record.other[-1] > LARGEST_CURRENT or record.position[-1] > LARGEST_GAP:
        raise InputError(
            f"other currents of a pair's map begin at 0 A and end at {LARGEST_CURRENT:g} A at most, positions at "
            f"{LARGEST_GAP:g} m; look at the units"
        )
    even = np.linspace(-record.position[-1], record.position[-1], record.position.size)
    if not np.allclose(record.position, even, rtol=0, atol=SAME * abs(record.position[-1])):
        raise InputError("the positions of a pair's map must have equal steps, the same on both sides of 0")
    if not np.allclose(record.other, np.linspace(0, record.other[-1], record.other.size), rtol=0, atol=SAME):
        raise InputError("the other currents of a pair's map must have equal steps from 0 A")
    shape = (len(RELATIONS), *(nodes.size for nodes in axes))
    for name in ("current", "allowance"):
        values = getattr(record, name)
        if values.shape != shape or not np.isfinite(values).all():
            raise InputError(f"{name} of a pair's map must be finite, of shape {shape}; it has {values.shape}")
    if (record.allowance < 0).any():
        raise InputError("allowances of a pair's map must be 0 or more")
    if record.polarity not in RELATIONS:
        raise InputError(f"polarity '{record.polarity[:40]}' is not known; choose {' or '.join(RELATIONS)}")


def pair_map(table: PairTable, *, levels: Sequence[float] = LEVELS, polarity: str = "opposing") -> PairMap:
    """The map of a pair from its table, by the criterion `mean`: |B| averaged over the most loaded section.

    Flux densities between the table's nodes are monotone along the currents (PCHIP: Fritsch and Carlson, SIAM J. Numer.
    Anal. 17 (1980) 238) and cubic along the position. The allowance is the sum of three parts: how far straight lines
    between the map's nodes lie above it, a third of what every second node of the table would change, and the
    table's stated mesh error.

    Raises
    ------
    InputError : a table without flux densities of its sections, or that does not hold both signs of a current
    """
    if not table.sections:
        raise InputError("the table holds no flux densities of sections; make it with 'msl-fem table --sides both'")
    if table.current_1[0] != -table.current_1[-1] or table.current_2[0] != -table.current_2[-1]:
        raise InputError("a map of a pair needs a table with both signs of both currents")
    level = np.asarray(levels, dtype=float)
    position = np.linspace(table.position[0], table.position[-1], N_POSITION)
    other = np.linspace(0.0, table.current_2[-1], N_OTHER)
    currents = _limits(table, level, position, other)
    sag = _sag(table, level, position, other)
    thinned = [
        np.abs(currents - _limits(table, level, position, other, every=every)) / THINNING_GAIN
        for every in ((2, 1, 1), (1, 2, 1), (1, 1, 2))
    ]
    mesh = 0.0 if np.isnan(table.mesh_error) else table.mesh_error
    allowance = SAG_MARGIN * sag + np.sum(thinned, axis=0) + mesh * np.abs(currents)
    return PairMap(
        level,
        position,
        other,
        currents,
        allowance,
        polarity=polarity,
        actuator=str(table.provenance.get("actuator", "")),
        digest=str(table.provenance.get("actuator_sha256", "")),
        provenance=dict(table.provenance),
    )


def _between(nodes: Array) -> Array:
    """The nodes and `INNER` - 1 points between each two."""
    inner = [nodes[:-1] + np.diff(nodes) * k / INNER for k in range(INNER)]
    return np.sort(np.concatenate([*inner, nodes[-1:]]))


def _limits(
    table: PairTable, levels: Array, position: Array, other: Array, *, every: tuple[int, int, int] = (1, 1, 1)
) -> Array:
    """(2, n_level, n_x, n_j) A: see `PairMap.current`; `every` leaves nodes of the table out."""
    fine = table.current_1[-1] * np.linspace(-1, 1, FINE) * np.abs(np.linspace(-1, 1, FINE))
    found = np.full((len(RELATIONS), levels.size, position.size, other.size), np.inf)
    for name in table.sections:
        if name.endswith("_2"):
            continue
        for relation, sign in ((OPPOSING, -1.0), (AIDING, 1.0)):
            b = _flux_density(table, name, (position, fine, sign * other), every)
            for k, value in enumerate(levels):
                found[relation, k] = np.minimum(found[relation, k], _last_rise(fine, b, float(value)))
    return found


def _flux_density(
    table: PairTable, section: str, points: tuple[Array, Array, Array], every: tuple[int, int, int]
) -> Array:
    """(n_x, n_1, n_2) T between the table's nodes."""
    from scipy.interpolate import PchipInterpolator, make_interp_spline  # not for who reads a map

    kept = [_kept(nodes, step) for nodes, step in zip(table.axes, every, strict=True)]
    values = np.asarray(table.extras[SECTION + section])[np.ix_(*kept)]
    position, one, two = (nodes[k] for nodes, k in zip(table.axes, kept, strict=True))
    values = PchipInterpolator(two, values, axis=2)(points[2])
    values = PchipInterpolator(one, values, axis=1)(points[1])
    spline = make_interp_spline(position, np.eye(position.size), k=min(3, position.size - 1))
    return np.tensordot(spline(points[0]), values, axes=1)  # what it does to each unit vector is all that it does


def _kept(nodes: Array, step: int) -> NDArray[np.int64]:
    """Every so many nodes counted from the middle, both ends among them."""
    middle = nodes.size // 2
    chosen = np.arange(middle % step, nodes.size, step)
    return np.unique(np.r_[0, chosen, nodes.size - 1])


def _last_rise(current: Array, b: Array, level: float) -> Array:
    """(n_x, n_j) A: the current above which b (n_x, n_i, n_j) rises past the level for good; the end where it does not.

    Coming from the end of the currents: the first that is not above the level, and the straight line to the next.
    """
    above = b > level
    last_below = b.shape[1] - 1 - np.argmax(~above[:, ::-1, :], axis=1)
    never = above.all(axis=1)
    k = np.minimum(last_below, b.shape[1] - 2)
    low, high = (np.take_along_axis(b, (k + step)[:, None, :], axis=1)[:, 0, :] for step in (0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip((level - low) / (high - low), 0.0, 1.0)
    crossing = current[k] + share * (current[k + 1] - current[k])
    crossing = np.where(last_below == b.shape[1] - 1, current[-1], crossing)
    return np.where(never, current[0], crossing)


def _sag(table: PairTable, levels: Array, position: Array, other: Array) -> Array:
    """A, at the map's nodes: how far bilinear interpolation lies above the limits in the cells around, at most."""
    finer_x, finer_j = _between(position), _between(other)
    exact = _limits(table, levels, finer_x, finer_j)
    coarse = exact[:, :, ::INNER, ::INNER]
    along = [_shares(nodes, finer) for nodes, finer in ((position, finer_x), (other, finer_j))]
    straight = np.einsum("ax,rkxj,bj->rkab", along[0], coarse, along[1])
    above = np.maximum(straight - exact, 0.0)
    padded = np.pad(above, ((0, 0), (0, 0), (INNER, INNER), (INNER, INNER)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * INNER + 1, 2 * INNER + 1), axis=(2, 3))
    return np.asarray(windows.max(axis=(-1, -2))[:, :, ::INNER, ::INNER])


def _shares(nodes: Array, at: Array) -> Array:
    """(n_at, n_node) weights of linear interpolation."""
    return np.stack([np.interp(at, nodes, row) for row in np.eye(nodes.size)], axis=1)
