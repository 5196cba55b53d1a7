"""From a record to an ARMAX model."""

from dataclasses import replace

import numpy as np
import pytest

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.identification import ArmaxOrders, Identification, ModelChoice, identify
from msl_fem.plant import NamedRun, excitation_inputs, simulate, simulation_record
from msl_fem.plant.excitation import parse_excitation
from msl_fem.record import Record
from msl_fem.table.magnetic_table import MagneticTable

NOISE = "band-limited-noise:channel=independent,band=500 Hz,bias=0.4 A,amplitude=0.06 A,duration=0.5 s,seed=3"
SWEEP = "swept-sine:channel=differential,start=5 Hz,stop=140 Hz,bias=0.4 A,amplitude=0.01 A,duration=0.5 s"


@pytest.fixture(scope="module")
def record(table: MagneticTable, servo: Actuator) -> Record:
    """Noise to fit and a swept sine held out, of the closed-form magnet."""
    generator = np.random.default_rng(5)
    runs = []
    for name, spec, role in (("noise", NOISE, "fit"), ("sweep", SWEEP, "held-out")):
        inputs = excitation_inputs(servo, parse_excitation(spec), rate=1e4)
        runs.append(NamedRun(name, spec, role, simulate(servo, table, inputs, generator=generator)))
    return simulation_record(servo, runs)


@pytest.fixture(scope="module")
def found(record: Record) -> Identification:
    """By the default choice."""
    return identify(record)


def test_the_default_choice_predicts_the_held_out_run(found: Identification) -> None:
    fits = {fit.run: fit for fit in found.fits}
    assert found.model.input_names == ("i1^2/g1^2", "i2^2/g2^2")
    assert fits["sweep"].free_run is not None
    assert fits["sweep"].free_run > 95
    assert found.roles == ("fit", "held-out")
    fields = found.to_json()
    assert fields["fit_percent"]["noise"]["role"] == "fit"
    assert fields["parameters"]["delta"]["standard_error"] > 0
    assert fields["noise_standard_deviation"] == pytest.approx(50e-9, rel=0.3)


def test_the_held_out_run_takes_no_part_in_the_fit(record: Record, found: Identification) -> None:
    """A held-out run with another position changes its own fit and nothing of the model."""
    columns = {**record.runs[1].columns}
    columns["position_m"] = columns["position_m"][::-1].copy()
    spoilt = replace(record, runs=(record.runs[0], replace(record.runs[1], columns=columns)))
    second = identify(spoilt)
    np.testing.assert_array_equal(found.model.parameters, second.model.parameters)
    assert second.fits[1].one_step < found.fits[1].one_step


def test_terms_and_orders_can_be_chosen(record: Record) -> None:
    chosen = ModelChoice(ArmaxOrders(2, 3, 2), ("i1^2/g1^2", "i2^2/g2^2", "i1^2/g1", "i2^2/g2"), delta=False)
    model = identify(record, choice=chosen).model
    assert len(model.input_names) == 4
    assert "delta" not in model.parameter_names
    assert len(model.polynomials.b[0]) == 3


def test_a_record_without_a_fit_run_or_an_input_is_refused(record: Record) -> None:
    held = tuple(replace(run, role="held-out") for run in record.runs)
    with pytest.raises(InputError, match="no run with role fit"):
        identify(replace(record, runs=held))
    columns = {k: v for k, v in record.runs[0].columns.items() if not k.startswith("current")}
    with pytest.raises(InputError, match="ARMAX needs position_m and at least one of"):
        identify(replace(record, runs=(replace(record.runs[0], columns=columns),)))


def test_physical_parameters_are_those_of_the_actuator(found: Identification, servo: Actuator) -> None:
    """The stiffness within a few per cent (currents' iron is not quite i^2/g^2), in JSON with an interval."""
    assert servo.motion is not None
    stiffness = found.to_json()["physical_parameters"]["stiffness"]
    assert stiffness["value"] == pytest.approx(servo.motion.stiffness, rel=0.03)
    assert stiffness["ci95"][0] < stiffness["value"] < stiffness["ci95"][1]
    assert stiffness["unit"] == "N/m"


def test_a_prior_counts_when_asked(record: Record) -> None:
    """A stiffness believed 5 % too high, to 1e-5, holds the estimate there; without `prior` it is a start only."""
    motion = record.actuator.motion
    assert motion is not None
    wrong = motion.model_copy(update={"stiffness": 1.05 * motion.stiffness})
    tolerance = record.tolerance.model_copy(update={"moving_mass": 1e-5, "stiffness": 1e-5, "damping": 1e-3})
    biased = replace(record, actuator=record.actuator.model_copy(update={"motion": wrong}), tolerance=tolerance)
    free, held = (identify(biased, choice=ModelChoice(prior=p)).physical["stiffness"].value for p in (False, True))
    assert free == pytest.approx(motion.stiffness, rel=0.03)
    assert held == pytest.approx(1.05 * motion.stiffness, rel=0.005)


def test_orders_and_terms_are_searched_for(record: Record) -> None:
    terms = ("i1^2/g1^2", "i2^2/g2^2", "i1^2/g1", "i2^2/g2")
    found = identify(record, choice=ModelChoice("auto", terms, select_terms=True))
    assert set(found.model.input_names) >= {"i1^2/g1^2", "i2^2/g2^2"}
    fields = found.to_json()
    assert [selection["of"] for selection in fields["selection"]] == ["terms", "orders"]
    assert fields["selection"][0]["criterion"] == "bic"
    assert len(fields["selection"][1]["tried"]) > 5


def test_the_record_of_a_loop_says_so(record: Record, found: Identification) -> None:
    looped = replace(record, controller={"law": "pid"})
    assert any("recorded under feedback" in note for note in identify(looped).notes)
    assert not any("recorded under feedback" in note for note in found.notes)


def test_output_error_ties_the_noise_to_the_plant(record: Record, servo: Actuator) -> None:
    """C = A: what i^2/g^2 leaves out of the force has no place in the noise, so the fit is that of a free run."""
    assert servo.motion is not None
    tied = identify(record, choice=ModelChoice(structure="output-error"))
    np.testing.assert_allclose(tied.model.polynomials.c, tied.model.polynomials.a)
    assert tied.model.convergence.converged
    assert tied.model.rational is not None
    assert tied.fits[0].free_run is not None
    assert tied.fits[0].free_run > 95
    assert tied.physical["stiffness"].value == pytest.approx(servo.motion.stiffness, rel=0.03)


def test_box_jenkins_has_a_noise_of_its_own(record: Record) -> None:
    model = identify(record, choice=ModelChoice(ArmaxOrders(2, 2, 1), structure="box-jenkins", delta=False)).model
    assert model.orders.na == 3  # F and D
    assert model.orders.nc == 3  # F and C
    with pytest.raises(InputError, match="the prior counts in ARMAX only"):
        identify(record, choice=ModelChoice(structure="box-jenkins", prior=True))
