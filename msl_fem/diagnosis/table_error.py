"""Smooth errors of a field table as a few coefficients: a Gaussian process over current and gap, where a record went.

The coenergy of the table is multiplied by 1 + a phi, phi a process of unit variance with the Matern covariance of order
5/2 in u(i) = log(1 + (i/s)^2) and in z(g) = sqrt(g) (Rasmussen and Williams, Gaussian Processes for Machine Learning,
2006, ch. 4), so that force and flux stay derivatives of one coenergy. Even in the current, it may change as much over
an octave of small currents as over one of large ones; a process over the current itself is a number below the knee. It
has the two derivatives that a table needs and no more: an infinitely smooth process, on the small part of a table that
a record visits, leaves none of the fine shape that an error has at the knee. On that part the process is its first
Karhunen-Loeve modes. The amplitude a is such that the RMS error over the table, of force or flux linkage, whichever is
larger, is the table's tolerance.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import TableError
from msl_fem.prediction import KernelPlant, RunData
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record.columns import Channel
from msl_fem.table.coenergy_surface import fit_coenergy_surface
from msl_fem.table.magnetic_table import NODES, SECTION, MagneticTable

LENGTH = 1.5
"""Correlation length, in half widths of the table's range of u and z."""
SMALL = 12.0  # the largest current over s
MOST_MODES = 12
LEAST = 1e-7  # of the first mode's variance: what is smaller cannot be seen
_SAMPLES = 14  # points a direction of the visited part
_MARGIN = 0.15  # of its width, by which the visited part is widened


@dataclass(frozen=True, eq=False)
class Visited:
    """Where data go: currents of a magnet (A, absolute) and gaps (m), lowest and highest."""

    current: tuple[float, float]
    gap: tuple[float, float]

    @classmethod
    def by(cls, current: Array, gap: Array) -> "Visited":
        """What these currents, of either sign, and gaps reach."""
        size = np.abs(current)
        return cls((float(size.min()), float(size.max())), (float(gap.min()), float(gap.max())))

    @classmethod
    def by_runs(cls, plant: KernelPlant, runs: Sequence[RunData]) -> "Visited":
        """What the readings of runs say, or where currents are not read, the commands."""
        p = plant.parameters
        positions = np.concatenate([run.measured[POSITION_COLUMN] for run in runs]) / plant.gain
        gaps = [p.nominal_gap - positions]
        if p.sides == 2:
            gaps.append(p.nominal_gap + positions)
        currents = []
        for run in runs:
            for side in range(p.sides):
                column = Channel("current", side + 1).column
                currents.append(run.measured.get(column, run.commands[:, side]) * p.current_share)
        return cls.by(np.concatenate(currents), np.concatenate(gaps))

    def joined(self, other: "Visited") -> "Visited":
        """What either of them reaches."""
        low, high = np.minimum(self._spans, other._spans)[:, 0], np.maximum(self._spans, other._spans)[:, 1]
        return Visited((float(low[0]), float(high[0])), (float(low[1]), float(high[1])))

    @property
    def _spans(self) -> Array:
        return np.array([self.current, self.gap])


@dataclass(frozen=True, eq=False)
class TableErrorModes:
    """Changes of a table by unit normal numbers.

    Attributes
    ----------
    modes : (n_mode, n_gap - 1, n_current - 1, 6, 6) of the coenergy surface's coefficients
    nodes : variable of the table's nodes to (n_mode, n_gap, n_current)
    """

    modes: Array
    nodes: Mapping[str, Array]


def table_error(table: MagneticTable, visited: Visited, *, tolerance: float) -> TableErrorModes:
    """The modes of a smooth error with an RMS of `tolerance` over the table."""
    coordinates = _Coordinates(table)
    amplitude = tolerance / np.sqrt(_error_of_unit(table, coordinates))
    currents, gaps = (0.0, float(table.current[-1])), (float(table.gap[0]), float(table.gap[-1]))
    i = np.linspace(*_widened(visited.current, currents), _SAMPLES)
    g = np.linspace(*_widened(visited.gap, gaps), _SAMPLES)
    u, z = (a.ravel() for a in np.meshgrid(coordinates.u(i)[0], coordinates.z(g)[0]))
    covariance = _matern(u[:, None] - u)[0] * _matern(z[:, None] - z)[0]
    values, vectors = np.linalg.eigh(covariance)
    order = np.argsort(values)[::-1][:MOST_MODES]
    kept = order[values[order] > LEAST * values[order[0]]]
    weights = amplitude * vectors[:, kept] / np.sqrt(values[kept])
    changes = [_node_changes(table, coordinates, (u, z, w)) for w in weights.T]
    modes = [fit_coenergy_surface(table.gap, table.current, nodes).coefficients for nodes in changes]
    return TableErrorModes(np.array(modes), {name: np.array([nodes[name] for nodes in changes]) for name in NODES})


def corrected(table: MagneticTable, error: TableErrorModes, numbers: Array, *, scale: float) -> MagneticTable:
    """The table with an error of these numbers (n_mode,), its coenergy multiplied by `scale`.

    A fit that lacks a cause may have an error with which it is no magnet's table any more, as with a force that repels:
    it is there to be compared with, so of that error the largest share in tenths with which it is one.
    """
    whole = {name: np.tensordot(numbers, error.nodes[name], axes=1) for name in NODES}
    for tenths in range(10, 0, -1):
        nodes = {name: scale * (table.nodes[name] + tenths / 10 * whole[name]) for name in NODES}
        try:
            return _with_nodes(table, nodes)
        except TableError:
            continue
    return scaled(table, scale)


def scaled(table: MagneticTable, scale: float) -> MagneticTable:
    """The table with its coenergy multiplied."""
    return _with_nodes(table, {name: scale * table.nodes[name] for name in NODES})


def _with_nodes(table: MagneticTable, nodes: dict[str, Array]) -> MagneticTable:
    """The table with other nodes, its flux densities in proportion to the flux linkage; it keeps its stated errors.

    In the leg that the coil sits on they are in proportion exactly; elsewhere up to the leakage, a few per cent of a
    correction of a tenth of a per cent.
    """
    before = table.nodes["flux_linkage"]
    ratio = np.divide(nodes["flux_linkage"], before, out=np.ones_like(before), where=before != 0)
    densities = {name: values * ratio for name, values in table.extras.items() if name.startswith(SECTION)}
    return replace(table, nodes=nodes, extras=densities, provenance=dict(table.provenance))


def _widened(span: tuple[float, float], limits: tuple[float, float]) -> tuple[float, float]:
    margin = _MARGIN * (span[1] - span[0]) + 1e-3 * (limits[1] - limits[0])
    return max(span[0] - margin, limits[0]), min(span[1] + margin, limits[1])


class _Coordinates:
    """u of the current and z of the gap, -1 to 1 over the table, with first and second derivative."""

    def __init__(self, table: MagneticTable) -> None:
        self.s = float(table.current[-1]) / SMALL
        self.u_span = math.log1p(SMALL**2)
        self.z_low = np.sqrt(table.gap[0])
        self.z_span = np.sqrt(table.gap[-1]) - self.z_low

    def u(self, i: Array) -> tuple[Array, Array, Array]:
        k, square = 2 / self.u_span, self.s**2 + i**2
        return k * np.log1p((i / self.s) ** 2) - 1, k * 2 * i / square, k * 2 * (self.s**2 - i**2) / square**2

    def z(self, g: Array) -> tuple[Array, Array, Array]:
        k, root = 2 / self.z_span, np.sqrt(g)
        return k * (root - self.z_low) - 1, k / (2 * root), -k / (4 * root**3)


def _matern(d: Array) -> tuple[Array, Array, Array]:
    """The covariance at a distance d along one coordinate, and its first and second derivative over d."""
    r = math.sqrt(5.0) * np.abs(d) / LENGTH
    rate, falling = 5 / (3 * LENGTH**2), np.exp(-r)
    return (1 + r + r**2 / 3) * falling, -rate * d * (1 + r) * falling, -rate * (1 + r - r**2) * falling


def _error_of_unit(table: MagneticTable, coordinates: _Coordinates) -> float:
    """Mean square over the nodes of the relative error of force or flux linkage that phi makes, the larger.

    A relative error of the force is phi + (W'/W'_g) dphi/dg; a stationary process and its slope at a point are not
    correlated, and the slope's variance is 5/3 z_g^2 / LENGTH^2.
    """
    w = table.nodes["coenergy"][:, 1:]
    u_i, z_g = coordinates.u(table.current[1:])[1], coordinates.z(table.gap)[1][:, None]
    slope = 5 / (3 * LENGTH**2)
    flux = 1 + slope * (w / table.nodes["flux_linkage"][:, 1:] * u_i) ** 2
    force = 1 + slope * (w / table.nodes["force"][:, 1:] * z_g) ** 2
    return float(max(flux.mean(), force.mean()))


def _node_changes(
    table: MagneticTable, coordinates: _Coordinates, mode: tuple[Array, Array, Array]
) -> dict[str, Array]:
    """The nodes of W' phi, phi(u, z) = sum of weights times the covariance to sample points."""
    at_u, at_z, weight = mode
    u, u_i, u_ii = (a[:, None] for a in coordinates.u(table.current))
    z, z_g, z_gg = (a[:, None] for a in coordinates.z(table.gap))
    along, along_u, along_uu = _matern(u - at_u)  # (n_node, n_sample)
    across, across_z, across_zz = _matern(z - at_z)
    along_i = (along, u_i * along_u, u_ii * along_u + u_i**2 * along_uu)
    across_g = (across, z_g * across_z, z_gg * across_z + z_g**2 * across_zz)
    p, p_i, p_g, p_ii, p_ig, p_gg = (
        (across_g[k] * weight) @ along_i[m].T for m, k in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    )
    n = {name: table.nodes[name] for name in NODES}
    w, w_i, w_g = n["coenergy"], n["flux_linkage"], -n["force"]
    w_ii, w_ig, w_gg = n["incremental_inductance"], -n["force_current_slope"], -n["force_gap_slope"]
    return {
        "coenergy": w * p,
        "flux_linkage": w_i * p + w * p_i,
        "force": -(w_g * p + w * p_g),
        "incremental_inductance": w_ii * p + 2 * w_i * p_i + w * p_ii,
        "force_current_slope": -(w_ig * p + w_i * p_g + w_g * p_i + w * p_ig),
        "force_gap_slope": -(w_gg * p + 2 * w_g * p_g + w * p_gg),
    }
