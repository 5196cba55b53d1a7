"""What the user can get wrong: one clear message each, with the name and the way out."""

from dataclasses import replace

import numpy as np
import pytest

from msl_fem.errors import InputError
from msl_fem.identification import ArmaxOrders, OscillatorPrior, SampledRun, fit_armax

ORDERS = ArmaxOrders(2, 2, 2, 1)


@pytest.fixture
def run():
    rng = np.random.default_rng(0)
    u, v, y = rng.standard_normal((3, 500))
    return SampledRun(y, {"u": u, "v": v}, 1e-3, name="first")


def refusal(runs, orders=ORDERS, **options):
    with pytest.raises(InputError) as caught:
        fit_armax(runs, orders, **options)
    return str(caught.value)


def test_no_run():
    assert "at least one run" in refusal([])


def test_too_few_samples(run):
    short = replace(run, output=run.output[:60], inputs={k: v[:60] for k, v in run.inputs.items()})
    message = refusal([short])
    assert "too few samples" in message
    assert "'first'" in message
    assert "lower the orders" in message


def test_lengths_differ(run):
    message = refusal([replace(run, inputs={**run.inputs, "v": run.inputs["v"][:-1]})])
    assert "'v' has 499 samples but 'output' has 500" in message


def test_not_a_number(run):
    y = run.output.copy()
    y[17] = np.nan
    assert "'output' is not finite at sample 17" in refusal([replace(run, output=y)])


@pytest.mark.parametrize("name", ["u", "v"])
def test_constant_input(run, name):
    message = refusal([replace(run, inputs={**run.inputs, name: np.full(500, 0.3)})])
    assert f"input {name!r} is constant (0.3)" in message
    assert "offset=True" in message


def test_constant_output(run):
    assert "output 'output' is constant" in refusal([replace(run, output=np.zeros(500))])


def test_identical_inputs(run):
    message = refusal([replace(run, inputs={**run.inputs, "w": run.inputs["u"]})])
    assert "the inputs 'u', 'w' are linearly dependent" in message
    assert "'v'" not in message


def test_collinear_inputs(run):
    mixed = run.inputs["u"] - 2.0 * run.inputs["v"]
    assert "'u', 'v', 'w'" in refusal([replace(run, inputs={**run.inputs, "w": mixed})])


def test_sum_of_inputs_is_the_offset(run):
    message = refusal([replace(run, inputs={**run.inputs, "v": 1.0 - run.inputs["u"]})], replace(ORDERS, offset=True))
    assert "'u', 'v', 'offset'" in message


def test_one_sine_cannot_excite_four_coefficients(run):
    sine = np.sin(0.3 * np.arange(500))
    message = refusal([replace(run, inputs={"u": sine})], ArmaxOrders(2, 4, 2, 1))
    assert "'u' does not excite" in message
    assert "lower nb" in message


def test_feedback_without_excitation(run):
    y = run.output
    u = 0.5 * np.concatenate([[0.0], y[:-1]])
    message = refusal([replace(run, inputs={"u": u})], ArmaxOrders(2, 1, 0, 0))
    assert "'u' is a linear function of past outputs" in message
    assert "external excitation" in message


def test_other_inputs_in_another_run(run):
    other = replace(run, name="second", inputs={"u": run.inputs["u"]})
    assert "run 'second' has the inputs u but run 'first' has u, v" in refusal([run, other])


def test_other_rate_in_another_run(run):
    assert "one rate" in refusal([run, replace(run, name="second", sampling_period=2e-3)])


@pytest.mark.parametrize(
    ("orders", "words"),
    [
        (ArmaxOrders(2, (2,), 2, 1), "nb = (2,) is for 1 inputs but there are 2"),
        (ArmaxOrders(2, 0, 2, 1), "nb = 0"),
        (ArmaxOrders(-1, 1, 2, 1), "na = -1"),
        (ArmaxOrders(2, 1, 2, -1), "nk = -1"),
    ],
)
def test_orders_that_cannot_be(run, orders, words):
    assert words in refusal([run], orders)


def test_prior_needs_room(run):
    assert "na >= 2" in refusal([run], ArmaxOrders(1, 1, 1, 1), prior=OscillatorPrior(1.0))
    prior = OscillatorPrior(1.0, force_gains={"u": 1.0})
    assert "no coefficient at delay 2" in refusal([run], ArmaxOrders(2, 1, 2, 1), prior=prior)
    assert "['w']" in refusal([run], prior=OscillatorPrior(1.0, force_gains={"w": 1.0}))
    with pytest.raises(InputError, match="mass -1"):
        OscillatorPrior(-1.0)
