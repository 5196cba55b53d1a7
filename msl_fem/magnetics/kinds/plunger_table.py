"""The force and flux table of a plunger magnet: the axisymmetric section's way into the coupled model."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline, make_interp_spline

from msl_fem.errors import InputError
from msl_fem.magnetics.kinds.plunger import PlungerMagnet, plunger_field
from msl_fem.magnetics.solver.mesh import MeshSize
from msl_fem.table.magnetic_table import MagneticTable

Array = NDArray[np.float64]
FEWEST_GAPS, FEWEST_CURRENTS = 4, 4


def plunger_table(
    magnet: PlungerMagnet, gap: ArrayLike, current: ArrayLike, *, size: MeshSize | None = None, order: int = 3,
    progress: Callable[[int, int], None] | None = None,
) -> MagneticTable:  # fmt: skip
    """The table of a plunger magnet whose air gap is the plunger's displacement and whose force closes it.

    Parameters
    ----------
    gap : (n_gap,) m, increasing and positive; each is meshed and solved on its own
    current : (n_current,) A, increasing and positive; the column 0 A is added
    progress : called with (gaps done, all gaps)

    Coenergy, flux linkage, force and incremental inductance are field solutions. The force's slopes are those of cubic
    splines through them: odd or even in the current, over log(gap).

    Raises
    ------
    InputError : too few nodes, or nodes that are not positive and increasing; a plunger that touches another part
    ComputationError : the mesher or Newton's iteration failed
    """
    gaps, currents = _nodes("gaps", gap, FEWEST_GAPS), _nodes("currents", current, FEWEST_CURRENTS)
    rows = []
    for done, displacement in enumerate(gaps, start=1):
        rows.append(_row(magnet, float(displacement), currents, size, order))
        if progress is not None:
            progress(done, gaps.size)
    solved = np.array(rows)
    coenergy, flux_linkage, force, inductance = (np.insert(solved[:, :, k], 0, 0.0, axis=1) for k in range(4))
    inductance[:, 0] = _at_rest(currents, inductance[:, 1:])
    everywhere = np.r_[0.0, currents]
    mirrored = np.r_[-currents[::-1], everywhere]
    along_current = [CubicSpline(mirrored, np.r_[row[:0:-1], row])(everywhere, 1) for row in force]
    along_gap = make_interp_spline(np.log(gaps), force, k=3)(np.log(gaps), 1) / gaps[:, None]
    return MagneticTable(
        gap=gaps,
        current=everywhere,
        nodes={
            "coenergy": coenergy,
            "flux_linkage": flux_linkage,
            "force": force,
            "incremental_inductance": inductance,
            "force_current_slope": np.array(along_current),
            "force_gap_slope": along_gap,
        },
        provenance={"solver": f"axisymmetric plunger magnet, P{order}, each gap on its own mesh"},
    )


def _row(
    magnet: PlungerMagnet, displacement: float, currents: Array, size: MeshSize | None, order: int
) -> list[tuple[float, float, float, float]]:
    """Coenergy, flux linkage, force that closes the gap and incremental inductance at each current."""
    field, start, row = plunger_field(magnet, displacement, size=size, order=order), None, []
    for current in currents:
        solution = field.solve(float(current), start=start)
        start = solution.potential
        it = field.evaluate(solution)
        row.append((it.coenergy, it.flux_linkage, -it.force, it.incremental_inductance))
    return row


def _at_rest(currents: Array, inductance: Array) -> Array:
    """(n_gap,) incremental inductance without current, by an even parabola through the two smallest currents."""
    near, far = currents[:2] ** 2
    return (far * inductance[:, 0] - near * inductance[:, 1]) / (far - near)


def _nodes(name: str, values: ArrayLike, fewest: int) -> Array:
    nodes = np.array(values, dtype=float)
    if nodes.ndim != 1 or nodes.size < fewest or not (np.diff(nodes) > 0).all() or not nodes[0] > 0:
        raise InputError(f"{name} must be at least {fewest}, positive and increasing; these are {nodes.tolist()}")
    return nodes
