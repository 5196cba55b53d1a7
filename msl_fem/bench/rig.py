"""The rig on the bench: true parameters within the belief's tolerances, a table with a smooth error, the plant."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from msl_fem.actuator import Actuator
from msl_fem.bench import plant as parts
from msl_fem.bench.plant import CURRENT_DRIVE, FORCE_DRIVE, VOLTAGE_DRIVE, Array, BenchPlant, MagnetSurface
from msl_fem.errors import ActuatorError, InputError
from msl_fem.record import Tolerance
from msl_fem.table.magnetic_table import NODES, MagneticTable

ERROR_TERMS = tuple((a, b) for a in range(5) for b in range(5) if 0 < a + b <= 4)
"""Degrees over current and gap of the terms of a table's error; the constant is the magnetic scale's."""
FINER = 4
CUT = 3.0
"""Standard deviations beyond which no parameter lies."""
DRIVES = {"current": CURRENT_DRIVE, "voltage": VOLTAGE_DRIVE, "force": FORCE_DRIVE}


@dataclass(frozen=True, eq=False)
class Factor:
    """A factor of the coenergy on a table's nodes with its partial derivatives, (n_gap, n_current) or numbers."""

    value: Array
    over_current: Array | float = 0.0
    over_gap: Array | float = 0.0
    over_current_twice: Array | float = 0.0
    over_both: Array | float = 0.0
    over_gap_twice: Array | float = 0.0


def multiplied(table: MagneticTable, factor: Factor) -> MagneticTable:
    """The table whose coenergy is the factor times the given one's."""
    return MagneticTable(table.gap, table.current, multiplied_nodes(table, factor))


def multiplied_nodes(table: MagneticTable, factor: Factor) -> dict[str, Array]:
    """The nodes of a coenergy that is the factor times the table's, by the product rule at every node."""
    w = table.nodes["coenergy"]
    w_i = table.nodes["flux_linkage"]
    w_g = -table.nodes["force"]
    w_ii = table.nodes["incremental_inductance"]
    w_ig = -table.nodes["force_current_slope"]
    w_gg = -table.nodes["force_gap_slope"]
    p = factor.value
    p_i = factor.over_current
    p_g = factor.over_gap
    return {
        "coenergy": w * p,
        "flux_linkage": w_i * p + w * p_i,
        "force": -(w_g * p + w * p_g),
        "incremental_inductance": w_ii * p + 2 * w_i * p_i + w * factor.over_current_twice,
        "force_current_slope": -(w_ig * p + w_i * p_g + w_g * p_i + w * factor.over_both),
        "force_gap_slope": -(w_gg * p + 2 * w_g * p_g + w * factor.over_gap_twice),
    }


def averaged(table: MagneticTable, shifts: Sequence[float], weights: Sequence[float]) -> MagneticTable:
    """The mean over magnets (or strips of one) at the same current whose gaps differ by `shifts` (m) from the table's.

    Its gaps are those between which every shifted gap lies in the table, `FINER` times as many: between its nodes the
    mean of the table's pieces is no single piece.

    Raises
    ------
    InputError : the shifts leave less than half of the table's gaps
    """
    low = table.gap[0] - min(shifts)
    high = table.gap[-1] - max(shifts)
    if not low < table.gap[0] + 0.5 * (table.gap[-1] - table.gap[0]) < high:
        raise InputError(f"gaps that differ by {max(shifts) - min(shifts):.3g} m do not fit the table's range")
    gap = np.geomspace(low, high, FINER * table.gap.size)
    nodes = dict.fromkeys(NODES, np.zeros((gap.size, table.current.size)))
    for shift, weight in zip(shifts, weights, strict=True):
        at = np.clip(gap[:, None] + shift, table.gap[0], table.gap[-1])  # a rounding beyond the edge
        part = table.evaluate(table.current[None, :], at)
        nodes = {name: nodes[name] + weight * part[name] for name in NODES}
    return MagneticTable(gap, table.current, nodes)


def error_factor(table: MagneticTable, coefficients: Array) -> Factor:
    """1 + sum of coefficients (n_term,) times the terms P_a(u) P_b(z) on the table's nodes.

    u runs from -1 to 1 as i^2/(i^2 + i_s^2), i_s a sixth of the largest current, and z as the logarithm of the gap:
    smooth, even in the current, and as fine at small currents and gaps as the field's own changes are.
    """
    i, g = table.current, table.gap
    s2 = (i[-1] / 6) ** 2
    top = i[-1] ** 2 / (i[-1] ** 2 + s2)
    u = 2 * i**2 / (i**2 + s2) / top - 1
    u_i = 4 * i * s2 / (i**2 + s2) ** 2 / top
    u_ii = 4 * s2 * (s2 - 3 * i**2) / (i**2 + s2) ** 3 / top
    span = np.log(g[-1] / g[0])
    z = 2 * np.log(g / g[0]) / span - 1
    z_g = 2 / (span * g)
    z_gg = -2 / (span * g**2)
    parts = np.zeros((6, g.size, i.size))
    for c, (a, b) in zip(coefficients, ERROR_TERMS, strict=True):
        p, p_u, p_uu = _legendre(a, u)
        q, q_z, q_zz = _legendre(b, z)
        along = (p, p_u * u_i, p_uu * u_i**2 + p_u * u_ii)
        across = (q, q_z * z_g, q_zz * z_g**2 + q_z * z_gg)
        for n, (m, k) in enumerate(((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))):
            parts[n] += c * np.outer(across[k], along[m])
    return Factor(1 + parts[0], *parts[1:])


def _legendre(degree: int, x: Array) -> tuple[Array, Array, Array]:
    """P(x), P'(x), P''(x) of a degree."""
    series = np.zeros(degree + 1)
    series[degree] = 1.0
    return tuple(legendre.legval(x, legendre.legder(series, n)) for n in range(3))  # type: ignore[return-value]


def term_errors(table: MagneticTable) -> tuple[Array, Array]:
    """(force, flux): mean squares over the nodes of the relative error that each term (n_term,) makes by itself."""
    inside = np.s_[:, 1:]
    force: list[float] = []
    flux: list[float] = []
    for n in range(len(ERROR_TERMS)):
        unit = np.zeros(len(ERROR_TERMS))
        unit[n] = 1.0
        changed = multiplied_nodes(table, error_factor(table, unit))
        for name, found in (("force", force), ("flux_linkage", flux)):
            relative = changed[name][inside] / table.nodes[name][inside] - 1
            found.append(float(np.mean(relative**2)))
    return np.array(force), np.array(flux)


@dataclass(frozen=True, eq=False)
class Truth:
    """The true parameters over the believed ones, and the coefficients (n_term,) of the table's error.

    Attributes
    ----------
    moving_mass, stiffness, damping, coil_resistance, nominal_gap : true over believed
    position_gain : reading over position
    magnetic_scale : coenergy, flux and force over the table's
    """

    moving_mass: float = 1.0
    stiffness: float = 1.0
    damping: float = 1.0
    coil_resistance: float = 1.0
    nominal_gap: float = 1.0
    position_gain: float = 1.0
    magnetic_scale: float = 1.0
    table: Array | None = None

    def to_json(self, actuator: Actuator) -> dict[str, Any]:
        """The true values in SI units, and how far each lies from the believed one."""
        ratios = {name: value for name, value in asdict(self).items() if name != "table"}
        believed: dict[str, float] = {"position_gain": 1.0, "magnetic_scale": 1.0}
        if actuator.motion is not None:
            names = ("moving_mass", "stiffness", "damping", "nominal_gap")
            believed |= {name: float(getattr(actuator.motion, name) or 0.0) for name in names}
        if actuator.magnet is not None:
            believed["coil_resistance"] = actuator.coil_resistance()
        found: dict[str, Any] = {
            name: {"value": believed[name] * ratios[name], "relative_error": ratios[name] - 1} for name in believed
        }
        found["table"] = {
            "terms": [list(term) for term in ERROR_TERMS],
            "coefficients": [] if self.table is None else self.table.tolist(),
        }
        return found


def draw_truth(tolerance: Tolerance, table: MagneticTable | None, generator: np.random.Generator) -> Truth:
    """True parameters: each normal about the believed one with its tolerance as sigma, cut at three.

    The coefficients of the table's error fall with the square of the degree; they are scaled such that the expected
    RMS error over the table, of force or flux linkage, whichever is larger, is the tolerance.
    """
    drawn = {}
    for name in Tolerance.OF_THE_RIG:
        sigma = getattr(tolerance, name)
        if name != "table":
            drawn[name] = 1 + sigma * _cut_normal(generator)
    spread = np.array([1.0 / (1 + a + b) ** 2 for a, b in ERROR_TERMS])
    raw = spread * np.array([_cut_normal(generator) for _ in ERROR_TERMS])
    if table is None:
        return Truth(**drawn)
    worst = max(float(spread**2 @ part) for part in term_errors(table))
    return Truth(**drawn, table=tolerance.table * raw / np.sqrt(worst))


def _cut_normal(generator: np.random.Generator) -> float:
    """A standard normal number within three standard deviations."""
    while True:
        value = float(generator.standard_normal())
        if abs(value) <= CUT:
            return value


def true_table(table: MagneticTable, truth: Truth) -> MagneticTable:
    """The magnets' own table: the believed one with its smooth error and the magnetic scale."""
    coefficients = np.zeros(len(ERROR_TERMS)) if truth.table is None else truth.table
    if truth.table is None and truth.magnetic_scale == 1.0:
        return table
    changed = multiplied(table, error_factor(table, coefficients))
    return multiplied(changed, Factor(np.array(truth.magnetic_scale)))


@dataclass(frozen=True)
class InstrumentErrors:
    """What is wrong with the readings beside noise; every value at its default is an ideal instrument.

    Attributes
    ----------
    current_gain, current_offset : of the current reading, A
    play : half width of the position reading's play, m
    drift, drift_seed : RMS of the position zero's wander, m, and the seed of its path
    coil_reading, coil_reading_lag : what the position sensor reads for the sides' currents, m/A, and how late, s
    """

    current_gain: float = 1.0
    current_offset: float = 0.0
    play: float = 0.0
    drift: float = 0.0
    drift_seed: int = 0
    coil_reading: tuple[float, float] = (0.0, 0.0)
    coil_reading_lag: float = 0.0


@dataclass(frozen=True, eq=False)
class Rig:
    """A plant with what stands around it.

    Attributes
    ----------
    plant : its equations' parameters
    table : of one magnet, as it truly is; None without magnets
    delay : between a command and the amplifier, s
    random_force, random_force_seed : RMS of a force that nobody asked for, N, and the seed of its path
    warm : rises in K of coil and core of side 1, then of side 2, where a run begins
    """

    name: str
    plant: BenchPlant
    table: MagneticTable | None
    instruments: InstrumentErrors = field(default_factory=InstrumentErrors)
    delay: float = 0.0
    random_force: float = 0.0
    random_force_seed: int = 0
    warm: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def with_parts(self, **pieces: Any) -> "Rig":
        """The rig with pieces of its plant replaced."""
        return replace(self, plant=self.plant._replace(**pieces))


def true_rig(actuator: Actuator, table: MagneticTable | None, truth: Truth | None = None) -> Rig:
    """The rig with every effect off; at `truth` None its parameters are the believed ones.

    Raises
    ------
    ActuatorError : a section of the actuator is missing
    InputError : a current drive without a bandwidth, no table for magnets
    """
    truth = truth or Truth()
    motion, drive = actuator.motion, actuator.drive
    if motion is None or drive is None:
        missing = "[motion]" if motion is None else "[drive]"
        raise ActuatorError(f"{actuator.name}: section {missing} is missing; the bench needs it")
    magnetic = drive.kind != "force"
    if magnetic and actuator.sides is None:
        raise ActuatorError(f"{actuator.name}: section [sides] is missing; the bench needs count and magnets")
    if magnetic and table is None:
        raise InputError(f"{actuator.name} has magnets and there is no table; make one with 'msl-fem table'")
    if drive.kind == "current" and drive.bandwidth is None:
        raise InputError(
            f"{actuator.name}: drive.bandwidth is missing; no amplifier makes a current jump, state its bandwidth"
        )
    gap = float(motion.nominal_gap or math.inf) * truth.nominal_gap
    travel = float(motion.range or motion.nominal_gap or math.inf)
    plant = BenchPlant(
        magnets=_magnets(actuator if magnetic else None, gap),
        circuit=parts.CoilCircuit(
            drive=DRIVES[drive.kind],
            resistance=_resistance(actuator) * truth.coil_resistance if magnetic else 0.0,
            bandwidth=_angular(drive.bandwidth),
            voltage_limit=float(drive.voltage_limit or math.inf),
            current_limit=float(drive.current_limit or math.inf),
        ),
        amplifier=parts.Amplifier(0.0, 0.7, math.inf, 0.0, 1.0),
        ladder=parts.Ladder(0, 0.0, 1.0),
        hysteresis=parts.Hysteresis(0.0, 1.0, 4.0),
        series_iron=parts.SeriesIron(0.0, np.zeros(parts.IRON_NODES), np.zeros(parts.IRON_NODES)),
        coupling=0.0,
        thermal=parts.Thermal(0.0, 0.0, 1.0, 1.0),
        motion=parts.SpringMassDamper(
            mass=motion.moving_mass * truth.moving_mass,
            stiffness=motion.stiffness * truth.stiffness,
            damping=motion.damping * truth.damping,
            constant_force=motion.constant_force,
            travel=travel,
        ),
        flexure=parts.FlexureLaw(0.0, 1.0, 0, np.zeros(parts.MOST_BRANCHES), np.zeros(parts.MOST_BRANCHES)),
        friction=parts.Friction(0.0, 0.0, 1.0, 0.0, 0.0),
        film=parts.Film(0.0, gap),
        attached=parts.Attached(0.0, 0.0, 0.0),
        support=parts.Support(0.0, 0.0, 0.0),
        disturbance=parts.Disturbance(*9 * (0.0,))._replace(cogging_period=1.0),
        reading=parts.SensorElectronics(
            truth.position_gain, 0.0, np.zeros(2), _angular(actuator.position_sensor.bandwidth)
        ),
        layout=parts.StateLayout(*8 * (-1,), parts.N_COMMON),
    )
    return Rig(actuator.name, plant, None if table is None else true_table(table, truth))


def _magnets(actuator: Actuator | None, gap: float) -> parts.Magnets:
    if actuator is None or actuator.sides is None:
        return parts.Magnets(0, 1, 1.0, gap)
    n = actuator.sides.magnets_per_side
    share = 1.0 / n if actuator.sides.connection == "parallel" else 1.0
    return parts.Magnets(int(actuator.sides.count), n, share, gap)


def _resistance(actuator: Actuator) -> float:
    """Of a side, ohm: its magnets in series or in parallel."""
    assert actuator.sides is not None
    n = actuator.sides.magnets_per_side
    return actuator.coil_resistance() * (n if actuator.sides.connection == "series" else 1 / n)


def _angular(frequency: float | None) -> float:
    return math.inf if frequency is None else 2 * math.pi * frequency


def magnet_surface(table: MagneticTable | None) -> MagnetSurface:
    """The table's interpolant as compiled functions take it; without a table one that is never evaluated."""
    if table is None:
        return MagnetSurface(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.zeros((1, 1, 6, 6)))
    s = table.surface
    return MagnetSurface(*(np.array(a, dtype=np.float64, order="C") for a in (s.gap, s.current, s.coefficients)))
