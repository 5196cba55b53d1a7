"""One side of the actuator: its equal magnets and their connection, seen from the side's terminals.

With effects its coenergy is n A(g) (W' + V(g) W'_gg/2)(c share i, g), A = depth + growth g (early_saturation, fringing,
armature_tilt; gap_offset lies in g). Force, flux and their slopes are derivatives of this one function, so
dF/di = -dlambda/dg holds with any of them.
"""

from msl_fem.compiled import compiled
from msl_fem.coupled_model.cell import N_BLOCK, Cells, cell_slopes, cell_values, enter_cell
from msl_fem.coupled_model.coefficients import COMPLIANCE, CURRENT_SCALE, DEPTH, GAP_1, GROWTH, TILT
from msl_fem.coupled_model.lanes import Flag, Rows, Value, choose, size
from msl_fem.coupled_model.plant import PlantParameters
from msl_fem.coupled_model.state import BASE, X
from msl_fem.coupled_model.work import BLOCKS, Y


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
    tilt, tilt_slope = _tilt(e[TILT], gap)
    w, w_g, w_i, w_ii, w_ig = cell_values(work, BLOCKS + j * N_BLOCK, size(i), gap, tilt, tilt_slope)
    depth, growth = e[DEPTH] + e[GROWTH] * gap, e[GROWTH]
    pull = p.magnets * (depth * (0.0 - w_g) - growth * w)
    inductance = linkages * per_magnet * (depth * w_ii)
    flux_slope = depth * w_ig + growth * w_i
    flux = depth * w_i
    negative = i < 0.0
    flux_slope, flux = choose(negative, 0.0 - flux_slope, flux_slope), choose(negative, 0.0 - flux, flux)
    return inside, pull, inductance, linkages * flux_slope, linkages * flux, p.magnets * (depth * w)


@compiled
def _tilt(variance: Value, gap: Value) -> tuple[Value, Value]:
    """(V, dV/dg): the variance of the gap over the face that acts as all even moments of the tilt do.

    For a coenergy in proportion to 1/g the mean over gaps g - e ... g + e is artanh(e/g)/(e/g) times that of the
    middle, which is 1 + V/g^2 with r = e^2/(3 g^2), V = e^2/3 (1 + 9 r/5 + 27 r^2/7 + 9 r^3 + ...).
    """
    r = variance / (gap * gap)
    more = r * (1.8 + r * (27.0 / 7.0 + 9.0 * r))
    slope = r * (1.8 + r * (54.0 / 7.0 + 27.0 * r))
    return variance + variance * more, (0.0 - 2.0 * variance) * slope / gap


@compiled
def side_flux(
    cells: Cells, p: PlantParameters, e: Rows, work: Rows, j: int, current: Value, gap: Value
) -> tuple[Flag, Value, Value]:
    """(inside the table, flux linkage Wb, field energy lambda i - W' in J) of a side; e is None without effects."""
    if e is None:
        i = p.current_share * current
        inside = enter_cell(cells, work, BLOCKS + j * N_BLOCK, size(i), gap)
        w, _, w_i, _, _ = cell_values(work, BLOCKS + j * N_BLOCK, size(i), gap, 0.0, 0.0)
        flux = p.magnets * p.current_share * choose(i < 0.0, 0.0 - w_i, w_i)
        return inside, flux, flux * current - p.magnets * w
    else:
        inside, _, _, _, flux, coenergy = side_with_effects(cells, p, e, work, j, current, gap)
        return inside, flux, flux * current - coenergy
