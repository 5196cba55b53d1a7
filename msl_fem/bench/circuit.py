"""The circuits of both sides: magnetising current, what stands in series with it, and the drive.

A side's coil current is i = i_m + i_s(L) + i_h[L] + r L_other + i_e: the table's magnetising current i_m, that of iron
beyond the table, of hysteresis and of the other side's flux in the shared armature, all over the flux linkage L, and
the eddy currents. v = R i + dL/dt. The states are i_m and those of hysteresis and eddy currents; i follows from them.

The believed current amplifier knows the coil: v = R i + dL/dg dg/dt + L_inc w (target - i) within its voltage limit,
which makes a plain coil's current a first-order lag of its target (Krishnan, Electric Motor Drives, 2001, ch. 3).
"""

import numpy as np

from msl_fem.bench.amplifier import crossover
from msl_fem.bench.diffusion import ladder_current, ladder_rates
from msl_fem.bench.magnet import series_current, side_magnet
from msl_fem.bench.plant import CURRENT_DRIVE, IM1, Array, Bench, Plant
from msl_fem.bench.preisach import pinned_current
from msl_fem.bench.thermal import warm_resistance
from msl_fem.computing.compiled import compiled

# Columns of a side's scratch row
FLUX, PULL, INDUCTANCE, GAP_SLOPE, CURRENT, VOLTAGE = range(6)
N_SIDE = 6


@compiled
def side_currents(bench: Bench, y: Array, position: float) -> bool:
    """Fills FLUX ... CURRENT of the sides; False outside the table. `position` is relative to the magnets."""
    plant, sides = bench.plant, bench.sides
    for j in range(plant.magnets.sides):
        row = sides[j]
        gap = plant.magnets.nominal_gap - (1.0 - 2.0 * j) * position
        inside, flux, pull, inductance, slope = side_magnet(bench.surface, plant.magnets, y[IM1 + j], gap)
        if not inside:
            return False
        row[FLUX], row[PULL], row[INDUCTANCE], row[GAP_SLOPE] = flux, pull, inductance, slope
        row[CURRENT] = y[IM1 + j]
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
def side_resistance(plant: Plant, y: Array, j: int) -> float:
    """Resistance of side j in ohm at its present temperature."""
    if plant.layout.thermal < 0:
        return plant.circuit.resistance
    return warm_resistance(plant.circuit.resistance, y[plant.layout.thermal + 2 * j])


@compiled
def drive_sides(bench: Bench, y: Array, target: Array, gap_rate: Array, dy: Array) -> None:
    """Fills VOLTAGE of the sides and the rates of i_m and the ladders.

    `target` (2,) is the current aimed at, or the voltage given; `gap_rate` (2,) in m/s.
    """
    plant = bench.plant
    for j in range(plant.magnets.sides):
        row = bench.sides[j]
        drop, motional = side_resistance(plant, y, j) * row[CURRENT], row[GAP_SLOPE] * gap_rate[j]
        voltage = target[j]
        if plant.circuit.drive == CURRENT_DRIVE:
            voltage = drop + motional + row[INDUCTANCE] * plant.circuit.bandwidth * (target[j] - row[CURRENT])
            if abs(voltage) > plant.circuit.voltage_limit:
                voltage = np.copysign(plant.circuit.voltage_limit, voltage)
        if plant.amplifier.crossover != 0.0:
            voltage = crossover(plant.amplifier, voltage)
        row[VOLTAGE] = voltage
        dy[IM1 + j] = (voltage - drop - motional) / row[INDUCTANCE]
        if plant.ladder.stages > 0:
            at = plant.layout.ladder + j * plant.ladder.stages
            end = at + plant.ladder.stages
            ladder_rates(plant.ladder, y[at:end], voltage - drop, dy[at:end])
