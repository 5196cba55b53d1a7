"""What an effect is fitted into: the true rig, its undisturbed runs and their scales, and a source of chance."""

from collections.abc import Callable
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.bench.following import Following, follow
from msl_fem.bench.plant import CURRENT_DRIVE, FORCE_DRIVE, VOLTAGE_DRIVE, Array
from msl_fem.bench.rig import Rig
from msl_fem.bench.running import Response, run_rig
from msl_fem.bench.truth import Truth
from msl_fem.record import Tolerance
from msl_fem.table.magnetic_table import MagneticTable

DRIVE_WORD = {CURRENT_DRIVE: "current", VOLTAGE_DRIVE: "voltage", FORCE_DRIVE: "force"}


@dataclass(frozen=True)
class Scales:
    """RMS values over the first run, of both sides together where there are two; `step` is that of the command."""

    position: float
    velocity: float
    current: float
    flux_linkage: float
    flux_rate: float
    voltage: float
    step: float
    copper_loss: float
    duration: float
    pull: float


@dataclass(frozen=True, eq=False)
class Setting:
    """Everything that an effect's parameters are chosen by.

    Attributes
    ----------
    actuator, table, tolerance : as believed
    truth : what was drawn
    rig : the true one, without effects
    commands : (n_sample, n_column) of each run in open loop, what a run in closed loop follows
    leads : what each run's commands start from, held until the currents stand; not in closed loop
    responses : of the rig, without noise
    """

    actuator: Actuator
    table: MagneticTable | None
    tolerance: Tolerance
    truth: Truth
    rig: Rig
    commands: tuple[Array | Following, ...]
    leads: tuple[float, ...]
    responses: tuple[Response, ...]
    rate: float
    seed: int
    scales: Scales

    def chance(self, effect: str) -> np.random.Generator:
        """The source of an effect's chance: always the same for a seed and an effect."""
        return np.random.default_rng([self.seed, 3, crc32(effect.encode())])

    @property
    def drive(self) -> str:
        return DRIVE_WORD[self.rig.plant.circuit.drive]


@dataclass(frozen=True)
class Effect:
    """An effect that can be hidden.

    Attributes
    ----------
    name : of RECORDS' catalogue, or one outside it
    parameter, unit : what its strength is
    hide : the rig with the effect at a strength above 0, and all its parameters in SI units
    start : a strength that makes an effect of some per cent
    largest : the largest strength that makes sense
    least : the strength that is six tolerances of the believed parameter with which the effect coincides; None: none
    needs_magnets : whether a rig that an external force drives cannot have it
    """

    name: str
    parameter: str
    unit: str
    hide: Callable[[Setting, Rig, float], tuple[Rig, dict[str, float]]]
    start: Callable[[Setting], float]
    largest: Callable[[Setting], float]
    least: Callable[[Setting], float] | None = None
    needs_magnets: bool = False


def lag_to_start_with(setting: Setting) -> float:
    """s: a lag of the command of some per cent; a current drive's voltages show less than a voltage drive's motion."""
    return (0.1 if setting.drive == "current" else 0.3) / setting.rate


def runs_of(
    rig: Rig, commands: tuple[Array | Following, ...], leads: tuple[float, ...], *, rate: float
) -> tuple[Response, ...]:
    """The rig's runs of all commands, each after its lead-in, or in closed loop; raises as `run_rig` and `follow`."""
    pairs = zip(commands, leads, strict=True)
    return tuple(
        follow(rig, one, rate=rate, seed=n)
        if isinstance(one, Following)
        else run_rig(rig, one, rate=rate, lead_in=lead, seed=n)
        for n, (one, lead) in enumerate(pairs)
    )


def scales_of(response: Response, rig: Rig) -> Scales:
    """The scales of a run."""

    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2))) if values.size else 0.0

    magnets = rig.plant.magnets
    pull = 0.0
    if rig.table is not None and response.current.size:
        gap = np.clip(magnets.nominal_gap, rig.table.gap[0], rig.table.gap[-1])
        inside = np.clip(magnets.share * response.current[::20, 0], -rig.table.current[-1], rig.table.current[-1])
        pull = rms(magnets.per_side * rig.table.force(inside, gap))
    return Scales(
        position=rms(response.position),
        velocity=rms(response.velocity),
        current=rms(response.current),
        flux_linkage=rms(response.flux_linkage),
        flux_rate=rms(np.diff(response.flux_linkage, axis=0) * response.rate),
        voltage=rms(response.voltage),
        step=rms(np.diff(response.command, axis=0)),
        copper_loss=rig.plant.circuit.resistance * rms(response.current) ** 2,
        duration=response.command.shape[0] / response.rate,
        pull=pull,
    )
