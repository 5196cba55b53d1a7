"""A record with something hidden in it, the answer that stays apart, and the excitations where none are stated."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.bench.catalogue import OUTSIDE_BY_NAME, Request
from msl_fem.bench.instruments import (
    FLUX_NOISE,
    FORCE_NOISE,
    believed_noise,
    bench_static_map,
    instrument_noise,
    noise_of_instruments,
    run_columns,
    with_noise,
)
from msl_fem.bench.nuisances import (
    Nuisances,
    draw_nuisances,
    nuisances_report,
    spoilt_columns,
    spoilt_map,
    with_stray_flux,
)
from msl_fem.bench.plant import Array
from msl_fem.bench.rig import Rig, draw_truth, true_rig
from msl_fem.bench.running import BenchController, Following, Response, check_stable_stretches, run_rig, stable_current
from msl_fem.bench.setting import (
    BenchEffect,
    BenchSetting,
    EffectAtSize,
    changes,
    channels,
    effect_of_size,
    runs_of,
    scales_of,
)
from msl_fem.errors import ActuatorError, ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.plant.excitation import parse_excitation, reference, samples
from msl_fem.plant.excitation_kinds import Excitation, Unit
from msl_fem.record import Record, Run, Sampling, Tolerance
from msl_fem.table.magnetic_table import MagneticTable

DRIVE_UNIT: dict[str, Unit] = {"current": "A", "voltage": "V", "force": "N"}
REACH = 0.2
"""Share of the range that the mover uses at most."""
_HALVINGS = 14


def usual_unit(actuator: Actuator) -> Unit:
    """The unit of what the actuator's drive takes; ActuatorError without a drive."""
    if actuator.drive is None:
        raise ActuatorError(f'{actuator.name} has no [drive]; add one with kind = "current", "voltage" or "force"')
    return DRIVE_UNIT[actuator.drive.kind]


def commands_of(actuator: Actuator, excitation: Excitation, *, rate: float) -> Array:
    """The commands (n_sample, n_column) of an excitation to the actuator's drive; InputError where it does not fit."""
    kind = actuator.drive.kind if actuator.drive else "none"
    sides = actuator.sides.count if kind != "force" and actuator.sides else 1
    return samples(excitation, rate=rate, sides=sides)


def usual_excitations(actuator: Actuator, table: MagneticTable | None, *, rate: float) -> tuple[Excitation, ...]:
    """Band-limited noise (fit) and a swept sine (held-out), 4 s each, chosen by what is believed of the actuator alone.

    The bias is half the current up to which the open loop is stable; the amplitudes are the largest halvings with which
    the believed rig uses a fifth of its range.

    Raises
    ------
    InputError : there is neither spring nor range to choose them by
    """
    rig = true_rig(actuator, table)
    kind = actuator.drive.kind if actuator.drive else "none"
    motion = rig.plant.motion
    if motion.stiffness <= 0 or not math.isfinite(motion.travel):
        raise InputError(
            f"{actuator.name}: without stiffness and range there are no usual excitations; state --excitation"
        )
    band = format_quantity(min(500.0, rate / 20), "Hz", digits=2)
    stop = format_quantity(min(300.0, rate / 30), "Hz", digits=2)
    bias, first = _bias(rig, kind)
    unit = usual_unit(actuator)
    held = f"bias={_text(bias, unit)}," if bias else ""
    noise = f"band-limited-noise:{held}band={band},duration=4 s,seed=1,role=fit"
    sweep = f"swept-sine:{held}start=5 Hz,stop={stop},duration=4 s,role=held-out"
    return tuple(_borne(actuator, rig, spec, (first, unit), rate=rate) for spec in (noise, sweep))


def _text(value: float, unit: str) -> str:
    return f"{value:.2g} {unit}"


def _bias(rig: Rig, kind: str) -> tuple[float, float]:
    """(bias, the first amplitude to try) in the drive's unit."""
    motion = rig.plant.motion
    if kind == "force":
        return 0.0, motion.stiffness * motion.travel
    assert rig.table is not None
    limit = min(stable_current(rig), rig.plant.circuit.current_limit, float(rig.table.current[-1]))
    current = 0.5 * limit
    if kind == "current":
        return current, current / 3.2  # three RMS of noise leave the current positive
    return current * rig.plant.circuit.resistance, 2 * current * rig.plant.circuit.resistance


def _borne(actuator: Actuator, rig: Rig, spec: str, start: tuple[float, Unit], *, rate: float) -> Excitation:
    amplitude, unit = start
    for _ in range(_HALVINGS):
        excitation = parse_excitation(f"{spec},amplitude={_text(amplitude, unit)}", unit=unit)
        commands = commands_of(actuator, excitation, rate=rate)
        try:
            response = run_rig(rig, commands, rate=rate, lead_in=excitation.bias)
        except ComputationError:
            amplitude /= 2
            continue
        if np.abs(response.position).max() <= REACH * rig.plant.motion.travel:
            return excitation
        amplitude /= 2
    raise InputError(f"{actuator.name}: no amplitude of '{spec}' is borne; state --excitation")


Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The controller of runs in closed loop, designed from what is believed, and what rig.toml states of it."""

    controller: BenchController
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
    nuisances : names and sizes in tolerances of what the instruments do beside (`parse_nuisances`)
    stated_noise : the noise that rig.toml states over the true one
    stated_hold : how rig.toml says that commands run between samples; they are held
    stated_bandwidth : of the drive, Hz, in rig.toml; None: the true one
    """

    seed: int
    rate: float = 10_000.0
    excitations: tuple[Excitation, ...] = ()
    static: bool = False
    exact: bool = False
    noise: str = "coloured"
    tolerance: Tolerance = field(default_factory=Tolerance)
    loop: ClosedLoop | None = None
    nuisances: tuple[tuple[str, float], ...] = ()
    stated_noise: float = 1.0
    stated_hold: Literal["zero-order", "linear"] = "zero-order"
    stated_bandwidth: float | None = None


@dataclass(frozen=True, eq=False)
class SealedRecord:
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
) -> SealedRecord:
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
    hidden: list[EffectAtSize] = []
    for n, request in enumerate(requests):
        hidden.append(_hidden(setting, request, hidden, exact=options.exact))
        progress(3 + n, steps)
    rig = with_all(setting, hidden)
    try:
        asked = tuple(_with_noise(command, actuator, options, n) for n, command in enumerate(setting.commands))
        responses = runs_of(rig, asked, setting.leads, rate=options.rate)
    except ComputationError as err:
        raise InputError(f"with the effects asked for, {err}") from err
    record = recorded(setting, rig, excitations, options, responses)
    progress(steps, steps)
    together: dict[str, float] = {}
    if hidden:
        silent = responses
        if any(isinstance(command, Following) for command in setting.commands):
            silent = runs_of(rig, setting.commands, setting.leads, rate=options.rate)
        together = changes(channels(rig, silent), channels(setting.rig, setting.responses))
    return SealedRecord(record, _answer(setting, hidden, together, excitations, options))


def prepared_setting(
    actuator: Actuator, table: MagneticTable | None, excitations: Sequence[Excitation], options: BenchOptions
) -> BenchSetting:
    """The true rig of a seed with its undisturbed runs.

    Raises
    ------
    InputError : an excitation does not fit the drive, or the rig does not bear it; names the limit
    """
    unit = usual_unit(actuator)
    for excitation in excitations:
        if excitation.loop == "open" and excitation.unit != unit:
            raise InputError(
                f"{excitation.name}: amplitude is in {excitation.unit}, the drive of {actuator.name} takes {unit}"
            )
    truth = draw_truth(options.tolerance, table, np.random.default_rng([options.seed, 1]))
    rig = with_stray_flux(true_rig(actuator, table, truth), actuator, table, _nuisances(options))
    commands = tuple(_asked(actuator, excitation, options) for excitation in excitations)
    leads = tuple(excitation.bias for excitation in excitations)
    try:
        responses = runs_of(rig, commands, leads, rate=options.rate)
    except ComputationError as err:
        raise InputError(f"{err} (at x = 0 it is stable up to {stable_current(rig):.3g} A on all sides)") from err
    for response in responses:
        if response.measured is None:
            check_stable_stretches(rig, response)
    return BenchSetting(
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


def _nuisances(options: BenchOptions) -> Nuisances:
    return draw_nuisances(options.nuisances, options.tolerance, seed=options.seed)


def _asked(actuator: Actuator, excitation: Excitation, options: BenchOptions) -> Array | Following:
    """The commands of an excitation, or what its closed loop follows, without noise."""
    if excitation.loop == "open":
        return commands_of(actuator, excitation, rate=options.rate)
    if options.loop is None:
        raise InputError(f"{excitation.name}: loop=closed needs a controller; leave it out for open loop")
    path = reference(excitation, rate=options.rate)
    followed = np.column_stack([path.position, path.velocity, path.acceleration])
    controller = options.loop.controller
    rows = controller.rows(followed, period=1.0 / options.rate)
    return Following(rows, controller, resolution=actuator.position_sensor.resolution)


def _with_noise(asked: Array | Following, actuator: Actuator, options: BenchOptions, run: int) -> Array | Following:
    """What a run is asked for; in closed loop the noise of the position's reading is in the loop, and around a voltage
    drive that of its current loop's sensors."""
    if not isinstance(asked, Following) or options.noise == "none":
        return asked
    how = noise_of_instruments(actuator, coloured=options.noise == "coloured")
    generator = np.random.default_rng([options.seed, 5, run])
    noise = instrument_noise(len(asked.reference), how, rate=options.rate, generator=generator)
    of_currents = how.sigma["current"] * generator.standard_normal((len(asked.reference), 2))
    return replace(asked, noise=how.sigma["position"] * noise, current_noise=of_currents)


def _hidden(setting: BenchSetting, request: Request, others: Sequence[EffectAtSize], *, exact: bool) -> EffectAtSize:
    """The effect of a request at its size; an unnamed one outside is drawn among those that can be seen."""
    if request.effect is not None:
        return effect_of_size(setting, request.effect, request.size, exact=exact)
    taken = {other.effect.name for other in others}
    left: list[BenchEffect] = [effect for name, effect in OUTSIDE_BY_NAME.items() if name not in taken]
    order = setting.generator("outside").permutation(len(left))
    last: InputError | None = None
    for n in order:
        try:
            return effect_of_size(setting, left[int(n)], request.size, exact=exact)
        except InputError as err:
            last = err
    raise InputError(f"no effect outside the catalogue is as large here: {last}")


def with_all(setting: BenchSetting, hidden: Sequence[EffectAtSize]) -> Rig:
    """The true rig with every effect at its strength."""
    rig = setting.rig
    for item in hidden:
        rig, _ = item.effect.hide(setting, rig, item.strength)
    return rig


def recorded(
    setting: BenchSetting,
    rig: Rig,
    excitations: Sequence[Excitation],
    options: BenchOptions,
    responses: Sequence[Response],
) -> Record:
    actuator = setting.actuator
    how = noise_of_instruments(actuator, coloured=options.noise == "coloured")
    runs = []
    for n, (excitation, response) in enumerate(zip(excitations, responses, strict=True)):
        table = spoilt_columns(run_columns(rig, response, run=n), _nuisances(options))
        generator = np.random.default_rng([options.seed, 2, n])
        if options.noise != "none":
            table = with_noise(table, how, rate=options.rate, generator=generator)
        asked = setting.commands[n]
        if isinstance(asked, Following):
            assert response.measured is not None
            zero = _nuisances(options).zero("position_zero")
            table |= {"position_m": response.measured + zero, "reference_m": asked.reference[:, 0]}
        name = excitation.name.replace("-", "_") + (f"_{n + 1}" if len(excitations) > 1 else "")
        runs.append(Run(name, excitation.spec, excitation.role, table))
    noise = believed_noise(actuator)
    static = None
    if options.static:
        generator = np.random.default_rng([options.seed, 4])
        static = bench_static_map(actuator, setting.table, rig, generator=generator, noisy=options.noise != "none")
        noise = noise.model_copy(update={"force": FORCE_NOISE, "flux_linkage": FLUX_NOISE})
        nominal = actuator.motion.nominal_gap if actuator.motion is not None else None
        shift = float(nominal or 0.0) * (setting.truth.nominal_gap - 1.0)
        static = spoilt_map(static, _nuisances(options), gauge_shift=shift)
    return Record(
        "simulated",
        _stated(actuator, options),
        sampling=Sampling(rate=options.rate, hold=options.stated_hold),
        noise=noise.model_copy(update={k: v * options.stated_noise for k, v in noise if v is not None}),
        tolerance=options.tolerance,
        controller=None if options.loop is None else options.loop.section,
        belief="plain",
        runs=tuple(runs),
        static=static,
    )


def _stated(actuator: Actuator, options: BenchOptions) -> Actuator:
    """The actuator as the record states it: its sensors' noise and the drive's bandwidth."""
    update: dict[str, Any] = {}
    if options.stated_noise != 1.0:
        for name in ("position_sensor", "current_sensor"):
            sensor = getattr(actuator, name)
            update[name] = sensor.model_copy(update={"noise": sensor.noise * options.stated_noise})
    if options.stated_bandwidth is not None and actuator.drive is not None:
        update["drive"] = actuator.drive.model_copy(update={"bandwidth": options.stated_bandwidth})
    return actuator.model_copy(update=update)


def _answer(
    setting: BenchSetting,
    hidden: Sequence[EffectAtSize],
    together: dict[str, float],
    excitations: Sequence[Excitation],
    options: BenchOptions,
) -> dict[str, Any]:
    """What was hidden; `changes_together` are the record's changes by all effects at once."""
    return {
        "effects": [item.to_json() for item in hidden],
        "true_parameters": setting.truth.to_json(setting.actuator),
        "seed": setting.seed,
        "drive": setting.drive,
        "excitations": [excitation.spec for excitation in excitations],
        "changes_together": together,
        "nuisances": nuisances_report(_nuisances(options)),
        "stated": {
            "noise": options.stated_noise,
            "hold": options.stated_hold,
            "bandwidth_Hz": options.stated_bandwidth,
        },
    }
