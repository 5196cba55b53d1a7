"""The right-hand side of the bench's equations of motion: amplifier, circuits, heat, mover."""

from msl_fem.bench.amplifier import amplifier_rates
from msl_fem.bench.circuit import CURRENT, VOLTAGE, drive_sides, side_currents, side_resistance
from msl_fem.bench.mover import move, outside_force
from msl_fem.bench.plant import (
    ENERGY_COPPER,
    ENERGY_DAMPER,
    ENERGY_ELECTRICAL,
    ENERGY_OUTSIDE,
    FORCE_DRIVE,
    VOLT_SECONDS_1,
    Array,
    Bench,
    Plant,
    V,
    X,
)
from msl_fem.bench.thermal import thermal_rates
from msl_fem.computing.compiled import compiled


@compiled
def rates(bench: Bench, y: Array, command: Array, instant: tuple[float, float], dy: Array) -> bool:
    """dy/dt (layout.size,) at the state y; False outside the table.

    `command` (2,) is what the amplifier is asked for, `instant` the time in s and a force from outside in N.
    """
    plant, sides, scratch = bench.plant, bench.sides, bench.scratch
    at = plant.layout
    target, gap_rate = scratch[0], scratch[1]
    _amplify(plant, y, command, target, dy)
    position, speed = y[X], y[V]
    if at.support >= 0:
        position -= y[at.support]
        speed -= y[at.support + 1]
    gap_rate[0], gap_rate[1] = -speed, speed
    if not side_currents(bench, y, position):
        return False
    drive_sides(bench, y, target, gap_rate, dy)
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
    if plant.circuit.drive == FORCE_DRIVE:
        external += target[0]
        dy[VOLT_SECONDS_1] = target[0]
    move(plant, y, external, sides, dy)
    dy[ENERGY_DAMPER] = plant.motion.damping * y[V] * y[V]
    dy[ENERGY_OUTSIDE] = external * y[V]
    return True


@compiled
def _amplify(plant: Plant, y: Array, command: Array, target: Array, dy: Array) -> None:
    """What the drive aims at (2,): the command after the amplifier's own dynamics, then after the believed lag."""
    at = plant.layout
    for j in range(2):
        target[j] = command[j]
        if at.amplifier >= 0:
            n = at.amplifier + 2 * j
            dy[n], dy[n + 1] = amplifier_rates(plant.amplifier, command[j], y[n], y[n + 1])
            target[j] = y[n]
        if at.output >= 0:
            dy[at.output + j] = plant.circuit.bandwidth * (target[j] - y[at.output + j])
            target[j] = y[at.output + j]
