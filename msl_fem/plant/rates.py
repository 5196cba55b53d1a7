"""The equations of motion of the plain model.

    v_j = R i_j + d lambda_j(i_j, g_j)/dt,   g_1 = g_0 - x,   g_2 = g_0 + x
    m x'' + c x' + k x = F_1(i_1, g_1) - F_2(i_2, g_2) + F_const + d(t)

(Woodson and Melcher, Electromechanical Dynamics I, 1968, ch. 3: flux linkage and force are derivatives of one
coenergy.) The currents are the electrical states: L_inc di/dt = v - R i - lambda_g dg/dt, with lambda_g = -dF/di.
"""

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, choose
from msl_fem.plant.cell import Cells
from msl_fem.plant.drive import terminal_voltage
from msl_fem.plant.plant import FORCE_DRIVE, PlantParameters
from msl_fem.plant.side import side_gap, side_slopes
from msl_fem.plant.state import (
    ENERGY_COPPER,
    ENERGY_DAMPING,
    ENERGY_ELECTRICAL,
    ENERGY_EXTERNAL,
    I1,
    VOLT_SECONDS_1,
    V,
    X,
)
from msl_fem.plant.work import LIMITED_1, OUTPUT_OF_1, PUSH, TARGET_1, Y


@compiled
def rates(cells: Cells, p: PlantParameters, work: Rows, inputs: int, dy: int) -> Flag:
    """The slopes of the first N_PLAIN states Y into the rows from `dy`, under inputs from that row; False outside."""
    position, velocity = work[Y + X], work[Y + V]
    external = work[inputs + PUSH]
    if p.drive == FORCE_DRIVE:
        external = external + work[inputs + OUTPUT_OF_1]
        work[dy + VOLT_SECONDS_1] = work[inputs + OUTPUT_OF_1]
    force = external
    electrical = copper = velocity - velocity
    inside = velocity == velocity
    for j in range(p.sides):
        toward = 1.0 - 2.0 * j  # side 1 pulls towards +x, side 2 towards -x
        current = work[Y + I1 + j]
        found, pull, inductance, flux_slope = side_slopes(cells, p, work, j, current, side_gap(p, None, work, j))
        inside = inside & found
        drop = p.resistance * current - flux_slope * toward * velocity
        voltage, slope, over = terminal_voltage(
            p, current, drop, inductance, work[inputs + TARGET_1 + j], work[inputs + OUTPUT_OF_1 + j]
        )
        work[LIMITED_1 + j] = choose(over, 1.0, work[LIMITED_1 + j])
        force = force + toward * pull
        electrical = electrical + voltage * current
        copper = copper + p.resistance * current * current
        work[dy + I1 + j] = slope
        work[dy + VOLT_SECONDS_1 + j] = voltage
    work[dy + X] = velocity
    work[dy + V] = (force - p.damping * velocity - p.stiffness * position) / p.mass
    work[dy + ENERGY_ELECTRICAL] = electrical
    work[dy + ENERGY_COPPER] = copper
    work[dy + ENERGY_DAMPING] = p.damping * velocity * velocity
    work[dy + ENERGY_EXTERNAL] = external * velocity
    return inside
