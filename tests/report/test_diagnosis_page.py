"""The report of a diagnosis: what it says follows from the record it shows, in words an engineer acts on."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from devtools import Browser

from msl_fem.actuator import Actuator
from msl_fem.diagnosis.estimates import Estimate
from msl_fem.diagnosis.kind import PredictionError, Size
from msl_fem.diagnosis.likelihood import NO_NOISE
from msl_fem.diagnosis.null import NullDistribution
from msl_fem.diagnosis.result import Accuracy, Cause, ChannelResiduals, Diagnosis, Evidence, TriedVariant, Unexplained
from msl_fem.plant.effects import CATALOGUE
from msl_fem.record import Noise, Record, Run, Sampling
from msl_fem.report.diagnosis_figures import amplitude_density, envelope, gain_figure, over_frequency, over_variables
from msl_fem.report.diagnosis_page import diagnosis_page
from msl_fem.report.diagnosis_words import (
    amount_text,
    by_chance_text,
    gain_sentence,
    next_steps,
    verdict_sentence,
)
from msl_fem.report.page import Page, write_page

RATE, SIGMA, SAMPLES = 1e4, 50e-9, 8000


def residuals(role: str = "held-out") -> ChannelResiduals:
    """A 60 Hz residual of 1 um, of which what was found leaves the noise."""
    generator = np.random.default_rng(5)
    noise = generator.normal(0, SIGMA, SAMPLES)
    tone = np.sqrt(2) * 1e-6 * np.sin(2 * np.pi * 60 * np.arange(SAMPLES) / RATE)
    return ChannelResiduals("sweep", role, "position_m", RATE, SIGMA, 3 * tone + noise, tone + noise, noise)


def followed(rms: float, role: str = "held-out") -> PredictionError:
    return PredictionError("sweep", role, "position_m", rms, rms / 1e-5, SIGMA, SAMPLES, 1e-5)


@pytest.fixture
def named() -> Diagnosis:
    estimate = Estimate(9.44e-5, 9.42e-5, 9.46e-5)
    cause = Cause("time_delay", {"command": estimate}, 17789.7, None, 87610.0)
    left = residuals()
    tried = (
        TriedVariant(1, "time_delay", "time_delay (command)", 6525.4, 17789.7, True),
        TriedVariant(1, "coil_heating", "coil_heating (initial_rise)", -1.5, None, False),
    )
    variables = {"sweep": {"position_m": left.nominal, "current_1_A": np.linspace(0.4, 0.6, SAMPLES)}}
    evidence = Evidence(tried, (left,), variables, (Size("time_delay", "sweep", "position_m", 0.0325, 4.3e-7),))
    return Diagnosis(
        "named", "residuals are at most 1.01 of the noise (position_m)", (cause,),
        accuracy=(Accuracy(followed(5e-6), followed(1e-6), followed(5.1e-8)),),
        parameters={"moving_mass": Estimate(0.918, 0.91, 0.926, believed=0.9, tolerances=4.0 + 1e-9),
                    "stiffness": Estimate(1.4e5, 1.36e5, 1.44e5, believed=1.4e5, tolerances=0.0)},
        threshold=5.0, evidence=evidence,
    )  # fmt: skip


@pytest.fixture
def record(servo: Actuator) -> Record:
    columns = {"time_s": np.arange(1000) / RATE, "position_m": np.zeros(1000)}
    run = Run("sweep", "swept sine", "held-out", columns)
    return Record("simulated", servo, sampling=Sampling(rate=RATE), noise=Noise(position=SIGMA), runs=(run,))


def texts(page: Page) -> str:
    found = [page.title, page.subtitle, *page.notes, *(t for pair in page.headline for t in pair)]
    for stage in page.stages:
        found += [stage.title, stage.sentence, *(t for pair in stage.numbers for t in pair)]
        found += [cell for row in stage.table.rows for cell in row] if stage.table else []
    return "\n".join(found)


def test_the_first_page_says_what_how_sure_how_much_better_and_what_next(record: Record, named: Diagnosis) -> None:
    page = diagnosis_page(record, named)
    assert [s.title for s in page.stages][:4] == ["What", "How sure", "How much better", "What to do next"]
    assert page.headline[0][0] == "time delay"
    said = texts(page)
    assert "94.4 µs (94.2 µs ... 94.6 µs)" in said
    assert "3.25 % of position (430 nm RMS, sweep)" in said
    assert "100 → 20 → 1.02" in said
    assert "17\u202f790 nats" in said
    assert "no surrogates were made" in said
    assert CATALOGUE["time_delay"].advice in said
    assert "moving mass is +4 of its tolerances off" in said
    assert "stiffness is" not in said


def test_what_is_louder_than_noise_is_not_called_nothing(named: Diagnosis) -> None:
    note = f"position: from 9.61 to 19.2 Hz 3.9 times the noise is left, {NO_NOISE}"
    assert "nothing is left that differs from the noise" in verdict_sentence(named)
    said = verdict_sentence(replace(named, notes=("a table of one's own", note, note)))
    assert "nothing" not in said
    assert "at some frequencies of position more is left" in said


@pytest.mark.parametrize("verdict", ["nothing-found", "unexplained", "named-and-unexplained", "undecidable"])
def test_a_verdict_without_a_full_answer_does_not_sound_like_one(
    record: Record, named: Diagnosis, verdict: str
) -> None:
    causes = named.causes if verdict == "named-and-unexplained" else ()
    left = Unexplained(0.37, ("velocity",), "force") if "unexplained" in verdict else Unexplained(0.0)
    found = replace(named, verdict=verdict, causes=causes, unexplained=left)
    if verdict == "undecidable":
        found = Diagnosis("undecidable", "no run is held out, so no gain could be shown")
    said = texts(diagnosis_page(record, found))
    assert ("time delay" in diagnosis_page(record, found).headline[0][0]) == bool(causes)
    if "unexplained" in verdict:
        assert "37 %" in said
        assert "depends on velocity" in said
        assert "noise." not in verdict_sentence(found)
    if verdict == "undecidable":
        assert "cannot decide: no run is held out" in said
        assert "extended_model.toml" not in said
    if verdict == "nothing-found":
        assert "down to the noise" in said
        assert "with what was found" not in said


def test_a_gain_that_re_fitting_alone_makes_is_not_claimed(named: Diagnosis) -> None:
    alike = replace(named, accuracy=(Accuracy(followed(5e-6), followed(5.2e-8), followed(5.1e-8)),))
    assert "Re-fitting alone does as well" in gain_sentence(alike)
    assert "Re-fitting alone" not in gain_sentence(named)
    assert "no merit" in gain_sentence(named)


def test_rivals_are_a_set_and_their_experiment_stands_among_the_next_steps(named: Diagnosis) -> None:
    cause = replace(named.causes[0], rivals=("amplifier_bandwidth",), next_experiment="a wider band: simulate ...")
    steps = dict(next_steps(replace(named, causes=(cause,))))
    assert steps["to tell time delay from amplifier bandwidth"] == "a wider band: simulate ..."


def test_what_chance_brings_is_told(named: Diagnosis) -> None:
    by_chance = NullDistribution(np.linspace(-1.0, 3.0, 201))
    assert by_chance_text(replace(named, null=by_chance)).startswith("1 nats in half, 2.96 nats in 99 of 100 of 201")
    assert by_chance_text(replace(named, null=NullDistribution())) == "no surrogates were made"


@pytest.mark.parametrize(
    ("effect", "name", "value", "text"),
    [
        ("time_delay", "command", 9.44e-5, "94.4 µs"),
        ("fringing", "depth_error", 0.0123, "1.23 %"),
        ("fringing", "growth", 1234.0, "1.23e+03 m^-1"),
        ("armature_tilt", "gap_variance", 4.1e-10, "4.1e-10 m^2"),
        ("squeeze_film", "damping", 0.0052, "5.2 mN s/m"),
        ("structural_mode", "damping_ratio", 0.015, "0.015"),
    ],
)
def test_parameters_bear_prefixes_only_where_these_are_right(effect: str, name: str, value: float, text: str) -> None:
    """A prefix belongs to the unit with its power: 1 km^-2 is no 1000 m^-2."""
    assert amount_text(effect, name, value) == text


def test_the_spectrum_of_white_noise_is_its_sigma_over_the_root_of_half_the_rate() -> None:
    f, density = amplitude_density(np.random.default_rng(3).normal(0, 2.0, 80000), RATE)
    assert np.sqrt(np.mean(density[f > 100] ** 2)) == pytest.approx(2.0 * np.sqrt(2 / RATE), rel=0.03)
    assert (np.diff(f) > 0).all()


def test_the_figures_show_the_peak_and_what_is_left() -> None:
    left = residuals()
    before, after, noise = over_frequency(left, named=True).data
    assert before.x[int(np.argmax(before.y))] == pytest.approx(60, abs=RATE / 4096 + 5)
    assert np.median(np.asarray(after.y) / noise.y[0]) == pytest.approx(1.0, rel=0.1)
    assert len(over_frequency(left, named=False).data) == 2
    shown = over_variables(left, {"position_m": left.refitted}, named=True)
    assert max(shown.data[0].y) > 10 * max(shown.data[1].y)


def test_the_noise_that_the_fit_took_is_drawn_beside_the_stated_one() -> None:
    """Where the noise is coloured, the white line alone would show a residual far above 'the noise'."""
    edges, density = np.array([0.0, 50.0, 100.0, 5000.0]), np.array([100.0, 4.0, 1.0])
    steps = over_frequency(residuals(), (edges, density), named=True).data[-1]
    white = SIGMA * 1e6 * np.sqrt(2 / RATE)
    assert np.interp(75.0, steps.x, steps.y) == pytest.approx(2 * white, rel=1e-5)
    assert steps.y[0] == pytest.approx(10 * white, rel=1e-5)
    assert steps.y[-1] == pytest.approx(white, rel=1e-5)
    assert max(steps.x) == 5000.0


def test_what_is_not_told_apart_is_no_headline_of_one_name(record: Record, named: Diagnosis) -> None:
    cause = replace(named.causes[0], rivals=("amplifier_bandwidth",), next_experiment="a wider band")
    page = diagnosis_page(record, replace(named, causes=(cause,)))
    assert page.headline[0] == ("time delay or amplifier bandwidth", "not told apart by this record")
    assert "time delay or amplifier bandwidth, which this record does not tell apart" in page.subtitle
    assert "With it in the model" not in page.subtitle


def test_an_envelope_keeps_the_extremes() -> None:
    time, values = np.arange(50000) / RATE, np.zeros(50000)
    values[31415], values[27182] = 7.0, -8.0
    t, shown = envelope(time, values)
    assert t.size < 1500
    assert (shown.max(), shown.min()) == (7.0, -8.0)
    assert t[np.argmax(shown)] == time[31415]
    assert (np.diff(t) >= 0).all()


def test_a_model_that_left_its_table_is_drawn_as_no_dot() -> None:
    made = gain_figure([Accuracy(followed(float("inf")), followed(1e-6), followed(5e-8))], named=True)
    assert np.isnan(made.data[0].x[0])
    assert made.data[1].x[0] == pytest.approx(20)


def test_names_from_a_record_cannot_become_markup(
    record: Record, named: Diagnosis, page_file: Path, browser: Browser
) -> None:
    evil = "<img src=x onerror=document.title='broken'>"
    left = replace(residuals(), run=evil)
    accuracy = tuple(
        replace(a, nominal=replace(a.nominal, run=evil), refitted=replace(a.refitted, run=evil)) for a in named.accuracy
    )
    evidence = replace(named.evidence, residuals=(left,), variables={evil: {"position_m": left.nominal}})
    found = replace(named, accuracy=accuracy, notes=(evil,), evidence=evidence)
    browser.open(write_page(diagnosis_page(record, found), page_file))
    assert browser.run("document.title") == "fast_tool_servo: what the model gets wrong"
    assert browser.run("document.images.length") == 0
    assert not [a for a in browser.requests if not a.startswith(("file:", "data:", "blob:"))]
    drawn = browser.run("document.querySelectorAll('.plotly-graph-div .main-svg').length")
    assert drawn >= 5
