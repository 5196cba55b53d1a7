"""Plants that a controller has not seen: drawn within tolerances, with the suspects that hurt a loop most.

Parameters are normal with `record.Tolerance`, cut at three sigma. The suspects are those three of the catalogue that
cost the reference actuator's loop most at 3 % size (docs/control.md): a second mass on the mover, a gap offset of six
tolerances and a suspension that hardens. What a number of plants tells of all of them is Clopper and Pearson's bound
(Biometrika 26, 1934); for none lost of n it is the scenario bound 1 - 0.05^(1/n) (Tempo, Bai, Dabbene, Systems &
Control Letters 30, 1997).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.control.closed_loop import ClosedLoopRun, PlantUnderTest, ReferenceArrays, run_closed_loop
from msl_fem.control.design import ControllerDesign
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.numbers import json_value
from msl_fem.plant.effects import EffectValues
from msl_fem.record import Tolerance

N_PLANT = 20
HELD_WITHIN = 0.1  # of the reference's amplitude: a plant with a larger error, once settled, is not held
SUSPECTS = ("structural_mode", "gap_offset", "stiffness_nonlinearity")
_CUT = 3.0  # sigma
_MASS_SHARE = 0.083  # of the moving mass, that hangs on a spring
_MODE = (0.12, 0.24)  # of the loop rate: 300 to 600 Hz at 2.5 kHz
_OFFSET = 6.0  # tolerances of the nominal gap
_HARDENING = 0.157  # of the spring's force at the end of the travel, added or taken away
_CONFIDENCE = 0.95
_SETTLED = 0.5  # of a run

DrawPlant = Callable[[np.random.Generator], PlantUnderTest]
Progress = Callable[[int, int], None]
Effects = dict[str, dict[str, float]]


def random_plant(
    plant: PlantUnderTest, generator: np.random.Generator, *, tolerance: Tolerance | None = None
) -> PlantUnderTest:
    """A plant within its tolerances: mass, stiffness, damping, resistance, gap; sensor gain, magnetic scale, table.

    The table's smooth error is a depth that changes over the gap, whose largest value over the travel is drawn.
    """
    t = tolerance or Tolerance()
    actuator = plant.actuator
    motion, drive = actuator.motion, actuator.drive
    if motion is None or drive is None or motion.nominal_gap is None:
        raise InputError(f"{actuator.name} has no [drive] or no motion.nominal_gap; random plants need both")
    parts = {
        "moving_mass": motion.moving_mass * (1 + _drawn(generator, t.moving_mass)),
        "stiffness": motion.stiffness * (1 + _drawn(generator, t.stiffness)),
        "damping": motion.damping * (1 + _drawn(generator, t.damping)),
        "nominal_gap": motion.nominal_gap * (1 + _drawn(generator, t.nominal_gap)),
    }
    resistance = actuator.coil_resistance() * (1 + _drawn(generator, t.coil_resistance))
    changed = {
        "motion": motion.model_copy(update=parts),
        "drive": drive.model_copy(update={"coil_resistance": resistance}),
    }
    growth = _drawn(generator, t.table) / (motion.range or motion.nominal_gap)
    scale = _drawn(generator, t.magnetic_scale)
    gain = _drawn(generator, t.position_gain)
    effects = {
        "position_sensor_nonlinearity": {"gain_error": gain},
        "fringing": {"depth_error": scale - growth * motion.nominal_gap, "growth": growth},
    }
    return PlantUnderTest(actuator.model_copy(update=changed), plant.table, with_more(plant.effects, effects))


def suspected_plant(plant: PlantUnderTest, generator: np.random.Generator) -> PlantUnderTest:
    """A `random_plant` with all `SUSPECTS`, of either sign where they have one, the mode anywhere in its band."""
    drawn = random_plant(plant, generator)
    return PlantUnderTest(drawn.actuator, drawn.table, with_more(drawn.effects, suspects_of(plant.actuator, generator)))


def suspects_of(actuator: Actuator, generator: np.random.Generator) -> Effects:
    """The values of the `SUSPECTS` for an actuator."""
    motion, controller = actuator.motion, actuator.controller
    assert motion is not None
    assert motion.nominal_gap is not None
    assert controller is not None
    travel = motion.range or motion.nominal_gap
    offset, cubic = generator.choice([-1.0, 1.0], 2)
    frequency = controller.rate * generator.uniform(*_MODE)
    return {
        "structural_mode": {"mass_share": _MASS_SHARE, "frequency": float(frequency)},
        "gap_offset": {"offset": float(offset) * _OFFSET * Tolerance().nominal_gap * motion.nominal_gap},
        "stiffness_nonlinearity": {"cubic": float(cubic) * _HARDENING * motion.stiffness / travel**2},
    }


def with_more(effects: EffectValues | None, more: Mapping[str, Mapping[str, float]]) -> EffectValues:
    """Effects with others beside; amounts of the same parameter add up, of a shape the later one counts."""
    stated: Effects = {} if effects is None else {name: dict(values) for name, values in effects.stated.items()}
    for effect, values in more.items():
        own = stated.setdefault(effect, {})
        for name, value in values.items():
            own[name] = value if name == "frequency" else own.get(name, 0.0) + value
    return EffectValues(stated)


def _drawn(generator: np.random.Generator, sigma: float) -> float:
    while True:
        drawn = float(generator.normal())
        if abs(drawn) <= _CUT:
            return sigma * drawn


@dataclass(frozen=True, eq=False)
class UnseenPlants:
    """What a loop did on plants that its design has not seen.

    Attributes
    ----------
    suspects : effects that every plant had beside its tolerances
    error : (n_plant,) settled RMS of the reading less the reference over the amplitude; nan where the run was lost
    violations : (n_plant,) commands that the guard cut
    guarded : (n_plant,) share of the commands beyond the guard's first level
    """

    suspects: tuple[str, ...]
    error: Array
    violations: Array
    guarded: Array

    @property
    def held(self) -> int:
        """Plants whose run ended and whose error is below `HELD_WITHIN` of the amplitude."""
        return int(np.count_nonzero(self.error < HELD_WITHIN))

    @property
    def held_at_least(self) -> float:
        """The share of all such plants that is held, at least, with 95 % confidence."""
        return least_share(self.held, self.error.size)

    def to_json(self) -> dict[str, Any]:
        """The JSON object of the figures; errors are those of the plants that were held."""
        held = self.error[self.error < HELD_WITHIN]
        of_held = np.quantile(held, [0.5, 0.95, 1.0]) if held.size else np.full(3, np.nan)
        errors = zip(("error_median", "error_95", "error_largest"), of_held, strict=True)
        return {
            "plants": self.error.size,
            "suspects": list(self.suspects),
            "held": self.held,
            "held_share": self.held / self.error.size,
            "held_share_at_least": self.held_at_least,
            **{name: json_value(float(value)) for name, value in errors},
            "guard_violations": int(self.violations.sum()),
            "plants_with_guard_violations": int(np.count_nonzero(self.violations)),
            "guard_share": float(self.guarded.mean()),
        }


def least_share(successes: int, trials: int, *, confidence: float = _CONFIDENCE) -> float:
    """The lower one-sided bound of a share at a confidence: Clopper and Pearson's."""
    from scipy.special import betaincinv

    return float(betaincinv(successes, trials - successes + 1, 1 - confidence)) if successes else 0.0


def on_unseen_plants(
    design: ControllerDesign,
    reference: ReferenceArrays,
    draw: DrawPlant,
    *,
    n: int = N_PLANT,
    seed: int = 1,
    suspects: tuple[str, ...] = SUSPECTS,
    progress: Progress | None = None,
) -> UnseenPlants:
    """The loop on `n` plants, each drawn with a generator of its own seed, so that one can be run again alone."""
    rows = unheld_rows(n)
    amplitude = 0.5 * float(np.ptp(reference.position))
    for k, plant, generator in each_drawn(draw, n, seed=seed, progress=progress):
        run = _tried(design, reference, plant, generator)
        if run is not None:
            rows[k] = _settled_error(run) / amplitude, run.guard_violations, run.guard_share
    return UnseenPlants(suspects, *rows.T)


def each_drawn(
    draw: DrawPlant, n: int, *, seed: int, progress: Progress | None
) -> Iterator[tuple[int, PlantUnderTest, np.random.Generator]]:
    """(k, the k-th plant, its generator), which goes on with the plant's noise; `progress` is told before each."""
    tell = progress or (lambda *_: None)
    for k in range(n):
        tell(k, n)
        generator = np.random.default_rng([seed, k])
        yield k, draw(generator), generator
    tell(n, n)


def unheld_rows(*shape: int) -> Array:
    """(*shape, 3) of `UnseenPlants` where no plant is held: no error, no violation, no share."""
    rows = np.full((*shape, 3), np.nan)
    rows[..., 1:] = 0.0
    return rows


def _tried(
    design: ControllerDesign, reference: ReferenceArrays, plant: PlantUnderTest, generator: np.random.Generator
) -> ClosedLoopRun | None:
    try:
        return run_closed_loop(design, reference, plant=plant, generator=generator)
    except ComputationError:
        return None


def _settled_error(run: ClosedLoopRun) -> float:
    late = run.time >= _SETTLED * run.time[-1]
    return float(np.sqrt(np.mean((run.measured - run.reference)[late] ** 2)))
