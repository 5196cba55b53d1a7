"""The table of two magnets that share an armature: one coenergy over position and both currents.

W'(x, i_1, i_2) = W'_1(i_1, g_1) + W'_2(i_2, g_2) + D(x, i_1, i_2), the first two of the table of one magnet, D what the
shared armature makes of them: the mutual flux, small and smooth. All quantities are derivatives of the sum, so
d lambda_1/d i_2 = d lambda_2/d i_1 and dF/d i_k = d lambda_k/dx hold to rounding.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.computing.arrays import Array
from msl_fem.computing.splines import spline_derivative
from msl_fem.errors import TableError
from msl_fem.files.netcdf_file import NetcdfVariable, read_variables, write_variables
from msl_fem.files.quantity import format_quantity
from msl_fem.files.whole_file import whole_file
from msl_fem.table.magnetic_table import (
    LARGEST_VALUE,
    MOST_VALUES,
    NODES,
    SECTION,
    MagneticTable,
    read_table,
    write_table,
)
from msl_fem.table.pair_surface import CORNERS, DERIVATIVES, FEWEST_NODES, PairSurface, SharedCoenergy, fit_pair_surface

SCHEMA = 1
PAIR_NODES = {
    "coenergy": ("J", "coenergy W' of both coils"),
    "flux_linkage_1": ("Wb", "flux linkage of side 1, dW'/di_1"),
    "flux_linkage_2": ("Wb", "flux linkage of side 2, dW'/di_2"),
    "force": ("N", "force on the armature towards side 1, dW'/dx"),
    "incremental_inductance_1": ("H", "d2W'/di_1^2"),
    "incremental_inductance_2": ("H", "d2W'/di_2^2"),
    "mutual_inductance": ("H", "d2W'/(di_1 di_2)"),
    "force_current_slope_1": ("N/A", "dF/di_1 = dlambda_1/dx"),
    "force_current_slope_2": ("N/A", "dF/di_2 = dlambda_2/dx"),
    "force_position_slope": ("N/m", "dF/dx"),
}
"""In the order of `pair_surface.DERIVATIVES`."""
ONE_SIDED = "one_sided_"
"""Before the names of the variables of one magnet's table, which lies in the same file."""
ERRORS = ("mesh_error", "interpolation_error", "reciprocity_error")
MIRRORED = {
    "flux_linkage_1": ("flux_linkage_2", 1.0),
    "incremental_inductance_1": ("incremental_inductance_2", 1.0),
    "force_current_slope_1": ("force_current_slope_2", -1.0),
    "force": ("force", -1.0),
}
"""What a quantity is called, and its sign, where the sides are exchanged; the others stay."""
OF_THE_SLOPE, OF_THE_RANGE = 0.25, 0.02
"""What a change may differ from the mean of its slopes: of the larger slope, of the largest change over a range."""
CONTRADICTING = 0.1
"""What may lie beyond that, of all changes together; at one place as much as the steepest slope makes of a step.
Between nodes far apart a slope may be steeper than at both."""


@dataclass(frozen=True, eq=False, repr=False)
class PairTable:
    """Force and both flux linkages over the armature's position (towards side 1) and both currents; equal signs aid.

    Evaluation never extrapolates. Arrays have the shape (n_x, n_1, n_2).

    Attributes
    ----------
    one_sided : table of one magnet, over the gaps that the positions leave
    gap_sum : both gaps together, in m; side 1 has half of it less the position
    position, current_1, current_2 : nodes, increasing, in m and A
    nodes : the arrays named in `PAIR_NODES`
    extras : flux_density_<section> in T, mean over the section, _1 and _2 of the sides
    mesh_error, interpolation_error, reciprocity_error : as of `MagneticTable`
    provenance : how the table came to be
    """

    one_sided: MagneticTable
    gap_sum: float
    position: Array
    current_1: Array
    current_2: Array
    nodes: Mapping[str, Array]
    extras: Mapping[str, Array] = field(default_factory=dict)
    mesh_error: float = float("nan")
    interpolation_error: float = float("nan")
    reciprocity_error: float = float("nan")
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check(self)

    def __repr__(self) -> str:
        size = " x ".join(str(nodes.size) for nodes in self.axes)
        largest = format_quantity(float(np.abs(self.nodes["force"]).max()), "N")
        return f"PairTable({size}: {self.block}; largest force {largest}, mesh error {self.mesh_error:.1e})"

    @property
    def axes(self) -> tuple[Array, Array, Array]:
        return self.position, self.current_1, self.current_2

    @property
    def block(self) -> str:
        """The table's range, for messages."""
        return self.shared.block

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections whose flux density is stored."""
        return tuple(name.removeprefix(SECTION) for name in self.extras)

    @cached_property
    def shared(self) -> SharedCoenergy:
        """What the sides have in common."""
        return SharedCoenergy(self.difference, self.gap_sum)

    @cached_property
    def coupled(self) -> MagneticTable:
        """The table of one magnet, with what the sides have in common: what the coupled model takes."""
        return replace(self.one_sided, shared=self.shared)

    @cached_property
    def difference(self) -> PairSurface:
        """D, the coenergy beyond that of two magnets apart."""
        x, i, j = np.meshgrid(*self.axes, indexing="ij")
        apart = two_apart(self.one_sided, self.gap_sum / 2, x, i, j)
        rows = dict(zip(DERIVATIVES, PAIR_NODES, strict=True))
        nodes = {key: self.nodes[name] - apart[name] for key, name in rows.items() if key in CORNERS}
        mutual = nodes["12"].reshape(self.position.size, -1)
        degree = min(5, self.position.size - 1)
        slope = spline_derivative(self.position, mutual, self.position, degree=degree)
        return fit_pair_surface(*self.axes, nodes | {"x12": slope.reshape(x.shape)})

    def evaluate(self, position: ArrayLike, current_1: ArrayLike, current_2: ArrayLike) -> dict[str, Array]:
        """The quantities of `PAIR_NODES` at (position, current_1, current_2), broadcast together.

        Raises
        ------
        OutOfTable : a point outside the block of nodes or not a number
        """
        given = (np.asarray(v, dtype=float) for v in (position, current_1, current_2))
        x, i, j = np.broadcast_arrays(*given)
        together = self.shared.evaluate(x, i, j)
        apart = two_apart(self.one_sided, self.gap_sum / 2, x, i, j)
        return {name: together[key] + apart[name] for key, name in zip(DERIVATIVES, PAIR_NODES, strict=True)}


def two_apart(magnet: MagneticTable, half: float, x: Array, i: Array, j: Array) -> dict[str, Array]:
    """`PAIR_NODES` of two magnets that share nothing, at positions from the middle, `half` a gap sum away from both."""
    one = magnet.evaluate(i, half - x)
    two = magnet.evaluate(j, half + x)
    return {
        "coenergy": one["coenergy"] + two["coenergy"],
        "flux_linkage_1": one["flux_linkage"],
        "flux_linkage_2": two["flux_linkage"],
        "force": one["force"] - two["force"],
        "incremental_inductance_1": one["incremental_inductance"],
        "incremental_inductance_2": two["incremental_inductance"],
        "mutual_inductance": np.zeros(x.shape),
        "force_current_slope_1": one["force_current_slope"],
        "force_current_slope_2": -two["force_current_slope"],
        "force_position_slope": -one["force_gap_slope"] - two["force_gap_slope"],
    }


def _check(table: PairTable) -> None:
    names = ("position", "current_1", "current_2")
    for name, nodes in zip(names, table.axes, strict=True):
        finite = bool(np.isfinite(nodes).all())
        if nodes.ndim != 1 or nodes.size < FEWEST_NODES or not finite or not (np.diff(nodes) > 0).all():
            raise TableError(f"'{name}' must be {FEWEST_NODES} or more increasing values, it has {nodes.shape}")
    shape = tuple(nodes.size for nodes in table.axes)
    for name in PAIR_NODES:
        if name not in table.nodes:
            raise TableError(f"variable '{name}' is missing; a table of a pair has {', '.join(PAIR_NODES)}")
    for name, values in {**table.nodes, **table.extras}.items():
        if values.shape != shape:
            raise TableError(f"variable '{name}' has shape {values.shape}, expected {names} = {shape}")
        if not np.isfinite(values).all():
            raise TableError(f"variable '{name}' is not finite at {int((~np.isfinite(values)).sum())} nodes")
        if not np.abs(values).max() < LARGEST_VALUE:
            raise TableError(
                f"variable '{name}' reaches {np.abs(values).max():g}, above any magnet's; look at the unit"
            )
    half, gap = table.gap_sum / 2, table.one_sided.gap
    if not (half - table.position[-1] >= gap[0] and half - table.position[0] <= gap[-1]):
        raise TableError(
            f"gap_sum {table.gap_sum:g} m leaves gaps outside those of one magnet: {table.one_sided.rectangle}"
        )
    _check_slopes(table)
    for name in ERRORS:
        error = getattr(table, name)
        if not (np.isnan(error) or 0 <= error <= 1):
            raise TableError(f"{name} is {error:g}; it is a share of the largest value, 0 to 1, or nan where not known")


def _check_slopes(table: PairTable) -> None:
    """TableError where a stored array and the slope that belongs to it contradict each other over a whole range."""
    slopes = (
        ("coenergy", 1, "flux_linkage_1"),
        ("coenergy", 2, "flux_linkage_2"),
        ("coenergy", 0, "force"),
        ("flux_linkage_1", 1, "incremental_inductance_1"),
        ("flux_linkage_2", 2, "incremental_inductance_2"),
        ("flux_linkage_1", 2, "mutual_inductance"),
        ("flux_linkage_2", 1, "mutual_inductance"),
        ("force", 0, "force_position_slope"),
        ("force", 1, "force_current_slope_1"),
        ("force", 2, "force_current_slope_2"),
    )
    for name, axis, slope_name in slopes:
        nodes = table.axes[axis]
        change = np.diff(table.nodes[name], axis=axis)
        slope = table.nodes[slope_name]
        first, last = (np.take(slope, range(k, nodes.size - 1 + k), axis=axis) for k in (0, 1))
        step = np.expand_dims(np.diff(nodes), tuple(k for k in range(3) if k != axis))
        range_ = float(np.ptp(table.nodes[name], axis=axis).max())
        spread = np.abs(last - first) + OF_THE_SLOPE * np.maximum(np.abs(first), np.abs(last))
        excess = np.abs(change - step * (first + last) / 2) - spread * step - OF_THE_RANGE * range_
        steepest = step * np.abs(slope).max()
        share = np.maximum(excess, 0).sum() / max(float(np.abs(change).sum()), 1e-300)
        if share > CONTRADICTING or (excess > steepest).any():
            where = np.unravel_index(int(np.argmax(excess)), excess.shape)
            at = ", ".join(f"{nodes[k]:g}" for nodes, k in zip(table.axes, where, strict=True))
            raise TableError(
                f"'{name}' and its slope '{slope_name}' contradict each other beside ({at}); look at the sign and the "
                "unit of both"
            )


# --- the file --------------------------------------------------------------------------------------------------------


def write_pair_table(table: PairTable, path: str | Path) -> Path:
    """The NetCDF-4 file written; it appears whole or not at all."""
    dims = ("position", "current_1", "current_2")
    alone, variables = table.one_sided, {}
    coordinates = dict(zip(dims, table.axes, strict=True)) | {"gap": alone.gap, "current": alone.current}
    for name, values in coordinates.items():
        unit = "m" if name in ("position", "gap") else "A"
        variables[name] = NetcdfVariable((name,), values, {"units": unit})
    for name, values in {**table.nodes, **table.extras}.items():
        section = name.removeprefix(SECTION).replace("_", " ")
        unit, long_name = PAIR_NODES.get(name, ("T", f"mean flux density in the iron, {section}"))
        variables[name] = NetcdfVariable(dims, np.asarray(values), {"units": unit, "long_name": long_name})
    for name, values in {**alone.nodes, **alone.extras}.items():
        unit = NODES[name][0] if name in NODES else "T" if name.startswith(SECTION) else "N"
        variables[ONE_SIDED + name] = NetcdfVariable(("gap", "current"), np.asarray(values), {"units": unit})
    attributes: dict[str, Any] = {
        "schema": SCHEMA,
        "title": "force and flux of two magnets with one armature over its position and both currents",
        "gap_sum": table.gap_sum,
        "provenance": json.dumps(dict(table.provenance), sort_keys=True),
        ONE_SIDED + "provenance": json.dumps(dict(alone.provenance), sort_keys=True),
    }
    attributes |= {name: getattr(table, name) for name in ERRORS}
    attributes |= {ONE_SIDED + name: getattr(alone, name) for name in ERRORS}
    target = Path(path)
    with whole_file(target) as partial:
        write_variables(variables, attributes, partial)
    return target


def is_pair_table(path: str | Path) -> bool:
    """Whether a NetCDF file has the coordinates of a pair; TableError where it is no such file."""
    variables, _ = _read(Path(path))
    return "position" in variables


def read_pair_table(path: str | Path) -> PairTable:
    """The table of a pair in a NetCDF file; raises TableError."""
    variables, attributes = _read(Path(path))
    if "position" not in variables:
        raise TableError(
            f"{path}: this is the table of one magnet; make that of a pair with 'msl-fem table ACTUATOR --sides both'"
        )
    return _pair_of(variables, attributes, path)


def _pair_of(variables: Mapping[str, NetcdfVariable], attributes: Mapping[str, Any], path: str | Path) -> PairTable:
    """The table that a file's content tells; TableError."""
    try:
        alone = _with_dims(variables, ("gap", "current"), ONE_SIDED)
        own = _with_dims(variables, ("position", "current_1", "current_2"))
        one_sided = MagneticTable(
            _values(variables, "gap"),
            _values(variables, "current"),
            {name: values for name, values in alone.items() if name in NODES},
            {name: values for name, values in alone.items() if name not in NODES},
            mesh_error=_error(attributes, ONE_SIDED + "mesh_error"),
            interpolation_error=_error(attributes, ONE_SIDED + "interpolation_error"),
            reciprocity_error=_error(attributes, ONE_SIDED + "reciprocity_error"),
            provenance=_json(attributes, ONE_SIDED + "provenance"),
        )
        return PairTable(
            one_sided,
            float(attributes["gap_sum"]),
            _values(variables, "position"),
            _values(variables, "current_1"),
            _values(variables, "current_2"),
            nodes={name: values for name, values in own.items() if name in PAIR_NODES},
            extras={name: values for name, values in own.items() if name.startswith(SECTION)},
            mesh_error=_error(attributes, "mesh_error"),
            interpolation_error=_error(attributes, "interpolation_error"),
            reciprocity_error=_error(attributes, "reciprocity_error"),
            provenance=_json(attributes, "provenance"),
        )
    except TableError as err:
        raise TableError(f"{path}: {err}") from err
    except Exception as err:  # attributes and variables of a foreign file can be of any kind
        raise TableError(f"{path}: not the table of a pair ({err or type(err).__name__})") from err


def load_table(path: str | Path) -> MagneticTable:
    """The table of one magnet in a file; where that is of a pair, with what the sides have in common.

    Raises
    ------
    TableError : as of `read_table` and `read_pair_table`
    """
    variables, attributes = _read(Path(path))
    return _pair_of(variables, attributes, path).coupled if "position" in variables else read_table(path)


def save_table(table: MagneticTable, path: str | Path) -> Path:
    """The file that `load_table` reads back; it appears whole or not at all."""
    if table.shared is None:
        return write_table(table, path)
    surface, half = table.shared.surface, table.shared.gap_sum / 2
    axes = surface.position, surface.current_1, surface.current_2
    x, i, j = np.meshgrid(*axes, indexing="ij")
    together = table.shared.evaluate(x, i, j)
    apart = two_apart(table, half, x, i, j)
    nodes = {name: together[key] + apart[name] for key, name in zip(DERIVATIVES, PAIR_NODES, strict=True)}
    one_sided, pair = replace(table, shared=None), (table.shared.gap_sum, *axes)
    return write_pair_table(PairTable(one_sided, *pair, nodes=nodes, provenance=table.provenance), path)


def _values(variables: Mapping[str, NetcdfVariable], name: str) -> Array:
    values = variables[name].values
    if values.dtype.kind not in "fiu":
        raise TableError(f"variable '{name}' holds {values.dtype}, expected real numbers")
    return np.asarray(values, dtype=float)


def _with_dims(variables: Mapping[str, NetcdfVariable], dims: tuple[str, ...], prefix: str = "") -> dict[str, Array]:
    """The variables over these dimensions whose names begin so, by the rest of their names."""
    chosen = [name for name, variable in variables.items() if variable.dims == dims and name.startswith(prefix)]
    return {name.removeprefix(prefix): _values(variables, name) for name in chosen}


def _error(attributes: Mapping[str, Any], name: str) -> float:
    return float(attributes.get(name, "nan"))


def _json(attributes: Mapping[str, Any], name: str) -> dict[str, Any]:
    content = json.loads(attributes.get(name, "{}")) or {}
    if not isinstance(content, dict):
        raise TableError(f"attribute '{name}' must be a JSON object")
    return content


def _read(path: Path) -> tuple[dict[str, NetcdfVariable], dict[str, Any]]:
    if not path.is_file():
        problem = "is no file" if path.exists() else "no such file"
        raise TableError(f"{path}: {problem}; make a table with 'msl-fem table'")
    try:
        return read_variables(path, most_values=MOST_VALUES)
    except Exception as err:
        raise TableError(f"{path}: not a magnetic table ({err or type(err).__name__})") from err
