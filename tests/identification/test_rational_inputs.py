"""Rational terms, the gap offset, and a magnet rig simulated in continuous time and identified."""

from dataclasses import replace

import numpy as np
import pytest
from armax_plants import mode_polynomial
from magnet_rig import DAMPING, DELTA, MASS, NOMINAL_GAP, SAMPLING_PERIOD, STIFFNESS, STRENGTH, magnet_run

from msl_fem.errors import InputError
from msl_fem.identification import (
    ArmaxOrders,
    DeltaSearch,
    OscillatorPrior,
    RationalInputs,
    RationalTerm,
    fit_figures,
    identify_rational,
    predict,
    rational_term,
)
from msl_fem.identification.search import prior_starts

TERMS = (rational_term("i1^2/g1^2"), rational_term("i2^2/g2^2"))
ORDERS = ArmaxOrders(2, 2, 2, 1)
NOISE = 50e-9
FREQUENCY = np.sqrt(STIFFNESS / MASS) / (2 * np.pi)
RATIO = DAMPING / (2 * np.sqrt(STIFFNESS * MASS))


@pytest.fixture(scope="module")
def run():
    return magnet_run(20_000, np.random.default_rng(11), noise=NOISE)


@pytest.fixture(scope="module")
def model(run):
    return identify_rational([run], ORDERS, rational=RationalInputs(TERMS, NOMINAL_GAP), search=DeltaSearch())


@pytest.mark.parametrize(
    ("text", "term"),
    [
        ("i1^2/g1^2", RationalTerm(1, 2, 2)),
        ("i2/g2", RationalTerm(2, 1, 1)),
        (" i1 ^ 2 / (g1)^3 ", RationalTerm(1, 2, 3)),
        ("i2^2", RationalTerm(2, 2, 0)),
    ],
)
def test_a_term_is_read_and_written(text, term):
    assert rational_term(text) == term
    assert rational_term(str(term)) == term


@pytest.mark.parametrize("text", ["i3/g3", "i1^2/g2^2", "i1+i2", "g1", "", "i1^-1"])
def test_a_text_that_is_no_term(text):
    with pytest.raises(InputError):
        rational_term(text)


def test_terms_at_the_measured_position(run):
    """Side 1's gap shrinks with x, side 2's grows; no sign is built in; a plain channel stays as it is."""
    force = np.arange(run.n_samples, dtype=float)
    with_force = replace(run, inputs={**run.inputs, "force": force})
    inputs = RationalInputs(TERMS, NOMINAL_GAP, 1e-5, ("force",)).evaluated(with_force).inputs
    x, i2 = run.output[100], run.inputs["i2"][100]
    assert list(inputs) == ["i1^2/g1^2", "i2^2/g2^2", "force"]
    assert inputs["i1^2/g1^2"][100] == pytest.approx((run.inputs["i1"][100] / (NOMINAL_GAP - x + 1e-5)) ** 2)
    assert inputs["i2^2/g2^2"][100] == pytest.approx((i2 / (NOMINAL_GAP + x + 1e-5)) ** 2)
    np.testing.assert_array_equal(inputs["force"], force)


def test_delta_derivatives_pass_a_taylor_test(run):
    rational = RationalInputs((*TERMS, rational_term("i1/g1")), NOMINAL_GAP, 1e-5)
    slope = rational.delta_derivatives(run)

    def values(delta):
        return np.vstack(list(rational.with_delta(delta).evaluated(run).inputs.values()))

    steps = 2e-5 * 0.5 ** np.arange(4)
    remainders = [np.abs(values(1e-5 + h) - values(1e-5) - h * slope).max() for h in steps]
    np.testing.assert_allclose(np.diff(np.log(remainders)) / np.log(0.5), 2.0, atol=0.15)


def test_delta_is_recovered(model):
    """40 um of 600 um, within its interval and the half-sample's worth of the zero-order hold; error below 1.5 um."""
    assert model.convergence.converged
    assert model.rational.delta == pytest.approx(DELTA, abs=1.5e-6)
    assert 1e-7 < model.delta_standard_error < 1e-6
    assert model.parameter_names[-1] == "delta"
    assert model.parameters[-1] == model.rational.delta


def test_mass_stiffness_and_forces_are_recovered(model):
    """Natural frequency from A within 0.2 %, strengths from the static gain, and the noise is the sensor's."""
    pole = np.log(np.roots(model.polynomials.a)[0]) / SAMPLING_PERIOD
    assert abs(pole) == pytest.approx(np.sqrt(STIFFNESS / MASS), rel=2e-3)
    gains = [b.sum() / model.polynomials.a.sum() * STIFFNESS for b in model.polynomials.b]
    np.testing.assert_allclose(gains, [STRENGTH[0], -STRENGTH[1]], rtol=0.015)
    assert np.sqrt(model.noise_variance) == pytest.approx(NOISE, rel=0.06)


def test_delta_is_the_minimum_of_the_profile(run, model):
    """The objective at delta plus and minus two standard errors is higher, by about 2 in the log likelihood."""
    costs = []
    for shift in (-2.0, 0.0, 2.0):
        delta = model.rational.delta + shift * model.delta_standard_error
        fixed = identify_rational([run], ORDERS, rational=RationalInputs(TERMS, NOMINAL_GAP, delta))
        costs.append(0.5 * run.n_samples * np.log(fixed.convergence.costs[-1]))
    np.testing.assert_allclose([costs[0] - costs[1], costs[2] - costs[1]], 2.0, atol=0.3)


def test_free_run_on_a_signal_it_has_not_seen(model):
    """A sine instead of noise, simulated position in the gaps: better than 99 %."""
    sine = magnet_run(10_000, np.random.default_rng(12), frequency=30.0, name="sine")
    (fit,) = fit_figures(model, [sine])
    assert fit.diverged_at is None
    assert fit.free_run > 99.0
    assert fit.one_step > 99.0


def test_an_offset_and_a_plain_input_beside_the_terms(run):
    rng = np.random.default_rng(2)
    idle = replace(run, inputs={**run.inputs, "force": rng.standard_normal(run.n_samples)})
    rational = RationalInputs(TERMS, NOMINAL_GAP, DELTA, ("force",))
    model = identify_rational([idle], replace(ORDERS, offset=True), rational=rational)
    assert model.input_names == ("i1^2/g1^2", "i2^2/g2^2", "force")
    force = model.polynomials.b[2]
    error = model.standard_errors[[model.parameter_names.index(f"b[force][{lag}]") for lag in (1, 2)]]
    assert np.all(np.abs(force) < 4.0 * error)


def test_prior_start_knows_the_magnets_strength(run):
    """With A from mass, damping and stiffness, least squares alone finds both strengths to 3 %."""
    evaluated = RationalInputs(TERMS, NOMINAL_GAP, DELTA).evaluated(run)
    starts = prior_starts(
        [evaluated.signals],
        ORDERS.for_inputs(2),
        OscillatorPrior(MASS, DAMPING, STIFFNESS),
        sampling_period=SAMPLING_PERIOD,
        names=list(evaluated.inputs),
    )
    assert [start.name for start in starts] == ["prior, white force", "prior, white sensor noise"]
    for start in starts:
        gains = [b.sum() / start.polynomials.a.sum() * STIFFNESS for b in start.polynomials.b]
        np.testing.assert_allclose(gains, [STRENGTH[0], -STRENGTH[1]], rtol=0.03)


def test_prior_with_a_known_gain_is_the_discretised_oscillator(run):
    """B of an input whose gain is known stays: with a unit force, x settles at 1/k."""
    force = replace(run, inputs={"force": np.random.default_rng(0).standard_normal(run.n_samples)})
    start, _ = prior_starts(
        [force.signals],
        ORDERS.for_inputs(1),
        OscillatorPrior(MASS, DAMPING, STIFFNESS, {"force": 1.0}),
        sampling_period=SAMPLING_PERIOD,
        names=["force"],
    )
    assert start.polynomials.b[0].sum() / start.polynomials.a.sum() == pytest.approx(1 / STIFFNESS, rel=1e-6)
    np.testing.assert_allclose(start.polynomials.a, mode_polynomial(FREQUENCY, RATIO, SAMPLING_PERIOD), rtol=1e-9)


def test_a_bound_that_holds_delta_is_named(run):
    search = DeltaSearch(bounds=(0.0, 20e-6))
    model = identify_rational([run], ORDERS, rational=RationalInputs(TERMS, NOMINAL_GAP), search=search)
    assert model.rational.delta == pytest.approx(20e-6)
    assert any("bound" in note for note in model.notes)


def test_small_motion_says_that_inputs_are_nearly_collinear():
    """i^2 and i^2/g^2 are the same input when the gap hardly moves."""
    run = magnet_run(5_000, np.random.default_rng(3), amplitude=0.0005)
    terms = (*TERMS, rational_term("i1^2/g1"))
    model = identify_rational([run], ORDERS, rational=RationalInputs(terms, NOMINAL_GAP, DELTA))
    assert model.input_condition_number > 1e4
    assert any("nearly collinear" in note for note in model.notes)


def test_predictions_take_the_measured_gap(run, model):
    missed = predict(model, run, 10) - run.output
    assert np.isnan(missed[:11]).all()
    assert np.nanstd(missed) < 0.05 * run.output.std()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rational": RationalInputs(TERMS, 0.05e-3)}, "gap of side"),
        ({"rational": RationalInputs(TERMS, NOMINAL_GAP, plain=("force",))}, "no channel 'force'"),
        ({"orders": ArmaxOrders(2, 2, 2, 0)}, "nk = 0"),
        ({"search": DeltaSearch(bounds=(-1e-3, 0.0))}, "would close the smallest measured gap"),
        ({"search": DeltaSearch(bounds=(1e-4, 0.0))}, "the first must be the smaller"),
    ],
)
def test_what_cannot_be_identified(run, change, words):
    settings = {"orders": ORDERS, "rational": RationalInputs(TERMS, NOMINAL_GAP), "search": None, **change}
    with pytest.raises(InputError, match=words):
        identify_rational([run], settings["orders"], rational=settings["rational"], search=settings["search"])


@pytest.mark.parametrize("gap", [0.0, -1e-3, np.nan])
def test_a_nominal_gap_that_is_none(gap):
    with pytest.raises(InputError, match="nominal gap"):
        RationalInputs(TERMS, gap)
