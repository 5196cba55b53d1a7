"""A MagneticTable from scattered static measurements of force and flux linkage, with the residuals stated."""

import datetime
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError, InputError, TableError
from msl_fem.files.quantity import format_quantity
from msl_fem.record.columns import FIRST_ROW
from msl_fem.record.record import StaticMap
from msl_fem.record.rig_file import Noise
from msl_fem.table.coenergy_fit import SMOOTHING, CoenergyFit, Samples, SaturatingReluctance, fit_base, fit_coenergy
from msl_fem.table.magnetic_table import NODES, MagneticTable

GAPS, CURRENTS = 20, 34
FEWEST_ROWS, FEWEST_GAPS, FEWEST_CURRENTS = 20, 3, 3
FAR = 0.15
"""Data are thin in a cell whose middle has no measurement within this share of the rectangle's sides ..."""
VAGUE = 0.05
"""... or whose force has a 95 % band beyond this share of the largest force."""
SUSPICIOUS = 2.0
"""Residuals beyond this multiple of the stated noise are said: something else than noise is in the data."""
OUTLIER = 8.0
"""Sigma beyond which a row is named."""
MEDIAN_OF_NORMAL = 0.6745
"""Of the absolute value, over sigma."""
CONTRADICTION = 0.3
"""Share of its values by which the fit may miss force or flux linkage, in the median over the rows."""
CHANNELS = {"force": ("N", "force_N"), "flux_linkage": ("Wb", "flux_linkage_Wb")}


@dataclass(frozen=True)
class MeasuredReport:
    """What the fit found; field names as in the command line's JSON.

    Attributes
    ----------
    points : measured rows used (role "fit")
    force_residual, flux_linkage_residual : RMS of (measured - table) over the stated noise; None where not measured
    held_out_force_residual, held_out_flux_linkage_residual : the same over the rows of role "held-out"
    force_error : largest 95 % band of the fitted force where data are not thin, of the largest force; from the stated
        noise, or from the residuals where they are larger
    interpolation_error, reciprocity_error : of the table's interpolant against the fitted surface, as in a table
    smoothing : weight of the penalty, by cross-validation; a note says where it was raised
    cells, thin_cells : of the table's grid, and those where data are thin
    notes : what a user should know
    """

    points: int
    force_residual: float | None
    flux_linkage_residual: float | None
    held_out_force_residual: float | None
    held_out_flux_linkage_residual: float | None
    force_error: float
    interpolation_error: float
    reciprocity_error: float
    smoothing: float
    cells: int
    thin_cells: int
    notes: tuple[str, ...]


def table_from_measurements(
    static: StaticMap,
    noise: Noise,
    *,
    gaps: ArrayLike | None = None,
    currents: ArrayLike | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> tuple[MagneticTable, MeasuredReport]:
    """The table fitted to a static map, and how well it fits.

    One coenergy surface is fitted to force and flux linkage together, each weighted by its stated noise; noise of
    current and position counts through the slopes (effective variance: Orear, Am. J. Phys. 50 (1982) 912-916). The
    table spans the measured rectangle and never more. Flux linkage alone fixes the coenergy, and with it the force by
    virtual work. Force alone fixes it up to a function of the current (the flux that does not depend on the gap, of
    leakage across the window); that part is then taken to be nought beyond the fitted reluctance, and a note says so.

    Parameters
    ----------
    static : rows of one magnet; those of role "fit" are fitted
    noise : one sigma of force (N) and flux linkage (Wb) for the quantities measured; current and position where known
    gaps, currents : (n,) nodes in m and A inside the measured rectangle; 20 and 34 of them where left out
    provenance : entries to add to the table's own, like the record's folder

    Raises
    ------
    InputError : too few rows, no noise stated for a measured quantity, a grid beyond the measurements, force and flux
        linkage that contradict each other
    ComputationError : the rows are not those of a reluctance magnet
    """
    samples = _all_samples(static, noise, "fit")
    _refuse_too_few(samples)
    gap, current = _grid(samples, gaps, currents)
    base = fit_base(samples)
    weighted = {name: _effective(s, name, base, noise) for name, s in samples.items()}
    fit, table = _positive_fit(weighted, base, gap, current)
    _refuse_contradiction(fit, weighted)
    report = _report(static, noise, fit=fit, table=table, weighted=weighted)
    table = replace(
        table,
        interpolation_error=report.interpolation_error,
        reciprocity_error=report.reciprocity_error,
        provenance={
            "solver": "none: one coenergy surface fitted to static measurements",
            "reluctance": asdict(base),
            **{name: value for name, value in asdict(report).items() if name != "notes"},
            "stated_noise": noise.model_dump(exclude_none=True),
            "versions": {name: version(name) for name in ("msl-fem", "numpy", "scipy")},
            "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
            "notes": list(report.notes),
            **(provenance or {}),
        },
    )
    return table, report


def _positive_fit(
    samples: Mapping[str, Samples], base: SaturatingReluctance, gap: Array, current: Array
) -> tuple[CoenergyFit, MagneticTable]:
    """The fit and its table, smoothed further where that is no magnet's: inductance and force are to be above 0."""
    i, g = _dense(current, gap)
    least = 0.0
    while least <= SMOOTHING[-1]:
        fit = fit_coenergy(samples, base, keep_positive=(i, g), least_smoothing=least)
        try:
            table = _sampled(fit, gap, current)
        except TableError:  # a force below 0 where rows are thin and their noise is understated
            table = None
        if table is not None and (table.evaluate(i, g)["incremental_inductance"] > 0).all():
            return fit, table
        least = 10 * fit.smoothing
    raise ComputationError(
        "the fitted force or incremental inductance falls below 0 at or between the nodes; give more --gaps and "
        "--currents, or check the rows for outliers and the noise stated for them"
    )


def _all_samples(static: StaticMap, noise: Noise, role: str) -> dict[str, Samples]:
    """The rows of a role by the quantity measured."""
    samples = {name: _samples(static, noise, name, role) for name in CHANNELS}
    return {name: s for name, s in samples.items() if s is not None}


def _samples(static: StaticMap, noise: Noise, name: str, role: str) -> Samples | None:
    """The rows of a role with current, signs folded into the first quadrant; None where there are none."""
    values: Array | None = getattr(static, name)
    if values is None:
        return None
    sigma: float | None = getattr(noise, name)
    unit, column = CHANNELS[name]
    if not sigma:
        raise InputError(
            f"the noise of {column} is not stated, and without it nobody knows what a row is worth; add "
            f'[noise] {name} = "... {unit}" (one sigma, above 0) to rig.toml'
        )
    kept = (static.role == role) & (static.current != 0)
    if not kept.any():
        return None
    i = static.current[kept]
    folded = values[kept] * (np.sign(i) if name == "flux_linkage" else 1.0)
    return Samples(np.abs(i), static.gap[kept], folded, np.full(i.size, sigma))


def _effective(s: Samples, name: str, base: SaturatingReluctance, noise: Noise) -> Samples:
    """The samples with the noise of current and position turned into that of the value."""
    slopes = base.derivatives(s.current, s.gap)
    along_i, along_g = ((1, 1), (0, 2)) if name == "force" else ((2, 0), (1, 1))
    variance = s.sigma**2
    variance = variance + (slopes[along_i] * (noise.current or 0.0)) ** 2
    variance = variance + (slopes[along_g] * (noise.position or 0.0)) ** 2
    return replace(s, sigma=np.sqrt(variance))


def _refuse_too_few(samples: Mapping[str, Samples]) -> None:
    if not samples:
        raise InputError('no rows with role "fit" and a current; a table needs some')
    rows = sum(s.gap.size for s in samples.values())
    gaps = np.unique(np.concatenate([s.gap for s in samples.values()])).size
    currents = np.unique(np.concatenate([s.current for s in samples.values()])).size
    if rows < FEWEST_ROWS or gaps < FEWEST_GAPS or currents < FEWEST_CURRENTS:
        raise InputError(
            f"{rows} values at {gaps} gaps and {currents} currents are too few for a table; measure at least "
            f"{FEWEST_ROWS}, at {FEWEST_GAPS} gaps and {FEWEST_CURRENTS} currents beside 0"
        )


def _grid(samples: Mapping[str, Samples], gaps: ArrayLike | None, currents: ArrayLike | None) -> tuple[Array, Array]:
    """Nodes inside the measured rectangle: geometric gaps, currents denser at small ones."""
    measured = np.unique(np.concatenate([s.gap for s in samples.values()]))
    smallest, largest = float(measured[measured > 0][0]), float(measured[-1])
    highest = max(float(s.current.max()) for s in samples.values())
    gap = np.geomspace(smallest, largest, GAPS)
    if gaps is not None:
        gap = np.unique(np.asarray(gaps, dtype=float))
    current = highest * np.linspace(0, 1, CURRENTS) ** 1.5
    if currents is not None:
        current = np.unique(np.r_[0.0, np.asarray(currents, dtype=float)])
    for end, bound in ((0, smallest), (-1, largest)):
        if np.isclose(gap[end], bound, rtol=1e-9):
            gap[end] = bound
    inside = gap[0] >= smallest and gap[-1] <= largest and current[0] >= 0 and current[-1] <= highest * (1 + 1e-9)
    if not inside:  # also for nan
        raise InputError(
            f"the grid leaves the measurements: gaps {smallest * 1e3:.4g} ... {largest * 1e3:.4g} mm and currents up "
            f"to {highest:.4g} A are measured; give --gaps and --currents inside, or leave them out"
        )
    if gap.size < 3 or current.size < 4:
        raise InputError(
            f"a grid of {gap.size} gaps and {current.size - 1} currents is too small; give at least 3 each"
        )
    return gap, np.minimum(current, highest)


def _dense(current: Array, gap: Array) -> tuple[Array, Array]:
    """Nodes and middles of a grid as points (current, gap)."""
    i, g = np.meshgrid(np.sort(np.r_[current, _middles(current)]), np.sort(np.r_[gap, _middles(gap)]))
    return i.ravel(), g.ravel()


def _middles(nodes: Array) -> Array:
    return (nodes[1:] + nodes[:-1]) / 2


def _sampled(fit: CoenergyFit, gap: Array, current: Array) -> MagneticTable:
    i, g = (v.ravel() for v in np.meshgrid(current, gap))
    shape = gap.size, current.size
    nodes = {name: fit(name, i, g)[0].reshape(shape) for name in NODES}
    return MagneticTable(gap, current, nodes)


def _report(
    static: StaticMap, noise: Noise, *, fit: CoenergyFit, table: MagneticTable, weighted: Mapping[str, Samples]
) -> MeasuredReport:
    residual = {name: _residual(fit, name, s) for name, s in weighted.items()}
    held_out = {}
    for name, s in _all_samples(static, noise, "held-out").items():
        kept = _inside(fit, s)
        if kept.gap.size:
            held_out[name] = _residual(fit, name, _effective(kept, name, fit.base, noise))
    i, g = _dense(table.current, table.gap)
    between = table.evaluate(i, g)
    error = {}
    for name in CHANNELS:
        largest = np.abs(fit(name, i, g)[0] - between[name]).max()
        error[name] = float(largest / np.abs(table.nodes[name]).max())
    thin = _thin(fit, table, weighted, excess=max(1.0, *residual.values()))
    return MeasuredReport(
        points=int(np.count_nonzero(static.role == "fit")),
        force_residual=residual.get("force"),
        flux_linkage_residual=residual.get("flux_linkage"),
        held_out_force_residual=held_out.get("force"),
        held_out_flux_linkage_residual=held_out.get("flux_linkage"),
        force_error=thin.force_error,
        interpolation_error=error["force"],
        reciprocity_error=max(error.values()),
        smoothing=fit.smoothing,
        cells=thin.cells,
        thin_cells=thin.count,
        notes=tuple([*_data_notes(static, residual, fit, noise), *thin.notes]),
    )


def _residual(fit: CoenergyFit, name: str, s: Samples) -> float:
    """RMS of (measured - fitted) over sigma."""
    error = s.value - fit(name, s.current, s.gap)[0]
    return float(np.sqrt(np.mean((error / s.sigma) ** 2)))


def _inside(fit: CoenergyFit, s: Samples) -> Samples:
    """The samples within the fitted rectangle."""
    smallest, largest, highest = fit.span
    kept = (s.gap >= smallest) & (s.gap <= largest) & (s.current <= highest)
    return Samples(s.current[kept], s.gap[kept], s.value[kept], s.sigma[kept])


@dataclass(frozen=True)
class _Thin:
    """Where data are thin, counted by cells of the grid."""

    cells: int
    count: int
    force_error: float
    notes: tuple[str, ...]


def _thin(fit: CoenergyFit, table: MagneticTable, samples: Mapping[str, Samples], *, excess: float) -> _Thin:
    """The cells far from measurements or of vague force; `excess` is that of the residuals over the stated noise.

    A magnet without remanence is known at i = 0, so that side of the rectangle counts as measured.
    """
    i, g = (v.ravel() for v in np.meshgrid(_middles(table.current), _middles(table.gap)))
    width, height = table.current[-1], table.gap[-1] - table.gap[0]
    apart = i / width
    for s in samples.values():
        away = np.hypot((i[:, None] - s.current) / width, (g[:, None] - s.gap) / height)
        apart = np.minimum(apart, away.min(axis=1))
    band = 1.96 * excess * fit("force", i, g)[1] / np.abs(table.nodes["force"]).max()
    far = apart > FAR
    thin = far | (band > VAGUE)
    if not thin.any():
        return _Thin(i.size, 0, float(band.max()), ())
    worst = int(np.argmax(np.where(far, apart, 0.0) if far.any() else band))
    why = f"{np.count_nonzero(far)} of them have no measurement within {FAR * 100:g} % of the measured ranges"
    note = (
        f"data are thin in {np.count_nonzero(thin)} of {i.size} cells of the grid (worst near {i[worst]:.3g} A, "
        f"{format_quantity(float(g[worst]), 'm')}): {why}, in the others force is uncertain by more than "
        f"{VAGUE * 100:g} % of the largest; there the table rests on the smooth reluctance model, so measure there"
    )
    return _Thin(i.size, int(np.count_nonzero(thin)), float(band[~thin].max(initial=0.0)), (note,))


def _outlier_notes(static: StaticMap, noise: Noise, fit: CoenergyFit) -> list[str]:
    """A note for each quantity of which single rows lie far off the fit, by the noise or by the other rows' errors."""
    notes = []
    for name, s in _all_samples(static, noise, "fit").items():
        rows = np.flatnonzero((static.role == "fit") & (static.current != 0))
        weighted = _effective(s, name, fit.base, noise)
        off = np.abs(s.value - fit(name, s.current, s.gap)[0]) / weighted.sigma
        far = np.flatnonzero(off > OUTLIER * max(1.0, float(np.median(off)) / MEDIAN_OF_NORMAL))
        if far.size:
            worst = far[np.argsort(-off[far])][:5]
            listed = ", ".join(f"{rows[k] + FIRST_ROW['.csv']} ({off[k]:.0f} sigma)" for k in worst)
            notes.append(
                f"{CHANNELS[name][1]}: {far.size} of {off.size} rows lie more than {OUTLIER:g} sigma off the fit, "
                f"static.csv row {listed}; look at them, or leave them out"
            )
    return notes


def _refuse_contradiction(fit: CoenergyFit, samples: Mapping[str, Samples]) -> None:
    """InputError where no one coenergy has both the measured force and the measured flux linkage as derivatives."""
    if len(samples) < 2:
        return
    missed = {}
    for name, s in samples.items():
        error = s.value - fit(name, s.current, s.gap)[0]
        missed[name] = float(np.median(np.abs(error)) / np.median(np.abs(s.value)))
    if max(missed.values()) > CONTRADICTION:
        shares = " and ".join(f"{CHANNELS[name][1]} by {share:.0%}" for name, share in missed.items())
        raise InputError(
            "static.csv: force and flux linkage contradict each other: the coenergy that fits both best misses "
            f"{shares} in the median; look at the units of gap_m, current_A, force_N and flux_linkage_Wb"
        )


def _data_notes(static: StaticMap, residual: Mapping[str, float], fit: CoenergyFit, noise: Noise) -> list[str]:
    notes = _outlier_notes(static, noise, fit)
    if "flux_linkage" not in residual:
        notes.append(
            "no flux linkage was measured: force fixes the coenergy up to a function of the current, so flux linkage "
            "and inductance leave out flux that does not depend on the gap, and rest on the fitted reluctance"
        )
    if "force" not in residual:
        notes.append("no force was measured: it is the derivative of the coenergy under the measured flux linkage")
    if static.direction is not None and np.unique(static.direction).size > 1:
        notes.append("the rows hold both directions of the current: the table is their mean, without hysteresis")
    if fit.raised:
        notes.append("smoothed more than cross-validation asked, to keep force and incremental inductance positive")
    for name, value in residual.items():
        if value > SUSPICIOUS:
            notes.append(
                f"{CHANNELS[name][1]}: residuals are {value:.1f} times the stated noise; hysteresis, an offset of the "
                "gap or a wrong noise figure may be the cause"
            )
    return notes
