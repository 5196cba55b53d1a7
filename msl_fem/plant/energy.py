"""The energy ledger of a run: what came in is what was lost and what is stored."""

import math
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import keep, rows_of
from msl_fem.plant.effects import magnetic, mechanical, stray_flux
from msl_fem.plant.effects.magnetic import N_EDDY
from msl_fem.plant.effects.mechanisms import N_IRON_STOP, N_STOP
from msl_fem.plant.layout import (
    ANCHOR_1,
    ANCHOR_2,
    ANCHORED,
    BASE,
    BASE_RATE,
    CIRCUIT_1,
    CREEP,
    EDDY_FLUX_1,
    ENERGY_COPPER,
    ENERGY_DAMPING,
    ENERGY_EDDY,
    ENERGY_ELECTRICAL,
    ENERGY_EXTERNAL,
    ENERGY_FRICTION,
    ENERGY_HYSTERESIS,
    ENERGY_IMPACT,
    ENERGY_INTERNAL,
    I1,
    I2,
    MODE,
    MODE_RATE,
    N_CIRCUIT,
    SHARED_ENERGY,
    SHARED_FLUX,
    SLOW_CREEP,
    STOPS_1,
    STOPS_2,
    STOPS_X,
    V,
    X,
    workspace,
)
from msl_fem.plant.mutual_flux import set_mutual_flux
from msl_fem.plant.plant import PlantParameters, Surface
from msl_fem.plant.side import cells_of, side_flux, side_gap
from msl_fem.plant.step import look_at


@dataclass(frozen=True)
class EnergyAudit:
    """Energies of a run in J, from its start to its end.

    electrical + external = copper + damping + eddy_currents + hysteresis + friction + internal + impact + field +
    mechanical, up to the integrator's error: the integrals on the left and the losses run along with the state, the
    rest is a difference of states. So the imbalance measures the error of the fixed step, and that the table and the
    effects create no energy.

    Attributes
    ----------
    electrical : integral of v i over all sides
    external : work of the disturbance, the constant forces and a force drive
    copper, damping : losses; damping with that of the air film
    eddy_currents, hysteresis, friction, impact : losses of the effects and of end stops
    internal : losses in flexure, second mass and base
    field : change of lambda i - W' over all magnets, of the iron in series, of what hysteresis and eddy currents store
    mechanical : change of m x'^2/2 + k x^2/2, with those of second mass, base, flexure and friction's elastic part
    """

    electrical: float
    external: float
    copper: float
    damping: float
    field: float
    mechanical: float
    eddy_currents: float = 0.0
    hysteresis: float = 0.0
    friction: float = 0.0
    internal: float = 0.0
    impact: float = 0.0

    @property
    def losses(self) -> float:
        """All that is lost."""
        effects = self.eddy_currents + self.hysteresis + self.friction + self.internal + self.impact
        return self.copper + self.damping + effects

    @property
    def imbalance(self) -> float:
        """What is missing, over the largest of the terms; 0 for a run in which nothing happens."""
        missing = self.electrical + self.external - self.losses - self.field - self.mechanical
        terms = (self.electrical, self.external, self.losses, self.field, self.mechanical)
        largest = max(abs(term) for term in terms)
        return missing / largest if largest > 0 else 0.0


def energy_audit(
    surface: Surface, parameters: PlantParameters, effects: Array | None, *, start: Array, end: Array
) -> EnergyAudit:
    """The ledger between two states (N_STATE,) of one run, `start` before its first command.

    `effects` are the kernel's coefficients of the run, None of the plain model.
    """

    def gained(n: int) -> float:
        return float(end[n] - start[n])

    stored = [_stored(surface, parameters, effects, state) for state in (start, end)]
    return EnergyAudit(
        electrical=gained(ENERGY_ELECTRICAL),
        external=gained(ENERGY_EXTERNAL),
        copper=gained(ENERGY_COPPER),
        damping=gained(ENERGY_DAMPING),
        field=stored[1][0] - stored[0][0],
        mechanical=stored[1][1] - stored[0][1],
        eddy_currents=gained(ENERGY_EDDY),
        hysteresis=gained(ENERGY_HYSTERESIS),
        friction=gained(ENERGY_FRICTION),
        internal=gained(ENERGY_INTERNAL),
        impact=gained(ENERGY_IMPACT),
    )


def _stored(surface: Surface, p: PlantParameters, e: Array | None, state: Array) -> tuple[float, float]:
    """(field, mechanical) energy of a state in J."""
    field = float(_field(surface, p._replace(end_stop=None), e, state))
    x, v = float(state[X]), float(state[V])
    if e is None:
        return field, 0.5 * p.mass * v**2 + 0.5 * p.stiffness * x**2
    for anchor, start in ((ANCHOR_1, STOPS_1), (ANCHOR_2, STOPS_2)):
        field += _in_iron(e, state, anchor, start)
    moving = 0.5 * e[mechanical.MODE_KEPT] * p.mass * v**2 + 0.5 * e[mechanical.MODE_MASS] * (v + state[MODE_RATE]) ** 2
    spring = 0.5 * p.stiffness * x**2 + e[mechanical.QUADRATIC] * x**3 / 3 + e[mechanical.CUBIC] * x**4 / 4
    spring += 0.5 * e[mechanical.CREEP_STIFFNESS] * (x - state[CREEP]) ** 2
    spring += 0.5 * e[mechanical.SLOW_CREEP_STIFFNESS] * (x - state[SLOW_CREEP]) ** 2
    spring += _in_stops(e, state, mechanical.FRICTION_SLOPE, STOPS_X, N_STOP)
    link = 0.5 * e[mechanical.MODE_MASS] * e[mechanical.MODE_STIFFNESS] * state[MODE] ** 2
    base = 0.5 * (e[mechanical.COMPLIANCE] * state[BASE] ** 2 + e[mechanical.BASE_INERTIA] * state[BASE_RATE] ** 2)
    return field, float(moving + spring + link + base)


def _in_stops(e: Array, state: Array, slopes: int, start: int, count: int) -> float:
    """What `count` stops store that stand in the state from row `start` on, in J."""
    return 0.5 * float(np.sum(e[slopes : slopes + count] * state[start : start + count] ** 2))


def _in_iron(e: Array, state: Array, anchor: int, start: int) -> float:
    """What the stops of a side's iron store, in J: s_k times the integral of e dy, y = sinh(gamma z)/gamma, from e = 0
    to where they stand."""
    gamma, z, stop = e[magnetic.HYSTERESIS_BROADENING], state[anchor], state[start : start + N_IRON_STOP]
    if gamma == 0.0:
        return _in_stops(e, state, magnetic.HYSTERESIS_SLOPE, start, N_IRON_STOP)
    slopes = e[magnetic.HYSTERESIS_SLOPE : magnetic.HYSTERESIS_SLOPE + N_IRON_STOP]
    middle, half = np.sinh(gamma * (z - 0.5 * stop)) / gamma, np.sinh(0.5 * gamma * stop) / gamma
    return float(np.sum(slopes * (stop * np.sinh(gamma * z) / gamma - 2.0 * middle * half)))


@compiled
def _under_knee(bends: float, square: float) -> float:
    """The integral of y (exp(7 b y^2) - 1)/(b (exp(7) - 1)) over y up to a y^2, or y^4/4 where there is no b."""
    if bends == 0.0:
        return 0.25 * square * square
    steep = magnetic.STEEPNESS * bends * square
    rest = math.expm1(steep) - steep
    if steep < 1e-3:
        rest = steep * steep * (0.5 + steep * (1.0 / 6.0 + steep / 24.0))
    return 0.5 * rest / (magnetic.STEEPNESS * bends * bends * magnetic.RISE)


@compiled
def _field(surface: Surface, p: PlantParameters, effects: Array | None, state: Array) -> float:
    """Field energy of all magnets in J, with that of their eddy currents."""
    memory = workspace()
    e, rows, work, cells = rows_of(effects), rows_of(state), rows_of(memory), cells_of(surface)
    look_at(e, rows, work)
    energy = 0.0
    if p.sides == 2:
        set_mutual_flux(cells, p, e, work, rows[I1], rows[I2])
        energy += work[SHARED_ENERGY]
    begun = rows[ANCHORED] > 0.0
    for j in range(p.sides):
        _, flux, stored = side_flux(cells, p, e, work, j, rows[I1 + j], side_gap(p, e, work, j))
        energy += stored
        if p.sides == 2:
            flux += work[CIRCUIT_1 + j * N_CIRCUIT + SHARED_FLUX]
        if effects is not None:
            y, width = abs(e[magnetic.IRON_SCALE] * flux), e[magnetic.IRON_WIDTH]
            iron = e[magnetic.IRON_LOW] * (y - width * np.log(1.0 + y / width))
            iron += e[magnetic.IRON_KNEE] * _under_knee(e[magnetic.IRON_BENDS], y * y)
            bend = np.sqrt(e[stray_flux.REMANENCE_FADES])
            bent = np.arctan(bend * flux) / bend if bend > 0.0 else flux
            energy += iron / e[magnetic.IRON_SCALE] - e[stray_flux.REMANENT_1 + j] * bent
            for k in range(N_EDDY):
                behind = flux - rows[EDDY_FLUX_1 + j * N_EDDY + k] if begun else e[magnetic.EDDY_MISSED + k] * flux
                energy += 0.5 * e[magnetic.EDDY_MODE + k] * behind**2
    keep(memory)
    return energy
