"""A record with something hidden in it, and the answer that stays apart."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.bench.catalogue import OUTSIDE_BY_NAME, Request
from msl_fem.bench.following import Following, LoopController
from msl_fem.bench.plant import Array
from msl_fem.bench.readings import believed_noise, columns, disturbed, instrument_noise, noisy
from msl_fem.bench.rig import Rig, true_rig
from msl_fem.bench.running import Response
from msl_fem.bench.setting import Effect, Setting, runs_of, scales_of
from msl_fem.bench.size import Hidden, changes, channels, hidden_of_size
from msl_fem.bench.stability import check_stable, stability_limit
from msl_fem.bench.static_map import FLUX_NOISE, FORCE_NOISE, static_map
from msl_fem.bench.truth import draw_truth
from msl_fem.bench.usual_excitation import commands_of, usual_excitations, usual_unit
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.excitation import reference
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.record import Record, Run, Sampling, Tolerance
from msl_fem.table.magnetic_table import MagneticTable

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The controller of runs in closed loop, designed from what is believed, and what rig.toml states of it."""

    controller: LoopController
    section: Mapping[str, Any]


@dataclass(frozen=True)
class BenchOptions:
    """How a record is made.

    Attributes
    ----------
    seed : of the true parameters, the hidden effect's chance and the noise
    rate : samples a second, Hz
    excitations : empty: the usual ones
    static : whether a static map is made too
    exact : sizes as asked, even where six tolerances of a believed parameter are more
    noise : "coloured", "white" or "none"
    tolerance : within which the true parameters are drawn
    loop : for excitations with loop=closed
    """

    seed: int
    rate: float = 10_000.0
    excitations: tuple[Excitation, ...] = ()
    static: bool = False
    exact: bool = False
    noise: str = "coloured"
    tolerance: Tolerance = field(default_factory=Tolerance)
    loop: ClosedLoop | None = None


@dataclass(frozen=True, eq=False)
class Sealed:
    """The record, which tells nothing, and the answer as JSON has it."""

    record: Record
    answer: dict[str, Any]


def sealed_record(
    actuator: Actuator,
    table: MagneticTable | None,
    requests: Sequence[Request],
    options: BenchOptions,
    *,
    progress: Progress = lambda done, total: None,
) -> Sealed:
    """A simulated record of the actuator's rig with the effects asked for, every size as asked.

    Raises
    ------
    InputError : an effect cannot be seen or cannot be as large; an excitation does not fit the drive or is not borne
    """
    steps = 3 + len(requests)
    excitations = options.excitations or usual_excitations(actuator, table, rate=options.rate)
    progress(1, steps)
    setting = prepared_setting(actuator, table, excitations, options)
    progress(2, steps)
    hidden: list[Hidden] = []
    for n, request in enumerate(requests):
        hidden.append(_hidden(setting, request, hidden, exact=options.exact))
        progress(3 + n, steps)
    rig = with_all(setting, hidden)
    try:
        asked = tuple(_with_noise(one, actuator, options, n) for n, one in enumerate(setting.commands))
        responses = runs_of(rig, asked, setting.leads, rate=options.rate)
    except ComputationError as err:
        raise InputError(f"with the effects asked for, {err}") from err
    record = _record(setting, rig, excitations, options, responses)
    progress(steps, steps)
    together: dict[str, float] = {}
    if hidden:
        silent = responses
        if any(isinstance(one, Following) for one in setting.commands):
            silent = runs_of(rig, setting.commands, setting.leads, rate=options.rate)
        together = changes(channels(rig, silent), channels(setting.rig, setting.responses))
    return Sealed(record, _answer(setting, hidden, together, excitations))


def prepared_setting(
    actuator: Actuator, table: MagneticTable | None, excitations: Sequence[Excitation], options: BenchOptions
) -> Setting:
    """The true rig of a seed with its undisturbed runs.

    Raises
    ------
    InputError : an excitation does not fit the drive, or the rig does not bear it; names the limit
    """
    unit = usual_unit(actuator)
    for one in excitations:
        if one.loop == "open" and one.unit != unit:
            raise InputError(f"{one.name}: amplitude is in {one.unit}, the drive of {actuator.name} takes {unit}")
    truth = draw_truth(options.tolerance, table, np.random.default_rng([options.seed, 1]))
    rig = true_rig(actuator, table, truth)
    commands = tuple(_asked(actuator, one, options) for one in excitations)
    leads = tuple(one.bias for one in excitations)
    try:
        responses = runs_of(rig, commands, leads, rate=options.rate)
    except ComputationError as err:
        raise InputError(f"{err} (at x = 0 it is stable up to {stability_limit(rig):.3g} A on all sides)") from err
    for response in responses:
        if response.measured is None:
            check_stable(rig, response)
    return Setting(
        actuator=actuator,
        table=table,
        tolerance=options.tolerance,
        truth=truth,
        rig=rig,
        commands=commands,
        leads=leads,
        responses=responses,
        rate=options.rate,
        seed=options.seed,
        scales=scales_of(responses[0], rig),
    )


def _asked(actuator: Actuator, excitation: Excitation, options: BenchOptions) -> Array | Following:
    """The commands of an excitation, or what its closed loop follows, without noise."""
    if excitation.loop == "open":
        return commands_of(actuator, excitation, rate=options.rate)
    if options.loop is None:
        raise InputError(f"{excitation.name}: loop=closed needs a controller; leave it out for open loop")
    wanted = reference(excitation, rate=options.rate)
    followed = np.column_stack([wanted.position, wanted.velocity, wanted.acceleration])
    return Following(followed, options.loop.controller, resolution=actuator.position_sensor.resolution)


def _with_noise(asked: Array | Following, actuator: Actuator, options: BenchOptions, run: int) -> Array | Following:
    """What a run is asked for; in closed loop the noise of the position's reading is in the loop."""
    if not isinstance(asked, Following) or options.noise == "none":
        return asked
    how = disturbed(actuator, coloured=options.noise == "coloured")
    generator = np.random.default_rng([options.seed, 5, run])
    noise = instrument_noise(len(asked.reference), how, rate=options.rate, generator=generator)
    return replace(asked, noise=how.sigma["position"] * noise)


def _hidden(setting: Setting, request: Request, others: Sequence[Hidden], *, exact: bool) -> Hidden:
    """The effect of a request at its size; an unnamed one outside is drawn among those that can be seen."""
    if request.effect is not None:
        return hidden_of_size(setting, request.effect, request.size, exact=exact)
    taken = {one.effect.name for one in others}
    left: list[Effect] = [effect for name, effect in OUTSIDE_BY_NAME.items() if name not in taken]
    order = setting.chance("outside").permutation(len(left))
    last: InputError | None = None
    for n in order:
        try:
            return hidden_of_size(setting, left[int(n)], request.size, exact=exact)
        except InputError as err:
            last = err
    raise InputError(f"no effect outside the catalogue is as large here: {last}")


def with_all(setting: Setting, hidden: Sequence[Hidden]) -> Rig:
    """The true rig with every effect at its strength."""
    rig = setting.rig
    for one in hidden:
        rig, _ = one.effect.hide(setting, rig, one.strength)
    return rig


def _record(
    setting: Setting, rig: Rig, excitations: Sequence[Excitation], options: BenchOptions, responses: Sequence[Response]
) -> Record:
    actuator = setting.actuator
    how = disturbed(actuator, coloured=options.noise == "coloured")
    runs = []
    for n, (excitation, response) in enumerate(zip(excitations, responses, strict=True)):
        table = columns(rig, response, run=n)
        generator = np.random.default_rng([options.seed, 2, n])
        if options.noise != "none":
            table = noisy(table, how, rate=options.rate, generator=generator)
        asked = setting.commands[n]
        if isinstance(asked, Following):
            assert response.measured is not None
            table |= {"position_m": response.measured, "reference_m": asked.reference[:, 0]}
        name = excitation.name.replace("-", "_") + (f"_{n + 1}" if len(excitations) > 1 else "")
        runs.append(Run(name, excitation.spec, excitation.role, table))
    noise = believed_noise(actuator)
    static = None
    if options.static:
        generator = np.random.default_rng([options.seed, 4])
        static = static_map(setting, rig, generator, noisy=options.noise != "none")
        noise = noise.model_copy(update={"force": FORCE_NOISE, "flux_linkage": FLUX_NOISE})
    return Record(
        "simulated", actuator, sampling=Sampling(rate=options.rate), noise=noise, tolerance=options.tolerance,
        controller=None if options.loop is None else options.loop.section, runs=tuple(runs), static=static,
    )  # fmt: skip


def _answer(
    setting: Setting, hidden: Sequence[Hidden], together: dict[str, float], excitations: Sequence[Excitation]
) -> dict[str, Any]:
    """What was hidden; `changes_together` are the record's changes by all effects at once."""
    return {
        "effects": [one.report() for one in hidden],
        "true_parameters": setting.truth.report(setting.actuator),
        "seed": setting.seed,
        "drive": setting.drive,
        "excitations": [one.spec for one in excitations],
        "changes_together": together,
    }
