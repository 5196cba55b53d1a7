"""The bench's plant as its compiled equations take it: one record for each piece of physics, SI units throughout.

Every piece has a value that switches it off; `true_rig` of `rig.py` makes the plant with all of them off.
"""

from typing import Any, NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array

CURRENT_DRIVE, VOLTAGE_DRIVE, FORCE_DRIVE = 0, 1, 2
IRON_NODES = 257
MOST_BRANCHES = 8
MOST_LAWS, LONGEST_PROGRAM = 3, 500  # as many as are hidden together; a character of a law each
# States that every plant has: magnetising currents (A), position, velocity; volt-seconds of the sides since the sample
# began; energies since the start (J): electrical input, copper, damper, work of forces from outside.
IM1, IM2, X, V, VOLT_SECONDS_1, VOLT_SECONDS_2 = range(6)
ENERGY_ELECTRICAL, ENERGY_COPPER, ENERGY_DAMPER, ENERGY_OUTSIDE = range(6, 10)
N_COMMON = 10


class MagnetSurface(NamedTuple):
    """The coenergy surface of one magnet, see `msl_fem.table.coenergy_surface`."""

    gap: Array  # (n_gap,) m
    current: Array  # (n_current,) A
    coefficients: Array  # (n_gap - 1, n_current - 1, 6, 6)


class Magnets(NamedTuple):
    """The magnets of a side, all alike, as the side's terminals see them."""

    sides: int  # 0 without magnets
    per_side: int
    share: float  # magnet's current over the side's
    nominal_gap: float  # m, the true one


class CoilCircuit(NamedTuple):
    """Coil and power amplifier of a side; `inf` switches a bandwidth or limit off."""

    drive: int
    resistance: float  # ohm, cold
    bandwidth: float  # rad/s, the believed first-order lag
    voltage_limit: float
    current_limit: float


class Amplifier(NamedTuple):
    """What the amplifier does beside its believed lag: second order with a slew limit before it, crossover behind."""

    frequency: float  # rad/s; 0: none
    damping_ratio: float
    slew: float  # of the output, in the command's unit a second
    crossover: float  # V lost on either side of zero; 0: none
    crossover_width: float  # V
    rail: float = np.inf  # A, V or N that the amplifier tends to


class Ladder(NamedTuple):
    """Eddy currents in sheets as a ladder, see `iron.py`."""

    stages: int  # 0: none
    conductance: float  # A/V: slow eddy current over d(flux linkage)/dt, of a side
    diffusion_time: float  # s: mu sigma d^2/4


class Hysteresis(NamedTuple):
    """Magnetising current of the iron's hysteresis, see `iron.py`."""

    amplitude: float  # A; 0: none
    flux_scale: float  # Wb, of a side
    stretch: float  # flux scales over which the loops change their shape


class SeriesIron(NamedTuple):
    """Magnetising current of a side beyond the table's, over its flux linkage: a cubic through nodes."""

    step: float  # Wb between nodes; 0: none
    value: Array  # (IRON_NODES,) A, from flux linkage 0; odd
    slope: Array  # (IRON_NODES,) A/Wb


class Stray(NamedTuple):
    """Flux that links the coils beside the table's: of a side for its own current, of both for each other's, in H; and
    the magnetising current that remanence stands for.

    What the field of both sides shows of their mutual flux depends little on the position (docs/decoupling.md):
    M(x) = mutual (1 + mutual_curve x^2). Leakage flux passes the iron too, l i/(1 + (i/leakage_bend)^2) in its slope.
    Remanence gives way to flux, r/(1 + (flux/remanent_flux)^2).
    """

    leakage_1: float = 0.0
    leakage_2: float = 0.0
    mutual: float = 0.0
    mutual_curve: float = 0.0  # 1/m2
    leakage_bend: float = np.inf  # A
    remanent_1: float = 0.0  # A, of side 1
    remanent_2: float = 0.0
    remanent_flux: float = np.inf  # Wb


class UserLaws(NamedTuple):
    """Laws that users state, as programs (`law_program.py`); 0: none."""

    number_of_laws: int
    equation: Array  # (MOST_LAWS,)
    code: Array  # (MOST_LAWS, LONGEST_PROGRAM) operations, -1 behind the last
    number: Array  # (MOST_LAWS, LONGEST_PROGRAM) of numbers and variables


NO_LAWS = UserLaws(
    0, np.zeros(MOST_LAWS), -np.ones((MOST_LAWS, LONGEST_PROGRAM)), np.zeros((MOST_LAWS, LONGEST_PROGRAM))
)


class Thermal(NamedTuple):
    """Coil and core of a side as two nodes; 0 K/W: none."""

    coil_to_core: float  # K/W
    core_to_air: float  # K/W
    coil_time: float  # s
    core_time: float  # s


class SpringMassDamper(NamedTuple):
    """The mover as believed: mass, spring, damper, constant force."""

    mass: float
    stiffness: float
    damping: float
    constant_force: float
    travel: float  # m, to either side


class FlexureLaw(NamedTuple):
    """What the spring does beyond its stiffness: stretching of the leaves, and Maxwell branches in parallel."""

    stretch_stiffness: float  # N/m; 0: none
    stretch_length: float  # m
    branches: int  # how many of the following are used
    branch_stiffness: Array  # (MOST_BRANCHES,) N/m
    branch_rate: Array  # (MOST_BRANCHES,) 1/s
    cushion: float = 0.0  # N/m2, force over the square of the first branch's stretch


class Friction(NamedTuple):
    """LuGre's bristles, see `equations.py`."""

    coulomb: float  # N; 0: none
    breakaway: float  # N
    stribeck_velocity: float  # m/s
    bristle_stiffness: float  # N/m
    bristle_damping: float  # N s/m


class Film(NamedTuple):
    """Squeezed film between the pole faces and the armature, see `equations.py`."""

    damping: float  # N s/m of a side at `gap`; 0: none
    gap: float  # m


class Attached(NamedTuple):
    """A part of the moving mass that hangs on a spring of its own."""

    share: float  # of the moving mass; 0: none
    frequency: float  # rad/s, of the part alone
    damping_ratio: float


class Support(NamedTuple):
    """The magnets' support, which gives way; 0 kg: it is rigid."""

    mass: float
    stiffness: float
    damping: float


class Disturbance(NamedTuple):
    """Forces on the mover that no believed equation has."""

    hum: float  # N, peak of the fundamental; 0: none
    hum_frequency: float  # rad/s
    hum_phase: float
    hum_third: float  # third harmonic over the fundamental
    cogging: float  # N, periodic in x; 0: none
    cogging_period: float  # m
    cogging_phase: float
    drag: float  # N s2/m2, v |v|
    product: float  # N/A2, of both currents


class SensorElectronics(NamedTuple):
    """The position sensor up to its electronics' output."""

    gain: float
    curvature: float  # 1/m
    lags: Array  # (2,) s, further first-order lags; 0: none
    bandwidth: float  # rad/s, the believed one


class StateLayout(NamedTuple):
    """Where the states of the pieces stand in the state vector; -1: not there."""

    output: int  # of a lagging voltage or force drive, 2
    amplifier: int  # 2 a side
    ladder: int  # `stages` a side
    thermal: int  # 2 a side
    attached: int  # 2
    support: int  # 2
    branches: int
    bristle: int
    size: int


class BenchPlant(NamedTuple):
    magnets: Magnets
    circuit: CoilCircuit
    amplifier: Amplifier
    ladder: Ladder
    hysteresis: Hysteresis
    series_iron: SeriesIron
    coupling: float  # A/Wb: current of a side for the other side's flux linkage; 0: none
    thermal: Thermal
    motion: SpringMassDamper
    flexure: FlexureLaw
    friction: Friction
    film: Film
    attached: Attached
    support: Support
    disturbance: Disturbance
    reading: SensorElectronics
    layout: StateLayout
    stray: Stray = Stray()
    laws: UserLaws = NO_LAWS


class Bench(NamedTuple):
    """What the compiled equations work with: the plant's record, its magnets' surface, memory and scratch."""

    plant: BenchPlant
    surface: MagnetSurface
    memory: Array  # (2, MEMORY) of both sides' hysteresis
    sides: Array  # (2, N_SIDE), see `equations.py`
    scratch: Array  # (2, 2)


def arranged(plant: BenchPlant) -> BenchPlant:
    """The plant with a layout that has room for the pieces that are on, and for no others."""
    used = N_COMMON
    places: dict[str, int] = {}
    lagging = plant.circuit.drive != CURRENT_DRIVE and np.isfinite(plant.circuit.bandwidth)
    sizes = {
        "output": 2 if lagging else 0,
        "amplifier": 4 if plant.amplifier.frequency > 0 else 0,
        "ladder": 2 * plant.ladder.stages,
        "thermal": 4 if plant.thermal.coil_to_core > 0 else 0,
        "attached": 2 if plant.attached.share > 0 else 0,
        "support": 2 if plant.support.mass > 0 else 0,
        "branches": plant.flexure.branches,
        "bristle": 1 if plant.friction.coulomb > 0 else 0,
    }
    for name, size in sizes.items():
        places[name] = used if size else -1
        used += size
    return plant._replace(layout=StateLayout(**places, size=used))


def as_record(plant: BenchPlant) -> BenchPlant:
    """The plant as one numpy record, which compiled functions take by its address and read by the same names."""
    record: BenchPlant = np.array([_values(plant)], dtype=_type(plant))[0]
    return record


def _type(piece: Any) -> np.dtype[Any]:
    fields: list[Any] = []
    for name, value in piece._asdict().items():
        if isinstance(value, tuple):
            fields.append((name, _type(value)))
        elif isinstance(value, np.ndarray):
            fields.append((name, np.float64, value.shape))
        else:
            fields.append((name, np.int64 if isinstance(value, int) else np.float64))
    return np.dtype(fields)


def _values(piece: Any) -> tuple[Any, ...]:
    return tuple(_values(value) if isinstance(value, tuple) else value for value in piece)
