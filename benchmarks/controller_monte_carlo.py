"""Random plants under the controllers: tolerances alone, and with the worst three effects."""

from collections.abc import Callable

import numpy as np
from controller_cases import RandomPlant, design, late_rms, random_plant, run, sine
from controller_effects import sized_effects

from msl_fem.control import ControllerDesign

N_PLANT = 500
AMPLITUDE = 0.4e-3
_SEED = 2024
# Found by the part `effects`: what the LQR loses, then the two that move its tracking most
WORST = (("structural_mode", "mass_share"), ("gap_offset", "offset"), ("stiffness_nonlinearity", "cubic"))
Draw = Callable[[np.random.Generator], RandomPlant]


def _share_stable(made: ControllerDesign, draw: Draw, amplitude: float) -> tuple[int, np.ndarray]:
    """(number held, tracking RMS over the amplitude of those)."""
    generator, errors = np.random.default_rng(_SEED), []
    for n in range(N_PLANT):
        plant = draw(generator)
        found = run(made, sine(amplitude, 2.0, 1.0), actuator=plant.actuator, effects=plant.effects, seed=n)
        if found is not None and late_rms(found, read=True) < 0.1 * amplitude:
            errors.append(found.tracking_rms / amplitude)
    return len(errors), np.array(errors)


def _row(name: str, made: ControllerDesign, draw: Draw, amplitude: float = AMPLITUDE) -> str:
    held, errors = _share_stable(made, draw, amplitude)
    if not held:
        return f"| {name} | {amplitude * 1e3:g} mm | 0 of {N_PLANT} | - | - | - |"
    quantiles = (f"{100 * q:.2f} %" for q in (*np.quantile(errors, [0.5, 0.95]), errors.max()))
    return f"| {name} | {amplitude * 1e3:g} mm | {held} of {N_PLANT} | {' | '.join(quantiles)} |"


_HEAD = "| design | sine | held | RMS error: median | 95 % | largest |\n| --- | --- | --- | --- | --- | --- |\n"


def tolerances() -> str:
    """500 plants with RECORDS.md's tolerances."""
    cases = (("lqr", AMPLITUDE), ("robust", AMPLITUDE), ("biased", 0.3e-3), ("pid", 0.3e-3))
    return _HEAD + "\n".join(_row(kind, design(kind), random_plant, a) for kind, a in cases)


def _worst_plant(generator: np.random.Generator) -> RandomPlant:
    """A random plant with the worst three effects at their size, of either sign where they have one."""
    plant = random_plant(generator)
    effects = dict(plant.effects)
    for one in sized_effects():
        if (one.effect, one.parameter) in WORST:
            sign = 1.0 if one.effect == "structural_mode" else float(generator.choice([-1.0, 1.0]))
            effects[one.effect] = effects.get(one.effect, {}) | {one.parameter: sign * one.value}
    effects["structural_mode"] = effects["structural_mode"] | {"frequency": float(generator.uniform(300.0, 600.0))}
    return RandomPlant(plant.actuator, effects)


def with_effects() -> str:
    """500 plants with tolerances and the worst three effects at 3 % size."""
    cases = [(kind, a) for kind in ("lqr", "robust") for a in (AMPLITUDE, 0.2e-3)]
    cases += [("biased", 0.2e-3), ("pid", 0.2e-3)]
    return _HEAD + "\n".join(_row(kind, design(kind), _worst_plant, a) for kind, a in cases)
