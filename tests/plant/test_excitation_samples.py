"""Excitations: texts and files read, sides driven as the channel says, nothing clipped in silence."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msl_fem.errors import InputError
from msl_fem.plant.excitation import load_excitations, parse_excitation, reference, samples
from msl_fem.plant.excitation_kinds import KINDS, Excitation

RATE = 10e3
NOISE = "band-limited-noise:channel=independent,band=500 Hz,bias=0.6 A,amplitude=0.2 A,duration=4 s,seed=1"
TEXTS = [
    NOISE,
    "swept-sine:channel=differential,start=5 Hz,stop=150 Hz,amplitude=0.5 A,duration=4 s",
    "swept-sine:start=1 Hz,stop=1 kHz,law=logarithmic,fade=0 s,amplitude=0.5 A,bias=0.5 A,duration=2 s",
    "multisine:start=1 Hz,stop=300 Hz,lines=odd,periods=5,amplitude=30 um,bias=0.3 mm,duration=4 s,seed=3,loop=closed",
    "sine:channel=1,frequency=2 Hz,amplitude=0.3 A,bias=0.5 A,duration=1 s,role=held-out",
    "step:frequency=3 Hz,amplitude=0.4 A,duration=1 s",
    "step:channel=2,amplitude=0.4 A,duration=1 s",
    "ramp:channel=common,frequency=5 Hz,amplitude=0.4 A,bias=1 A,duration=1 s",
    "ramp:channel=common,amplitude=0.4 A,duration=1 s",
]


@pytest.mark.parametrize("text", TEXTS)
def test_an_excitation_writes_itself_as_a_text_that_reads_back(text: str) -> None:
    excitation = parse_excitation(text)
    assert parse_excitation(excitation.spec) == excitation


@given(
    st.sampled_from(["common", "differential", "1", "2"]),
    st.floats(1e-6, 1e3),
    st.floats(0, 1e3),
    st.floats(1e-3, 1e3),
    st.integers(0, 2**40),
)
def test_any_sine_reads_back(channel: str, amplitude: float, bias: float, frequency: float, seed: int) -> None:
    made = KINDS["sine"](
        name="sine", channel=channel, amplitude=amplitude, bias=bias, frequency=frequency, duration=1.0, seed=seed
    )
    again = parse_excitation(made.spec)
    assert again.channel == channel
    assert again.seed == seed
    for key in ("amplitude", "bias", "frequency", "duration"):
        assert getattr(again, key) == pytest.approx(getattr(made, key), rel=1e-15)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("noise:amplitude=1 A", "'noise' is no excitation; there are band-limited-noise, multisine"),
        ("sine", "is missing"),
        ("sine:amplitude=1 A,duration=1 s", "frequency: is missing"),
        ("sine:amplitude=1 A,duration=1 s,frequency=2", "frequency: '2' has no unit"),
        ("sine:amplitude=1 A,duration=1 s,frequency=2 m", "frequency: unit 'm' has the wrong dimension"),
        ("sine:amplitude=1 m,duration=1 s,frequency=2 Hz", "amplitude: unit 'm' has the wrong dimension"),
        ("sine:amplitude=1,duration=1 s,frequency=2 Hz", "amplitude: '1' has no unit"),
        ("sine:amplitude=0 A,duration=1 s,frequency=2 Hz", "amplitude: Input should be greater than 0"),
        ("sine:amplitude=1 A,duration=0 s,frequency=2 Hz", "duration: Input should be greater than 0"),
        ("sine:amplitude=1 A,duration=1 s,frequency=2 Hz,bias=-1 A", "bias: -1 A is below zero"),
        ("sine:amplitude=1 A,duration=1 s,frequency=2 Hz,gain=2", "gain unknown; sine takes amplitude"),
        ("sine:amplitude=1 A,duration=1 s,frequency=2 Hz,unit=m", "unit: unknown key"),
        ("sine:amplitude=1 A,duration=1 s,frequency=2 Hz,channel=3", "channel: "),
        ("sine:amplitude=1 A,duration=1 s,frequency=2 Hz,loop=half", "loop: "),
        ("sine:amplitude=1 A,duration=1 s,frequency=2 Hz,seed=x", "seed: "),
        ("sine:amplitude=1 A,amplitude=1 A", "amplitude is there twice"),
        ("sine:amplitude", "'amplitude' is no key=value"),
        ("sine:amplitude=,duration=1 s", "'amplitude=' is no key=value"),
        ("swept-sine:amplitude=1 A,duration=1 s,start=1 Hz,stop=9 Hz,fade=0.6 s", "fade: 0.6 s is above half"),
        ("swept-sine:amplitude=1 A,duration=1 s,start=0 Hz,stop=9 Hz", "start: "),
        ("missing.toml", "missing.toml: cannot be read"),
    ],
)
def test_a_faulty_text_is_refused_in_one_line(text: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        load_excitations(text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_holds_several(tmp_path: Path) -> None:
    file = tmp_path / "plan.toml"
    file.write_text(
        '[[excitation]]\nname = "sine"\nchannel = 1\nfrequency = "2 Hz"\nbias = "1 A"\namplitude = "1 A"\n'
        'duration = "1 s"\n'
        '[[excitation]]\nname = "multisine"\nstart = "1 Hz"\nstop = "50 Hz"\nperiods = 2\namplitude = "0.1 A"\n'
        'bias = "0.5 A"\nduration = "2 s"\nseed = 7\nrole = "held-out"\n'
    )
    first, second = load_excitations(str(file))
    assert (first.name, first.channel, first.role) == ("sine", "1", "fit")
    assert (second.name, second.seed, second.role) == ("multisine", 7, "held-out")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "excitation: is missing"),
        ("x = 1", "x: unknown key"),
        ("excitation = 3", "excitation: is missing"),
        ('[[excitation]]\nname = "sine"\nfrequency = 2', "excitation.0.frequency: 2 has no unit"),
        ('[[excitation]]\nname = "sine"\nfrequency = "2 Hz"', "excitation.0: amplitude: is missing"),
        ('[[excitation]]\nnam = "sine"', "excitation.0: 'None' is no excitation"),
        ("[[excitation]", "not valid TOML"),
    ],
)
def test_a_faulty_file_is_refused_by_its_key_path(tmp_path: Path, content: str, said: str) -> None:
    (tmp_path / "plan.toml").write_text(content)
    with pytest.raises(InputError) as caught:
        load_excitations(str(tmp_path / "plan.toml"))
    assert str(caught.value).startswith(f"{tmp_path / 'plan.toml'}: ")
    assert said in str(caught.value)


@pytest.mark.parametrize("text", TEXTS)
def test_samples_fill_the_duration_and_repeat_by_seed(text: str) -> None:
    excitation = parse_excitation(text)
    u = samples(excitation, rate=RATE, sides=2)
    assert u.shape == (round(excitation.duration * RATE), 2)
    assert u.dtype == np.float64
    assert u.min() >= 0
    assert np.array_equal(u, samples(excitation, rate=RATE, sides=2))
    other = samples(excitation, rate=RATE, sides=2, generator=np.random.default_rng(99))
    random = excitation.name in ("band-limited-noise", "multisine")
    assert np.array_equal(u, other) != random


def signal_of(excitation: Excitation, rate: float = RATE) -> np.ndarray:
    return excitation.amplitude * excitation.signal(rate, np.random.default_rng(excitation.seed))[0]


def test_channels_drive_their_sides() -> None:
    def u(channel: str, bias: float) -> np.ndarray:
        text = f"sine:channel={channel},frequency=2 Hz,amplitude=0.4 A,bias={bias} A,duration=1 s"
        return samples(parse_excitation(text), rate=RATE, sides=2)

    s = 0.4 * np.sin(2 * np.pi * 2 * np.arange(10_000) / RATE)
    same = {"rtol": 0, "atol": 1e-14}
    np.testing.assert_allclose(u("1", 0.5), np.column_stack([0.5 + s, np.full_like(s, 0.5)]), **same)
    np.testing.assert_allclose(u("2", 0.5), np.column_stack([np.full_like(s, 0.5), 0.5 + s]), **same)
    np.testing.assert_allclose(u("common", 0.5), np.column_stack([0.5 + s, 0.5 + s]), **same)
    np.testing.assert_allclose(u("differential", 0.5), np.column_stack([0.5 + s, 0.5 - s]), **same)
    np.testing.assert_allclose(u("differential", 0.0), np.column_stack([s.clip(0), (-s).clip(0)]), **same)


def test_independent_channels_are_uncorrelated_and_of_the_stated_size() -> None:
    u = samples(parse_excitation(NOISE), rate=RATE, sides=2)
    assert u.mean(axis=0) == pytest.approx([0.6, 0.6], abs=1e-12)
    assert u.std(axis=0) == pytest.approx([0.2, 0.2], rel=1e-9)
    assert abs(np.corrcoef(u.T)[0, 1]) < 4 / np.sqrt(2 * 2000)  # 2000 lines of random phase
    spectrum = np.abs(np.fft.rfft(u[:, 1])) ** 2
    assert spectrum[1:2001].min() > 0.999 * spectrum[1:2001].max()
    assert spectrum[2001:].max() < 1e-20 * spectrum[1]


def test_a_multisine_repeats_its_period_with_the_stated_lines() -> None:
    text = "multisine:start=4 Hz,stop=300 Hz,lines=odd,periods=4,amplitude=0.2 A,bias=0.6 A,duration=4 s"
    u = samples(parse_excitation(text), rate=RATE, sides=2)
    assert np.array_equal(u[:10_000], u[10_000:20_000])
    spectrum = np.abs(np.fft.rfft(u[:10_000, 0]))
    assert np.flatnonzero(spectrum[1:] > 1e-6 * spectrum[5]).tolist() == list(range(4, 299, 2))  # lines 5, 7, ... 299
    assert u[:, 0].std() == pytest.approx(0.2, rel=1e-9)


def test_the_stated_generator_goes_before_the_seed() -> None:
    e = parse_excitation(NOISE)
    u = samples(e, rate=RATE, sides=2, generator=np.random.default_rng(e.seed))
    assert np.array_equal(u, samples(e, rate=RATE, sides=2))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["independent", "common", "differential", "1"]))
def test_a_bias_of_three_rms_keeps_currents_positive_whatever_the_seed(seed: int, channel: str) -> None:
    text = f"band-limited-noise:channel={channel},band=300 Hz,bias=0.6 A,amplitude=0.2 A,duration=0.5 s,seed={seed}"
    u = samples(parse_excitation(text), rate=2500.0, sides=2)
    assert u.min() >= 0
    assert u.max() <= 1.2 + 1e-12


@pytest.mark.parametrize(
    ("text", "largest"),
    [
        (NOISE.replace("amplitude=0.2", "amplitude=0.201"), "at most 200 mA is allowed"),
        ("sine:channel=1,frequency=2 Hz,amplitude=0.51 A,bias=0.5 A,duration=1 s", "at most 500 mA is allowed"),
        ("sine:channel=common,frequency=2 Hz,amplitude=0.1 A,duration=1 s", "at most 0 A is allowed"),
        ("step:channel=1,frequency=3 Hz,amplitude=0.6 A,bias=0.5 A,duration=1 s", "at most 500 mA is allowed"),
        ("ramp:channel=2,frequency=3 Hz,amplitude=0.6 A,bias=0.5 A,duration=1 s", "at most 500 mA is allowed"),
        ("step:channel=differential,amplitude=0.6 A,bias=0.5 A,duration=1 s", "at most 500 mA is allowed"),
    ],
)
def test_a_current_below_zero_is_refused_with_the_largest_amplitude(text: str, largest: str) -> None:
    with pytest.raises(InputError, match=largest):
        samples(parse_excitation(text), rate=RATE, sides=2)


def test_voltages_and_forces_may_be_negative() -> None:
    u = samples(
        parse_excitation("sine:frequency=2 Hz,amplitude=3 V,duration=1 s,channel=1", unit="V"), rate=RATE, sides=2
    )
    assert u[:, 0].min() == pytest.approx(-3.0)
    f = samples(
        parse_excitation("sine:frequency=2 Hz,amplitude=3 N,bias=-9.8 N,duration=1 s", unit="N"), rate=RATE, sides=1
    )
    assert (f.min(), f.max()) == (pytest.approx(-12.8), pytest.approx(-6.8))


@pytest.mark.parametrize(
    ("text", "sides", "rate", "said"),
    [
        ("sine:frequency=2 Hz,amplitude=1 A,duration=1 s,channel=2", 1, RATE, "channel=2 needs two sides"),
        ("sine:frequency=2 Hz,amplitude=1 A,duration=1 s,channel=differential", 1, RATE, "needs two sides"),
        ("sine:frequency=2 Hz,amplitude=1 A,duration=1 s,channel=independent", 2, RATE, "needs a signal with random"),
        ("sine:frequency=2 Hz,amplitude=1 A,duration=1 s", 3, RATE, "an actuator of 3 sides"),
        (
            "sine:frequency=5 kHz,amplitude=1 A,duration=1 s",
            2,
            RATE,
            "5 kHz is not below half",
        ),
        (NOISE, 2, 1000.0, "500 Hz is not below half"),
        (NOISE.replace("4 s", "1 ms"), 2, RATE, "shorter than a period of the band"),
        ("multisine:start=1 Hz,stop=2 Hz,amplitude=1 A,bias=9 A,duration=0.1 s", 2, RATE, "no multiple of 40 Hz"),
        (
            "multisine:start=1 Hz,stop=90 Hz,periods=3,amplitude=1 A,bias=9 A,duration=1 s",
            2,
            RATE,
            "not 3 equal periods",
        ),
        ("sine:frequency=2 Hz,amplitude=1 A,duration=1e6 s", 2, RATE, "shorten the duration"),
    ],
)
def test_what_cannot_be_sampled_is_refused(text: str, sides: int, rate: float, said: str) -> None:
    with pytest.raises(InputError, match=said):
        samples(parse_excitation(text), rate=rate, sides=sides)


def test_references_have_exact_derivatives() -> None:
    w = 2 * np.pi * 2
    r = reference(
        parse_excitation("sine:frequency=2 Hz,amplitude=0.4 mm,bias=-0.1 mm,duration=1 s", unit="m"), rate=2500.0
    )
    assert r.time.size == r.position.size == 2500
    np.testing.assert_allclose(r.position, -1e-4 + 4e-4 * np.sin(w * r.time), atol=1e-15)
    np.testing.assert_allclose(r.velocity, 4e-4 * w * np.cos(w * r.time), atol=1e-14)
    np.testing.assert_allclose(r.acceleration, -4e-4 * w**2 * np.sin(w * r.time), atol=1e-12)


def test_steps_and_ramps_of_the_paper() -> None:
    step = reference(parse_excitation("step:frequency=3 Hz,amplitude=0.2 mm,duration=1 s", unit="m"), rate=2500.0)
    assert set(step.position) == {2e-4, -2e-4}
    assert np.flatnonzero(np.diff(step.position)).size == 5  # three periods have five edges inside
    assert not step.velocity.any()
    ramp = reference(parse_excitation("ramp:frequency=5 Hz,amplitude=0.3 mm,duration=1 s", unit="m"), rate=2500.0)
    assert (ramp.position[0], ramp.position.max()) == (pytest.approx(0, abs=1e-18), pytest.approx(3e-4))
    assert set(np.round(np.abs(ramp.velocity), 12)) == {6e-3}  # 4 f amplitude
    slope = np.diff(ramp.position) * 2500
    assert np.abs(slope - ramp.velocity[:-1]).max() < 1e-12


def test_single_step_and_ramp() -> None:
    step = samples(parse_excitation("step:channel=1,amplitude=2 A,duration=1 s"), rate=1000.0, sides=1)[:, 0]
    assert (step[:100].max(), step[100:].min()) == (0.0, 2.0)
    ramp = samples(parse_excitation("ramp:channel=1,amplitude=2 A,duration=1 s"), rate=1000.0, sides=1)[:, 0]
    assert np.allclose(np.diff(ramp), 2e-3, rtol=1e-9)


def test_a_reference_is_a_position() -> None:
    with pytest.raises(InputError, match="a reference needs one in m"):
        reference(parse_excitation("sine:frequency=2 Hz,amplitude=1 A,duration=1 s"), rate=RATE)


def test_a_spec_states_role_and_loop_only_where_they_are_not_the_usual_ones() -> None:
    """A record states the role of a run itself; a default in the excitation's text would contradict it."""
    plain = parse_excitation("sine:amplitude=0.1 A,frequency=2 Hz,duration=1 s,bias=0.2 A")
    assert "role" not in plain.spec
    assert "loop" not in plain.spec
    held = parse_excitation("sine:amplitude=0.1 mm,frequency=2 Hz,duration=1 s,role=held-out,loop=closed")
    assert "role=held-out" in held.spec
    assert "loop=closed" in held.spec


def test_a_channel_is_a_number_or_a_word(tmp_path) -> None:
    """1 and "1" are the same channel; a seed in quotes is a slip."""
    text = '[[excitation]]\nname = "sine"\nchannel = {}\nfrequency = "5 Hz"\namplitude = "0.1 A"\nduration = "1 s"\n'
    file = tmp_path / "e.toml"
    specs = set()
    for channel in ("1", '"1"'):
        file.write_text(text.format(channel))
        specs.add(load_excitations(str(file))[0].spec)
    assert len(specs) == 1
    noise = '[[excitation]]\nname = "band-limited-noise"\nseed = "3"\namplitude = "0.1 A"\nduration = "1 s"\n'
    file.write_text(noise)
    with pytest.raises(InputError, match="write the number without quotes, seed = 3"):
        load_excitations(str(file))


def csv_of(folder: Path, text: str) -> Path:
    (folder / "pulse.csv").write_text(text)
    return folder / "pulse.csv"


def test_a_csv_file_is_a_signal(tmp_path: Path) -> None:
    """Alone, with a column and a factor, and from a TOML file's folder; straight between rows, held after the last."""
    file = csv_of(tmp_path, "time_s,voltage_1_V,other\n0,1,0\n0.1,3,0\n0.2,-2,5\n")
    with pytest.raises(InputError, match="state which; beside time_s there are voltage_1_V, other"):
        load_excitations(str(file))
    (run,) = load_excitations(f"csv:file={file},column=voltage_1_V,amplitude=2 V,duration=0.3 s", unit="V")
    t = np.arange(3000) / RATE
    wanted = 2 * np.interp(t, [0, 0.1, 0.2], [1, 3, -2])
    np.testing.assert_allclose(samples(run, rate=RATE, sides=1)[:, 0], wanted, rtol=0, atol=1e-12)
    assert parse_excitation(run.spec, unit="V") == run
    (tmp_path / "plan.toml").write_text('[[excitation]]\nname = "csv"\nfile = "pulse.csv"\ncolumn = "other"\n')
    (told,) = load_excitations(str(tmp_path / "plan.toml"), unit="V")
    assert told.file == str(file)
    assert told.duration == 0.2
    csv_of(tmp_path, "x_m,time_s\n0,0\n1e-3,0.1\n1e-3,0.2\n")
    (alone,) = load_excitations(str(file), unit="A")
    path = reference(parse_excitation(f"csv:file={file},loop=closed"), rate=RATE)
    assert samples(alone, rate=RATE, sides=2)[-1].tolist() == [1e-3, 0]
    np.testing.assert_allclose(path.velocity[[1, 999, 1000]], [0.01, 0.01, 0], atol=1e-15)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no column time_s"),
        ("t,u\n0,1\n1,1\n", "no column time_s"),
        ("time_s\n0\n1\n", "there are none"),
        ("time_s,u\n0,1\n", "has 1 rows"),
        ("time_s,u\n0,1\n1\n", "line 3: '1' has no finite numbers"),
        ("time_s,u\n0,1\n1,nan\n", "line 3: '1,nan' has no finite numbers"),
        ("time_s,u\n0,1\n1,1\n1,2\n", "line 4: time_s must begin at 0 or later and increase"),
        ("time_s,u\n0,1\n1e-320,2\n1,1\n", "line 3: time_s must begin at 0 or later and increase"),
        ("time_s,u\n-1,1\n1,1\n", "line 2: time_s must begin at 0"),
        ("time_s,u\n0,1\n1,-1\n", "would make currents negative"),
    ],
)
def test_a_faulty_csv_file_is_refused(tmp_path: Path, text: str, said: str) -> None:
    file = csv_of(tmp_path, text)
    with pytest.raises(InputError) as caught:
        samples(load_excitations(f"csv:file={file},channel=1")[0], rate=RATE, sides=1)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
