"""The whole chain for one actuator: table, operating map, coupled model, identification, guarded closed loop."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.control import (
    ClosedLoopRun,
    ControllerDesign,
    FrequencyResponse,
    PlantUnderTest,
    closed_loop_response,
    design_controller,
    run_closed_loop,
)
from msl_fem.control.unseen_plants import UnseenPlants, on_unseen_plants, suspected_plant
from msl_fem.errors import InputError
from msl_fem.identification import Identification, identify
from msl_fem.magnetics.field.accuracy import Accuracy, PointResult
from msl_fem.magnetics.field.magnet_field import MagnetField, solve_with_field
from msl_fem.magnetics.field.two_sided import Decoupling, polarity_costs
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition
from msl_fem.magnetics.kinds.kind import PlaneMagnet
from msl_fem.magnetics.solver.magnetostatics import FieldSolution
from msl_fem.magnetics.sweep.table_sweep import SweepReport, SweepSettings, default_grid, sweep
from msl_fem.maps import OperatingMap, operating_map
from msl_fem.plant import (
    Linearisation,
    NamedRun,
    Simulation,
    bearable_run,
    linearise,
    simulation_record,
    stability_limit,
)
from msl_fem.plant.excitation import parse_excitation, reference
from msl_fem.record import Record
from msl_fem.table.magnetic_table import MagneticTable

Progress = Callable[[str, int, int], None]
Keep = Callable[[str, Any], None]
RECORD_RATE = 1e4  # Hz
RESPONSE_AMPLITUDE = 2e-5  # m: the paper's small sines
MOST_HALVINGS = 5  # of an amplitude that the actuator cannot follow
Result = TypeVar("Result")


@dataclass(frozen=True)
class StudySettings:
    """How a study runs: accuracy of the table, processes, cache of finished rows, seed of all noise."""

    accuracy: Accuracy = "normal"
    workers: int = 1
    cache: Path | None = None
    resume: bool = False
    seed: int = 1


@dataclass(frozen=True, eq=False)
class FieldStage:
    """The table, what it took, and one field to look at: at the nominal gap, at the first level's current.

    `polarity` is how far two sides are from independent at half the range, each at its first level's current, by how
    their fluxes meet; empty where there is one side.
    """

    table: MagneticTable
    report: SweepReport
    point: PointResult
    field: MagnetField
    solution: FieldSolution
    polarity: Mapping[str, Decoupling]


@dataclass(frozen=True, eq=False)
class ModelStage:
    """The coupled model at its bias, and its simulated record: noise to fit, a swept sine held out."""

    linearisation: Linearisation
    stability_limit: float
    bias: float
    noise: Simulation
    sweep: Simulation
    record: Record
    excitations: tuple[str, str]


@dataclass(frozen=True, eq=False)
class LoopStage:
    """The controller and its runs on the believed plant: sine, step and ramp, and the frequency response.

    `unseen` is the sine on plants within the tolerances that have the suspects. `notes` say which amplitudes were made
    smaller, and why.
    """

    design: ControllerDesign
    runs: dict[str, ClosedLoopRun]
    references: dict[str, str]
    response: FrequencyResponse
    unseen: UnseenPlants
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Study:
    """The results of all stages, and the seconds that each took."""

    actuator: Actuator
    field: FieldStage
    operating_map: OperatingMap
    model: ModelStage
    identification: Identification
    loop: LoopStage
    seconds: dict[str, float]


def run_study(
    actuator: Actuator,
    *,
    settings: StudySettings | None = None,
    progress: Progress | None = None,
    keep: Keep | None = None,
) -> Study:
    """All stages, one after the other.

    Parameters
    ----------
    progress : called with a stage's name and the numbers of its finished and of all parts
    keep : called with a name and a result ("table", "map", "record", "model") as soon as it is there

    Raises
    ------
    InputError : the actuator lacks what a stage needs
    ComputationError : a stage failed; what was kept stays
    """
    settings = settings or StudySettings()
    tell = progress or (lambda *_: None)
    hold = keep or (lambda *_: None)
    _check(actuator)
    clock = _Clock(tell)
    with clock.stage("table") as part:
        grid = default_grid(actuator)
        sweeping = SweepSettings(settings.accuracy, settings.workers, settings.cache, settings.resume)
        table, report = sweep(actuator, *grid, settings=sweeping, progress=part)
        hold("table", table)
    with clock.stage("map") as part:
        made_map = operating_map(table, gap=np.union1d(table.gap, _nominal_gap(actuator)))
        hold("map", made_map)
        field_stage = _look_at_field(actuator, table, report, made_map)
    with clock.stage("coupled model") as part:
        model = _simulated(actuator, table, seed=settings.seed)
        hold("record", model.record)
    with clock.stage("identification") as part:
        identification = identify(model.record)
        hold("model", identification)
    with clock.stage("closed loop") as part:
        loop = _closed_loop(actuator, table, made_map, seed=settings.seed, part=part)
    return Study(actuator, field_stage, made_map, model, identification, loop, clock.seconds)


class _Clock:
    """Seconds by stage, told as they pass."""

    def __init__(self, tell: Progress) -> None:
        self.tell = tell
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[int, int], None]]:
        self.tell(name, 0, 1)
        started = time.perf_counter()
        yield lambda done, total: self.tell(name, done, total)
        self.seconds[name] = time.perf_counter() - started
        self.tell(name, 1, 1)


def _check(actuator: Actuator) -> None:
    """InputError for an actuator whose chain cannot be run to its end."""
    missing = [
        name
        for name, section in (
            ("magnet", actuator.magnet), ("sides", actuator.sides), ("motion", actuator.motion),
            ("drive", actuator.drive), ("controller", actuator.controller),
        )
        if section is None
    ]  # fmt: skip
    if missing:
        raise InputError(
            f"{actuator.name} has no [{'], ['.join(missing)}]; a study needs them: add them, or use "
            "'msl-fem table' and "
            "'msl-fem map' for the magnet alone"
        )


def _look_at_field(actuator: Actuator, table: MagneticTable, report: SweepReport, made: OperatingMap) -> FieldStage:
    """One field at the nominal gap and the current of the map's first level there (or half the table's largest)."""
    gap = _nominal_gap(actuator)
    row = np.where(np.isnan(made.current[0]), made.current_max / 2, made.current[0])
    current = float(np.interp(gap, made.gap, row))
    point, magnet_field, solution = solve_with_field(actuator, current, gap)
    return FieldStage(table, report, point, magnet_field, solution, _polarity(actuator, made, gap))


def _polarity(actuator: Actuator, made: OperatingMap, gap: float) -> Mapping[str, Decoupling]:
    magnet, sides, motion = actuator.magnet, actuator.sides, actuator.motion
    if sides is None or sides.count != 2 or motion is None or motion.range is None:
        return {}
    if not isinstance(magnet, PlaneMagnet):
        return {}
    off = motion.range / 2
    position = TwoSidedPosition(gap - off, gap + off)
    currents = [float(np.interp(g, made.gap, made.current[0])) for g in (position.gap_1, position.gap_2)]
    if not np.isfinite(currents).all():
        return {}
    return polarity_costs(actuator, (currents[0], currents[1]), position, accuracy="fast")


def _simulated(actuator: Actuator, table: MagneticTable, *, seed: int) -> ModelStage:
    """Noise and a swept sine about half the stable bias, with amplitudes that the open loop bears."""
    limit = stability_limit(actuator, table)
    bias = round(0.5 * min(limit, table.current[-1]), 2)
    at_bias = linearise(actuator, table, currents=(bias,) * _n_sides(actuator), position=0.0)
    natural = at_bias.natural_frequency
    generator = np.random.default_rng(seed)
    channels = ("independent", "differential") if _n_sides(actuator) == 2 else ("1", "1")
    same = f"bias={bias} A,duration=4 s"
    noise_spec = f"band-limited-noise:channel={channels[0]},band={9 * natural:.0f} Hz,seed={seed},{same}"
    band = f"start={natural / 10:.1f} Hz,stop={2.5 * natural:.0f} Hz"
    sweep_spec = f"swept-sine:role=held-out,channel={channels[1]},{band},{same}"
    runs = [
        bearable_run(
            actuator, table, parse_excitation(f"{spec},amplitude={a:.3g} A"), rate=RECORD_RATE, generator=generator
        )
        for spec, a in ((noise_spec, bias / 6), (sweep_spec, bias / 30))
    ]
    (noise, noise_excitation), (swept, sweep_excitation) = runs
    specs = noise_excitation.spec, sweep_excitation.spec
    record = simulation_record(
        actuator,
        [NamedRun("noise", specs[0], "fit", noise), NamedRun("swept_sine", specs[1], sweep_excitation.role, swept)],
    )
    return ModelStage(at_bias, limit, bias, noise, swept, record, specs)


def _closed_loop(
    actuator: Actuator, table: MagneticTable, made: OperatingMap, *, seed: int, part: Callable[[int, int], None]
) -> LoopStage:
    """The paper's references at four, one and two fifths of the range, and small sines over frequency.

    An amplitude that asks for more than guard, drive or table allow is halved until they bear it.
    """
    assert actuator.motion is not None
    assert actuator.motion.range is not None
    assert actuator.controller is not None
    travel = actuator.motion.range * 1e3
    wishes = {
        "sine": ("sine:frequency=2 Hz,duration=1.5 s", 0.8 * travel),
        "step": ("step:frequency=3 Hz,duration=1 s", 0.2 * travel),
        "ramp": ("ramp:frequency=5 Hz,duration=1 s", 0.4 * travel),
    }
    design = design_controller(actuator, table, made)
    plant = PlantUnderTest(actuator, table)
    runs, specs, notes = {}, {}, []
    for n, (name, (spec, wish)) in enumerate(wishes.items()):
        part(n, len(wishes) + 1)

        def followed(amplitude: float, spec: str = spec) -> tuple[ClosedLoopRun, str]:
            stated = f"{spec},amplitude={amplitude:.4g} mm"
            wanted = reference(parse_excitation(stated, unit="m"), rate=1 / design.law.plant.period)
            return run_closed_loop(design, wanted, plant=plant, generator=np.random.default_rng(seed)), stated

        (runs[name], specs[name]), note = _bearable(followed, wish, f"the {name}'s amplitude in mm")
        notes.append(note)
    part(len(wishes), len(wishes) + 1)
    response, note = _bearable(
        lambda amplitude: closed_loop_response(design, plant=plant, amplitude=amplitude * 1e-6),
        RESPONSE_AMPLITUDE * 1e6,
        "the frequency response's amplitude in µm",
    )
    track = reference(parse_excitation(specs["sine"], unit="m"), rate=1 / design.law.plant.period)
    unseen = on_unseen_plants(design, track, lambda generator: suspected_plant(plant, generator), seed=seed)
    return LoopStage(design, runs, specs, response, unseen, tuple(said for said in (*notes, note) if said))


def _bearable(attempt: Callable[[float], Result], wish: float, what: str) -> tuple[Result, str]:
    """What an attempt makes of the wished amplitude, or of the largest of its halves that is not refused; a note if so.

    Raises
    ------
    InputError : of the last attempt, after `MOST_HALVINGS`
    """
    refused = ""
    for amplitude in wish / 2.0 ** np.arange(MOST_HALVINGS + 1):
        try:
            made = attempt(float(amplitude))
        except InputError as err:
            refused, last = refused or str(err), err
        else:
            return made, f"{what} is {amplitude:.3g} instead of {wish:.3g}: {refused}" if refused else ""
    raise last


def _nominal_gap(actuator: Actuator) -> float:
    assert actuator.motion is not None
    assert actuator.motion.nominal_gap is not None
    return actuator.motion.nominal_gap


def _n_sides(actuator: Actuator) -> int:
    return actuator.sides.count if actuator.sides else 1
