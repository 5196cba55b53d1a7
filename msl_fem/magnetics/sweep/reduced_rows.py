"""Rows of a sweep from a reduced field, as `RowSolver` would solve them; or none, where no certificate holds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.row_cache import Arrays
from msl_fem.magnetics.field.accuracy import Accuracy
from msl_fem.magnetics.field.magnet_field import MagnetField
from msl_fem.magnetics.field.pair_field import PairField
from msl_fem.magnetics.kinds.ends import leaked
from msl_fem.magnetics.reduced.full_field import FullField
from msl_fem.magnetics.reduced.reduced_model import FieldPoints, ReducedModel, ReducedStates
from msl_fem.magnetics.reduced.reduction import Certificate, Reduction, ReductionSettings, reduce_at_all
from msl_fem.magnetics.solver.postprocess import TAIL_SHARE, Cuts, Probes
from msl_fem.magnetics.sweep.pair_rows import PairSweepRow
from msl_fem.magnetics.sweep.rows import SweepRow
from msl_fem.materials.constants import MU_0
from msl_fem.table.magnetic_table import SECTION

LEAST_POINTS = 60
"""Below that many the full solver is as fast."""
TOLERANCE: dict[Accuracy, float] = {"fast": 5e-4, "normal": 2.5e-4, "fine": 1e-4}


@dataclass(frozen=True, eq=False)
class ReducedRows:
    """The rows' answers, what certifies them, the full solutions taken, and the model."""

    answers: list[Arrays]
    certificate: Certificate
    solutions: int
    model: ReducedModel


@one_blas_thread
def reduced_rows(field: MagnetField, rows: Sequence[SweepRow], accuracy: Accuracy) -> ReducedRows | None:
    """The rows from a reduced field; None where there are too few points, or no certificate holds.

    A mesh with a motion of its own is left to the full solver.
    """
    gap = np.concatenate([np.full(len(row.currents), row.gap) for row in rows])
    current = np.concatenate([row.currents for row in rows])
    probes = field.probes
    if current.size < LEAST_POINTS or not isinstance(probes, Probes):
        return None
    full = FullField(field.model, [field.model.source])
    reduction = reduce_at_all(full, FieldPoints(gap, current[:, None]), ReductionSettings(TOLERANCE[accuracy]))
    if reduction is None:
        return None
    arrays = _magnet_arrays(probes, reduction.states) | _read_fields(probes, reduction.model, reduction.states)
    _add_leakage(arrays, field.leakage, current)
    return _by_row(arrays, [len(row.currents) for row in rows], reduction)


@one_blas_thread
def reduced_side_rows(field: PairField, rows: Sequence[PairSweepRow], accuracy: Accuracy) -> ReducedRows | None:
    """Rows with side 2 alone on, as `reduced_rows`; what belongs to side 1, and the mutual inductance, is left out."""
    counts = [len(row.currents_2) for row in rows]
    position = np.repeat([row.position for row in rows], counts)
    if position.size < LEAST_POINTS:
        return None
    points = FieldPoints(position, np.concatenate([row.currents_2 for row in rows])[:, None])
    full = FullField(field.model, [field.sources[1]])
    reduction = reduce_at_all(full, points, ReductionSettings(TOLERANCE[accuracy]))
    if reduction is None:
        return None
    model, states = reduction.model, reduction.states
    arrays = _side_arrays(field.scale, states) | _cut_means(field.cuts, model, states)
    _add_leakage(arrays, field.leakage, points.currents[:, 0], side="_2")
    return _by_row(arrays, counts, reduction)


def _by_row(arrays: Arrays, counts: Sequence[int], reduction: Reduction) -> ReducedRows:
    """Arrays (n,) of all points as the rows' answers."""
    ends = np.cumsum(counts)[:-1]
    pieces = {name: np.split(values, ends) for name, values in arrays.items()}
    answers = [{name: piece[k] for name, piece in pieces.items()} for k in range(len(counts))]
    answers = [answer | {"cpu_seconds": np.array(0.0)} for answer in answers]
    return ReducedRows(answers, reduction.certificate, reduction.solutions, reduction.model)


def _add_leakage(arrays: Arrays, inductance: float, current: Array, side: str = "") -> None:
    """Adds the flux (H) of the end turns, of one side where it is named, at its currents (n,) in A."""
    for name, value in leaked(inductance, current).items():
        own = name if name == "coenergy" else f"{name}{side}"
        arrays[own] = arrays[own] + value


def _side_arrays(scale: float, states: ReducedStates) -> Arrays:
    """(n,) of a pair's nodes with side 2 alone on; the coordinate is the position towards side 1, force its way."""
    arrays = {
        "coenergy": states.coenergy,
        "flux_linkage_2": states.flux_linkage[:, 0],
        "force": -states.energy_slope,
        "incremental_inductance_2": states.inductance[:, 0, 0],
        "force_current_slope_2": -states.energy_slope_by_current[:, 0],
        "force_position_slope": -states.energy_slope_by_coordinate,
    }
    return {name: scale * values for name, values in arrays.items()} | {"newton_iterations": states.steps.astype(float)}


def _magnet_arrays(probes: Probes, states: ReducedStates) -> Arrays:
    """(n,) of the quantities of a table's nodes, for the whole magnet."""
    scale = probes.scale
    return {
        "coenergy": scale * states.coenergy,
        "flux_linkage": scale * states.flux_linkage[:, 0],
        "force": scale * states.energy_slope,
        "incremental_inductance": scale * states.inductance[:, 0, 0],
        "force_current_slope": scale * states.energy_slope_by_current[:, 0],
        "force_gap_slope": scale * states.energy_slope_by_coordinate,
        "newton_iterations": states.steps.astype(float),
    }


def _read_fields(probes: Probes, model: ReducedModel, states: ReducedStates) -> Arrays:
    """(n,) flux densities of the sections, the force by the stress tensor, and whether an iron rests on its tail."""
    vectors, c = model.basis.vectors, states.states.T
    arrays = _cut_means(probes.cuts, model, states)
    gap = states.points.coordinate
    b_y = (probes.line_x @ vectors) @ c
    b_x = (probes.line_y @ vectors) @ c * (probes.model.mesh.gap / gap)
    in_plane = probes.line_weight @ (b_y**2 - b_x**2) / (2 * MU_0)
    depth = [probes.model.air_depth.strip(float(g)) for g in gap]
    k, slope = (np.array([one[m] for one in depth]) for m in (0, 1))
    bulging = strip_energy(model, states) * slope / k if slope.any() else 0.0
    arrays["force_stress_tensor"] = probes.scale * (in_plane / k - bulging)
    return arrays | {"tail": on_tail(model, states).astype(float)}


def strip_energy(model: ReducedModel, states: ReducedStates) -> Array:
    """(n,) field energy of the strips, per unit depth in the plane."""
    total = np.zeros(len(states.points))
    rest = np.einsum("ni,ij,nj->n", states.states, model.linear.rest, states.states)
    for q in np.unique(states.points.coordinate):
        here = states.points.coordinate == q
        c = states.states[here]
        total[here] = 0.5 * (np.einsum("ni,ij,nj->n", c, model.linear.at(float(q))[0], c) - rest[here])
    return total


def _cut_means(cuts: Cuts, model: ReducedModel, states: ReducedStates) -> Arrays:
    """(n,) means of |B| in the iron over cuts."""
    vectors, c = model.basis.vectors, states.states.T
    arrays = {}
    for name, cut in cuts.items():
        b = np.hypot((cut.along_x @ vectors) @ c, (cut.along_y @ vectors) @ c)
        sheets = model.basis.model.irons[cut.region].iron.iron_flux_density(b)
        arrays[SECTION + name] = np.asarray(cut.weight @ sheets[1:-1])
    return arrays


def on_tail(model: ReducedModel, states: ReducedStates) -> Array:
    """(n,) whether more than 1 % of an iron lies beyond its last B-H point, by the mean field of each element."""
    coarse = model.basis.coarse_iron()
    found = np.zeros(len(states.points), dtype=bool)
    for k, part in enumerate(model.basis.model.irons.values()):
        own = coarse.iron == k
        if not np.isfinite(part.iron.tail_from):
            continue
        x, y = (coarse.gradients[m::2][own] @ states.states.T for m in (0, 1))
        share = coarse.weight[own] @ (x * x + y * y > part.iron.tail_from**2) / coarse.weight[own].sum()
        found |= share > TAIL_SHARE
    return found
