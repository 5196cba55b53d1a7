"""Free run and k-step prediction against plain loops; divergence is said, not returned."""

import json
from dataclasses import replace

import numpy as np
import pytest
from armax_plants import CASES
from magnet_rig import DELTA, NOMINAL_GAP, magnet_run

from msl_fem.errors import InputError
from msl_fem.identification import (
    ArmaxOrders,
    RationalInputs,
    fit_armax,
    fit_figures,
    fit_percent,
    identify_rational,
    model_from_json,
    predict,
    prediction_residuals,
    rational_term,
    simulate_armax,
)
from msl_fem.identification.prediction_error import Polynomials


@pytest.fixture(scope="module")
def oversampled():
    run, _ = CASES[3].run(20_000, np.random.default_rng(21))
    return run, fit_armax([run], CASES[3].orders)


@pytest.fixture(scope="module")
def magnet():
    run = magnet_run(8_000, np.random.default_rng(22))
    terms = (rational_term("i1^2/g1^2"), rational_term("i2^2/g2^2"))
    model = identify_rational(
        [run], ArmaxOrders(2, 2, 2, 1, offset=True), rational=RationalInputs(terms, NOMINAL_GAP, DELTA)
    )
    return run, model


def test_linear_free_run_is_the_recursion(oversampled):
    run, model = oversampled
    a, b = model.polynomials.a, model.polynomials.b
    u = list(run.inputs.values())
    y = run.output[:500].copy()
    for t in range(2, 500):
        y[t] = -a[1] * y[t - 1] - a[2] * y[t - 2]
        y[t] += sum(b[k][0] * u[k][t - 1] + b[k][1] * u[k][t - 2] for k in range(4))
    free = simulate_armax(model, run, initial="measured")
    assert free.first == 2
    np.testing.assert_allclose(free.output[:500], y, rtol=1e-9, atol=1e-12 * np.abs(y).max())


def test_rational_free_run_uses_its_own_position(magnet):
    """The gaps of the terms come from the simulated position, sample by sample."""
    run, model = magnet
    a, b, g = model.polynomials.a, model.polynomials.b, NOMINAL_GAP + model.rational.delta
    i1, i2 = run.inputs["i1"], run.inputs["i2"]
    x = run.output[:400].copy()
    u = np.zeros((2, 400))
    for t in range(400):
        if t >= 2:
            x[t] = model.polynomials.offset - a[1] * x[t - 1] - a[2] * x[t - 2]
            x[t] += sum(b[k][0] * u[k, t - 1] + b[k][1] * u[k, t - 2] for k in range(2))
        u[:, t] = (i1[t] / (g - x[t])) ** 2, (i2[t] / (g + x[t])) ** 2
    free = simulate_armax(model, run, initial="measured")
    np.testing.assert_allclose(free.output[:400], x, rtol=1e-9, atol=1e-15)


def test_estimated_start_beats_noisy_samples():
    """Two noisy samples give an oversampled mode a wrong speed; the estimated start does not."""
    sensor_noise = replace(CASES[3], c=CASES[3].a, noise_ratio=0.1)
    run, _ = sensor_noise.run(20_000, np.random.default_rng(21))
    model = fit_armax([run], sensor_noise.orders)
    fits = {"estimated": [], "measured": []}
    for first in range(0, 16_000, 4_000):
        part = slice(first, first + 4_000)
        later = replace(run, output=run.output[part], inputs={k: u[part] for k, u in run.inputs.items()})
        for initial, values in fits.items():
            values.append(fit_percent(later.output, simulate_armax(model, later, initial=initial).output))
    assert min(fits["estimated"]) > 85.0
    assert np.mean(fits["measured"]) < 78.0, fits


def test_inputs_are_left_alone(magnet):
    run, model = magnet
    before = [run.output.copy(), *(channel.copy() for channel in run.inputs.values())]
    simulate_armax(model, run)
    for old, new in zip(before, [run.output, *run.inputs.values()], strict=True):
        np.testing.assert_array_equal(old, new)


def test_an_unstable_free_run_says_where_it_left():
    run, _ = CASES[2].run(5_000, np.random.default_rng(0))
    model = fit_armax([run], CASES[2].orders)
    free = simulate_armax(model, run)
    assert 20 < free.diverged_at < 2_000
    assert "span" in free.reason
    assert np.isfinite(free.output[: free.diverged_at]).all()
    assert np.isnan(free.output[free.diverged_at :]).all()
    (fit,) = fit_figures(model, [run])
    assert fit.free_run is None
    assert fit.diverged_at == free.diverged_at
    assert fit.one_step > 50.0


def test_a_closed_gap_says_where(magnet):
    """With ten times the magnets' strength the armature is pulled onto a pole face."""
    run, model = magnet
    strong = replace(model.polynomials, b=tuple(10.0 * b for b in model.polynomials.b))
    free = simulate_armax(replace(model, polynomials=strong), run)
    assert free.reason == "a gap closed"
    assert np.isnan(free.output[free.diverged_at :]).all()
    assert np.isfinite(free.output[: free.diverged_at]).all()


@pytest.mark.parametrize("case", [CASES[0], CASES[2]], ids=lambda case: case.name)
@pytest.mark.parametrize("horizon", [1, 2, 7])
def test_prediction_is_the_recursion_with_future_errors_zero(case, horizon):
    run, _ = case.run(800, np.random.default_rng(31))
    model = fit_armax([run], case.orders)
    a, b, c = model.polynomials.a, model.polynomials.b, model.polynomials.c
    predicted = predict(model, run, horizon)
    e, u, y = prediction_residuals(model, run), list(run.inputs.values()), run.output
    assert np.isnan(predicted[: 2 + horizon - 1]).all()
    assert np.isfinite(predicted[2 + horizon - 1 :]).all()
    for origin in (50, 400):  # the last known sample; 50 lets the first errors fade
        past_y, past_e = list(y[: origin + 1]), list(np.nan_to_num(e[: origin + 1]))
        for t in range(origin + 1, origin + horizon + 1):
            value = -a[1] * past_y[-1] - a[2] * past_y[-2] + c[1] * past_e[-1] + c[2] * past_e[-2]
            value += sum(b[k][0] * u[k][t - 1] + b[k][1] * u[k][t - 2] for k in range(len(u)))
            past_y.append(value)
            past_e.append(0.0)
        assert predicted[origin + horizon] == pytest.approx(past_y[-1], rel=1e-9, abs=1e-9)


def test_fit_percent():
    y = np.array([0.0, 1.0, 2.0, 3.0])
    assert fit_percent(y, y) == 100.0
    assert fit_percent(y, np.full(4, 1.5)) == pytest.approx(0.0)
    assert fit_percent(y, np.array([np.nan, 1.0, 2.0, 3.0])) == 100.0


def test_a_run_that_does_not_fit_the_model(oversampled):
    run, model = oversampled
    with pytest.raises(InputError, match="lacks the model's input"):
        simulate_armax(model, replace(run, inputs={"u1": run.inputs["u1"]}))
    with pytest.raises(InputError, match="sampled every"):
        predict(model, replace(run, sampling_period=1e-3))
    with pytest.raises(InputError, match="horizon 0"):
        predict(model, run, 0)
    with pytest.raises(InputError, match="initial"):
        simulate_armax(model, run, initial="guessed")


def test_extra_channels_and_another_order_do_not_matter(oversampled):
    run, model = oversampled
    shuffled = replace(run, inputs={"other": run.output, **dict(reversed(list(run.inputs.items())))})
    np.testing.assert_array_equal(predict(model, run), predict(model, shuffled))


def test_a_model_survives_json(magnet, oversampled):
    for run, model in (magnet, oversampled):
        document = json.loads(json.dumps(model.to_json(), allow_nan=False))
        again = model_from_json(document)
        np.testing.assert_array_equal(again.parameters, model.parameters)
        np.testing.assert_array_equal(again.covariance, model.covariance)
        assert again.convergence == model.convergence
        assert again.rational == model.rational
        assert again.orders == model.orders
        np.testing.assert_array_equal(simulate_armax(again, run).output, simulate_armax(model, run).output)
        first = document["parameters"]["a1"]
        assert first == {"value": model.polynomials.a[1], "standard_error": model.standard_errors[0]}


def test_a_document_that_is_no_model(oversampled):
    document = oversampled[1].to_json()
    with pytest.raises(InputError, match="kind 'arx'"):
        model_from_json({**document, "kind": "arx"})
    with pytest.raises(InputError, match="'covariance'"):
        model_from_json({key: value for key, value in document.items() if key != "covariance"})
    with pytest.raises(InputError, match="wrong kind"):
        model_from_json({**document, "a": "many"})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"a": []}, "a must be"),
        ({"a": 3.0}, "a must be"),
        ({"sampling_period_s": 0.0}, "sampling_period_s is 0.0, it must be positive"),
        ({"covariance": [[1.0]]}, "covariance must be"),
        ({"inputs": [[1], [2], [3], [4]]}, "no different names"),
        ({"parameters": {"a1": {}}}, "parameters must be a1"),
        ({"noise_variance": -1.0}, "noise_variance is -1.0"),
        ({"input_slopes": [1.0, 2.0, 3.0, 4.0, 5.0]}, "input_slopes are 5 numbers"),
        ({"orders": {"na": 2, "nb": [1] * 4, "nc": 2, "nk": [1] * 4, "offset": [True]}}, "offset is \\[True\\]"),
        ({"orders": {"na": 500, "nb": [2], "nc": 2, "nk": [1], "offset": False}}, "500|is for 1 inputs"),
    ],
)
def test_a_document_that_contradicts_itself(oversampled, change, said):
    with pytest.raises(InputError, match=said) as refused:
        model_from_json({**oversampled[1].to_json(), **change})
    assert "identify it anew" in str(refused.value)


def test_polynomials_are_plain(oversampled):
    polynomials = oversampled[1].polynomials
    assert isinstance(polynomials, Polynomials)
    assert polynomials.a[0] == polynomials.c[0] == 1.0
    assert [b.shape for b in polynomials.b] == [(2,)] * 4
