"""What two sides with one armature have in common: a coenergy D(x, u_1, u_2) beside those of each side alone.

Mutual inductance that is one number has D = M u_1 u_2. The table of a pair has the whole D, mutual flux and the
armature's saturation, as triquintic cells (`table.pair_surface`). Flux linkages, mutual inductance and force are its
slopes, so no closed path yields energy. Equal signs of the magnets' currents aid; `polarity` turns that of side 2.

With effects D is taken at half the difference of the gaps, with the sides' share of turns and, of their mean gap, the
same factor as theirs; a tilted armature's is that of a parallel one.
"""

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, Value, every, fma, lane_of, set_lane, width
from msl_fem.computing.quintic_cell import N_CELL, PADDED
from msl_fem.plant.effects import magnetic, stray_flux
from msl_fem.plant.layout import (
    CIRCUIT_1,
    CIRCUIT_2,
    MUTUAL,
    MUTUAL_CELL,
    MUTUAL_HIGH,
    MUTUAL_LEFT,
    MUTUAL_LOW,
    MUTUAL_POINT,
    MUTUAL_RISE,
    MUTUAL_VALUE,
    SHARED,
    SHARED_ENERGY,
    SHARED_FLUX,
    SHARED_INDUCTANCE,
    SHARED_PULL,
    SHARED_SLOPE,
)
from msl_fem.plant.plant import PlantParameters
from msl_fem.plant.side import Cells, MutualCells, lower_node, side_gap, upper_edge

Three = tuple[Value, Value, Value]
Nine = tuple[Value, Value, Value, Value, Value, Value, Value, Value, Value]


@compiled
def set_mutual_flux(cells: Cells, p: PlantParameters, e: Rows, work: Rows, u_1: Value, u_2: Value) -> Flag:
    """What the sides have in common at the currents, and at the gaps of Y, into its rows; False outside the table."""
    return _in_common(cells.mutual, p, e, work, u_1, u_2)


@compiled
def shared(cells: Cells, work: Rows, row: int, value: Value) -> Value:
    """The value and what a pair's table adds to it, from that row."""
    return _and_table(cells.mutual, work, row, value)


@compiled
def are_coupled(cells: Cells) -> bool:
    """Whether the sides have a table in common."""
    return _is_there(cells.mutual)


@compiled
def _is_there(mutual: MutualCells | None) -> bool:
    return mutual is not None


@compiled
def _and_table(mutual: MutualCells | None, work: Rows, row: int, value: Value) -> Value:
    if mutual is None:
        return value
    else:
        return value + work[row]


@compiled
def _in_common(
    mutual: MutualCells | None, p: PlantParameters, e: Rows, work: Rows, u_1: Value, u_2: Value
) -> Flag:  # fmt: skip
    constant = _constant(p, e)
    work[MUTUAL] = constant
    work[CIRCUIT_1 + SHARED_FLUX] = constant * u_2
    work[CIRCUIT_2 + SHARED_FLUX] = constant * u_1
    work[SHARED_ENERGY] = constant * u_1 * u_2
    if mutual is None:
        return u_1 == u_1
    else:
        gap_1, gap_2 = side_gap(p, e, work, 0), side_gap(p, e, work, 1)
        share, depth = _share_and_depth(p, e, 0.5 * (gap_1 + gap_2))
        share_2 = share * p.polarity
        point = 0.5 * (gap_2 - gap_1), share * u_1, share_2 * u_2
        inside = _enter_cell(mutual, work, point)
        w, w_x, w_1, w_2, w_11, w_22, w_12, w_1x, w_2x = _cell_values(work, point, mutual.n_power)
        turns_1, turns_2 = depth * share, depth * share_2
        flux_1, flux_2 = turns_1 * w_1, turns_2 * w_2
        work[SHARED_PULL] = depth * w_x
        work[MUTUAL] = work[MUTUAL] + turns_1 * share_2 * w_12
        work[CIRCUIT_1 + SHARED_INDUCTANCE] = turns_1 * share * w_11
        work[CIRCUIT_2 + SHARED_INDUCTANCE] = turns_2 * share_2 * w_22
        work[CIRCUIT_1 + SHARED_SLOPE] = turns_1 * w_1x
        work[CIRCUIT_2 + SHARED_SLOPE] = turns_2 * w_2x
        work[CIRCUIT_1 + SHARED_FLUX] = work[CIRCUIT_1 + SHARED_FLUX] + flux_1
        work[CIRCUIT_2 + SHARED_FLUX] = work[CIRCUIT_2 + SHARED_FLUX] + flux_2
        work[SHARED_ENERGY] = work[SHARED_ENERGY] + (flux_1 * u_1 + flux_2 * u_2 - depth * w)
        return inside


@compiled
def _constant(p: PlantParameters, e: Rows) -> Value:
    """The mutual inductance in H that is one number."""
    if e is None:
        return p.mutual
    else:
        return p.mutual + e[stray_flux.MUTUAL_INDUCTANCE]


@compiled
def _share_and_depth(p: PlantParameters, e: Rows, mean_gap: Value) -> tuple[Value, Value]:
    """A magnet's current over its side's, and by how many magnets the coenergy of one of each side is taken."""
    if e is None:
        return p.current_share, p.magnets + (mean_gap - mean_gap)
    else:
        depth = e[magnetic.DEPTH] + e[magnetic.GROWTH] * mean_gap
        return p.current_share * e[magnetic.CURRENT_SCALE], p.magnets * depth


@compiled
def _enter_cell(mutual: MutualCells, work: Rows, point: Three) -> Flag:
    """True where the rows hold the cell of the point; False outside the table, or not a number."""
    inside = _inside_cell(work, point)
    if not every(inside):
        _move(mutual, work, point)
        inside = _inside_cell(work, point)
    return inside


@compiled
def _inside_cell(work: Rows, point: Three) -> Flag:
    x, u, v = point
    low, high = SHARED + MUTUAL_LOW, SHARED + MUTUAL_HIGH
    of_position = (work[low] <= x) & (x < work[high])
    of_first = (work[low + 1] <= u) & (u < work[high + 1])
    return of_position & of_first & ((work[low + 2] <= v) & (v < work[high + 2]))


@compiled
def _move(mutual: MutualCells, work: Rows, point: Three) -> None:
    """Fills the rows in all lanes that have left their cell; not in those that have left the table."""
    low, high, wanted = SHARED + MUTUAL_LOW, SHARED + MUTUAL_HIGH, SHARED + MUTUAL_POINT
    work[wanted], work[wanted + 1], work[wanted + 2] = point
    for lane in range(width(work)):
        k = lower_node(mutual.position, mutual.n_position, lane_of(work, wanted, lane))
        m = lower_node(mutual.current_1, mutual.n_current_1, lane_of(work, wanted + 1, lane))
        n = lower_node(mutual.current_2, mutual.n_current_2, lane_of(work, wanted + 2, lane))
        if k >= 0 and m >= 0 and n >= 0:
            start = ((k * (mutual.n_current_1 - 1) + m) * (mutual.n_current_2 - 1) + n) * N_CELL
            for q in range(N_CELL):
                set_lane(work, SHARED + MUTUAL_CELL + q, lane, mutual.coefficients[start + q])
            set_lane(work, low, lane, mutual.position[k])
            set_lane(work, high, lane, upper_edge(mutual.position, mutual.n_position, k))
            set_lane(work, low + 1, lane, mutual.current_1[m])
            set_lane(work, high + 1, lane, upper_edge(mutual.current_1, mutual.n_current_1, m))
            set_lane(work, low + 2, lane, mutual.current_2[n])
            set_lane(work, high + 2, lane, upper_edge(mutual.current_2, mutual.n_current_2, n))


@compiled
def _cell_values(work: Rows, point: Three, n_power: int) -> Nine:
    """(D, D_x, D_1, D_2, D_11, D_22, D_12, D_1x, D_2x) at a point of the rows' cell, by Horner's rule."""
    low = SHARED + MUTUAL_LOW
    x, u, v = point[0] - work[low], point[1] - work[low + 1], point[2] - work[low + 2]
    _along_position(work, x)
    _along_second(work, v, n_power)
    row = SHARED + MUTUAL_LEFT
    w = w_x = w_1 = w_2 = w_11 = w_22 = w_12 = w_1x = w_2x = x - x
    for q in range(5, -1, -1):
        w_11 = fma(w_11, u, w_1)
        w_1 = fma(w_1, u, w)
        w = fma(w, u, work[row + q])
        w_12 = fma(w_12, u, w_2)
        w_2 = fma(w_2, u, work[row + PADDED + q])
        w_22 = fma(w_22, u, work[row + 2 * PADDED + q])
        w_1x = fma(w_1x, u, w_x)
        w_x = fma(w_x, u, work[row + 3 * PADDED + q])
        w_2x = fma(w_2x, u, work[row + 4 * PADDED + q])
    return w, w_x, w_1, w_2, 2.0 * w_11, 2.0 * w_22, w_12, w_1x, w_2x


@compiled
def _along_position(work: Rows, x: Value) -> None:
    """Value and slope over the position of what multiplies the powers of the currents."""
    cell, value, rise = SHARED + MUTUAL_CELL, SHARED + MUTUAL_VALUE, SHARED + MUTUAL_RISE
    for k in range(6 * PADDED):
        a = work[cell + 30 * PADDED + k]
        b = a
        a = fma(a, x, work[cell + 24 * PADDED + k])
        b = fma(b, x, a)
        a = fma(a, x, work[cell + 18 * PADDED + k])
        b = fma(b, x, a)
        a = fma(a, x, work[cell + 12 * PADDED + k])
        b = fma(b, x, a)
        a = fma(a, x, work[cell + 6 * PADDED + k])
        b = fma(b, x, a)
        work[value + k] = fma(a, x, work[cell + k])
        work[rise + k] = b


@compiled
def _along_second(work: Rows, v: Value, n_power: int) -> None:
    """Value, slope and half the curvature over current 2, then value and slope of the slope over the position, of what
    multiplies the powers of current 1."""
    row, value, rise = SHARED + MUTUAL_LEFT, SHARED + MUTUAL_VALUE, SHARED + MUTUAL_RISE
    for q in range(n_power):
        a = work[value + 5 * PADDED + q]
        b = a
        a = fma(a, v, work[value + 4 * PADDED + q])
        c = b
        b = fma(b, v, a)
        a = fma(a, v, work[value + 3 * PADDED + q])
        c = fma(c, v, b)
        b = fma(b, v, a)
        a = fma(a, v, work[value + 2 * PADDED + q])
        c = fma(c, v, b)
        b = fma(b, v, a)
        a = fma(a, v, work[value + PADDED + q])
        work[row + q] = fma(a, v, work[value + q])
        work[row + PADDED + q] = fma(b, v, a)
        work[row + 2 * PADDED + q] = fma(c, v, b)
    for q in range(n_power):
        a = work[rise + 5 * PADDED + q]
        b = a
        a = fma(a, v, work[rise + 4 * PADDED + q])
        b = fma(b, v, a)
        a = fma(a, v, work[rise + 3 * PADDED + q])
        b = fma(b, v, a)
        a = fma(a, v, work[rise + 2 * PADDED + q])
        b = fma(b, v, a)
        a = fma(a, v, work[rise + PADDED + q])
        work[row + 3 * PADDED + q] = fma(a, v, work[rise + q])
        work[row + 4 * PADDED + q] = fma(b, v, a)
