"""The magnetic table, the waist between field solutions and models: a frozen record with one interpolant."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.computing.arrays import Array
from msl_fem.errors import OutOfTable, TableError
from msl_fem.files.netcdf_file import NetcdfVariable, read_variables, write_variables
from msl_fem.files.quantity import format_quantity
from msl_fem.files.shown import Tabular
from msl_fem.files.whole_file import whole_file
from msl_fem.table.coenergy_surface import CoenergySurface, fit_coenergy_surface
from msl_fem.table.consistency import check_consistency
from msl_fem.table.pair_surface import SharedCoenergy

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

EXAMPLES = Path(__file__).parent / "examples"
"""Tables that an installed package has; copies of those in lookup_tables/."""
SCHEMA = 1
INTERPOLANT = "C3 quintic Hermite coenergy spline"
NODES = {
    "coenergy": ("J", "coenergy W'"),
    "flux_linkage": ("Wb", "flux linkage, dW'/di"),
    "force": ("N", "force, attractive positive, -dW'/dgap by virtual work"),
    "incremental_inductance": ("H", "incremental inductance, d2W'/di2"),
    "force_current_slope": ("N/A", "dF/di = -dlambda/dgap"),
    "force_gap_slope": ("N/m", "dF/dgap"),
}
EXTRAS = {"force_stress_tensor": ("N", "force by the Maxwell stress tensor in mid-gap")}
SECTION = "flux_density_"
COORDINATES = {"gap": ("m", "air gap between pole faces and armature"), "current": ("A", "coil current of one magnet")}
SMALLEST_GAP, LARGEST_GAP = 1e-9, 100.0  # m
LARGEST_CURRENT, LARGEST_VALUE = 1e6, 1e20  # A, SI: beyond are mistakes of units and damaged files
MOST_VALUES = 20_000_000  # of a file
AT_REST = 1e-9  # of the largest value: what a quantity that vanishes without current may have there


@dataclass(frozen=True, eq=False, repr=False)
class MagneticTable(Tabular):
    """Force and flux of one magnet over gap and current, with exact derivatives and a stated error.

    Arrays have the shape (n_gap, n_current) and belong to one magnet of the full stack depth; the first current is 0,
    and negative currents follow from symmetry. Evaluation never extrapolates.

    Attributes
    ----------
    gap, current : (n_gap,) m and (n_current,) A, increasing
    nodes : the arrays named in `NODES`
    extras : force_stress_tensor (N) and flux_density_<section> (T, mean over the section, in the iron)
    mesh_error, interpolation_error : relative to the table's largest force; nan where not known
    reciprocity_error : largest difference of force or flux linkage between independent field solutions at midpoints
        and the interpolant's derivatives, each of its full scale; nan where not known
    provenance : how the table came to be
    shared : what the armature adds where it belongs to two such magnets; None: the table knows one magnet alone
    """

    gap: Array
    current: Array
    nodes: Mapping[str, Array]
    extras: Mapping[str, Array] = field(default_factory=dict)
    mesh_error: float = float("nan")
    interpolation_error: float = float("nan")
    reciprocity_error: float = float("nan")
    provenance: Mapping[str, Any] = field(default_factory=dict)
    shared: SharedCoenergy | None = None

    def __post_init__(self) -> None:
        _check(self)

    def __repr__(self) -> str:
        largest = format_quantity(float(np.abs(self.nodes["force"]).max()), "N")
        size = f"{self.gap.size} gaps x {self.current.size} currents"
        return f"MagneticTable({size}: {self.rectangle}; largest force {largest}, mesh error {self.mesh_error:.1e})"

    def facts(self) -> dict[str, str]:
        """Range, largest force and stated errors."""
        errors = {
            "mesh error": self.mesh_error,
            "interpolation error": self.interpolation_error,
            "reciprocity error": self.reciprocity_error,
        }
        return {
            "actuator": str(self.provenance.get("actuator", "not known")),
            "nodes": f"{self.gap.size} gaps x {self.current.size} currents",
            "range": self.rectangle,
            "largest force": format_quantity(float(np.abs(self.nodes["force"]).max()), "N"),
            **{name: "not known" if np.isnan(value) else f"{100 * value:.2g} %" for name, value in errors.items()},
        }

    def frame_columns(self) -> dict[str, Array]:
        """A row a node, all currents of a gap before those of the next: gap_m, current_A, force_N ..."""
        gap, current = np.meshgrid(self.gap, self.current, indexing="ij")
        columns = {"gap_m": gap.ravel(), "current_A": current.ravel()}
        units = {name: unit.replace("/", "_per_") for name, (unit, _) in (NODES | EXTRAS).items()}
        values = {**self.nodes, **self.extras}
        return columns | {f"{name}_{units.get(name, 'T')}": array.ravel() for name, array in values.items()}

    def to_pandas(self) -> "pd.DataFrame":
        """A row a node over gap_m and current_A; names end in SI units, `force_N`."""
        return super().to_pandas().set_index("current_A", append=True)

    @cached_property
    def surface(self) -> CoenergySurface:
        """The interpolant."""
        return fit_coenergy_surface(self.gap, self.current, dict(self.nodes))

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections whose flux density is stored."""
        return tuple(name.removeprefix(SECTION) for name in self.extras if name.startswith(SECTION))

    @property
    def rectangle(self) -> str:
        """The table's range, for messages."""
        return (
            f"gap {self.gap[0] * 1e3:.3g} ... {self.gap[-1] * 1e3:.3g} mm, "
            f"current up to {self.current[-1]:.3g} A in size"
        )

    def evaluate(self, current: ArrayLike, gap: ArrayLike) -> dict[str, Array]:
        """The quantities of `NODES` in SI units at (current in A, gap in m), broadcast; currents may be negative.

        Raises
        ------
        OutOfTable : a point outside the rectangle or not a number
        """
        i, g = np.asarray(current, dtype=float), np.asarray(gap, dtype=float)
        values = self.surface(i, g)
        if np.isnan(values).any():
            self._complain(*np.broadcast_arrays(i, g))
        return dict(zip(NODES, values, strict=True))

    def to_xarray(self) -> "xr.Dataset":
        """The nodes' arrays with units over gap (m) and current (A), stated errors and provenance as attributes."""
        import xarray as xr

        variables, attributes = self._content()
        return xr.Dataset({name: tuple(one) for name, one in variables.items()}, attrs=attributes)

    def _content(self) -> tuple[dict[str, NetcdfVariable], dict[str, Any]]:
        """The variables and attributes of its file."""
        units, variables = NODES | EXTRAS, {}
        for name, (unit, long_name) in COORDINATES.items():
            values = getattr(self, name)
            variables[name] = NetcdfVariable((name,), values, {"units": unit, "long_name": long_name})
        for name, values in {**self.nodes, **self.extras}.items():
            section = name.removeprefix(SECTION).replace("_", " ")
            unit, long_name = units.get(name, ("T", f"mean flux density in the iron, {section}"))
            about = {"units": unit, "long_name": long_name}
            variables[name] = NetcdfVariable(("gap", "current"), np.asarray(values), about)
        return variables, {
            "schema": SCHEMA,
            "title": "force and flux of one magnet over gap and current",
            "interpolant": INTERPOLANT,
            "mesh_error": self.mesh_error,
            "interpolation_error": self.interpolation_error,
            "reciprocity_error": self.reciprocity_error,
            "certificate": json.dumps(self.provenance.get("certificate", {}), sort_keys=True),
            "provenance": json.dumps(dict(self.provenance), sort_keys=True),
        }

    def _complain(self, i: Array, g: Array) -> None:
        gaps = f"{self.gap[0] * 1e3:.4g} ... {self.gap[-1] * 1e3:.4g} mm"
        highest = self.current[-1]
        bad_gap = ~((g >= self.gap[0]) & (g <= self.gap[-1]))
        if bad_gap.any():
            raise OutOfTable(
                f"gap {format_quantity(float(g[bad_gap].flat[0]), 'm')} lies outside the table's {gaps} "
                f"(currents up to {highest:g} A); extend the sweep (--gaps) or clip the request"
            )
        bad = ~(np.abs(i) <= highest)
        worst = format_quantity(float(i[bad].flat[0]), "A") if bad.any() else "nan"
        raise OutOfTable(
            f"current {worst} lies outside the table's 0 ... {highest:g} A of either sign (gaps {gaps}); "
            "extend the sweep (--currents) or clip the request"
        )

    def force(self, current: ArrayLike, gap: ArrayLike) -> Array:
        """Force in N, attractive positive; raises OutOfTable."""
        return self.evaluate(current, gap)["force"]

    def flux_linkage(self, current: ArrayLike, gap: ArrayLike) -> Array:
        """Flux linkage in Wb; raises OutOfTable."""
        return self.evaluate(current, gap)["flux_linkage"]


def _check(table: MagneticTable) -> None:
    _check_grid(table)
    shape = (table.gap.size, table.current.size)
    for name in NODES:
        if name not in table.nodes:
            raise TableError(f"variable '{name}' is missing; a table has {', '.join(NODES)}")
    for name, values in {**table.nodes, **table.extras}.items():
        if values.shape != shape:
            raise TableError(f"variable '{name}' has shape {values.shape}, expected (gap, current) = {shape}")
        if name in NODES and not np.isfinite(values).all():
            m, n = np.argwhere(~np.isfinite(values))[0]
            raise TableError(
                f"variable '{name}' is not finite at gap {table.gap[m]:g} m, current {table.current[n]:g} A"
            )
    if table.gap[-1] > LARGEST_GAP or table.gap[0] < SMALLEST_GAP:
        raise TableError(
            f"gaps of {table.gap[0]:g} ... {table.gap[-1]:g} m are not a magnet's, allowed are "
            f"{SMALLEST_GAP:g} ... {LARGEST_GAP:g} m; look at the unit"
        )
    for name, (unit, _) in NODES.items():
        largest = np.abs(table.nodes[name]).max()
        if not largest < LARGEST_VALUE:
            raise TableError(
                f"variable '{name}' reaches {largest:g} {unit}, above any magnet's ({LARGEST_VALUE:g}); "
                "look at the unit"
            )
    for name in ("coenergy", "flux_linkage", "force", "force_current_slope", "force_gap_slope"):
        values = np.abs(table.nodes[name])
        at_rest = values[:, 0].max()
        if at_rest > AT_REST * values.max():
            raise TableError(
                f"variable '{name}' reaches {at_rest:g} at i = 0; it must vanish there: a table is of a "
                "magnet without remanence and without permanent magnets"
            )
    check_consistency(table.gap, table.current, table.nodes)
    for name in ("mesh_error", "interpolation_error", "reciprocity_error"):
        error = getattr(table, name)
        if not (np.isnan(error) or 0 <= error <= 1):
            raise TableError(f"{name} is {error:g}; it is a share of the largest value, 0 to 1, or nan where not known")


def _check_grid(table: MagneticTable) -> None:
    gap, current = table.gap, table.current
    if gap.ndim != 1 or current.ndim != 1 or gap.size < 2 or current.size < 3:
        raise TableError(
            f"a table needs at least 2 gaps and 3 currents (0 included), this one has {(gap.size, current.size)}"
        )
    if not (np.isfinite(gap).all() and np.isfinite(current).all()):
        raise TableError("gaps and currents must be finite numbers")
    if not (np.diff(gap) > 0).all() or not (np.diff(current) > 0).all() or gap[0] <= 0:
        raise TableError("gaps must be positive and increasing, currents increasing")
    if current[-1] > LARGEST_CURRENT:
        raise TableError(
            f"currents up to {current[-1]:g} A are not a magnet's, allowed are {LARGEST_CURRENT:g} A; look at the unit"
        )
    if current[0] != 0:
        raise TableError(f"the first current must be 0, it is {current[0]:g} A")


def write_table(table: MagneticTable, path: str | Path) -> Path:
    """The NetCDF-4 file written; it appears whole or not at all."""
    content = table._content()
    target = Path(path)
    with whole_file(target) as partial:
        write_variables(*content, partial)
    return target


def _check_units(variables: Mapping[str, NetcdfVariable], attributes: Mapping[str, Any]) -> None:
    """TableError where a schema or a unit is stated and is not ours; a foreign table may state none."""
    if int(attributes.get("schema", SCHEMA)) != SCHEMA:
        raise TableError(f"schema {attributes['schema']} is not {SCHEMA}, the one this version reads")
    units = {name: unit for name, (unit, _) in (NODES | EXTRAS).items()}
    units |= {"gap": "m", "current": "A"}
    for name, unit in units.items():
        stated = variables[name].attributes.get("units", unit) if name in variables else unit
        if stated != unit:
            raise TableError(f"variable '{name}' is in '{stated}', expected '{unit}'")


def _nodes_and_extras(variables: Mapping[str, NetcdfVariable]) -> dict[str, Array]:
    """(n_gap, n_current) the variables that are a table's; TableError where one has other dimensions."""
    arrays = {}
    for name, variable in variables.items():
        if name not in NODES | EXTRAS and not name.startswith(SECTION):
            continue
        if set(variable.dims) != {"gap", "current"}:
            raise TableError(f"variable '{name}' has dimensions {variable.dims}, expected ('gap', 'current')")
        values = _real(name, variables)
        arrays[name] = values if variable.dims == ("gap", "current") else values.T
    return arrays


def _real(name: str, variables: Mapping[str, NetcdfVariable]) -> Array:
    """The values; TableError where they are not there or are no real numbers."""
    if name not in variables:
        raise TableError(f"No variable named '{name}'")
    values = variables[name].values
    if values.dtype.kind not in "fiu":
        raise TableError(f"variable '{name}' holds {values.dtype}, expected real numbers")
    return np.asarray(values, dtype=float)


def read_table(path: str | Path) -> MagneticTable:
    """The table in a NetCDF file, or that of an example of the package by the actuator's name: "fast_tool_servo".

    Raises
    ------
    TableError : no such file, not NetCDF, or a variable is missing or contradicts the others
    """
    if not Path(path).exists() and (EXAMPLES / f"{path}.nc").is_file():
        path = EXAMPLES / f"{path}.nc"
    if not Path(path).is_file():
        problem = "is no file" if Path(path).exists() else "no such file"
        raise TableError(f"{path}: {problem}; make a table with 'msl-fem table'")
    try:
        variables, attributes = read_variables(Path(path), most_values=MOST_VALUES)
        if "position" in variables and "current_2" in variables:
            raise TableError("it is of both sides and their armature")
        arrays = _nodes_and_extras(variables)
        gap = _real("gap", variables)
        current = _real("current", variables)
        _check_units(variables, attributes)
        provenance = json.loads(attributes.get("provenance", "{}")) or {}
        if not isinstance(provenance, dict):
            raise TableError("attribute 'provenance' must be a JSON object")
        names = ("mesh_error", "interpolation_error", "reciprocity_error")
        mesh_error, interpolation_error, reciprocity_error = (float(attributes.get(name, "nan")) for name in names)
    except Exception as err:  # attributes and variables of a foreign file can be of any kind
        raise TableError(
            f"{path}: not a magnetic table ({err or type(err).__name__}); make one with 'msl-fem table'"
        ) from err
    try:
        nodes = {k: v for k, v in arrays.items() if k in NODES}
        extras = {k: v for k, v in arrays.items() if k not in NODES}
        return MagneticTable(
            gap,
            current,
            nodes,
            extras,
            mesh_error=mesh_error,
            interpolation_error=interpolation_error,
            reciprocity_error=reciprocity_error,
            provenance=provenance,
        )
    except TableError as err:
        raise TableError(f"{path}: {err}") from err
