"""One side of the actuator: its equal magnets and their connection, seen from the side's terminals.

With effects its coenergy is n A(g) <W'>(c share i, g), A = depth + growth g (early_saturation, fringing), <> the mean
over a face that is not parallel (armature_tilt); gap_offset lies in g. Force, flux and their slopes are derivatives of
this one function, so dF/di = -dlambda/dg holds with any of them.
"""

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, Value, choose, size, some
from msl_fem.plant.cell import N_BLOCK, Cells, cell_slopes, cell_values, enter_cell
from msl_fem.plant.coefficients import COMPLIANCE, CURRENT_SCALE, DEPTH, GAP_1, GROWTH, TILT
from msl_fem.plant.plant import PlantParameters
from msl_fem.plant.state import BASE, X
from msl_fem.plant.work import BLOCKS, TILTED, Y

Five = tuple[Value, Value, Value, Value, Value]
GAUSS = 5.0 / 18.0  # weight of the outer two of three points


@compiled
def side_gap(p: PlantParameters, e: Rows, work: Rows, j: int) -> Value:
    """The gap of side j in m; with effects offset, and from a base that gives way (gap_offset, support_compliance)."""
    toward = 1.0 - 2.0 * j  # side 1's closes towards +x, side 2's towards -x
    if e is None:
        return p.nominal_gap - toward * work[Y + X]
    else:
        return e[GAP_1 + j] - toward * (work[Y + X] - e[COMPLIANCE] * work[Y + BASE])


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
    inside = enter_cell(cells, work, BLOCKS + j * N_BLOCK, size(i), gap)
    w_g, w_ii, w_ig = cell_slopes(work, BLOCKS + j * N_BLOCK, size(i), gap)
    flux_slope = choose(i < 0.0, 0.0 - w_ig, w_ig)
    return inside, p.magnets * (0.0 - w_g), linkages * p.current_share * w_ii, linkages * flux_slope


@compiled
def side_with_effects(
    cells: Cells, p: PlantParameters, e: Rows, work: Rows, j: int, current: Value, gap: Value
) -> tuple[Flag, Value, Value, Value, Value, Value]:
    """`side_slopes` with the magnetic effects, then flux linkage (Wb) and coenergy (J) of the side."""
    per_magnet = p.current_share * e[CURRENT_SCALE]
    linkages = p.magnets * per_magnet
    i = per_magnet * current
    inside = enter_cell(cells, work, BLOCKS + j * N_BLOCK, size(i), gap)
    w, w_g, w_i, w_ii, w_ig = cell_values(work, BLOCKS + j * N_BLOCK, size(i), gap)
    if some(e[TILT] > 0.0):
        middle = (w, w_g, w_i, w_ii, w_ig)
        found, mean = _mean_over_face(cells, work, j, size(i), gap, e[TILT], middle)
        inside = inside & found
        w, w_g, w_i, w_ii, w_ig = mean
    depth, growth = e[DEPTH] + e[GROWTH] * gap, e[GROWTH]
    pull = p.magnets * (depth * (0.0 - w_g) - growth * w)
    inductance = linkages * per_magnet * (depth * w_ii)
    flux_slope = depth * w_ig + growth * w_i
    flux = depth * w_i
    negative = i < 0.0
    flux_slope, flux = choose(negative, 0.0 - flux_slope, flux_slope), choose(negative, 0.0 - flux, flux)
    return inside, pull, inductance, linkages * flux_slope, linkages * flux, p.magnets * (depth * w)


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
def side_flux(
    cells: Cells, p: PlantParameters, e: Rows, work: Rows, j: int, current: Value, gap: Value
) -> tuple[Flag, Value, Value]:
    """(inside the table, flux linkage Wb, field energy lambda i - W' in J) of a side; e is None without effects."""
    if e is None:
        i = p.current_share * current
        inside = enter_cell(cells, work, BLOCKS + j * N_BLOCK, size(i), gap)
        w, _, w_i, _, _ = cell_values(work, BLOCKS + j * N_BLOCK, size(i), gap)
        flux = p.magnets * p.current_share * choose(i < 0.0, 0.0 - w_i, w_i)
        return inside, flux, flux * current - p.magnets * w
    else:
        inside, _, _, _, flux, coenergy = side_with_effects(cells, p, e, work, j, current, gap)
        return inside, flux, flux * current - coenergy
