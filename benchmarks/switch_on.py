"""Currents of a pull solenoid after switch-on: by the circuit of a shorted winding that an LCR meter told, in the
periodic regime of its PWM, and what the rows of long pulses tell of the chain that feeds and reads it.

    leak i' = V - (R + r) i + r j,   main j' = r (i - j),   r = main/tau

i is the coil's current, j what magnetises; while the switch is open i flows on through an ideal diode until it is zero,
and j decays with tau. V is the supply times what shunt and amplifier read of an ampere over what is stated.
"""

from dataclasses import dataclass

import numpy as np
from judged import DATA
from scipy.linalg import expm
from scipy.optimize import least_squares

from msl_fem.computing.arrays import Array
from msl_fem.record.columns import read_columns

AFTER = {50: "i_50us_A", 100: "i_100us_A", 500: "i_500us_A"}
"""us after switch-on, and the column."""
SUPPLY, PERIOD = 12.0, 0.01  # V, s
SHORT = 1e-3  # s: the pulses whose currents are foretold
N_OFF, MOST_PERIODS = 200, 40


@dataclass(frozen=True)
class Chain:
    """What feeds and reads: volt and ohm with their 95 % intervals, of how many rows."""

    volt: float
    ohm: float
    volt_off: float
    ohm_off: float
    rows: int


@dataclass(frozen=True)
class Pulse:
    """A row: its set-up, stroke number of the law, on-time (s), stated resistance (ohm), currents (3,) A."""

    label: str
    stroke: int
    on: float
    ohm: float
    currents: Array


def pulses(law, resistances: dict[int, float]) -> list[Pulse]:
    """All rows of the log; the stroke is that of the nearest inductance at 1 kHz."""
    meter = read_columns(DATA / "solenoid_stroke" / "inductance_cbs0730.csv")
    rows = read_columns(DATA / "solenoid_stroke" / "switch_on_cbs0730.csv")
    found = []
    for k, on in enumerate(rows["t_on_s"]):
        place = int(np.argmin(np.abs(meter["L_1kHz_H"] - rows["L_1kHz_H"][k])))
        stroke = int(np.argmin(np.abs(law.stroke - meter["withdrawal_m"][place])))
        ohm = resistances[int(rows["sheet"][k])]
        where = "out" if str(rows["stroke_label"][k]) == "Neutral" else str(rows["stroke_label"][k])
        currents = np.array([rows[name][k] for name in AFTER.values()])
        found.append(Pulse(f"{where}, {ohm:g} ohm", stroke, float(on), ohm, currents))
    return found


def switched_on(law, k: int, ohm: float, *, volt: float = SUPPLY, on: float = SHORT) -> Array:
    """A at the instants `AFTER`, in the periodic regime of pulses of `on` s at stroke k."""
    leak, main, tau = law.leakage, law.inductance[k], law.time_constant[k]
    loop = main / tau
    matrix = np.array([[-(ohm + loop) / leak, loop / leak], [loop / main, -loop / main]])

    def after(time: float, supply: float) -> Array:
        whole = np.zeros((3, 3))
        whole[:2, :2], whole[0, 2] = matrix, supply / leak
        return expm(whole * time)

    rise, step = after(on, volt), (PERIOD - on) / N_OFF
    fall, decay = after(step, 0.0), np.exp(-step / tau)
    state = np.zeros(2)
    for _ in range(MOST_PERIODS):
        begun = state
        state = (rise @ [*state, 1.0])[:2]
        for _ in range(N_OFF):
            further = (fall @ [*state, 1.0])[:2]
            state = further if further[0] > 0 else np.array([0.0, state[1] * decay])
        if np.abs(state - begun).max() < 1e-7:
            break
    return np.array([(after(1e-6 * us, volt) @ [*state, 1.0])[0] for us in AFTER])


def chain_of(law, rows: list[Pulse]) -> Chain:
    """Volt and ohm by which the rows of pulses longer than `SHORT` are followed best, relative errors weighed alike;
    their intervals take the three readings of a row for one."""
    long = [row for row in rows if row.on > 1.5 * SHORT]

    def missed(x: Array) -> Array:
        made = [switched_on(law, row.stroke, x[1], volt=x[0], on=row.on) / row.currents - 1 for row in long]
        return np.concatenate(made)

    found = least_squares(missed, [SUPPLY, 50.0], diff_step=1e-3)
    sigma = np.sqrt(3 * found.cost * 2 / (found.fun.size - 6))
    off = 1.96 * sigma * np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    return Chain(float(found.x[0]), float(found.x[1]), float(off[0]), float(off[1]), len(long))
