"""The bench's equations of motion: amplifier, circuits, heat, friction, squeezed film, mover, and all rates together.

A side's coil current is i = i_m + i_s(L) + i_h[L] + r L_other + i_e: the table's magnetising current i_m, that of iron
beyond the table, of hysteresis and of the other side's flux in the shared armature, all over the flux linkage L, and
the eddy currents. v = R i + dL/dt. The states are i_m and those of hysteresis and eddy currents; i follows from them.

The believed current amplifier knows the coil: v = R i + dL/dg dg/dt + L_inc w (target - i) within its voltage limit,
which makes a plain coil's current a first-order lag of its target (Krishnan, Electric Motor Drives, 2001, ch. 3).
Stray flux of coil and of both sides links the magnetising currents, without force. It is in L, and so in the iron:
iron that followed a side's own flux alone would give more than it took where both sides' currents go round.

Friction is LuGre's, by bristles (Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE Trans. Autom. Control 40, 1995):

    z' = v - s0 |v| z/G(v),   F = s0 z + s1 exp(-(v/v_s)^2) z',   G(v) = F_c + (F_s - F_c) exp(-(v/v_s)^2)

Below the break-away force F_s the contact is a spring of stiffness s0; at constant speed the force is G(v). The damping
of the bristles falls with the speed: were it constant, a contact that reverses fast would resist with s1 v, many times
its break-away force, and give energy back (Olsson, Astrom, Canudas de Wit, Gafvert and Lischinsky, Eur. J. Control 4,
1998, sec. 4.4).

The film of air or oil that is squeezed between pole faces and armature.

Reynolds' equation for an incompressible film between a plate w by l (w <= l) and a flat face, with ambient pressure at
the edges, gives the force c(g) v with

    c = eta w^3 l b(w/l)/g^3,   b = 1 - (192/pi^5) (w/l) sum over odd n of tanh(n pi l/(2 w))/n^5

(Hays, J. Basic Eng. 83, 1961; b -> 1 for a long plate, 0.4217 for a square). It is incompressible where the squeeze
number 12 eta omega w^2/(p_a g^2) is small (Blech, J. Lubr. Technol. 105, 1983), and free of cavitation where the peak
pressure, about 1.5 c v/(w l), stays below p_a; `film_numbers` gives both, and the bench's effect keeps to both.
"""

import math

import numpy as np

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.bench.iron import ladder_current, ladder_rates, pinned_current, series_current, side_magnet
from msl_fem.bench.law_program import FORCE, law_of_motion, law_of_side
from msl_fem.bench.plant import (
    CURRENT_DRIVE,
    ENERGY_COPPER,
    ENERGY_DAMPER,
    ENERGY_ELECTRICAL,
    ENERGY_OUTSIDE,
    FORCE_DRIVE,
    IM1,
    VOLT_SECONDS_1,
    Amplifier,
    Array,
    Bench,
    BenchPlant,
    Disturbance,
    Film,
    FlexureLaw,
    Friction,
    Stray,
    Thermal,
    V,
    X,
)
from msl_fem.computing.compiled import compiled

COPPER_COEFFICIENT = 3.93e-3  # 1/K, IEC 60028 at 20 degC
# Columns of a side's scratch row
FLUX, PULL, INDUCTANCE, GAP_SLOPE, CURRENT, VOLTAGE, LINKED = range(7)  # LINKED: with leakage and mutual flux
N_SIDE = 7
AIR_VISCOSITY = 1.81e-5  # Pa s at 20 degC
AMBIENT_PRESSURE = 1.013e5  # Pa
_TERMS = 40


@compiled
def amplifier_rates(a: Amplifier, command: float, output: float, speed: float) -> tuple[float, float]:
    """(d output/dt, d speed/dt): z' = w^2 (u - y) - 2 d w z and y' = S tanh(z/S), with z the speed asked for.

    The output never moves faster than the slew limit S, which the stage reaches softly; without one y' = z.
    """
    push = a.frequency * (a.frequency * (command - output) - 2.0 * a.damping_ratio * speed)
    if np.isinf(a.slew):
        return speed, push
    return a.slew * np.tanh(speed / a.slew), push


@compiled
def crossover(a: Amplifier, voltage: float) -> float:
    """The voltage left after the zone in which neither half of the output stage conducts well: v - c tanh(v/w)."""
    return voltage - a.crossover * np.tanh(voltage / a.crossover_width)


@compiled
def warm_resistance(cold: float, coil: float) -> float:
    """Resistance in ohm of a coil that is `coil` K above where its resistance is `cold`."""
    return cold * (1.0 + COPPER_COEFFICIENT * coil)


@compiled
def thermal_rates(t: Thermal, coil: float, core: float, loss: float) -> tuple[float, float]:
    """Rates in K/s of both temperature rises (K) under a copper loss (W).

    Heat flows from the coil to the core through one resistance and on to the air through the other; the heat
    capacities follow from the stated time constants, each with the node's own resistance.
    """
    flow = (coil - core) / t.coil_to_core
    coil_rate = (loss - flow) * t.coil_to_core / t.coil_time
    return coil_rate, (flow - core / t.core_to_air) * t.core_to_air / t.core_time


@compiled
def fill_side_currents(bench: Bench, y: Array, position: float) -> bool:
    """Fills FLUX ... CURRENT of the sides; False outside the table. `position` is relative to the magnets."""
    plant, sides = bench.plant, bench.sides
    mutual = mutual_inductance(plant.stray, position)
    for j in range(plant.magnets.sides):
        row = sides[j]
        gap = plant.magnets.nominal_gap - (1.0 - 2.0 * j) * position
        inside, flux, pull, inductance, slope = side_magnet(bench.surface, plant.magnets, y[IM1 + j], gap)
        if not inside:
            return False
        row[FLUX], row[PULL], row[INDUCTANCE], row[GAP_SLOPE] = flux, pull, inductance, slope
        flux += leakage_flux(plant.stray, j, y[IM1 + j])
        if plant.magnets.sides == 2:
            flux += mutual * y[IM1 + 1 - j]
        row[LINKED] = flux
        row[CURRENT] = y[IM1 + j] - remanent_current(plant.stray, j, flux)
        if plant.series_iron.step > 0.0:
            row[CURRENT] += series_current(plant.series_iron, flux)
        if plant.hysteresis.amplitude > 0.0:
            row[CURRENT] += pinned_current(plant.hysteresis, bench.memory[j], flux)
        if plant.ladder.stages > 0:
            at = plant.layout.ladder + j * plant.ladder.stages
            row[CURRENT] += ladder_current(plant.ladder, y[at : at + plant.ladder.stages])
    if plant.coupling != 0.0 and plant.magnets.sides == 2:
        sides[0, CURRENT] += plant.coupling * sides[1, FLUX]
        sides[1, CURRENT] += plant.coupling * sides[0, FLUX]
    return True


@compiled
def side_resistance(plant: BenchPlant, y: Array, j: int) -> float:
    """Resistance of side j in ohm at its present temperature."""
    if plant.layout.thermal < 0:
        return plant.circuit.resistance
    return warm_resistance(plant.circuit.resistance, y[plant.layout.thermal + 2 * j])


@compiled
def drive_sides(bench: Bench, y: Array, position: float, target: Array, gap_rate: Array, dy: Array) -> None:
    """Fills VOLTAGE of the sides and the rates of i_m and the ladders.

    `position` is relative to the magnets, `target` (2,) the current aimed at, or the voltage given; `gap_rate` (2,) in
    m/s.
    """
    plant = bench.plant
    for j in range(plant.magnets.sides):
        row = bench.sides[j]
        drop = side_resistance(plant, y, j) * row[CURRENT]
        drop += law_of_side(plant, y, plant.magnets.nominal_gap - (1.0 - 2.0 * j) * position, row[CURRENT])
        motional = row[GAP_SLOPE] * gap_rate[j]
        if plant.stray.mutual_curve != 0.0 and plant.magnets.sides == 2:
            motional += mutual_slope(plant.stray, position) * gap_rate[1] * y[IM1 + 1 - j]
        stray = leakage_slope(plant.stray, j, y[IM1 + j])
        voltage = target[j]
        if plant.circuit.drive == CURRENT_DRIVE:
            own = row[INDUCTANCE] + stray
            voltage = drop + motional + own * plant.circuit.bandwidth * (target[j] - row[CURRENT])
            if abs(voltage) > plant.circuit.voltage_limit:
                voltage = np.copysign(plant.circuit.voltage_limit, voltage)
        if plant.amplifier.crossover != 0.0:
            voltage = crossover(plant.amplifier, voltage)
        row[VOLTAGE] = voltage
        dy[IM1 + j] = (voltage - drop - motional) / (row[INDUCTANCE] + stray)
        if plant.ladder.stages > 0:  # whose node is at the rate of all that the coil links, v - R i
            at = plant.layout.ladder + j * plant.ladder.stages
            end = at + plant.ladder.stages
            ladder_rates(plant.ladder, y[at:end], voltage - drop, dy[at:end])
    if plant.stray.mutual != 0.0 and plant.magnets.sides == 2:
        _share_mutual_flux(bench, y, position, dy)


@compiled
def _share_mutual_flux(bench: Bench, y: Array, position: float, dy: Array) -> None:
    """Rates of both i_m that mutual flux ties together, from those without it; by Gauss' elimination."""
    stray, sides = bench.plant.stray, bench.sides
    first = sides[0, INDUCTANCE] + leakage_slope(stray, 0, y[IM1])
    second = sides[1, INDUCTANCE] + leakage_slope(stray, 1, y[IM1 + 1])
    mutual = mutual_inductance(stray, position)
    factor = mutual / first
    volts = first * dy[IM1]
    dy[IM1 + 1] = (second * dy[IM1 + 1] - factor * volts) / (second - factor * mutual)
    dy[IM1] = (volts - mutual * dy[IM1 + 1]) / first


@compiled
def leakage_slope(stray: Stray, j: int, current: float) -> float:
    """Incremental leakage inductance of side j in H at its magnetising current; its flux saturates iron a little."""
    leak = stray.leakage_1 if j == 0 else stray.leakage_2
    bent = current / stray.leakage_bend
    return leak / (1.0 + bent * bent)


@compiled
def leakage_flux(stray: Stray, j: int, current: float) -> float:
    """Leakage flux linkage of side j in Wb, the integral of `leakage_slope`."""
    leak = stray.leakage_1 if j == 0 else stray.leakage_2
    if np.isinf(stray.leakage_bend):
        return leak * current
    return leak * stray.leakage_bend * np.arctan(current / stray.leakage_bend)


@compiled
def remanent_current(stray: Stray, j: int, flux: float) -> float:
    """A, that the remanence of side j stands for: less of it at a large flux, along a recoil line that bends."""
    whole = stray.remanent_1 if j == 0 else stray.remanent_2
    ratio = flux / stray.remanent_flux
    return whole / (1.0 + ratio * ratio)


@compiled
def mutual_inductance(stray: Stray, position: float) -> float:
    """M in H: of both sides' fields in the shared armature."""
    return stray.mutual * (1.0 + stray.mutual_curve * position * position)


@compiled
def mutual_slope(stray: Stray, position: float) -> float:
    """dM/dx in H/m."""
    return 2.0 * stray.mutual * stray.mutual_curve * position


@compiled
def friction_force(f: Friction, velocity: float, bristle: float) -> tuple[float, float]:
    """(force against the motion in N, rate of the bristles' deflection in m/s) at a deflection in m."""
    ratio = velocity / f.stribeck_velocity
    slow = np.exp(-ratio * ratio)
    level = f.coulomb + (f.breakaway - f.coulomb) * slow
    rate = velocity - f.bristle_stiffness * abs(velocity) * bristle / level
    return f.bristle_stiffness * bristle + f.bristle_damping * slow * rate, rate


@compiled
def film_damping(film: Film, gap: float) -> float:
    """N s/m of a side at its gap: as the inverse cube."""
    ratio = film.gap / gap
    return film.damping * ratio * ratio * ratio


def finite_length(width: float, length: float) -> float:
    """The factor b of a rectangle against an endlessly long plate; the shorter side counts as its width."""
    w, l = min(width, length), max(width, length)  # noqa: E741 - the textbook's letters
    total = sum(math.tanh(n * math.pi * l / (2 * w)) / n**5 for n in range(1, 2 * _TERMS, 2))
    return 1 - 192 / math.pi**5 * (w / l) * total


def plate_damping(width: float, length: float, *, gap: float, viscosity: float = AIR_VISCOSITY) -> float:
    """c in N s/m of a rectangle (m) at a gap (m) in a film of a viscosity (Pa s)."""
    w, l = min(width, length), max(width, length)  # noqa: E741
    return viscosity * w**3 * l * finite_length(w, l) / gap**3


def faces(actuator: Actuator) -> tuple[tuple[float, float], ...]:
    """Width and length in m of the pole faces of a side; none where the magnet's shape is not known."""
    if not isinstance(actuator.magnet, MagnetKind) or actuator.sides is None:
        return ()
    return actuator.magnet.pole_faces * actuator.sides.magnets_per_side


def film_numbers(
    actuator: Actuator, damping: float, *, gap: float, velocity: float, frequency: float
) -> dict[str, float]:
    """Viscosity (Pa s), squeeze number and peak pressure over ambient that a side's damping (N s/m) at `gap` means.

    `velocity` (m/s) and `frequency` (rad/s) are the largest of the motion. Empty where the faces are not known.
    """
    plates = faces(actuator)
    if not plates:
        return {}
    viscosity = damping / sum(plate_damping(*plate, gap=gap, viscosity=1.0) for plate in plates)
    widest = max(plates, key=lambda plate: plate_damping(*plate, gap=gap, viscosity=1.0))
    share = plate_damping(*widest, gap=gap, viscosity=viscosity)
    return {
        "viscosity": viscosity,
        "squeeze_number": 12 * viscosity * frequency * min(widest) ** 2 / (AMBIENT_PRESSURE * gap**2),
        "peak_pressure": 1.5 * share * velocity / (widest[0] * widest[1]) / AMBIENT_PRESSURE,
    }


@compiled
def stretch_force(f: FlexureLaw, position: float) -> float:
    """What stretching of the leaves adds to the spring's force, N; against the displacement.

    A leaf whose ends are held at their distance gets longer: F = K x (1 - 1/sqrt(1 + (x/l)^2)), K x^3/(2 l^2) for
    small x (the stretched-string term of Senturia, Microsystem Design, 2001, sect. 10.4). A negative K softens.
    """
    ratio = position / f.stretch_length
    # 1 - 1/sqrt(1 + r^2) without the cancellation for small r
    root = np.sqrt(1.0 + ratio * ratio)
    return f.stretch_stiffness * position * ratio * ratio / (root * (1.0 + root))


@compiled
def outside_force(d: Disturbance, time: float, y: Array, sides: Array) -> float:
    """Force in N, along +x, of what no believed equation has."""
    position, velocity = y[X], y[V]
    force = -d.drag * velocity * abs(velocity) + d.product * sides[0, CURRENT] * sides[1, CURRENT]
    if d.hum != 0.0:
        phase = d.hum_frequency * time + d.hum_phase
        force += d.hum * (np.sin(phase) + d.hum_third * np.sin(3.0 * phase))
    if d.cogging != 0.0:
        force += d.cogging * np.sin(2.0 * np.pi * position / d.cogging_period + d.cogging_phase)
    return force


@compiled
def move(plant: BenchPlant, y: Array, external: float, sides: Array, dy: Array) -> None:
    """The rates of all mechanical states; `external` in N is what acts beside magnets, suspension and friction."""
    m, f, at = plant.motion, plant.flexure, plant.layout
    x, v = y[X], y[V]
    pull, film, support_v = 0.0, 0.0, 0.0
    if at.support >= 0:
        support_v = y[at.support + 1]
    for j in range(plant.magnets.sides):
        toward = 1.0 - 2.0 * j
        pull += toward * sides[j, PULL]
        if plant.film.damping > 0.0:
            position = x - y[at.support] if at.support >= 0 else x
            film += film_damping(plant.film, plant.magnets.nominal_gap - toward * position)
    if plant.stray.mutual_curve != 0.0 and plant.magnets.sides == 2:
        position = x - y[at.support] if at.support >= 0 else x
        pull += mutual_slope(plant.stray, position) * y[IM1] * y[IM1 + 1]
    reaction = pull - film * (v - support_v)  # of the magnets and the film, on the mover
    force = reaction + external - m.damping * v - m.stiffness * x
    if f.stretch_stiffness != 0.0:
        force -= stretch_force(f, x)
    for b in range(f.branches):
        branch = x - y[at.branches + b]
        force -= f.branch_stiffness[b] * branch
        if b == 0:
            force -= f.cushion * branch * abs(branch)
        dy[at.branches + b] = f.branch_rate[b] * branch
    if at.bristle >= 0:
        drag, dy[at.bristle] = friction_force(plant.friction, v, y[at.bristle])
        force -= drag
    mass = m.mass
    if at.attached >= 0:
        a = plant.attached
        part = a.share * m.mass
        mass -= part
        slip, slip_v = y[at.attached] - x, y[at.attached + 1] - v
        inner = part * a.frequency * (a.frequency * slip + 2.0 * a.damping_ratio * slip_v)
        force += inner
        dy[at.attached] = y[at.attached + 1]
        dy[at.attached + 1] = -inner / part
    if at.support >= 0:
        s = plant.support
        dy[at.support] = support_v
        dy[at.support + 1] = (-reaction - s.damping * support_v - s.stiffness * y[at.support]) / s.mass
    dy[X] = v
    dy[V] = force / mass


@compiled
def state_rates(bench: Bench, y: Array, command: Array, instant: tuple[float, float], dy: Array) -> bool:
    """dy/dt (layout.size,) at the state y; False outside the table.

    `command` (2,) is what the amplifier is asked for, `instant` the time in s and a force from outside in N.
    """
    plant = bench.plant
    sides = bench.sides
    scratch = bench.scratch
    at = plant.layout
    target, gap_rate = scratch[0], scratch[1]
    _amplify(plant, y, command, target, dy)
    position, speed = y[X], y[V]
    if at.support >= 0:
        position -= y[at.support]
        speed -= y[at.support + 1]
    gap_rate[0], gap_rate[1] = -speed, speed
    if not fill_side_currents(bench, y, position):
        return False
    drive_sides(bench, y, position, target, gap_rate, dy)
    dy[ENERGY_ELECTRICAL] = dy[ENERGY_COPPER] = 0.0
    for j in range(plant.magnets.sides):
        voltage, current = sides[j, VOLTAGE], sides[j, CURRENT]
        loss = side_resistance(plant, y, j) * current * current
        dy[VOLT_SECONDS_1 + j] = voltage
        dy[ENERGY_ELECTRICAL] += voltage * current
        dy[ENERGY_COPPER] += loss
        if at.thermal >= 0:
            n = at.thermal + 2 * j
            dy[n], dy[n + 1] = thermal_rates(plant.thermal, y[n], y[n + 1], loss)
    time, push = instant
    external = plant.motion.constant_force + push + outside_force(plant.disturbance, time, y, sides)
    external += law_of_motion(plant, FORCE, y, plant.magnets.nominal_gap - position, sides, CURRENT)
    if plant.circuit.drive == FORCE_DRIVE:
        external += target[0]
        dy[VOLT_SECONDS_1] = target[0]
    move(plant, y, external, sides, dy)
    dy[ENERGY_DAMPER] = plant.motion.damping * y[V] * y[V]
    dy[ENERGY_OUTSIDE] = external * y[V]
    return True


@compiled
def railed(rail: float, command: float) -> float:
    """What an amplifier gives whose output stage runs into its rail: nearly all below it, nearly the rail above."""
    ratio = command / rail
    square = ratio * ratio
    steep = square * square * square
    return command / (1.0 + steep * steep * square) ** (1.0 / 14.0)


@compiled
def _amplify(plant: BenchPlant, y: Array, command: Array, target: Array, dy: Array) -> None:
    """What the drive aims at (2,): the command after the amplifier's own dynamics, then after the believed lag."""
    at = plant.layout
    for j in range(2):
        target[j] = command[j]
        if plant.amplifier.rail < np.inf:
            target[j] = railed(plant.amplifier.rail, command[j])
        if at.amplifier >= 0:
            n = at.amplifier + 2 * j
            dy[n], dy[n + 1] = amplifier_rates(plant.amplifier, target[j], y[n], y[n + 1])
            target[j] = y[n]
        if at.output >= 0:
            dy[at.output + j] = plant.circuit.bandwidth * (target[j] - y[at.output + j])
            target[j] = y[at.output + j]
