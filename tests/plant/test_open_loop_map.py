"""The open loop over positions and currents, excitations with detection lines, runs that stay in the operating map."""

import numpy as np
import pytest
from coupled_twin import changed
from effect_sets import rig

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.maps import Guard, operating_map
from msl_fem.plant import NamedRun, open_loop_map, refused_unless_borne, simulation_record
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs, parse_excitation, samples
from msl_fem.plant.linearisation import linearise
from msl_fem.plant.open_loop import bearable_run, check_map
from msl_fem.plant.operating_point import equilibria, stability_limit
from msl_fem.plant.simulate import simulate
from msl_fem.table.magnetic_table import MagneticTable

POSITIONS = np.array([-3e-4, -1e-4, 0.0, 2e-4])


def test_the_map_knows_what_single_points_know(servo: Actuator, table: MagneticTable) -> None:
    currents = np.array([0.0, 0.5, 1.0])
    found = open_loop_map(servo, table, currents=currents, positions=POSITIONS)
    for n, i in enumerate(currents):
        for m, x in enumerate(POSITIONS):
            one = linearise(servo, table, currents=(i, i), position=x)
            assert found.stiffness[n, m] == pytest.approx(one.stiffness, rel=1e-12)
            assert found.natural_frequency[n, m] == pytest.approx(one.natural_frequency, rel=1e-12, nan_ok=True)
            assert found.stable[n, m] == (one.stiffness > 0)
    assert found.natural_frequency[0] == pytest.approx(np.sqrt(1.4e5 / 0.9) / (2 * np.pi))


def test_the_boundary_is_where_the_open_loop_turns_unstable(servo: Actuator, table: MagneticTable) -> None:
    found = open_loop_map(servo, table, currents=np.zeros(1), positions=POSITIONS)
    assert found.boundary[2] == pytest.approx(stability_limit(servo, table), rel=1e-4)
    assert (found.boundary < found.boundary[2] + 1e-12).all(), "the middle bears most"
    assert found.boundary[1] > found.boundary[0]
    for x, limit in zip(POSITIONS, found.boundary, strict=True):
        below, above = (linearise(servo, table, currents=(f * limit, f * limit), position=x) for f in (0.995, 1.005))
        assert below.is_stable
        assert not above.is_stable


def test_a_boundary_that_there_is_not(servo: Actuator, table: MagneticTable) -> None:
    stiff, loose = changed(servo, motion={"stiffness": 1e12}), changed(servo, motion={"stiffness": 0.0})
    assert open_loop_map(stiff, table, currents=np.ones(1), positions=POSITIONS).boundary.tolist() == [np.inf] * 4
    assert open_loop_map(loose, table, currents=np.ones(1), positions=POSITIONS).boundary == pytest.approx(
        0.0, abs=1e-9
    )
    assert equilibria(servo, table, currents=(0.5, 0.5))
    with pytest.raises(InputError, match="rig has no magnets"):
        open_loop_map(rig(), table, currents=np.ones(1), positions=POSITIONS)


def test_an_odd_multisine_leaves_detection_lines_silent() -> None:
    spec = "multisine:channel=1,start=10 Hz,stop=400 Hz,bias=1 A,amplitude=0.2 A,duration=4 s,periods=4,seed=5"
    full, sparse = parse_excitation(f"{spec},lines=odd"), parse_excitation(f"{spec},lines=odd-detection")
    left_out = sparse.detection_lines()
    assert sorted([*sparse.harmonics(), *left_out]) == full.harmonics().tolist()
    assert left_out.size == full.harmonics().size // 4
    assert len(set((left_out // 2 % 4).tolist())) > 1, "not the same of every four"
    assert parse_excitation(sparse.spec).detection_lines().tolist() == left_out.tolist()
    other = parse_excitation(spec.replace("seed=5", "seed=6") + ",lines=odd-detection")
    assert other.detection_lines().tolist() != left_out.tolist()
    command = samples(sparse, rate=2e3, sides=2)[:2000, 0]
    spectrum = np.abs(np.fft.rfft(command)) / 2000
    assert spectrum[sparse.harmonics()] == pytest.approx(spectrum[sparse.harmonics()][0], rel=1e-6)
    assert spectrum[left_out].max() < 1e-12
    assert full.detection_lines().size == 0


def test_a_run_that_leaves_the_operating_map_is_refused(servo: Actuator, table: MagneticTable) -> None:
    """The weakest of levels forbids what the plain limits allow; what is borne is said, and is."""
    guard = Guard(operating_map(table, levels=(0.1, 0.15)))
    spec = "step:channel=differential,bias=0.25 A,amplitude=0.2 A,duration=0.05 s,frequency=20 Hz"
    excitation = parse_excitation(spec)
    assert refused_unless_borne(servo, table, excitation, rate=1e4).complete
    with pytest.raises(InputError, match=r"side 1 leaves the operating map after .* s: .*an amplitude of .* is borne"):
        refused_unless_borne(servo, table, excitation, rate=1e4, guard=guard)
    run, tried = bearable_run(servo, table, excitation, rate=1e4, guard=guard)
    assert tried.amplitude < 0.2
    check_map(servo, run, guard)
    check_map(servo, run, None)


def test_a_run_with_effects_becomes_a_record_of_the_believed_actuator(servo: Actuator, table: MagneticTable) -> None:
    hidden = EffectValues({"current_sensor_error": {"offset_1": 0.05}})
    run = simulate(servo, table, Inputs(np.full((1500, 2), 0.3), 1e4), effects=hidden)
    record = simulation_record(servo, [NamedRun("run", "step", "fit", run)])
    assert record.actuator == servo
    columns = record.runs[0].columns
    assert columns["current_1_A"][-1] - columns["current_2_A"][-1] == pytest.approx(0.05, abs=1e-6)
