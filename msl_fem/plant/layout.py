"""What stands where: the state of the coupled model, the rows that the kernel works on, and the columns of a run.

The coefficients of the effects stand in the files of their groups. All rows are handed out by a `RowLayout`: a row more
is a name more. One array of rows each, since compiled code passes it on as one argument and counts no references to
parts of it.
"""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import LANES, RowLayout
from msl_fem.computing.quintic_cell import N_CELL, PADDED
from msl_fem.plant.effects import expressions
from msl_fem.plant.effects.electrical import N_QUEUE
from msl_fem.plant.effects.magnetic import N_EDDY
from msl_fem.plant.effects.mechanisms import N_IRON_STOP, N_STOP
from msl_fem.plant.plant import CURRENT_DRIVE, FORCE_DRIVE, PlantParameters

# What `advance` and `run` return
OK, OUTSIDE_TABLE, NOT_FINITE, OUTSIDE_RANGE = range(4)

_STATE = RowLayout()
# What Runge-Kutta integrates: magnetising currents of the sides (A; the coils' own without hysteresis and eddy
# currents), position (m), velocity (m/s); volt-seconds of the sides since the last call of `advance` began (N s in
# force drive)
I1, I2, X, V = _STATE.rows(4)
VOLT_SECONDS_1, VOLT_SECONDS_2 = _STATE.rows(2)
N_PLAIN = _STATE.size
# With some effects also: relative rise of the sides' resistances, and that which the core's temperature stands for; the
# relaxed lengths of the flexure's two branches (m); second mass against the armature (m, m/s); force that the base has
# given way to (N, N/s); what the position sensor sees of the coils' field (m), and its slope (m/s), known in closed
# form over a step
HEAT_1, HEAT_2, CORE_1, CORE_2, CREEP, SLOW_CREEP, MODE, MODE_RATE, BASE, BASE_RATE = _STATE.rows(10)
COIL_READING, COIL_READING_SLOPE = _STATE.rows(2)
N_OF_EFFECTS = _STATE.size
# With eddy currents in sheets: flux linkages that their modes follow (Wb), of side 1, then of side 2
EDDY_FLUX_1, EDDY_FLUX_2 = _STATE.rows(2, N_EDDY)
N_MOVING = _STATE.size
# In one run, not in lanes: energies since the start (J), electrical input, copper loss, damping loss (and film), work
# of forces that are not the plant's own (disturbance, constant force, force drive); losses of eddy currents, and of
# flexure, second mass and base
ENERGY_ELECTRICAL, ENERGY_COPPER, ENERGY_DAMPING, ENERGY_EXTERNAL = _STATE.rows(4)
ENERGY_EDDY, ENERGY_INTERNAL = _STATE.rows(2)
N_INTEGRATED = _STATE.size
# What is known in closed form over a step: position as its sensor gives it, before noise (m); the drive's outputs
# (V, or N in force drive). Then counts of the calls of `advance` in which a limit of the drive was reached.
SENSOR, OUTPUT_1, OUTPUT_2 = _STATE.rows(3)
AT_CURRENT_LIMIT_1, AT_CURRENT_LIMIT_2, AT_VOLTAGE_LIMIT_1, AT_VOLTAGE_LIMIT_2 = _STATE.rows(4)
HELD, ENERGY_IMPACT = _STATE.rows(2)  # the end stop that the mover lies on (-1, 0, 1); energy lost at end stops (J)
# Currents of the coils (A) and their slopes (A/s) behind the last step and within the first one of the last call
COIL_1, COIL_2, COIL_SLOPE_1, COIL_SLOPE_2, COIL_START_1, COIL_START_2 = _STATE.rows(6)
SLEW_1, SLEW_2, LAG_1, LAG_2 = _STATE.rows(4)  # the amplifier: command behind its slew limit, behind its lag
PHASE_COSINE, PHASE_SINE = _STATE.rows(2)  # of the periodic disturbance
ADDED_READING = _STATE.row()  # what laws add to the position reading, m
# Memory: where the stops stand that follow (Wb, Wb, m), losses of hysteresis and friction (J), whether the eddy
# currents have settled at the start (0 before the first evaluation), then the stops
ANCHOR_1, ANCHOR_2, ANCHOR_X, ENERGY_HYSTERESIS, ENERGY_FRICTION, ANCHORED = _STATE.rows(6)
STOPS_1, STOPS_2 = _STATE.rows(2, N_IRON_STOP)
STOPS_X = _STATE.row(N_STOP)
QUEUE_1, QUEUE_2 = _STATE.rows(2, N_QUEUE + 1)  # commands that have not acted yet, the latest first
N_STATE = _STATE.size

_BLOCK = RowLayout()
# The cell of the coenergy spline that a side is in: coefficients (powers of the gap first), its edges, what a lane
# looks for, and where the coefficients of the lane's surface begin; the |current| and gap of the last evaluation, and
# what it found
CELL = _BLOCK.row(36)
GAP_LOW, GAP_HIGH, CURRENT_LOW, CURRENT_HIGH, CURRENT, GAP, SURFACE_START = _BLOCK.rows(7)
LAST_CURRENT, LAST_GAP, LAST_FOUND = _BLOCK.row(), _BLOCK.row(), _BLOCK.row(5)
N_BLOCK = _BLOCK.size

_MUTUAL = RowLayout()
# The cell of the coenergy of both sides: coefficients, lower and upper edge of each variable, what a lane looks for;
# then what is left of the coefficients at a position, value and slope over it; and at current 2 too (`mutual_flux.py`).
MUTUAL_CELL = _MUTUAL.row(N_CELL)
MUTUAL_LOW, MUTUAL_HIGH, MUTUAL_POINT = _MUTUAL.rows(3, 3)
MUTUAL_VALUE, MUTUAL_RISE = _MUTUAL.rows(2, 6 * PADDED)
MUTUAL_LEFT = _MUTUAL.row(5 * PADDED)
N_MUTUAL = _MUTUAL.size

_INPUT = RowLayout()
# What acts on the plant: what a current loop aims at (A), what a voltage or force drive gives (V, N), outer forces (N)
TARGET_1, TARGET_2, OUTPUT_OF_1, OUTPUT_OF_2, PUSH = _INPUT.rows(5)
# What an ideal current drive's currents move by in a second (A/s): other than 0 where inputs are linear between samples
RAMP_1, RAMP_2 = _INPUT.rows(2)
# Of a command that jumps within a step, and is what a current loop aims at: by what the former one is above it (A), 0
# where none does; and the share of that which is in the target
FORMER_ABOVE_1, FORMER_ABOVE_2, FORMER_SHARE = _INPUT.rows(3)
N_INPUT = _INPUT.size

_CIRCUIT = RowLayout()
# A side's circuit: incremental inductance (H), back-EMF (V), magnetising current with memory and eddy part (A),
# resistance (ohm); then what `solve_circuits` finds: du/dt (A/s), voltage (V), current of the coil (A); loss of the
# modes of the eddy currents (W); power of the magnets' force (W)
INDUCTANCE, EMF, MMF, RESISTANCE, SLOPE, VOLTAGE, COIL_CURRENT, MODE_LOSS, PULL_POWER = _CIRCUIT.rows(9)
# Of both sides' common coenergy: what it adds to the inductance (H), flux linkage (Wb) and its slope over x (Wb/m)
SHARED_INDUCTANCE, SHARED_FLUX, SHARED_SLOPE = _CIRCUIT.rows(3)
N_CIRCUIT = _CIRCUIT.size

_WORK = RowLayout(after=expressions.ROWS)
BLOCK_1, BLOCK_2 = _WORK.rows(2, N_BLOCK)  # the cells of both sides
SLOPES, SLOPES_2, SLOPES_3, SLOPES_4 = _WORK.rows(4, N_INTEGRATED)  # of the stages of Runge-Kutta
Y = _WORK.row(N_INTEGRATED)  # the integrated states at which slopes are taken
INPUTS_BEGIN, INPUTS_MIDDLE, INPUTS_END = _WORK.rows(3, N_INPUT)  # of a step
# Whether a side met its voltage limit (0 or 1); commands of the call, clipped, and those before them; what they rise by
# over a sample (0 where they are held), those before them too; where amplifier, drive and periodic disturbance stand
# at the end of a step; the mean voltages of a call (N in force drive); what the amplifier gives at a step's begin, and
# at its end
LIMITED_1, LIMITED_2, COMMAND_1, COMMAND_2, FORMER_1, FORMER_2 = _WORK.rows(6)
RISE_1, RISE_2, OUTPUT_END_1, OUTPUT_END_2 = _WORK.rows(4)
SLEW_END_1, SLEW_END_2, LAG_END_1, LAG_END_2, PHASE_COSINE_END, PHASE_SINE_END = _WORK.rows(6)
MEAN_VOLTAGE_1, MEAN_VOLTAGE_2 = _WORK.rows(2)
GIVEN_BEGIN_1, GIVEN_BEGIN_2, GIVEN_END_1, GIVEN_END_2 = _WORK.rows(4)
STEPS_DONE = _WORK.row()  # of the last call
# Weights of the position sensor's lag over a step (`lag_weights`); of the drive's lag what stands for its fall at
# begin, middle and end, and what is left (`fall_rows`), its answers to an input that rises by 1 in a step
SENSOR_WEIGHTS = _WORK.row(5)
COIL_READING_WEIGHTS = _WORK.row(5)  # the same of the coils' field on its way to the position sensor
DRIVE_FALL, DRIVE_RAMP = _WORK.rows(2, 4)
# Currents of a loop that is fast against the step (`fast_loop.py`), side 1, then side 2: whether they are known (0, 1
# or 2), then their values at begin, middle and end of a step and behind it, what stands for their slopes (A/s), the one
# of the stage; flux linkage (Wb) and field energy (J) at the step's begin, whether the limit had been met before
N_KNOWN = 32
KNOWN_1, KNOWN_2 = _WORK.rows(2, N_KNOWN)
KNOWN_VALUE, KNOWN_LAST, KNOWN_SLOPES, KNOWN_SLOPE, KNOWN_FLUX, KNOWN_FIELD, KNOWN_LIMITED = 1, 4, 5, 8, 9, 10, 11
KNOWN_SHARED = 12  # what of that flux linkage the sides have in common (Wb)
KNOWN_CORNER = 13  # slope (A/s) where a voltage limit will cease to act, without one that of the step's begin
KNOWN_ABOVE = 14  # what the current is above where it goes (A)
# The same but for what memory and iron in series take on the way, and what they take over the way
KNOWN_MISSING, KNOWN_MEMORY = 15, 16
KNOWN_MEAN = 17  # of the coil's current over the step (A), beside modes of eddy currents: there known is 2
# The magnetising current at middle and end, less that of the begin, and what iron takes there beyond its share (A)
KNOWN_MOVED, KNOWN_BEYOND = 18, 20
# Whether a voltage limit acts at the begin (0 or 1); what the current's own flux linkage rises by there (V), and what
# iron takes (A); the current's mean slope up to where the limit ceases to act (A/s), the current there, and what iron
# takes more (A)
KNOWN_ACTS, KNOWN_RISES, KNOWN_TOOK, KNOWN_LINE, KNOWN_TURN, KNOWN_TAKEN = 22, 23, 24, 25, 26, 27
# Whether what iron takes is known over the step (0 or 1), and what it takes at begin, middle and end (A)
KNOWN_IRON, KNOWN_OF_IRON = 28, 29
CIRCUIT_1, CIRCUIT_2 = _WORK.rows(2, N_CIRCUIT)
TILTED = _WORK.row(4 * N_BLOCK)  # cells at either end of a tilted face: side 1's lower and upper gap, then side 2's
SHARED = _WORK.row(N_MUTUAL)  # the cell of the coenergy of both sides
# Of that coenergy: mutual inductance (H), force along +x (N), field energy (J), that at the begin of a step
MUTUAL, SHARED_PULL, SHARED_ENERGY, SHARED_BEFORE = _WORK.rows(4)
# Eddy currents in sheets over such a step (`sheet_modes.py`): its length for which weights are there; what is left of
# a mode at each instant; what modes take together at a node, of a unit slope at each; at end and middle what a mode
# answers to unevenly rising flux, and to an even rise, which follows the flux of that instant, and the share that does
# so now; slopes of currents (A) and flux linkages (Wb) at the nodes of each side, equations of these
N_NODE = 3
MODE_STEP = _WORK.row()
MODE_DECAY = _WORK.row((N_NODE + 1) * N_EDDY)
MODE_SUM = _WORK.row(N_NODE * N_NODE)
MODE_EVEN, MODE_FOLLOWS, MODE_FOLLOWS_NOW = (_WORK.row(n * N_EDDY) for n in (2 * N_NODE, 2, 1))
MODE_NODES_1, MODE_NODES_2, MODE_STILL_1, MODE_STILL_2, MODE_RISE_1, MODE_RISE_2 = _WORK.rows(6, N_NODE)
MODE_MATRIX = _WORK.row(2 * N_NODE * (2 * N_NODE + 1))
N_WORK = _WORK.size

_OUT = RowLayout()
# Columns of `run`: the state before the command acts (currents of the coils, what the position sensor gives before
# noise), mean voltages until the next row, flux linkages of the coils, limits reached; then slopes in time of the
# sensor, of the currents behind the row's instant and before the next one (with effects only)
OUT_I1, OUT_I2, OUT_X, OUT_V, OUT_SENSOR, OUT_VOLTAGE_1, OUT_VOLTAGE_2, OUT_FLUX_1, OUT_FLUX_2 = _OUT.rows(9)
OUT_AT_CURRENT_LIMIT_1, OUT_AT_CURRENT_LIMIT_2, OUT_AT_VOLTAGE_LIMIT_1, OUT_AT_VOLTAGE_LIMIT_2 = _OUT.rows(4)
OUT_SENSOR_SLOPE, OUT_SLOPE_AFTER_1, OUT_SLOPE_AFTER_2, OUT_SLOPE_BEFORE_1, OUT_SLOPE_BEFORE_2 = _OUT.rows(5)
N_OUT = _OUT.size


@compiled
def workspace() -> Array:
    """Rows for one run."""
    work = np.zeros(N_WORK)
    work[CIRCUIT_2 + INDUCTANCE] = 1.0  # of a side that is not there
    for block in range(2):
        work[BLOCK_1 + block * N_BLOCK + LAST_GAP] = np.nan  # of none
    for block in range(4):
        work[TILTED + block * N_BLOCK + LAST_GAP] = np.nan
    return work


def lane_workspace() -> Array:
    """Rows for `LANES` runs."""
    return np.repeat(workspace()[:, None], LANES, axis=1)


def initial_state(
    parameters: PlantParameters, current_1: float, current_2: float, position: float, velocity: float
) -> Array:
    """The state (N_STATE,) with the sensor settled, drive outputs that hold the currents, energies and counts zero.

    The iron was demagnetised before the currents rose to these, the flexure is relaxed at its present length, all else
    that effects bring at rest.
    """
    state = np.zeros(N_STATE)
    begin_at(parameters, state, current_1, current_2, position, velocity)
    return state


def begin_at(
    p: PlantParameters, state: Array, current_1: float, current_2: float, position: float, velocity: float
) -> None:
    """Puts the start of `initial_state` into a state that is zero."""
    state[I1], state[I2], state[X], state[V] = current_1, current_2, position, velocity
    state[COIL_1], state[COIL_2] = current_1, current_2
    state[SENSOR] = state[CREEP] = state[SLOW_CREEP] = state[ANCHOR_X] = position
    state[PHASE_COSINE] = 1.0
    held = p.drive != FORCE_DRIVE
    for j in range(2):
        current = state[I1 + j]
        state[OUTPUT_1 + j] = p.resistance * current if held else 0.0
        hold = current if p.drive == CURRENT_DRIVE else state[OUTPUT_1 + j]
        state[SLEW_1 + j] = state[LAG_1 + j] = hold
        state[QUEUE_1 + j * (N_QUEUE + 1) : QUEUE_1 + (j + 1) * (N_QUEUE + 1)] = hold
