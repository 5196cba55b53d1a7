"""A static map as a likelihood of what is not known: the table with its error, scales, the magnetic effects.

Force and flux linkage of one magnet at gaps and currents as they were read, row after row in the order of measurement
(hysteresis needs it). The rows of all roles are run through, since those held out are part of the history too; those of
the role `fit` count. The noise of each channel is white, its density estimated with the fit. Beside runs, the rows
belong to one likelihood with them: table, scale and gap are the same unknowns.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.gauss_newton import normal_equations
from msl_fem.diagnosis.estimates import effects_present
from msl_fem.diagnosis.kind import ErrorSignal, Kind, without_those_of
from msl_fem.diagnosis.likelihood import Columns, Fit, Likelihood, over_chance
from msl_fem.diagnosis.measured_map import DENSITY, FLUX, FORCE, MeasuredMap, is_stated, measured_map, path_of
from msl_fem.diagnosis.noise import NoiseBands
from msl_fem.diagnosis.problem import FitProblem, Points, Starts
from msl_fem.diagnosis.table_error import corrected, table_error
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import RecordFeatures, Variant, variants
from msl_fem.errors import InputError, OutOfTable
from msl_fem.plant import PlantParameters, plant_parameters, surface_of
from msl_fem.plant.effects import CATALOGUE, PARAMETER_INDEX, from_vector, neutral_vector
from msl_fem.plant.plant import VOLTAGE_DRIVE
from msl_fem.plant.preparation import small_signal_inductance
from msl_fem.plant.static_map import static_map
from msl_fem.prediction import KernelPlant, ModelHypothesis
from msl_fem.prediction.nuisances import line_of, nuisances_of_map, read_of_map
from msl_fem.record import Record, StaticMap, Tolerance
from msl_fem.table.magnetic_table import MagneticTable

FEWEST_ROWS = 12
OF_THE_CURRENT = ("magnetic_hysteresis", "early_saturation", "current_sensor_error")
"""Effects that a map at one gap can show."""
MAP_BESIDE = "the rows of the static map count beside the runs"


@dataclass(frozen=True, eq=False)
class StaticLikelihood(Likelihood):
    """The rows of a static map as a likelihood; of the bands it needs none."""

    measured: MeasuredMap

    def spectra(self, points: Points) -> Array:
        """Measured less modelled of the counted rows over the noise, channel after channel, (n_row, n_number)."""
        rows = []
        for z, effects in points.each():
            missed = self.missed(points.unknowns, z, effects)
            counts = {name: self.measured.counts(name) for name in missed}
            rows.append(np.concatenate([missed[n][counts[n]] / s[counts[n]] for n, s in self.measured.sigmas.items()]))
        return np.array(rows)

    def missed(self, unknowns: Unknowns, z: Array, effects: Array) -> dict[str, Array]:
        """Channel to measured less modelled of all rows; nan where the model leaves its table."""
        modelled = self._modelled(unknowns, z, effects)
        return {name: values - modelled[name] for name, values in self.measured.channels.items()}

    def _modelled(self, unknowns: Unknowns, z: Array, effects: Array) -> dict[str, Array]:
        p, rows = self.problem.plant.parameters, self.measured.rows
        factors = unknowns.factors(z)
        surface = self.problem.surface(factors.get("magnetic_scale", 1.0), z[unknowns.table_rows])
        wider = p.nominal_gap * (factors.get("nominal_gap", 1.0) - 1.0)
        if rows.gap_zero == "gauge":
            wider = -factors.get("static_gap_zero", 0.0)
        own_gain, own_zero = line_of("current_1_A", factors)
        gain = effects[PARAMETER_INDEX["current_sensor_error", "gain_1"]]
        offset = effects[PARAMETER_INDEX["current_sensor_error", "offset_1"]]
        current = ((rows.current - own_zero) / own_gain - offset) / (1.0 + gain)
        linked = p.inductance / (p.magnets * p.current_share**2) * factors.get("leakage_inductance_1", 0.0)
        path = path_of(replace(rows, current=current))
        try:
            force, flux = static_map(
                surface, p, from_vector(effects), gap=path.gap + wider, current=path.current, sequence=path.sequence
            )
        except (OutOfTable, InputError):
            force = flux = np.full(path.gap.size, np.nan)
        force = force[path.rows] + effects[PARAMETER_INDEX["force_offset", "force"]]
        flux = flux[path.rows] + linked * current
        there = {FORCE: force, FLUX: flux, DENSITY: flux}
        return {name: self._reading(name, there[name], factors) for name in self.measured.channels}

    def _reading(self, name: str, there: Array, factors: Mapping[str, float]) -> Array:
        """What the instrument of a channel reads of what is there."""
        read, zero = read_of_map(name, there, factors)
        return self.measured.factor(name, read, zero=zero) * read + zero

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

    def nats_of_noise(self, unknowns: Unknowns, z: Array) -> float:
        """None: rows have the noise that is stated."""
        return 0.0

    def excess(self, found: Fit) -> dict[str, float]:
        """Channel to RMS residual of the counted rows over the noise and what chance makes of so few."""
        names = enumerate(self.measured.sigmas)
        return {name: over_chance(found.residual[self.labels == n]) for n, name in names}


def why_no_map(static: StaticMap) -> str:
    """Why a static map alone can decide nothing; empty where it can."""
    fitted, held = static.rows("fit"), static.rows("held-out")
    if fitted.size < FEWEST_ROWS:
        return f"the static map has {fitted.size} rows with the role fit; at least {FEWEST_ROWS} are needed"
    if held.size == 0:
        return "no row of the static map is held out, so no gain could be shown; give some the role held-out"
    if np.ptp(np.abs(static.current[fitted])) == 0:
        return "the rows of the static map differ in gap alone; measure over the current"
    return ""


def static_plant(actuator: Actuator, table: MagneticTable, gap: Array) -> KernelPlant:
    """The plant whose magnet is measured; without [motion] or [drive] the middle of the gaps is the nominal one."""
    if actuator.motion is not None and actuator.drive is not None:
        p = plant_parameters(actuator)
    else:
        nominal = actuator.motion.nominal_gap if actuator.motion is not None else None
        p = PlantParameters(
            mass=1.0,
            stiffness=0.0,
            damping=0.0,
            constant_force=0.0,
            nominal_gap=float(nominal or np.median(gap)),
            travel=np.inf,
            sides=1,
            magnets=1,
            current_share=1.0,
            resistance=1.0,
            drive=VOLTAGE_DRIVE,
            bandwidth=np.inf,
            voltage_limit=np.inf,
            current_limit=np.inf,
            sensor_bandwidth=np.inf,
            end_stop=None,
        )
    surface = surface_of(table)
    p = p._replace(sides=1, inductance=small_signal_inductance(p._replace(sides=1), surface))
    return KernelPlant(surface, p, None, neutral_vector(), 1.0, 1.0, 1)


def prepared_map(record: Record, table: MagneticTable) -> tuple[StaticLikelihood, Unknowns]:
    """The likelihood of a record's static map under a table, and what it does not know without any effect."""
    measured, tolerance = measured_map(record, table), record.tolerance
    of_fields = bool(table.nodes["force"].any())  # a table of loops at one gap is their own mean
    error = table_error(table, measured.visited, tolerance=tolerance.table) if tolerance.table and of_fields else None
    plant = static_plant(record.actuator, table, measured.rows.gap)
    problem = FitProblem(plant, (), (), (), error)
    bands = NoiseBands(np.array([0.0, 1.0]), (), ())
    stated = {"nominal_gap": tolerance.nominal_gap, "magnetic_scale": tolerance.magnetic_scale}
    if measured.rows.gap_zero == "gauge":
        del stated["nominal_gap"]  # it is the gauges' zero that the map is off by
    stated |= own_of_map(measured, tolerance)
    believed = tuple((name, sigma) for name, sigma in stated.items() if sigma)
    unknowns = Unknowns(believed, 0 if error is None else len(error.modes), ())
    return StaticLikelihood(problem, bands, 1, measured), unknowns


@dataclass(frozen=True, eq=False)
class MapAlone(Kind):
    """The rows of a static map."""

    prediction: ClassVar[str] = "static"

    @property
    def rows(self) -> StaticLikelihood:
        assert isinstance(self.likelihood, StaticLikelihood)
        return self.likelihood

    def candidates(self, fit: Fit) -> list[Variant]:
        """What a magnet at rest can show; of the current's sensor, side 1's stands for the map's."""
        plant = self.likelihood.problem.plant.parameters
        spread = float(np.std(self.rows.measured.rows.current))
        at_one_gap = bool(np.ptp(self.rows.measured.rows.gap) == 0)
        peak = float(np.abs(self.rows.measured.rows.current).max())
        features = RecordFeatures(1.0, spread, 1.0, own_frequency=1.0, peak=peak, loops=at_one_gap)
        effects = [name for name, effect in CATALOGUE.items() if effect.separating]
        if at_one_gap:
            effects = [name for name in effects if name in OF_THE_CURRENT]
        if self.rows.measured.rows.order == "unknown":
            effects = [name for name in effects if name != "magnetic_hysteresis"]
        tried = [variant for name in effects for variant in variants(name, features, plant)]
        return without_those_of(fit, tried)

    def errors(self, belief: ModelHypothesis, fit: Fit | None) -> list[ErrorSignal]:
        """By role and channel, of all rows inside the table."""
        measured, unknowns = self.rows.measured, self.unknowns if fit is None else fit.unknowns
        z = np.zeros(unknowns.size) if fit is None else fit.z
        missed = self.rows.missed(unknowns, z, unknowns.effect_vector(z))
        signals = []
        for role in ("fit", "held-out"):
            for name, values in missed.items():
                readings = measured.channels[name]
                at = np.flatnonzero((measured.rows.role == role) & np.isfinite(readings))
                if at.size:
                    spread = float(readings[at].std()) or float(np.abs(readings[at]).mean())
                    sigma = float(np.sqrt(np.mean(measured.sigmas[name][at] ** 2)))
                    signals.append(ErrorSignal("static", role, name, values[at], spread, sigma, rate=float("nan")))
        return signals

    def extend(self, fit: Fit) -> ModelHypothesis:
        """An actuator without motion or drive stays as it is."""
        belief, error = self.belief, self.likelihood.problem.table_error
        if belief.actuator.motion is not None and belief.actuator.drive is not None:
            return super().extend(fit)
        table = belief.table
        if table is not None and error is not None:
            scale = fit.unknowns.factors(fit.z).get("magnetic_scale", 1.0)
            table = corrected(table, error, fit.z[fit.unknowns.table_rows], scale=scale)
        return ModelHypothesis(belief.actuator, table, effects_present(fit.unknowns.effect_vector(fit.z)))


def map_alone(record: Record, belief: ModelHypothesis) -> MapAlone:
    """A record's static map, made ready.

    Raises
    ------
    InputError : no row lies inside the table
    """
    assert belief.table is not None
    likelihood, unknowns = prepared_map(record, belief.table)
    guessed = [name for name in likelihood.measured.sigmas if not is_stated(record, name)]
    notes = [f"the noise of {name} is not stated; taken from repeats or neighbouring rows" for name in guessed]
    scatter = likelihood.measured.scatter
    notes += [*likelihood.measured.notes, *([] if scatter is None else [scatter.told])]
    return MapAlone(belief, likelihood, unknowns, tuple(notes))


@dataclass(frozen=True, eq=False)
class JointLikelihood(Likelihood):
    """The numbers of the runs, then those of the map, whose table error is that of `problem`."""

    static: StaticLikelihood

    @property
    def highest_at_rest(self) -> float:
        return float(np.abs(self.static.measured.rows.current).max())

    def spectra_and_starts(self, points: Points) -> tuple[Array, Starts, float]:
        """Residuals of the runs in the frequency domain over their white sigma, then the map's, (n_row, n_number); and
        what is said of the runs' stretches."""
        runs, starts, largest = super().spectra_and_starts(points)
        return np.hstack([runs, self.static.spectra(points)]), starts, largest

    @property
    def labels(self) -> NDArray[np.intp]:
        """(n_number,) the band of each number of the runs, then the channel of each of the map."""
        own, n = super().labels, self.bands.n_band * len(super().channel_names)
        return np.concatenate([own, self.static.labels + n])

    @property
    def ceilings(self) -> Array:
        """(n_label,) of the runs' bands, then of the map."""
        return np.concatenate([super().ceilings, self.static.ceilings])

    def excess(self, found: Fit) -> dict[str, float]:
        """Channel to RMS residual over the noise, of runs and map."""
        own = replace(found, residual=found.residual[self._of_runs :])
        return self.excess_of_runs(found) | self.static.excess(own)

    def runs_part(self, found: Fit) -> tuple[Likelihood, Fit]:
        """The runs alone, and a fit as they see it."""
        n, labels = self._of_runs, slice(int(self._labels_of_runs.max()) + 1)
        whole = found.weights
        share = None if whole.wander is None else whole.wander[:n]
        weights = replace(
            whole,
            density=whole.density[labels],
            root=whole.root[:n],
            count=whole.count[labels],
            limits=whole.limits[labels],
            wander=share,
        )
        columns = Columns(found.jacobian[:n], normal_equations(found.jacobian[:n], weights.root)[0])
        alone = replace(found, residual=found.residual[:n], columns=columns, weights=weights)
        return Likelihood(self.problem, self.bands, self.substeps), alone

    @property
    def _of_runs(self) -> int:
        """How many numbers the runs have."""
        return self._labels_of_runs.size


def map_beside(record: Record, belief: ModelHypothesis) -> StaticLikelihood | None:
    """A record's static map, to stand beside its runs; None where there is none that a fit can use."""
    if record.static is None or belief.table is None or why_no_map(record.static):
        return None
    return prepared_map(record, belief.table)[0]


def own_of_map(measured: MeasuredMap, tolerance: Tolerance) -> dict[str, float]:
    """What is believed of a map's instruments, to its sigma."""
    return nuisances_of_map(tolerance, gap=measured.rows.gap_zero, readings=measured.channels)


def joined(static: StaticLikelihood, runs: Likelihood) -> JointLikelihood:
    """The likelihood of runs with a static map beside it, which has the same error of the table."""
    static = replace(static, problem=replace(static.problem, table_error=runs.problem.table_error))
    return JointLikelihood(runs.problem, runs.bands, runs.substeps, static)
