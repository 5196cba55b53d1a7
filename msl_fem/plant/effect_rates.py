"""The equations of motion with every effect of the catalogue; `docs/coupled_model.md` writes them out.

At the effects' neutral values each term below is the plain one, plus zero or times one, so the output equals that of
`rates.py` to the last bit. Pieces with many numbers are passed by where no lane has them.
"""

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, Value, choose, size, some
from msl_fem.plant import coefficients as c
from msl_fem.plant.cell import Cells
from msl_fem.plant.circuits import solve_circuits
from msl_fem.plant.plant import FORCE_DRIVE, PlantParameters
from msl_fem.plant.side import side_gap, side_with_effects
from msl_fem.plant.state import (
    ANCHOR_1,
    ANCHOR_X,
    ANCHORED,
    BASE,
    BASE_RATE,
    CORE_1,
    CREEP,
    EDDY_FLUX_1,
    ENERGY_COPPER,
    ENERGY_DAMPING,
    ENERGY_EDDY,
    ENERGY_ELECTRICAL,
    ENERGY_EXTERNAL,
    ENERGY_FRICTION,
    ENERGY_HYSTERESIS,
    ENERGY_INTERNAL,
    HEAT_1,
    I1,
    MODE,
    MODE_RATE,
    STOPS_1,
    STOPS_X,
    VOLT_SECONDS_1,
    V,
    X,
)
from msl_fem.plant.stops import settle_stops, stop_sum
from msl_fem.plant.work import (
    CIRCUITS,
    COIL_CURRENT,
    EMF,
    INDUCTANCE,
    MMF,
    MODE_LOSS,
    N_CIRCUIT,
    OUTPUT_OF_1,
    PUSH,
    RESISTANCE,
    SLOPE,
    VOLTAGE,
    Y,
)


@compiled
def rates_with_effects(
    cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, inputs: int, dy: int, settle: bool
) -> Flag:  # fmt: skip
    """The slopes of the N_INTEGRATED states Y into the rows from `dy`, under inputs from that row; False outside.

    `state` holds the memory of iron and friction. With `settle` it is moved to Y: there a step begins, or ends.
    """
    gap_speed = work[Y + V] - e[c.COMPLIANCE] * work[Y + BASE_RATE]
    external = work[inputs + PUSH]
    if p.drive == FORCE_DRIVE:
        external = external + work[inputs + OUTPUT_OF_1]
        work[dy + VOLT_SECONDS_1] = work[inputs + OUTPUT_OF_1]
    force, magnets = external, external - external
    film, inside = magnets, magnets == magnets
    for j in range(p.sides):
        toward = 1.0 - 2.0 * j
        gap = side_gap(p, e, work, j)
        found, pull, inductance, flux_slope, flux, _ = side_with_effects(cells, p, e, work, j, work[Y + I1 + j], gap)
        inside = inside & found
        force = force + toward * pull
        magnets = magnets + toward * pull
        closeness = e[c.FILM_GAP] / gap
        film = film + closeness * closeness * closeness
        circuit = CIRCUITS + j * N_CIRCUIT
        emf = 0.0 - flux_slope * toward * gap_speed
        memory = _hysteresis(e, state, j, flux, settle) + series_iron(e, flux)
        work[circuit + INDUCTANCE] = inductance
        work[circuit + EMF] = emf
        eddies = _eddy_modes(e, state, work, j, flux, dy)
        work[circuit + MMF] = work[Y + I1 + j] + memory + eddies + e[c.EDDY] * emf
        work[circuit + RESISTANCE] = p.resistance * (1.0 + work[Y + HEAT_1 + j])
    if settle:
        state[ANCHORED] = 1.0
    if p.sides > 0:
        solve_circuits(p, e, work, inputs)
        _electrical_rates(p, e, work, dy)
    film_force = e[c.FILM] * film * gap_speed
    spring, stribeck = _suspension(e, state, work, settle)
    _motion(p, e, work, dy, force, film_force + spring + stribeck, magnets - film_force)
    work[dy + ENERGY_INTERNAL] = work[dy + ENERGY_INTERNAL] + stribeck * work[Y + V]
    work[dy + ENERGY_DAMPING] = p.damping * work[Y + V] * work[Y + V] + film_force * gap_speed
    work[dy + ENERGY_EXTERNAL] = external * work[Y + V]
    return inside


@compiled
def _hysteresis(e: Rows, state: Rows, j: int, flux: Value, settle: bool) -> Value:
    """The part of a side's current that its iron's memory takes, h = s sum_k e_k of the flux linkage, in A."""
    if not some(e[c.HYSTERESIS_SLOPE] > 0.0):
        return flux - flux
    width, first = e[c.HYSTERESIS_WIDTH], STOPS_1 + j * c.N_STOP
    change = flux - state[ANCHOR_1 + j]
    if settle:
        lost = e[c.HYSTERESIS_SLOPE] * settle_stops(state, first, width, change)
        state[ENERGY_HYSTERESIS] = state[ENERGY_HYSTERESIS] + lost
        state[ANCHOR_1 + j] = flux
        change = flux - flux
    return e[c.HYSTERESIS_SLOPE] * stop_sum(state, first, width, change)


@compiled
def series_iron(e: Rows, flux: Value) -> Value:
    """The part of a side's current (A) that its iron takes in excess of the table's, see early_saturation."""
    if not (some(e[c.IRON_LOW] > 0.0) or some(e[c.IRON_KNEE] > 0.0)):
        return flux - flux
    y = e[c.IRON_SCALE] * flux
    return y * (e[c.IRON_LOW] / (e[c.IRON_WIDTH] + size(y)) + e[c.IRON_KNEE] * y * y)


@compiled
def _eddy_modes(e: Rows, state: Rows, work: Rows, j: int, flux: Value, dy: int) -> Value:
    """The part of a side's current (A) that the modes of its eddy currents take; before the first evaluation they have
    settled. Their losses go into the side's loss row."""
    taken = flux - flux
    lost = taken
    if not some(e[c.EDDY_MODE] > 0.0):
        return taken
    for k in range(c.N_EDDY):
        row = EDDY_FLUX_1 + j * c.N_EDDY + k
        settled = state[ANCHORED] > 0.0
        state[row] = choose(settled, state[row], flux)
        work[Y + row] = choose(settled, work[Y + row], flux)
        behind = flux - work[Y + row]
        taken = taken + e[c.EDDY_MODE + k] * behind
        lost = lost + e[c.EDDY_MODE + k] * e[c.EDDY_RATE + k] * behind * behind
        work[dy + row] = e[c.EDDY_RATE + k] * behind
    work[CIRCUITS + j * N_CIRCUIT + MODE_LOSS] = lost
    return taken


@compiled
def _electrical_rates(p: PlantParameters, e: Rows, work: Rows, dy: int) -> None:
    """Slopes of the circuits' states: coil_heating warms R by what it dissipates; it cools towards its core."""
    electrical = copper = eddy = work[Y + V] - work[Y + V]
    for j in range(p.sides):
        circuit = CIRCUITS + j * N_CIRCUIT
        current, voltage = work[circuit + COIL_CURRENT], work[circuit + VOLTAGE]
        loss = work[circuit + RESISTANCE] * current * current
        change = work[circuit + INDUCTANCE] * work[circuit + SLOPE] + work[circuit + EMF]
        electrical = electrical + voltage * current
        copper = copper + loss
        eddy = eddy + e[c.EDDY] * change * change + work[circuit + MODE_LOSS]
        work[dy + I1 + j] = work[circuit + SLOPE]
        work[dy + VOLT_SECONDS_1 + j] = voltage
        above = work[Y + HEAT_1 + j] - work[Y + CORE_1 + j]
        work[dy + HEAT_1 + j] = e[c.HEAT_PER_JOULE] * loss - e[c.COOLING] * above
        work[dy + CORE_1 + j] = e[c.CORE_RATE] * above
    work[dy + ENERGY_ELECTRICAL] = electrical
    work[dy + ENERGY_COPPER] = copper
    work[dy + ENERGY_EDDY] = eddy


@compiled
def _suspension(e: Rows, state: Rows, work: Rows, settle: bool) -> tuple[Value, Value]:
    """The force (N) against +x of stiffness_nonlinearity, flexure_relaxation and coulomb_friction, and by how much
    friction at low velocities is above that (Hess and Soom, J. Tribology 112, 1990, 147-152)."""
    x, width = work[Y + X], e[c.FRICTION_WIDTH]
    spring = (e[c.QUADRATIC] + e[c.CUBIC] * x) * x * x
    creep = e[c.CREEP_STIFFNESS] * (x - work[Y + CREEP])
    if not some(e[c.FRICTION_SLOPE] > 0.0):
        return spring + creep, x - x
    change = x - state[ANCHOR_X]
    if settle:
        lost = e[c.FRICTION_SLOPE] * settle_stops(state, STOPS_X, width, change)
        state[ENERGY_FRICTION] = state[ENERGY_FRICTION] + lost
        state[ANCHOR_X] = x
        change = x - x
    v = work[Y + V]
    more = e[c.STRIBECK_RISE] / (1.0 + e[c.STRIBECK_FALL] * v * v)
    stops = e[c.FRICTION_SLOPE] * stop_sum(state, STOPS_X, width, change)
    return spring + creep + stops, more * stops


@compiled
def _motion(p: PlantParameters, e: Rows, work: Rows, dy: int, force: Value, own: Value, on_base: Value) -> None:
    """Slopes of mover, second mass (structural_mode), relaxed length (flexure_relaxation), base (support_compliance).

    `force` is that of the plain model, `own` what effects hold against it, `on_base` what the base is pulled with.
    """
    x, v, mode, mode_rate = work[Y + X], work[Y + V], work[Y + MODE], work[Y + MODE_RATE]
    base, base_rate, stretch = work[Y + BASE], work[Y + BASE_RATE], x - work[Y + CREEP]
    link = e[c.MODE_STIFFNESS] * mode + e[c.MODE_DAMPING] * mode_rate
    plain = force - p.damping * v - p.stiffness * x - own
    acceleration = plain / (e[c.MODE_KEPT] * p.mass) + e[c.MODE_RATIO] * link
    work[dy + X] = v
    work[dy + V] = acceleration
    work[dy + MODE] = mode_rate
    work[dy + MODE_RATE] = 0.0 - acceleration - link
    work[dy + CREEP] = e[c.CREEP_RATE] * stretch
    work[dy + BASE] = base_rate
    work[dy + BASE_RATE] = e[c.BASE_STIFFNESS] * (0.0 - on_base - base) - e[c.BASE_DAMPING] * base_rate
    base_loss = e[c.BASE_INERTIA] * e[c.BASE_DAMPING] * base_rate * base_rate
    mode_loss = e[c.MODE_MASS] * e[c.MODE_DAMPING] * mode_rate * mode_rate
    creep_loss = e[c.CREEP_STIFFNESS] * e[c.CREEP_RATE] * stretch * stretch
    work[dy + ENERGY_INTERNAL] = base_loss + mode_loss + creep_loss
