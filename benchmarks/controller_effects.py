"""Each effect at a stated size on the reference actuator, by the coupled model: for the benchmarks of the controller.

Size is the RMS change of an open-loop record at equal input over that channel's RMS, the largest over
position, currents and voltages. Effects that coincide with a believed parameter are at least six of its tolerances.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from controller_cases import SERVO, TABLE, Array

from msl_fem.errors import ComputationError
from msl_fem.plant import Options, excitation_inputs, simulate
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import parse_excitation

EXCITATIONS = (
    "band-limited-noise:amplitude=47 mA,bias=610 mA,duration=4 s,seed=1,band=500 Hz",
    "swept-sine:amplitude=12 mA,bias=610 mA,duration=4 s,start=5 Hz,stop=300 Hz",
)
"""What the virtual bench takes on this actuator by itself."""
RATE = 1e4
LEAST = {("gap_offset", "offset"): 18e-6, ("gap_offset", "centring"): 18e-6}
"""m, six tolerances of the nominal gap."""
FIRST_GUESS = {
    ("gap_offset", "offset"): 1e-6, ("gap_offset", "centring"): 2e-6, ("early_saturation", "knee_shift"): 0.2,
    ("fringing", "growth"): 60.0, ("fringing", "depth_error"): 0.004,
    ("magnetic_hysteresis", "coercive_current"): 2e-3, ("eddy_currents", "time_constant"): 2e-5,
    ("cross_coupling", "share"): 2e-3, ("armature_tilt", "gap_variance"): 3e-10,
    ("coil_heating", "initial_rise"): 0.04, ("amplifier_bandwidth", "lag"): 2e-5,
    ("amplifier_bandwidth", "slew_time"): 2e-3, ("amplifier_bandwidth", "bandwidth_error"): -0.1,
    ("stiffness_nonlinearity", "cubic"): 9e10, ("coulomb_friction", "force"): 5e-3, ("squeeze_film", "damping"): 0.25,
    ("structural_mode", "mass_share"): 0.08, ("flexure_relaxation", "strength"): 1e-3, ("force_offset", "force"): 0.06,
    ("support_compliance", "compliance"): 1e-7, ("position_sensor_nonlinearity", "gain_error"): 0.03,
    ("position_sensor_lag", "lag"): 9e-5, ("time_delay", "command"): 2e-5, ("time_delay", "position"): 9e-5,
    ("periodic_disturbance", "force_cosine"): 0.014,
}  # fmt: skip


@dataclass(frozen=True)
class Sized:
    """An effect's parameter at its size."""

    effect: str
    parameter: str
    value: float
    size: float

    @property
    def name(self) -> str:
        return f"{self.effect}.{self.parameter}"

    @property
    def values(self) -> dict[str, dict[str, float]]:
        return {self.effect: {self.parameter: self.value}}


@cache
def _plain() -> Array:
    return _channels({"force_offset": {"force": 0.0}})


def _channels(effects: dict[str, dict[str, float]]) -> Array:
    """(n_sample of all runs, 5) position, currents, voltages without noise."""
    rows = []
    for text in EXCITATIONS:
        excitation = parse_excitation(text)
        inputs = excitation_inputs(SERVO, excitation, rate=RATE)
        start = Options(currents=(excitation.bias, excitation.bias))
        done = simulate(SERVO, TABLE, inputs, effects=EffectValues(effects), options=start)
        rows.append(np.column_stack([done.measured_position, done.measured_current, done.voltage]))
    return np.concatenate(rows)


def size_of(effects: dict[str, dict[str, float]]) -> float:
    """The size of effects; inf where the open loop does not bear them."""
    try:
        change = _channels(effects) - _plain()
    except ComputationError:
        return float("inf")
    return float((np.sqrt(np.mean(change**2, axis=0)) / np.sqrt(np.mean(_plain() ** 2, axis=0))).max())


@cache
def sized_effects(size: float = 0.03) -> tuple[Sized, ...]:
    """Every effect at a size, to 2 %, or larger where its parameter's tolerance says so."""
    found = []
    for (effect, parameter), guess in FIRST_GUESS.items():
        value, got = guess, 0.0
        for _ in range(10):
            got = size_of({effect: {parameter: value}})
            if abs(got / size - 1) < 0.02:
                break
            value *= 0.25 if not np.isfinite(got) else float(np.clip(size / got, 0.1, 8.0))
        least = LEAST.get((effect, parameter))
        if least is not None and value < least:
            value = least
            got = size_of({effect: {parameter: value}})
        found.append(Sized(effect, parameter, value, got))
    return tuple(found)
