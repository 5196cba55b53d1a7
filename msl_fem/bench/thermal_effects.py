"""What a machine did before a run, as heat in its coils and cores: the bench's two nodes a side, worked and rested.

The temperatures T of coil and core follow C T' = P - K T; from cold, after a time under constant power, then a pause,

    T = e^(-M pause) (1 - e^(-M work)) K^-1 P,    M = C^-1 K

(Incropera, DeWitt, Fundamentals of Heat and Mass Transfer, 5th ed., 2002, ch. 5: lumped capacities).
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import expm

from msl_fem.bench.equations import COPPER_COEFFICIENT
from msl_fem.bench.plant import Thermal
from msl_fem.bench.rig import Rig
from msl_fem.bench.setting import BenchEffect, BenchSetting, RigWithEffect
from msl_fem.computing.arrays import Array

COIL_SHARE = 0.8  # of the whole thermal resistance
OWN_HEAT = 0.02  # of the rise: what the runs themselves would add in the end
LASTS = 0.5  # of the coil's rise: a lower bound of what is left of it when the currents stand


def warmed(thermal: Thermal, *, work: float, pause: float) -> Array:
    """Rises (coil, core) in K for each watt, after `work` seconds under it and a pause."""
    resistances = np.array([thermal.coil_to_core, thermal.core_to_air])
    flow = np.array([[1 / resistances[0], -1 / resistances[0]], [-1 / resistances[0], np.sum(1 / resistances)]])
    capacity = np.array([thermal.coil_time, thermal.core_time]) / resistances
    rates = flow / capacity[:, None]
    settled = np.linalg.solve(flow, np.array([1.0, 0.0]))
    return np.asarray(expm(-rates * pause) @ (settled - expm(-rates * work) @ settled))


def _thermal_history(setting: BenchSetting, rig: Rig, rise: float) -> RigWithEffect:
    """Side 1's coil is `rise` (K) above where its resistance is known, side 2 worked less; the runs add little."""
    generator, duration = setting.generator("thermal_history"), setting.scales.duration
    whole = OWN_HEAT * rise / setting.scales.copper_loss
    coil_time = float(generator.uniform(0.4, 1.2)) * duration
    thermal = Thermal(COIL_SHARE * whole, (1 - COIL_SHARE) * whole, coil_time, 8 * duration)
    work, pause = float(generator.uniform(1, 4)) * 8 * duration, float(generator.uniform(0.05, 0.3)) * coil_time
    each = warmed(thermal, work=work, pause=pause)
    other = float(generator.uniform(0.3, 0.9))
    coil, core = rise * each / each[0]
    warm = (float(coil), float(core), other * float(coil), other * float(core))
    parameters = {"rise": rise, "core_rise": float(core), "other_side": other, "work": work, "pause": pause}
    return replace(rig.with_parts(thermal=thermal), warm=warm), parameters | {"coil_time": coil_time}


def _least_history(setting: BenchSetting) -> float:
    """The rise with which the resistance begins six tolerances up."""
    return 6 * setting.tolerance.coil_resistance / COPPER_COEFFICIENT / LASTS


THERMAL = (
    BenchEffect(
        "thermal_history",
        "rise",
        "K",
        _thermal_history,
        lambda s: 5.0,
        lambda s: 180.0,
        least=_least_history,
        needs_magnets=True,
    ),
)
