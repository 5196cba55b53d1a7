"""One side of the actuator: its equal magnets and their connection, seen from the side's terminals.

A mover stays in one cell of the table for many steps. The cell's 36 coefficients and its edges are copied to a block of
their own, one a lane; an evaluation first looks whether all lanes are still inside.

With effects the side's coenergy is n A(g) <W'>(c share i, g), A = depth + growth g (early_saturation, fringing), <>
the mean over a face that is not parallel (armature_tilt); gap_offset lies in g. Force, flux and their slopes are
derivatives of this one function, so dF/di = -dlambda/dg holds with any of them. Leakage adds l u^2/2, which does not
depend on the gap: flux linkage without force. What both sides have in common is in `mutual_flux.py`.
"""

from typing import NamedTuple

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import (
    Flag,
    Rows,
    Value,
    choose,
    every,
    fma,
    lane_of,
    rows_of,
    set_lane,
    size,
    some,
    square_root,
    width,
)
from msl_fem.plant.effects import magnetic, mechanical, stray_flux
from msl_fem.plant.layout import (
    BASE,
    BLOCK_1,
    CELL,
    CURRENT,
    CURRENT_HIGH,
    CURRENT_LOW,
    GAP,
    GAP_HIGH,
    GAP_LOW,
    LAST_CURRENT,
    LAST_FOUND,
    LAST_GAP,
    N_BLOCK,
    SURFACE_START,
    TILTED,
    X,
    Y,
)
from msl_fem.plant.plant import MutualSurface, PlantParameters, Surface

Five = tuple[Value, Value, Value, Value, Value]
GAUSS = 5.0 / 18.0  # weight of the outer two of three points


class MutualCells(NamedTuple):
    """A `MutualSurface` as the kernel takes it."""

    position: Rows
    current_1: Rows
    current_2: Rows
    coefficients: Rows
    n_position: int
    n_current_1: int
    n_current_2: int
    n_power: int  # of current 1, with those that fill up


class Cells(NamedTuple):
    """A `Surface` as the kernel takes it."""

    gap: Rows
    current: Rows
    coefficients: Rows
    n_gap: int
    n_current: int
    mutual: MutualCells | None


@compiled
def cells_of(surface: Surface) -> Cells:
    """The surface by its addresses; it must outlive them."""
    gap, current = surface.gap, surface.current
    coefficients, mutual = rows_of(surface.coefficients.ravel()), _mutual_cells(surface.mutual)
    return Cells(rows_of(gap), rows_of(current), coefficients, gap.size, current.size, mutual)


@compiled
def _mutual_cells(surface: MutualSurface | None) -> MutualCells | None:
    if surface is None:
        return None
    else:
        x, i, j = surface.position, surface.current_1, surface.current_2
        n_power = surface.coefficients.shape[1] // 36
        coefficients = rows_of(surface.coefficients.ravel())
        return MutualCells(rows_of(x), rows_of(i), rows_of(j), coefficients, x.size, i.size, j.size, n_power)


@compiled
def inside_cell(work: Rows, block: int, current: Value, gap: Value) -> Flag:
    """Whether |current| and gap are in the cell of the block from that row; its upper edges belong to the next one."""
    within_gap = (work[block + GAP_LOW] <= gap) & (gap < work[block + GAP_HIGH])
    return within_gap & (work[block + CURRENT_LOW] <= current) & (current < work[block + CURRENT_HIGH])


@compiled
def enter_cell(cells: Cells, work: Rows, block: int, current: Value, gap: Value) -> Flag:
    """True where the block now holds the cell of |current| and gap; False outside the table, or not a number."""
    inside = inside_cell(work, block, current, gap)
    if not every(inside):
        _move(cells, work, block, current, gap)
        inside = inside_cell(work, block, current, gap)
    return inside


@compiled
def _move(cells: Cells, work: Rows, block: int, current: Value, gap: Value) -> None:
    """Fills the block in all lanes that have left their cell; not in those that have left the table."""
    work[block + CURRENT] = current
    work[block + GAP] = gap
    for lane in range(width(work)):
        i, g = lane_of(work, block + CURRENT, lane), lane_of(work, block + GAP, lane)
        m, n = lower_node(cells.gap, cells.n_gap, g), lower_node(cells.current, cells.n_current, i)
        if m >= 0 and n >= 0:
            start = int(lane_of(work, block + SURFACE_START, lane)) + (m * (cells.n_current - 1) + n) * 36
            for k in range(36):
                set_lane(work, block + CELL + k, lane, cells.coefficients[start + k])
            set_lane(work, block + GAP_LOW, lane, cells.gap[m])
            set_lane(work, block + GAP_HIGH, lane, upper_edge(cells.gap, cells.n_gap, m))
            set_lane(work, block + CURRENT_LOW, lane, cells.current[n])
            set_lane(work, block + CURRENT_HIGH, lane, upper_edge(cells.current, cells.n_current, n))


@compiled
def lower_node(nodes: Rows, n_node: int, x: float) -> int:
    """The index m with nodes[m] <= x < nodes[m + 1], the last but one at the end, by bisection; -1 outside."""
    if not (nodes[0] <= x and x <= nodes[n_node - 1]):
        return -1
    low, high = 0, n_node - 1
    while high - low > 1:
        middle = (low + high) // 2
        if nodes[middle] <= x:
            low = middle
        else:
            high = middle
    return low


@compiled
def upper_edge(nodes: Rows, n_node: int, m: int) -> float:
    """The first number above the cell from node m; the last cell has its upper node."""
    return nodes[m + 1] if m + 2 < n_node else np.nextafter(nodes[m + 1], np.inf)


@compiled
def _in_current(work: Rows, power: int, x: Value) -> tuple[Value, Value, Value]:
    """(value, slope, half the curvature) over the current of what multiplies a power of the gap, from that row."""
    a = work[power + 5]
    b = a
    a = fma(a, x, work[power + 4])
    c = b
    b = fma(b, x, a)
    a = fma(a, x, work[power + 3])
    c = fma(c, x, b)
    b = fma(b, x, a)
    a = fma(a, x, work[power + 2])
    c = fma(c, x, b)
    b = fma(b, x, a)
    a = fma(a, x, work[power + 1])
    return fma(a, x, work[power]), fma(b, x, a), fma(c, x, b)


@compiled
def cell_values(work: Rows, block: int, current: Value, gap: Value) -> Five:
    """(W', W'_g, W'_i, W'_ii, W'_ig) at |current| and gap inside the block's cell. What a step ends with the next one
    begins with, and it is asked for several times there: where all lanes are where they were last, it is known."""
    if every((work[block + LAST_CURRENT] == current) & (work[block + LAST_GAP] == gap)):
        last = block + LAST_FOUND
        return work[last], work[last + 1], work[last + 2], work[last + 3], work[last + 4]
    x, y = current - work[block + CURRENT_LOW], gap - work[block + GAP_LOW]
    w = w_g = w_i = w_ig = w_ii = x - x
    for p in range(5, -1, -1):
        a, b, c = _in_current(work, block + CELL + 6 * p, x)
        w_g = fma(w_g, y, w)
        w = fma(w, y, a)
        w_ig = fma(w_ig, y, w_i)
        w_i = fma(w_i, y, b)
        w_ii = fma(w_ii, y, c)
    w_ii = 2.0 * w_ii
    last = block + LAST_FOUND
    work[last], work[last + 1], work[last + 2], work[last + 3], work[last + 4] = w, w_g, w_i, w_ii, w_ig
    work[block + LAST_CURRENT], work[block + LAST_GAP] = current, gap
    return w, w_g, w_i, w_ii, w_ig


@compiled
def side_gap(p: PlantParameters, e: Rows, work: Rows, j: int) -> Value:
    """The gap of side j in m; with effects offset, and from a base that gives way (gap_offset, support_compliance)."""
    toward = 1.0 - 2.0 * j  # side 1's closes towards +x, side 2's towards -x
    if e is None:
        return p.nominal_gap - toward * work[Y + X]
    else:
        return e[magnetic.GAP_1 + j] - toward * (work[Y + X] - e[mechanical.COMPLIANCE] * work[Y + BASE])


@compiled
def side_slopes(
    cells: Cells, p: PlantParameters, work: Rows, j: int, current: Value, gap: Value
) -> tuple[Flag, Value, Value, Value]:
    """(inside the table, force N, dlambda/di H, dlambda/dgap Wb/m) of a side at its current.

    The slope of the flux over the gap is minus that of the force over the current, since both are second derivatives
    of one coenergy.
    """
    linkages = p.magnets * p.current_share
    i = p.current_share * current
    inside = enter_cell(cells, work, BLOCK_1 + j * N_BLOCK, size(i), gap)
    _, w_g, _, w_ii, w_ig = cell_values(work, BLOCK_1 + j * N_BLOCK, size(i), gap)
    flux_slope = choose(i < 0.0, 0.0 - w_ig, w_ig)
    return inside, p.magnets * (0.0 - w_g), linkages * p.current_share * w_ii + leakage(p, j), linkages * flux_slope


@compiled
def leakage(p: PlantParameters, j: int) -> Value:
    """The leakage inductance of side j in H."""
    return p.leakage_1 if j == 0 else p.leakage_2


@compiled
def side_with_effects(
    cells: Cells, p: PlantParameters, e: Rows, work: Rows, j: int, current: Value, gap: Value
) -> tuple[Flag, Value, Value, Value, Value, Value]:
    """`side_slopes` with the magnetic effects, then flux linkage (Wb) and coenergy (J) of the side."""
    per_magnet = p.current_share * e[magnetic.CURRENT_SCALE]
    linkages = p.magnets * per_magnet
    i = per_magnet * current
    inside = enter_cell(cells, work, BLOCK_1 + j * N_BLOCK, size(i), gap)
    w, w_g, w_i, w_ii, w_ig = cell_values(work, BLOCK_1 + j * N_BLOCK, size(i), gap)
    if some(e[magnetic.TILT] > 0.0):
        middle = (w, w_g, w_i, w_ii, w_ig)
        found, mean = _mean_over_face(cells, work, j, size(i), gap, e[magnetic.TILT], middle)
        inside = inside & found
        w, w_g, w_i, w_ii, w_ig = mean
    depth, growth = e[magnetic.DEPTH] + e[magnetic.GROWTH] * gap, e[magnetic.GROWTH]
    pull = p.magnets * (depth * (0.0 - w_g) - growth * w)
    leak = leakage(p, j) + e[stray_flux.LEAKAGE_1 + j]
    leak_flux, stored = leak * current, 0.5 * leak * current * current
    if some(e[stray_flux.LEAKAGE_BENDS] > 0.0):
        own = e[stray_flux.LEAKAGE_1 + j]
        bent = square_root(1.0 + e[stray_flux.LEAKAGE_BENDS] * current * current)
        leak = leak + (own / (bent * bent * bent) - own)
        leak_flux = leak_flux + (own * current / bent - own * current)
        stored = stored + own * current * current * (1.0 / (1.0 + bent) - 0.5)
    inductance = linkages * per_magnet * (depth * w_ii) + leak
    flux_slope = depth * w_ig + growth * w_i
    flux = depth * w_i
    negative = i < 0.0
    flux_slope, flux = choose(negative, 0.0 - flux_slope, flux_slope), choose(negative, 0.0 - flux, flux)
    coenergy = p.magnets * (depth * w) + stored
    return inside, pull, inductance, linkages * flux_slope, linkages * flux + leak_flux, coenergy


@compiled
def _mean_over_face(
    cells: Cells, work: Rows, j: int, current: Value, gap: Value, shift: Value, middle: Five
) -> tuple[Flag, Five]:
    """The values of `cell_values` as their mean over gaps that differ evenly over a face, by Gauss' three points: the
    middle and `shift` to either side of it; without a shift those of the middle. The flag: both are in the table."""
    low, high = TILTED + 2 * j * N_BLOCK, TILTED + (2 * j + 1) * N_BLOCK
    inside = enter_cell(cells, work, low, current, gap - shift) & enter_cell(cells, work, high, current, gap + shift)
    w, w_g, w_i, w_ii, w_ig = middle
    v, v_g, v_i, v_ii, v_ig = cell_values(work, low, current, gap - shift)
    u, u_g, u_i, u_ii, u_ig = cell_values(work, high, current, gap + shift)
    tilted = shift > 0.0
    return inside, (
        choose(tilted, w + GAUSS * (v - 2.0 * w + u), w),
        choose(tilted, w_g + GAUSS * (v_g - 2.0 * w_g + u_g), w_g),
        choose(tilted, w_i + GAUSS * (v_i - 2.0 * w_i + u_i), w_i),
        choose(tilted, w_ii + GAUSS * (v_ii - 2.0 * w_ii + u_ii), w_ii),
        choose(tilted, w_ig + GAUSS * (v_ig - 2.0 * w_ig + u_ig), w_ig),
    )


@compiled
def side_pull(cells: Cells, p: PlantParameters, e: Rows, work: Rows, j: int, current: Value, gap: Value) -> Value:
    """The force of a side's magnets in N, attractive positive; e is None without effects."""
    if e is None:
        return side_slopes(cells, p, work, j, current, gap)[1]
    else:
        return side_with_effects(cells, p, e, work, j, current, gap)[1]


@compiled
def side_flux(
    cells: Cells, p: PlantParameters, e: Rows, work: Rows, j: int, current: Value, gap: Value
) -> tuple[Flag, Value, Value]:
    """(inside the table, flux linkage Wb, field energy lambda i - W' in J) of a side; e is None without effects."""
    if e is None:
        i = p.current_share * current
        inside = enter_cell(cells, work, BLOCK_1 + j * N_BLOCK, size(i), gap)
        w, _, w_i, _, _ = cell_values(work, BLOCK_1 + j * N_BLOCK, size(i), gap)
        leak = leakage(p, j)
        flux = p.magnets * p.current_share * choose(i < 0.0, 0.0 - w_i, w_i) + leak * current
        return inside, flux, flux * current - (p.magnets * w + 0.5 * leak * current * current)
    else:
        inside, _, _, _, flux, coenergy = side_with_effects(cells, p, e, work, j, current, gap)
        return inside, flux, flux * current - coenergy
