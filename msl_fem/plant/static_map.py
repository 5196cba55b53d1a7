"""Force and flux of one magnet at rest, with the magnetic effects, measured point after point."""

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Rows, keep, rows_of
from msl_fem.errors import InputError, OutOfTable
from msl_fem.plant.effects import EffectValues, kernel_coefficients, magnetic, stray_flux
from msl_fem.plant.effects.mechanisms import N_IRON_STOP
from msl_fem.plant.equations import hysteresis, taken_by_iron
from msl_fem.plant.layout import STOPS_1, workspace
from msl_fem.plant.plant import PlantParameters, Surface
from msl_fem.plant.preparation import coercive_current, small_signal_inductance
from msl_fem.plant.side import Cells, cells_of, side_with_effects

WIDENED = 12  # times that a bracket is widened at most, by three each


def static_map(
    surface: Surface, plant: PlantParameters, effects: EffectValues, *, gap: ArrayLike, current: ArrayLike,
    sequence: ArrayLike | None = None,
) -> tuple[Array, Array]:  # fmt: skip
    """(force N, flux linkage Wb), (n,) each, of one magnet whose gap and current are set in this order.

    Effects: gap_offset (`offset`), early_saturation, fringing, armature_tilt, and magnetic_hysteresis, which knows what
    came before; the iron is demagnetised in the beginning, and wherever the number in `sequence` changes.

    Parameters
    ----------
    plant : of the actuator; its nominal gap is where the effects' parameters are stated
    gap, current : (n,) as they are read, m and A
    sequence : (n,) numbers of separate loops

    Raises
    ------
    InputError : gap, current and sequence of different length
    OutOfTable : a point outside the table
    """
    g, i = np.atleast_1d(np.asarray(gap, dtype=float)), np.atleast_1d(np.asarray(current, dtype=float))
    number = np.zeros(g.shape) if sequence is None else np.asarray(sequence, dtype=float)
    if not (g.shape == i.shape == number.shape and g.ndim == 1):
        raise InputError(
            f"gap {g.shape}, current {i.shape} and sequence {number.shape} differ; give rows of one length"
        )
    magnet = plant._replace(sides=1, magnets=1, current_share=1.0, end_stop=None)
    inductance = small_signal_inductance(magnet, surface)
    e = kernel_coefficients(magnet, effects.vector(), inductance=inductance, step=1.0, n_step=1)
    force, flux = np.empty(g.size), np.empty(g.size)
    done = _follow(surface, magnet, e, g + effects.get("gap_offset", "offset"), i, number, force, flux)
    if done < g.size:
        raise OutOfTable(
            f"row {done}: gap {g[done]:.6g} m, current {i[done]:.6g} A, with its effects, lies outside the table's "
            f"{surface.gap[0]:g} ... {surface.gap[-1]:g} m, up to {surface.current[-1]:g} A; extend the sweep or leave "
            "the row out"
        )
    return force, flux


@compiled
def _follow(
    surface: Surface, p: PlantParameters, coefficients: Array, gap: Array, current: Array, sequence: Array,
    force: Array, flux: Array,
) -> int:  # fmt: skip
    """Number of rows done; what the iron remembers stands in an array like the state's."""
    work_array, memory = workspace(), np.zeros(STOPS_1 + N_IRON_STOP)
    e, work, state, cells = rows_of(coefficients), rows_of(work_array), rows_of(memory), cells_of(surface)
    k = 0
    while k < gap.size:
        if k == 0 or sequence[k] != sequence[k - 1]:
            memory[:] = 0.0
        u = _magnetising(cells, p, e, state, work, gap[k], current[k])
        inside, pull, _, _, linked, _ = side_with_effects(cells, p, e, work, 0, u, gap[k])
        if not inside:
            break
        hysteresis(e, state, 0, linked, True)
        force[k], flux[k] = pull, linked
        k += 1
    keep(work_array)
    keep(memory)
    return k


@compiled
def _magnetising(
    cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, gap: float, current: float
) -> float:
    """The u with u + h + iron = i, by bisection between brackets that grow until they hold it: memory takes at most the
    coercive current at small flux and more at large, iron in series a part of the current's sign."""
    iron = e[magnetic.IRON_LOW] > 0.0 or e[magnetic.IRON_KNEE] > 0.0
    kept = e[stray_flux.REMANENT_1]
    if e[magnetic.HYSTERESIS_SLOPE] == 0.0 and not iron and kept * e[stray_flux.REMANENCE_FADES] == 0.0:
        return current + kept
    reach = coercive_current(e) + abs(kept)
    low, high = current - reach, current + reach
    if iron:
        low, high = min(low, 0.0 - reach), max(high, reach)
    for _ in range(WIDENED):
        if _taken(cells, p, e, state, work, low, gap) <= current <= _taken(cells, p, e, state, work, high, gap):
            break
        low, high = low - (high - low), high + (high - low)
    for _ in range(80):
        u = 0.5 * (low + high)
        if _taken(cells, p, e, state, work, u, gap) > current:
            high = u
        else:
            low = u
    return 0.5 * (low + high)


@compiled
def _taken(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, u: float, gap: float) -> float:
    """The current (A) at which u magnetises."""
    _, _, _, _, linked, _ = side_with_effects(cells, p, e, work, 0, u, gap)
    return u + taken_by_iron(e, state, 0, linked, False)
