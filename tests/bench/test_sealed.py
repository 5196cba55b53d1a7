"""The record tells nothing of what was hidden, the answer all of it; the same seed makes the same bits."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from bench_rigs import DRIVES, RATE, SERVO, SERVO_TABLE, VOLTAGE_SERVO, excitations

from msl_fem.bench import BenchOptions, parse_requests, sealed_record, usual_excitations
from msl_fem.bench.instruments import bench_static_map, instrument_noise, noise_of_instruments
from msl_fem.bench.rig import true_rig
from msl_fem.bench.running import run_rig
from msl_fem.bench.sealed import SealedRecord
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import parse_excitation
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.static_map import static_map
from msl_fem.record import load_record, write_record
from msl_fem.table.magnetic_table import MagneticTable


def made(*hide: str, seed: int = 4, drive: str = "voltage", **options: object) -> SealedRecord:
    actuator, table = DRIVES[drive]
    how = BenchOptions(seed=seed, excitations=excitations(drive), **options)
    return sealed_record(actuator, table, parse_requests(hide), how)


def files(sealed: SealedRecord, folder: Path) -> dict[str, bytes]:
    write_record(sealed.record, folder)
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize("hide", ["eddy_currents=3%", "outside:cogging=3%", "sensor_drift=2%"])
def test_nothing_in_the_folder_tells(tmp_path: Path, hide: str) -> None:
    """The same file names, the same rig.toml and actuator to the letter, the same columns and times as with none."""
    plain, hidden = files(made("none"), tmp_path / "a"), files(made(hide), tmp_path / "b")
    assert list(plain) == list(hidden)
    name = hide.partition("=")[0].rpartition(":")[2]
    for file, content in hidden.items():
        if not file.endswith(".csv"):
            assert content == plain[file]
        assert name.encode() not in content
        assert content.count(b"\n") == plain[file].count(b"\n")
    records = [load_record(tmp_path / part) for part in "ab"]
    for one, two in zip(records[0].runs, records[1].runs, strict=True):
        assert list(one.columns) == list(two.columns)
        assert (one.time == two.time).all()
        assert abs(np.std(one["position_m"]) / np.std(two["position_m"]) - 1) < 0.1
    assert records[1].origin == "simulated"
    assert not records[1].warnings


def test_the_same_seed_makes_the_same_bits(tmp_path: Path) -> None:
    hide = ("sensor_drift=3%", "magnetic_hysteresis=2%")
    digests = set()
    for part in "ab":
        sealed = made(*hide)
        content = files(sealed, tmp_path / part)
        content["answer"] = json.dumps(sealed.answer, sort_keys=True).encode()
        digests.add(hashlib.sha256(b"".join(content[name] for name in sorted(content))).hexdigest())
    assert len(digests) == 1
    assert made(*hide, seed=5).answer["true_parameters"] != made("none").answer["true_parameters"]


def test_the_answer_says_what_is_true() -> None:
    sealed = made("eddy_currents=2%", "position_sensor_lag=1%")
    answer = json.loads(json.dumps(sealed.answer))
    assert [one["effect"] for one in answer["effects"]] == ["eddy_currents", "position_sensor_lag"]
    assert [one["size"] for one in answer["effects"]] == pytest.approx([0.02, 0.01], rel=0.006)
    assert answer["effects"][0]["parameters"]["diffusion_time"] > 0
    assert answer["seed"] == 4
    true = answer["true_parameters"]
    believed = {"moving_mass": 0.9, "stiffness": 1.4e5, "nominal_gap": 6e-4, "coil_resistance": 1.0}
    for name, value in believed.items():
        assert true[name]["value"] == pytest.approx(value * (1 + true[name]["relative_error"]))
        assert 0 < abs(true[name]["relative_error"]) < 0.1
    assert len(true["table"]["coefficients"]) == len(true["table"]["terms"])


def test_sizes_stand_in_the_files() -> None:
    """From the columns of two records without noise, by the definition: within 2 % of what was asked for."""
    plain, hidden = made("none", noise="none"), made("cross_coupling=3%", noise="none")
    found = {}
    for channel in ("position_m", "current_1_A", "current_2_A"):
        one, two = (np.concatenate([run[channel] for run in s.record.runs]) for s in (plain, hidden))
        found[channel] = np.sqrt(np.mean((two - one) ** 2) / np.mean(one**2))
    assert max(found.values()) == pytest.approx(0.03, rel=0.02)


def test_none_differs_from_the_belief_as_a_real_bench_does() -> None:
    """With true parameters of its own even a bench with nothing hidden is not the believed rig: by more than noise."""
    run = made("none", noise="none").record.runs[0]
    commands = np.column_stack([run["voltage_1_V"], run["voltage_2_V"]])
    believed = run_rig(true_rig(VOLTAGE_SERVO, SERVO_TABLE), commands, rate=RATE, lead_in=1.0)
    off = np.std(run["position_m"] - believed.position) / np.std(believed.position)
    assert 0.005 < off < 0.5


def test_runs_begin_with_the_bias_on() -> None:
    run = made("none", noise="none", drive="current").record.runs[0]
    assert run["current_1_A"][0] == pytest.approx(0.5, rel=1e-3)
    assert abs(run["position_m"][0]) < 1e-6


def test_an_effect_outside_is_drawn_by_the_seed() -> None:
    names = {made("outside=3%", seed=seed).answer["effects"][0]["effect"] for seed in range(6)}
    assert len(names) > 2


def test_noise_has_its_sigma_and_its_colour() -> None:
    """Stated sigma, white at high frequency, up to some tens of times more power below 20 Hz."""
    how = noise_of_instruments(SERVO)
    noise = instrument_noise(200_000, how, rate=RATE, generator=np.random.default_rng(0))
    assert np.std(noise) == pytest.approx(1.0, rel=0.03)
    power = np.abs(np.fft.rfft(noise)) ** 2 / noise.size
    frequency = np.fft.rfftfreq(noise.size, 1 / RATE)
    high, low = power[frequency > 500].mean(), power[(frequency > 0) & (frequency < 5)].mean()
    assert high == pytest.approx(0.9, rel=0.03)
    assert 10 < low / high < 40
    white = instrument_noise(
        1000, noise_of_instruments(SERVO, coloured=False), rate=RATE, generator=np.random.default_rng(0)
    )
    assert white == pytest.approx(np.random.default_rng(0).standard_normal(1000))


def test_resolution_rounds_the_position() -> None:
    sensor = VOLTAGE_SERVO.position_sensor.model_copy(update={"resolution": 1e-7})
    actuator = VOLTAGE_SERVO.model_copy(update={"position_sensor": sensor})
    how = BenchOptions(seed=1, excitations=excitations("voltage"))
    run = sealed_record(actuator, SERVO_TABLE, (), how).record.runs[0]
    steps = run["position_m"] / 1e-7
    assert np.abs(steps - np.round(steps)).max() < 1e-6


def test_a_static_map_shows_hysteresis_and_little_else() -> None:
    """Up and down differ by the hysteresis alone; the forces are those of the believed table within tolerances."""
    loops = {}
    for name, hide in (("none", "none"), ("iron", "magnetic_hysteresis=10%")):
        static = made(hide, static=True, noise="none").record.static
        assert static is not None
        rows = static.sequence == 3
        up, down = (static.flux_linkage[rows & (static.direction == way)] for way in ("up", "down"))
        loops[name] = np.abs(up[:-1] - down[::-1]).max() / up.max()
        if name == "none":
            expected = SERVO_TABLE.force(static.current, static.gap)
            assert static.force == pytest.approx(expected, rel=0.06, abs=1e-9)
            assert {"fit", "held-out"} == set(static.role)
    assert loops["none"] < 1e-9
    assert loops["iron"] > 1e-3


def test_a_static_map_of_large_currents_is_the_same_up_and_down() -> None:
    """Fewer turns and more current: every row of a sweep is at its own current, steps of some amperes apart."""
    times, per = 20.0, {"flux_linkage": 1, "incremental_inductance": 2, "force_current_slope": 1}
    nodes = {name: values / times ** per.get(name, 0) for name, values in SERVO_TABLE.nodes.items()}
    table = MagneticTable(SERVO_TABLE.gap, times * SERVO_TABLE.current, nodes)
    drive = VOLTAGE_SERVO.drive.model_copy(update={"current_limit": times * VOLTAGE_SERVO.drive.current_limit})
    actuator = VOLTAGE_SERVO.model_copy(update={"drive": drive})
    rig = true_rig(actuator, table)
    static = bench_static_map(actuator, table, rig, generator=np.random.default_rng(1), noisy=False)
    assert np.abs(np.diff(static.current)).max() > 1.5
    assert static.flux_linkage == pytest.approx(table.flux_linkage(static.current, static.gap), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("effect", ["remanent_flux", "leakage_inductance"])
def test_stray_flux_is_in_the_static_map_as_in_the_runs(effect: str) -> None:
    """The map of a sealed record less that of one without, against the model's of side 1's magnet: remanence fades
    with the flux a little otherwise there, and leakage bends."""
    sealed = made(f"{effect}=3%", static=True)
    plain, hidden = made("none", static=True).record.static, sealed.record.static
    assert plain is not None
    assert hidden is not None
    truth = sealed.answer["effects"][0]["parameters"]
    plant, surface = plant_parameters(SERVO), surface_of(SERVO_TABLE)
    known = {name: value for name, value in truth.items() if name in ("current_1", "share_1")}
    assert known
    rows = {"gap": plain.gap, "current": plain.current}
    nothing, stray = EffectValues(), EffectValues({effect: known})
    without, expected = (static_map(surface, plant, one, **rows)[1] for one in (nothing, stray))
    low = np.abs(plain.current) <= 0.1 * plain.current.max()
    change = (hidden.flux_linkage - plain.flux_linkage)[low]
    assert change == pytest.approx((expected - without)[low], rel=0.15, abs=0.02 * np.abs(change).max())


@pytest.mark.parametrize(
    ("hide", "said"),
    [
        (("eddy_current=3%",), "'eddy_current' is no effect; there are gap_offset"),
        (("eddy_currents=0.03",), "'0.03' is no size; give a percentage"),
        (("eddy_currents=-3%",), "is no size"),
        (("eddy_currents=0%",), "is no size"),
        (("outside:nothing",), "'nothing' is no effect outside; there are cogging"),
        (("none", "fringing=1%"), "--hide none goes alone"),
        (("fringing=1%", "fringing=2%"), "is there twice"),
        (("fringing", "eddy_currents", "time_delay", "coil_heating"), "at most 3 effects"),
        (("cogging=3%",), "'cogging' is no effect"),
    ],
)
def test_requests_that_are_none(hide: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError, match=said.replace("(", r"\(")):
        parse_requests(hide)


def test_excitations_that_are_not_borne_are_refused_with_the_limit() -> None:
    strong = parse_excitation("sine:frequency=60 Hz,channel=common,bias=1.5 A,amplitude=0.2 A,duration=1 s")
    with pytest.raises(InputError, match=r"at x = 0 it is stable up to 1\.\d+ A on all sides"):
        sealed_record(SERVO, SERVO_TABLE, (), BenchOptions(seed=1, excitations=(strong,)))
    swinging = parse_excitation("sine:frequency=50 Hz,bias=0.8 A,amplitude=0.5 A,duration=1 s")
    with pytest.raises(InputError, match=r"stable up to 1\.\d+ A"):
        sealed_record(SERVO, SERVO_TABLE, (), BenchOptions(seed=1, excitations=(swinging,)))
    volts = parse_excitation("sine:frequency=60 Hz,bias=1 V,amplitude=0.2 V,duration=1 s", unit="V")
    with pytest.raises(InputError, match="the drive of fast_tool_servo takes A"):
        sealed_record(SERVO, SERVO_TABLE, (), BenchOptions(seed=1, excitations=(volts,)))
    ideal = SERVO.model_copy(update={"drive": SERVO.drive.model_copy(update={"bandwidth": None})})
    with pytest.raises(InputError, match=r"drive\.bandwidth is missing"):
        sealed_record(ideal, SERVO_TABLE, (), BenchOptions(seed=1))


def test_the_usual_excitations_are_chosen_by_belief() -> None:
    noise, sweep = usual_excitations(SERVO, SERVO_TABLE, rate=RATE)
    assert (noise.role, sweep.role) == ("fit", "held-out")
    assert noise.bias == sweep.bias == pytest.approx(0.61)
    assert noise.duration == sweep.duration == 4.0
