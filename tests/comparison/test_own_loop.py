"""A loop that one of our designs drove is simulated with the controller made again from the record."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from conftest import ROOT
from servo_controllers import TABLE, servo, servo_design

from msl_fem.cli.compare import _map_of_both
from msl_fem.comparison import CompareSettings, compare, nrmse
from msl_fem.comparison.models import own_loop
from msl_fem.control.output_stage import BIAS, VIOLATION, OutputStage, commanded_currents
from msl_fem.control.stepper import Stepper, stated
from msl_fem.errors import InputError
from msl_fem.plant.excitation import parse_excitation, reference
from msl_fem.plant.sampled_plant import simulate_closed
from msl_fem.plant.simulate import NamedRun, simulation_record
from msl_fem.prediction import ModelHypothesis, Start, closed_run, kernel_plant, run_data
from msl_fem.record import Record
from msl_fem.table.pair_table import load_table

PAIR = ROOT / "lookup_tables" / "fast_tool_servo_pair.nc"
SPEC = "multisine:start=5 Hz,stop=60 Hz,amplitude=20 um,duration=0.4 s,periods=2,seed=1,loop=closed"
AT_REST = Start((0.0, 0.0), 0.0, 0.0)


def looped(*, mass: float = 0.9, noisy: bool = False, spec: str = SPEC) -> Record:
    """The record of a plant with another mass than the controller believes."""
    wanted = reference(parse_excitation(spec), rate=1e4)
    generator = np.random.default_rng(1) if noisy else None
    run = simulate_closed(
        servo(motion={"moving_mass": mass}), TABLE, wanted, Stepper(servo_design()), generator=generator
    )
    made = NamedRun("loop", spec, "fit", run, wanted.position)
    return simulation_record(servo(), [made], controller=stated(servo_design()))


@pytest.fixture(scope="module")
def record() -> Record:
    return looped(mass=0.95)


def error_of(record: Record, **factors: float) -> float:
    data = run_data(record, record.runs[0])
    loop = own_loop(record, TABLE)
    assert loop is not None
    plant = kernel_plant(ModelHypothesis(servo(), TABLE), rate=data.rate, factors=factors)
    run = closed_run(plant, data, AT_REST, loop.beside(record.runs[0], data))
    assert run.ended is None
    return nrmse(data.measured["position_m"], run.readings["position_m"])


def test_the_true_plant_retraces_its_loop_and_the_believed_one_does_not(record: Record) -> None:
    true, believed = error_of(record, moving_mass=0.95 / 0.9), error_of(record)
    assert true < 5e-4
    assert believed > 5 * true


def test_a_reference_known_by_its_samples_alone_serves_as_well(record: Record) -> None:
    """Its derivatives are differences then; both answers take them, so little of the error is left."""
    in_words = replace(record, runs=(replace(record.runs[0], excitation="a sum of sines"),))
    assert error_of(in_words, moving_mass=0.95 / 0.9) < 2e-3


def test_what_cannot_be_made_again_is_refused(record: Record) -> None:
    for change, said in (
        ({"gain": [1.0, 2.0, 3.0, 4.0]}, "made again from actuator and table has other gains"),
        ({"design": "fuzzy"}, "'fuzzy' is no design"),
        ({"bandwidth": "60 m"}, "controller.bandwidth: unit 'm' has the wrong dimension"),
    ):
        with pytest.raises(InputError, match=said):
            own_loop(replace(record, controller={**record.controller, **change}), TABLE)
    assert own_loop(replace(record, controller={"rate": "2500 Hz"}), TABLE) is None
    bare = {name: v for name, v in record.runs[0].columns.items() if name != "reference_m"}
    run = replace(record.runs[0], columns=bare)
    assert own_loop(record, TABLE).beside(run, run_data(record, run)) is None


def test_compare_notes_a_loop_that_it_cannot_make_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """And judges in the one that it can; the same models serve both, a controller has no part in their fits."""
    short = looped(noisy=True, spec=SPEC.replace("0.4 s", "0.2 s").replace("periods=2", "periods=1"))
    found = compare(short, CompareSettings(table=TABLE))
    closed = {j.model: j.nrmse["closed_loop"] for j in found.accuracies if j.channel == "position_m"}
    assert closed["coupled"] < 0.1
    assert closed["armax"] is None
    models = found.models
    monkeypatch.setattr(import_module("msl_fem.comparison.compare"), "fitted_models", lambda *_: models)
    other = replace(short, controller={**short.controller, "gain": [0.0, 0.0, 0.0, 0.0]})
    found = compare(other, CompareSettings(table=TABLE))
    assert any("closed loop: left out, controller.gain" in note for note in found.models.notes)
    assert all(j.nrmse["closed_loop"] is None for j in found.accuracies)


def test_both_currents_are_judged_together_by_the_map_of_the_pair(record: Record) -> None:
    """In the middle either side alone bears 4.8 A; with both on, opposing, the armature does not, and the loop cuts."""
    table = load_table(PAIR)
    pair = _map_of_both(record, table, PAIR)
    assert pair is not None
    assert _map_of_both(replace(record, controller={"rate": "2500 Hz"}), table, PAIR) is None
    assert _map_of_both(record, TABLE, PAIR) is None
    of_pair = replace(record, controller={k: v for k, v in record.controller.items() if "gain" not in k})
    together, apart = own_loop(of_pair, table, pair=pair), own_loop(of_pair, table)
    judged = []
    for loop in (together, apart):
        inverse = loop.design.parameters.inverse
        stage = OutputStage(BIAS, 0.0, 4.8 / inverse.current_share, 1.0)
        judged.append(
            commanded_currents(stage, inverse, 0.0, (0.0, 0.0), (np.inf, np.inf), np.zeros(2))[1] == VIOLATION
        )
    assert judged == [True, False]
