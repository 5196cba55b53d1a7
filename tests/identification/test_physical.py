"""Physical parameters with intervals, the prior's weight, and python-control's object."""

from dataclasses import replace

import control
import numpy as np
import pytest
from armax_plants import CASES
from magnet_rig import DAMPING, MASS, NOMINAL_GAP, STIFFNESS, STRENGTH, magnet_run
from scipy.signal import lfilter

from msl_fem.errors import InputError
from msl_fem.identification import (
    ArmaxOrders,
    DeltaSearch,
    KnownMass,
    OscillatorPrior,
    OscillatorTolerance,
    RationalInputs,
    SampledRun,
    discretised_oscillator,
    fit_armax,
    identify_rational,
    rational_term,
)

PERIOD = 1e-3
ORDERS = ArmaxOrders(2, 2, 2, 1)


def driven(prior, n_samples, seed, *, noise=1e-6):
    """A mass on a spring under a held random force, its position read with white noise."""
    rng = np.random.default_rng(seed)
    a, b = discretised_oscillator(prior, PERIOD)
    force = 10.0 * rng.standard_normal(n_samples)
    x = lfilter(np.r_[0.0, b], a, force) + noise * rng.standard_normal(n_samples)
    return SampledRun(x, {"force": force}, PERIOD)


def test_mass_damping_and_stiffness_from_a_known_force():
    truth = OscillatorPrior(2.0, 30.0, 8e3)
    scores = []
    for seed in range(12):
        found = fit_armax([driven(truth, 3_000, seed)], ORDERS).physical_parameters(gains={"force": 1.0})
        scores.append(
            [
                (found[name].value - getattr(truth, name)) / found[name].standard_error
                for name in ("mass", "damping", "stiffness")
            ]
        )
        low, high = found["mass"].interval
        assert 0.0 < high - low < 0.2
    assert 0.5 < np.mean(np.square(scores)) < 1.7
    assert np.mean(np.abs(scores) < 1.96) > 0.85


def test_no_spring_is_no_special_case():
    """A free mass has a pole at one: stiffness zero within its interval, mass and damping found."""
    found = fit_armax([driven(OscillatorPrior(2.0, 30.0), 4_000, 1)], ORDERS).physical_parameters(gains={"force": 1.0})
    assert abs(found["stiffness"].value) < 4.0 * found["stiffness"].standard_error
    assert found["mass"].value == pytest.approx(2.0, abs=4.0 * found["mass"].standard_error)
    assert found["damping"].value == pytest.approx(30.0, abs=4.0 * found["damping"].standard_error)


def test_a_believed_mass_brings_its_tolerance():
    model = fit_armax([driven(OscillatorPrior(2.0, 30.0, 8e3), 5_000, 1)], ORDERS)
    loose = model.physical_parameters(mass=KnownMass(2.0, 0.01))["stiffness"]
    exact = model.physical_parameters(mass=KnownMass(2.0))["stiffness"]
    assert loose.standard_error**2 == pytest.approx(exact.standard_error**2 + (0.01 * exact.value) ** 2, rel=1e-3)


def test_a_variance_below_zero_tells_no_error():
    """As rounding makes it of readings without noise: no parameter is then known exactly."""
    model = fit_armax([driven(OscillatorPrior(2.0, 30.0, 8e3), 2_000, 1)], ORDERS)
    covariance = model.covariance.copy()
    covariance[0, 0] = -covariance[0, 0]
    assert replace(model, covariance=covariance).physical_parameters(mass=KnownMass(2.0)) == {}


def test_the_held_gap_does_not_count_as_damping():
    """Rational inputs hold the position over a sample: without its correction damping is 12 % too small."""
    run = magnet_run(20_000, np.random.default_rng(11))
    rational = RationalInputs((rational_term("i1^2/g1^2"), rational_term("i2^2/g2^2")), NOMINAL_GAP)
    model = identify_rational([run], ORDERS, rational=rational, search=DeltaSearch())
    found = model.physical_parameters(mass=KnownMass(MASS))
    assert found["damping"].value == pytest.approx(DAMPING, rel=0.01)
    assert found["stiffness"].value == pytest.approx(STIFFNESS, rel=1e-3)
    assert found["force_constant[i1^2/g1^2]"].value == pytest.approx(STRENGTH[0], rel=0.005)
    assert found["force_constant[i2^2/g2^2]"].unit == "N m^2/A^2"
    without = replace(model, input_slopes=()).physical_parameters(mass=KnownMass(MASS))
    assert without["damping"].value < 0.92 * DAMPING


def test_what_has_no_physical_parameters():
    run, _ = CASES[0].run(2_000, np.random.default_rng(0))
    with pytest.raises(InputError, match="na = 3"):
        fit_armax([run], ArmaxOrders(3, 2, 2, 1)).physical_parameters()
    with pytest.raises(InputError, match="known gain"):
        fit_armax([run], CASES[0].orders).physical_parameters(gains={"force": 1.0})


def test_a_tight_prior_holds_and_a_wide_one_does_not_matter():
    """The estimate goes from the data's to the believed stiffness as the tolerance shrinks."""
    run = driven(OscillatorPrior(2.0, 30.0, 8e3), 1_000, 3, noise=1e-4)
    plain = fit_armax([run], ORDERS)
    believed = OscillatorPrior(2.0, 30.0, 8.4e3, {"force": 1.0})
    tight, wide = (
        fit_armax([run], ORDERS, prior=replace(believed, tolerance=OscillatorTolerance(t, t, t))) for t in (1e-5, 10.0)
    )
    values = [m.physical_parameters(gains={"force": 1.0})["stiffness"].value for m in (plain, tight, wide)]
    assert values[1] == pytest.approx(8.4e3, rel=1e-3)
    assert values[2] == pytest.approx(values[0], rel=2e-3)
    assert tight.standard_errors[0] < plain.standard_errors[0]


def test_a_right_prior_makes_the_estimate_better():
    """Short noisy records, a truth drawn from the prior: the error of the stiffness falls."""
    tolerance = OscillatorTolerance(0.005, 0.2, 0.02)
    rng, errors = np.random.default_rng(8), {False: [], True: []}
    for seed in range(6):
        truth = OscillatorPrior(2.0, 30.0 * (1 + 0.2 * rng.standard_normal()), 8e3 * (1 + 0.02 * rng.standard_normal()))
        run = driven(truth, 600, seed, noise=3e-4)
        for counts in errors:
            prior = OscillatorPrior(2.0, 30.0, 8e3, {"force": 1.0}, tolerance if counts else None)
            found = fit_armax([run], ORDERS, prior=prior).physical_parameters(gains={"force": 1.0})
            errors[counts].append(found["stiffness"].value / truth.stiffness - 1.0)
    assert np.std(errors[True]) < 0.6 * np.std(errors[False]), errors


def test_python_control_has_the_same_frequency_response():
    run, _ = CASES[1].run(4_000, np.random.default_rng(2))
    model = fit_armax([run], CASES[1].orders)
    system = model.to_control(noise=True)
    assert isinstance(system, control.TransferFunction)
    assert (system.ninputs, system.noutputs, system.dt) == (5, 1, run.sampling_period)
    z = np.exp(0.7j)
    powers = z ** -np.arange(3)
    a = model.polynomials.a @ powers
    expected = [np.r_[0.0, b] @ powers / a for b in model.polynomials.b] + [model.polynomials.c @ powers / a]
    np.testing.assert_allclose(np.ravel(system(z)), expected, rtol=1e-9)


def test_the_methods_are_the_functions():
    run, _ = CASES[0].run(2_000, np.random.default_rng(0))
    model = fit_armax([run], CASES[0].orders)
    assert model.simulate(run).output.shape == model.predict(run, 3).shape == model.residuals(run).shape
    assert len(model.residual_tests(run)) == 3
