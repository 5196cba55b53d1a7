"""How often intervals of inverse dynamics hold the truth, where what is left is no white noise: rigs of other seeds."""

import numpy as np
import pytest
from scipy.stats import binom

from msl_fem.actuator import parse_actuator
from msl_fem.diagnosis.carriages import prepared_carriage
from msl_fem.diagnosis.estimates import believed_estimates
from msl_fem.diagnosis.fit import fit
from msl_fem.diagnosis.likelihood import Likelihood
from msl_fem.prediction import ModelHypothesis, run_data
from msl_fem.record import Noise, Record, Run, Sampling, Tolerance

RATE, N, RUNS, RIGS = 250.0, 3000, 6, 60
TRUTH = {"moving_mass": 2.1, "damping": 57.0, "stiffness": 3.9e3}
BELIEVED = {"moving_mass": "2 kg", "damping": "60 N s/m", "stiffness": "4000 N/m"}
RIPPLE, PITCH = 1.5, 5e-3  # N and m: what no model of the rig has
CHANCE = 1e-3


def moved(seed: int, number: int) -> Run:
    """A machine moves a mass on a spring and a damper; a ripple of the force over the place, at another phase in
    each run, comes again with every stroke."""
    rng, time = np.random.default_rng([seed, number]), np.arange(N) / RATE
    x, v, a = np.zeros(N), np.zeros(N), np.zeros(N)
    for frequency in rng.uniform(2.0, 6.0, 3):
        w, phase, size = 2 * np.pi * frequency, rng.uniform(0, 6.28), rng.uniform(1e-3, 3e-3)
        x += size * np.sin(w * time + phase)
        v += size * w * np.cos(w * time + phase)
        a -= size * w**2 * np.sin(w * time + phase)
    force = TRUTH["moving_mass"] * a + TRUTH["damping"] * v + TRUTH["stiffness"] * x
    force += RIPPLE * np.sin(2 * np.pi * x / PITCH + rng.uniform(0, 6.28)) + 0.02 * rng.standard_normal(N)
    columns = {"time_s": time, "force_N": force, "position_m": x + 1e-8 * rng.standard_normal(N)}
    return Run(f"run_{number}", "sines", "fit", columns, mover="imposed")


@pytest.fixture(scope="module")
def fitted():
    """The believed model fitted to each of the rigs."""
    actuator = parse_actuator({"schema": 1, "name": "rig", "motion": BELIEVED, "drive": {"kind": "force"}})
    belief, wide = ModelHypothesis(actuator, None), Tolerance(moving_mass=0.5, damping=0.5, stiffness=0.5)
    noise, found = Noise(position=1e-8, force=0.02), []
    for seed in range(RIGS):
        runs = tuple(moved(seed, number) for number in range(RUNS))
        record = Record("measured", actuator, Sampling(rate=RATE), noise, wide, runs=runs)
        likelihood, unknowns = prepared_carriage(belief, [run_data(record, run) for run in runs], wide)
        found.append((belief, fit(likelihood, unknowns, np.zeros(unknowns.size))))
    return found


def held(fitted) -> dict[str, int]:
    """In how many rigs the 95 % interval of each parameter holds the truth."""
    counts = dict.fromkeys(TRUTH, 0)
    for belief, found in fitted:
        for name, told in believed_estimates(belief, found).items():
            if name in TRUTH:
                counts[name] += told.low < TRUTH[name] < told.high
    return counts


def test_intervals_hold_the_truth_as_often_as_they_say(fitted) -> None:
    """No fewer than chance allows of 95 %; nor by being as wide as what was believed before."""
    counts = held(fitted)
    assert min(counts.values()) >= binom.ppf(CHANCE, RIGS, 0.95), counts
    belief, found = fitted[0]
    told = believed_estimates(belief, found)
    assert all((told[name].high - told[name].low) / told[name].value < 0.2 for name in ("damping", "stiffness"))


def test_those_of_white_noise_do_not(fitted, monkeypatch) -> None:
    """The same fits with the errors that white residuals would leave."""
    for _, found in fitted:
        monkeypatch.setattr(type(found.likelihood), "standard_errors", Likelihood.standard_errors)
    counts = held(fitted)
    assert min(counts.values()) < binom.ppf(CHANCE, RIGS, 0.95), counts
