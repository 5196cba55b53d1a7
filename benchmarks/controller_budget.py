"""What limits tracking: each of the paper's suspects alone and together; and the inverse of other models."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from controller_cases import SERVO, TABLE, Track, belief, late_rms, regions, run, servo, sine
from controller_effects import sized_effects

from msl_fem.actuator import Actuator
from msl_fem.cli.controllers import identified_plant
from msl_fem.control import ControllerChoice, ControllerDesign, DesignModel, design_model_of_terms, designed
from msl_fem.errors import InputError
from msl_fem.identification import ModelChoice, identify
from msl_fem.plant import NamedRun, bearable_run, simulation_record
from msl_fem.plant.excitation import parse_excitation
from msl_fem.record import Record

Effects = dict[str, dict[str, float]]
FAST, DELAY_AT_FAST = 20e3, 8  # Hz; samples of 0.4 ms, the delay of one sample at 2.5 kHz


@dataclass(frozen=True)
class Setting:
    """One loop of the budget.

    Attributes
    ----------
    rate, delay : Hz, samples
    drive : Hz, the amplifier's bandwidth
    noise : whether the sensors are noisy
    effects : that the plant has and the controller does not know
    scale : of the plant's parameters, in tolerances (one sigma each, signs that add up)
    terms : whether the inverse is that of identified rational terms
    """

    rate: float = FAST
    delay: int = 0
    drive: float = 20e3
    noise: bool = False
    effects: Effects = field(default_factory=dict)
    scale: float = 0.0
    terms: bool = False

    def known(self) -> Actuator:
        return servo(controller={"rate": self.rate, "delay_samples": self.delay}, drive={"bandwidth": self.drive})

    def true(self) -> Actuator:
        s = self.scale
        return servo(
            controller={"rate": self.rate, "delay_samples": self.delay},
            drive={"bandwidth": self.drive},
            motion={"moving_mass": 0.9 * (1 + 0.005 * s), "stiffness": 1.4e5 * (1 + 0.02 * s),
                    "damping": 12.0 * (1 + 0.2 * s), "nominal_gap": 0.6e-3 * (1 - 0.005 * s)},
        )  # fmt: skip


IDEAL = Setting()
PAPER = Setting(rate=2500.0, delay=1, drive=1000.0, noise=True)


def _slow_changes() -> Effects:
    """Time-varying parameters: a flexure that relaxes, coils that warm, a sensor whose zero wanders."""
    return {
        "flexure_relaxation": {"strength": 0.02, "time_constant": 0.3},
        "coil_heating": {"rise_per_joule": 1e-3},
        "sensor_drift": {"rate": 1e-7},
    }


def _mode() -> Effects:
    """Unmodelled dynamics that the LQR bears: the structural mode at half its 3 % size."""
    mode = next(one for one in sized_effects() if one.effect == "structural_mode")
    hanging = {"mass_share": 0.5 * mode.value, "frequency": 300.0}
    return {"structural_mode": hanging, "eddy_currents": {"time_constant": 1e-4}}


SUSPECTS: dict[str, Setting] = {
    "nothing (20 kHz, ideal)": IDEAL,
    "sensor noise": Setting(noise=True),
    "amplifier, 1 kHz": Setting(drive=1000.0),
    "loop rate 10 kHz": Setting(rate=10e3),
    "loop rate 5 kHz": Setting(rate=5e3),
    "loop rate 2.5 kHz": Setting(rate=2500.0),
    "delay 0.4 ms": Setting(delay=DELAY_AT_FAST),
    "parameters, one sigma each": Setting(scale=1.0),
    "inverse by identified terms": Setting(terms=True),
    "unmodelled dynamics": Setting(effects=_mode()),
    "time-varying parameters": Setting(effects=_slow_changes()),
}


@cache
def _record() -> Record:
    """The coupled model under noise on both sides, as the study makes it."""
    wish = "band-limited-noise:channel=independent,band=500 Hz,seed=1,bias=0.6 A,amplitude=0.1 A,duration=4 s"
    done, excitation = bearable_run(
        SERVO, TABLE, parse_excitation(wish), rate=10e3, generator=np.random.default_rng(1)
    )  # fmt: skip
    return simulation_record(SERVO, [NamedRun("noise", excitation.spec, "fit", done)])


@cache
def _terms(rate: float, delay: int, drive: float) -> DesignModel:
    actuator = servo(controller={"rate": rate, "delay_samples": delay}, drive={"bandwidth": drive})
    model = identify(_record(), choice=ModelChoice()).model
    return design_model_of_terms(actuator, identified_plant(model, actuator), regions())


def _made(setting: Setting) -> ControllerDesign:
    if setting.terms:
        return designed(_terms(setting.rate, setting.delay, setting.drive), ControllerChoice("lqr"))
    return designed(belief(setting.known()), ControllerChoice("lqr"))


def _error(setting: Setting, track: Track, amplitude: float) -> float:
    """RMS over the amplitude once settled; nan where the plant is lost."""
    try:
        made = _made(setting)
    except InputError:
        return float("nan")
    seed = 1 if setting.noise else None
    found = run(made, track, actuator=setting.true(), effects=setting.effects or None, seed=seed)
    return float("nan") if found is None else late_rms(found) / amplitude


def budget() -> str:
    """Each suspect alone on an otherwise ideal loop, the paper's loop, and everything together."""
    cases = ((0.4e-3, 2.0), (0.1e-3, 20.0))
    together = Setting(
        rate=2500.0, delay=1, drive=1000.0, noise=True, scale=1.0, effects={**_mode(), **_slow_changes()}
    )  # fmt: skip
    settings = SUSPECTS | {"the paper's loop, all as believed": PAPER, "all together": together}
    found = {
        name: [_error(setting, sine(a, f, 1.5, rate=setting.rate), a) for a, f in cases]
        for name, setting in settings.items()
    }
    alone = ("sensor noise", "amplifier, 1 kHz", "loop rate 2.5 kHz", "delay 0.4 ms", "parameters, one sigma each",
             "unmodelled dynamics", "time-varying parameters")  # fmt: skip
    ideal = np.array(found["nothing (20 kHz, ideal)"])
    parts = np.array([found[name] for name in alone])
    squares = np.sqrt(ideal**2 + np.sum(np.clip(parts**2 - ideal**2, 0, None), axis=0))
    rows = [*found.items(), ("root of the sum of squares of the parts", squares.tolist())]
    lines = ["| suspect | 0.4 mm, 2 Hz | 0.1 mm, 20 Hz |", "| --- | --- | --- |"]
    for name, row in rows:
        lines.append(f"| {name} | {' | '.join('lost' if np.isnan(e) else f'{100 * e:.3g} %' for e in row)} |")
    return "\n".join(lines)


def inverses() -> str:
    """The inverse of table and of identified terms, at the reference loop."""
    rows = [
        "| inverse | domain: magnet current | reach | peak S | 0.1 mm | 0.2 mm | 0.3 mm | 0.4 mm |",
        "| " + "--- | " * 8,
    ]
    identified = _terms(2500.0, 1, 1000.0)
    for name, it in (("table", belief()), ("rational terms", identified)):
        made = designed(it, ControllerChoice("lqr"))
        cells = []
        for amplitude in (0.1e-3, 0.2e-3, 0.3e-3, 0.4e-3):
            found = run(made, sine(amplitude, 2.0, 1.5))
            cells.append("lost" if found is None else f"{100 * late_rms(found) / amplitude:.3g} %")
        rows.append(
            f"| {name} | 0 ... {it.inverse.current_limit:.3g} A | {made.reach[1] * 1e3:.2f} mm | "
            f"{made.peak_sensitivity:.2f} | {' | '.join(cells)} |"
        )
    return "\n".join(rows)
