"""A static map as a likelihood of what is not known: the table with its error, scales, the magnetic effects.

Force and flux linkage of one magnet at gaps and currents as they were read, row after row in the order of measurement
(hysteresis needs it). The rows of all roles are run through, since those held out are part of the history too; those of
the role `fit` count. The noise of each channel is white, its density estimated with the fit.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.diagnosis.extension import extended_belief
from msl_fem.diagnosis.fit import Fit, Likelihood
from msl_fem.diagnosis.held_out import Followed
from msl_fem.diagnosis.noise_bands import Bands
from msl_fem.diagnosis.other_records import Kind
from msl_fem.diagnosis.simulator import Points, Problem
from msl_fem.diagnosis.table_error import Visited, corrected, table_error
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import Scene, Variant, variants
from msl_fem.errors import InputError, OutOfTable
from msl_fem.plant import PlantParameters, Surface, plant_parameters, surface_of
from msl_fem.plant.effects import CATALOGUE, PARAMETER_INDEX, EffectValues, from_vector, neutral_vector
from msl_fem.plant.plant import VOLTAGE_DRIVE
from msl_fem.plant.static_map import static_map
from msl_fem.prediction import KernelPlant, ModelHypothesis
from msl_fem.record import Record, StaticMap
from msl_fem.table.magnetic_table import MagneticTable

Array = NDArray[np.float64]
EXPERIMENTS = {name: effect.separating for name, effect in CATALOGUE.items() if effect.separating}
"""What a magnet at rest can show; of the current's sensor, side 1's stands for the map's."""
FEWEST_ROWS = 12
FORCE, FLUX = "force_N", "flux_linkage_Wb"
MARGIN = 4.0  # tolerances of the gap: rows nearer to the table's ends would leave it in a fit
LEAST_NOISE = 1e-5  # of the largest value, where no noise is stated


@dataclass(frozen=True, eq=False)
class MeasuredMap:
    """A static map and its instruments' noise.

    Attributes
    ----------
    channels : name to (n_row,) measured; nan where a row lacks it
    sigmas : name to one sigma
    counted : (n_row,) rows of the role `fit` that lie inside the table
    """

    rows: StaticMap
    channels: dict[str, Array]
    sigmas: dict[str, float]
    counted: NDArray[np.bool_]

    def counts(self, name: str) -> NDArray[np.bool_]:
        """(n_row,) rows of a channel that a fit looks at."""
        return np.asarray(self.counted & np.isfinite(self.channels[name]))


@dataclass(frozen=True, eq=False)
class StaticLikelihood(Likelihood):
    """The rows of a static map as a likelihood; of the bands it needs none."""

    measured: MeasuredMap

    def spectra(self, points: Points) -> Array:
        """Measured less modelled of the counted rows over the noise, channel after channel, (n_row, n_number)."""
        vectors = points.effects if points.effects is not None else [neutral_vector()] * len(points.rows)
        found = []
        for z, effects in zip(points.rows, vectors, strict=True):
            missed = self.missed(points.unknowns, z, effects)
            m = self.measured
            found.append(np.concatenate([missed[n][m.counts(n)] / s for n, s in m.sigmas.items()]))
        return np.array(found)

    def missed(self, unknowns: Unknowns, z: Array, effects: Array) -> dict[str, Array]:
        """Channel to measured less modelled of all rows; nan where the model leaves its table."""
        modelled = self._modelled(unknowns, z, effects)
        return {name: values - modelled[name] for name, values in self.measured.channels.items()}

    def _modelled(self, unknowns: Unknowns, z: Array, effects: Array) -> dict[str, Array]:
        p, rows = self.problem.plant.parameters, self.measured.rows
        factors = unknowns.factors(z)
        wider = p.nominal_gap * (factors.get("nominal_gap", 1.0) - 1.0)
        gain, offset = (effects[PARAMETER_INDEX["current_sensor_error", name]] for name in ("gain_1", "offset_1"))
        try:
            force, flux = static_map(
                self._surface(unknowns, z), p, from_vector(effects), gap=rows.gap + wider,
                current=(rows.current - offset) / (1.0 + gain), sequence=rows.sequence,
            )  # fmt: skip
        except (OutOfTable, InputError):
            force = flux = np.full(rows.gap.size, np.nan)
        return {FORCE: force + effects[PARAMETER_INDEX["force_offset", "force"]], FLUX: flux}

    def _surface(self, unknowns: Unknowns, z: Array) -> Surface:
        surface, error = self.problem.plant.surface, self.problem.table_error
        scale = unknowns.factors(z).get("magnetic_scale", 1.0)
        change = 0.0 if error is None else np.tensordot(z[unknowns.table_rows], error.modes, axes=1)
        return surface._replace(coefficients=scale * (surface.coefficients + change))

    @property
    def labels(self) -> NDArray[np.intp]:
        """(n_number,) the channel of each number."""
        numbers = [int(self.measured.counts(name).sum()) for name in self.measured.sigmas]
        return np.repeat(np.arange(len(numbers)), numbers)

    @property
    def ceilings(self) -> Array:
        return np.full(len(self.measured.sigmas), np.inf)

    @property
    def channel_names(self) -> list[str]:
        return list(self.measured.sigmas)

    def excess(self, found: Fit) -> dict[str, float]:
        """Channel to RMS residual of the counted rows over the noise, over what chance makes of so few: 1 and two
        standard errors of an RMS of n numbers, 1/sqrt(2 n) each."""
        labels, made = self.labels, {}
        for n, name in enumerate(self.measured.sigmas):
            own = found.residual[labels == n]
            made[name] = float(np.sqrt(np.mean(own**2)) / (1.0 + 2.0 / np.sqrt(2.0 * own.size)))
        return made


def why_no_map(static: StaticMap) -> str:
    """Why a static map alone can decide nothing; empty where it can."""
    fitted, held = static.rows("fit"), static.rows("held-out")
    if fitted.size < FEWEST_ROWS:
        return f"the static map has {fitted.size} rows with the role fit; at least {FEWEST_ROWS} are needed"
    if held.size == 0:
        return "no row of the static map is held out, so no gain could be shown; give some the role held-out"
    if np.ptp(np.abs(static.current[fitted])) == 0 or np.ptp(static.gap[fitted]) == 0:
        return "the rows of the static map differ in gap or in current alone; measure over both"
    return ""


def measured_map(record: Record, table: MagneticTable) -> MeasuredMap:
    """The static map of a record with its noise.

    Raises
    ------
    InputError : no row of the role fit lies inside the table
    """
    static = record.static
    assert static is not None
    stated = {FORCE: record.noise.force, FLUX: record.noise.flux_linkage}
    channels = {n: c for n, c in ((FORCE, static.force), (FLUX, static.flux_linkage)) if c is not None}
    sigmas = {name: float(stated[name] or _roughness(static, values)) for name, values in channels.items()}
    motion = record.actuator.motion
    margin = MARGIN * record.tolerance.nominal_gap * float((motion.nominal_gap if motion else None) or 0.0)
    inside = (static.gap > table.gap[0] + margin) & (static.gap < table.gap[-1] - margin)
    inside &= np.abs(static.current) < table.current[-1]
    counted = inside & (static.role == "fit")
    if not counted.any():
        raise InputError("no row of static.csv lies inside the table; extend the sweep")
    return MeasuredMap(_inside(static, inside), {n: c[inside] for n, c in channels.items()}, sigmas, counted[inside])


def _inside(static: StaticMap, kept: NDArray[np.bool_]) -> StaticMap:
    return replace(
        static, gap=static.gap[kept], current=static.current[kept], role=static.role[kept],
        force=None if static.force is None else static.force[kept],
        flux_linkage=None if static.flux_linkage is None else static.flux_linkage[kept],
        direction=None if static.direction is None else static.direction[kept],
        sequence=None if static.sequence is None else static.sequence[kept], extra={},
    )  # fmt: skip


def _roughness(static: StaticMap, values: Array) -> float:
    """One sigma of what neighbours in the order of gap and current do not share: third differences over sqrt(20)."""
    ordered = values[np.lexsort((static.current, static.gap))]
    third = np.diff(ordered, 3) / np.sqrt(20.0)
    return float(max(np.median(np.abs(third)) / 0.6745, LEAST_NOISE * np.abs(values).max()))


def static_plant(actuator: Actuator, table: MagneticTable, gap: Array) -> KernelPlant:
    """The plant whose magnet is measured; without [motion] or [drive] the middle of the gaps is the nominal one."""
    if actuator.motion is not None and actuator.drive is not None:
        p = plant_parameters(actuator)
    else:
        nominal = actuator.motion.nominal_gap if actuator.motion is not None else None
        p = PlantParameters(
            mass=1.0, stiffness=0.0, damping=0.0, constant_force=0.0, nominal_gap=float(nominal or np.median(gap)),
            travel=np.inf, sides=1, magnets=1, current_share=1.0, resistance=1.0, drive=VOLTAGE_DRIVE, bandwidth=np.inf,
            voltage_limit=np.inf, current_limit=np.inf, sensor_bandwidth=np.inf, end_stop=None,
        )  # fmt: skip
    return KernelPlant(surface_of(table), p._replace(sides=1), None, neutral_vector(), 1.0, 1.0, 1)


def prepared_map(record: Record, table: MagneticTable) -> tuple[StaticLikelihood, Unknowns]:
    """The likelihood of a record's static map under a table, and what it does not know without any effect."""
    measured, t = measured_map(record, table), record.tolerance
    rows = measured.rows
    current = np.abs(rows.current)
    visited = Visited((float(current.min()), float(current.max())), (float(rows.gap.min()), float(rows.gap.max())))
    error = table_error(table, visited, tolerance=t.table) if t.table else None
    plant = static_plant(record.actuator, table, rows.gap)
    problem = Problem(plant, (), (), (), error)
    bands = Bands(np.array([0.0, 1.0]), (), ())
    believed = tuple(
        (name, s) for name, s in (("nominal_gap", t.nominal_gap), ("magnetic_scale", t.magnetic_scale)) if s
    )
    unknowns = Unknowns(believed, 0 if error is None else len(error.modes), ())
    return StaticLikelihood(problem, bands, 1, measured), unknowns


def candidates_of_map(likelihood: Likelihood, found: Fit) -> list[Variant]:
    """The variants that a static map can show."""
    assert isinstance(likelihood, StaticLikelihood)
    plant = likelihood.problem.plant.parameters
    scene = Scene(1.0, float(np.std(likelihood.measured.rows.current)), 1.0, 1.0)
    have = {one.effect for one in found.unknowns.effects}
    return [v for effect in EXPERIMENTS if effect not in have for v in variants(effect, scene, plant)]


def map_followed(likelihood: StaticLikelihood, found: Fit | None) -> list[Followed]:
    """How well a fit, or the believed table, follows the rows of each role."""
    measured = likelihood.measured
    nothing = Unknowns(
        (), 0 if likelihood.problem.table_error is None else len(likelihood.problem.table_error.modes), ()
    )
    unknowns = nothing if found is None else found.unknowns
    z = np.zeros(unknowns.size) if found is None else found.z
    missed = likelihood.missed(unknowns, z, unknowns.effect_vector(z))
    made = []
    for role in ("fit", "held-out"):
        for name in missed:
            at = np.flatnonzero((measured.rows.role == role) & np.isfinite(measured.channels[name]))
            if not at.size:
                continue
            rms = float(np.sqrt(np.mean(missed[name][at] ** 2)))
            deviation = float(measured.channels[name][at].std()) or float(np.abs(measured.channels[name][at]).mean())
            made.append(
                Followed("static", role, name, rms if np.isfinite(rms) else np.inf, rms / deviation,
                         measured.sigmas[name], at.size, deviation)
            )  # fmt: skip
    return made


def map_extension(belief: ModelHypothesis, likelihood: StaticLikelihood, found: Fit) -> ModelHypothesis:
    """The belief with what a static map has told; an actuator without motion or drive stays as it is."""
    if belief.actuator.motion is not None and belief.actuator.drive is not None:
        return extended_belief(belief, likelihood.problem, found)
    table, error = belief.table, likelihood.problem.table_error
    assert table is not None
    if error is not None:
        scale = found.unknowns.factors(found.z).get("magnetic_scale", 1.0)
        table = corrected(table, error, found.z[found.unknowns.table_rows], scale=scale)
    every = from_vector(found.unknowns.effect_vector(found.z))
    present = {name: every.stated[name] for name in every.present}
    return ModelHypothesis(belief.actuator, table, EffectValues(present) if present else None)


def of_map(record: Record, belief: ModelHypothesis) -> tuple[StaticLikelihood, Unknowns, Kind]:
    """What the diagnosis of the static map of a record needs.

    Raises
    ------
    InputError : no row lies inside the table
    """
    assert belief.table is not None
    likelihood, unknowns = prepared_map(record, belief.table)
    stated = record.noise
    missing = [
        n for n, s in ((FORCE, stated.force), (FLUX, stated.flux_linkage)) if n in likelihood.measured.sigmas and not s
    ]
    notes = tuple(
        f"the noise of {name} is not stated; taken from the differences of neighbouring rows" for name in missing
    )
    kind = Kind(
        "static", belief, candidates_of_map, lambda found: map_followed(likelihood, found),
        lambda found: map_extension(belief, likelihood, found), experiments=EXPERIMENTS, notes=notes,
    )  # fmt: skip
    return likelihood, unknowns, kind
