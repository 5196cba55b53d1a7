"""A user's law on the bench: hidden at its size, by the bench's own evaluation."""

import numpy as np
import pytest

from msl_fem.bench import BenchOptions, parse_requests, sealed_record
from msl_fem.bench.law_program import VOLTAGE, law_sum, with_law
from msl_fem.bench.plant import NO_LAWS
from msl_fem.bench.rig import true_rig
from msl_fem.bench.running import run_rig
from msl_fem.computing.laws import parse_expression
from msl_fem.errors import InputError
from msl_fem.plant.excitation import parse_excitation

DRAG = parse_expression("drag: force = -a*v*abs(v); a: 0..5000 N s2/m2")
RATE = 1e4


def test_drag_is_the_bench_s_own_drag(servo, table) -> None:
    """The bench has a drag outside the catalogue: the user's law of the same form gives the same run."""
    rig = true_rig(servo, table)
    commands = 0.4 + 0.1 * np.sin(2 * np.pi * 60 * np.arange(2000) / RATE)[:, None] * np.array([1.0, -1.0])
    by_law = rig.with_parts(laws=with_law(NO_LAWS, DRAG, {"a": 400.0}))
    own = rig.with_parts(disturbance=rig.plant.disturbance._replace(drag=400.0))
    found, wanted, plain = (run_rig(r, commands, rate=RATE, lead_in=0.4).position for r in (by_law, own, rig))
    scale = np.abs(wanted).max()
    assert np.abs(found - wanted).max() < 1e-12 * scale
    assert np.abs(plain - wanted).max() > 1e-3 * scale


def test_laws_of_voltage_and_reading(servo, table) -> None:
    rig = true_rig(servo, table)
    resistor = parse_expression("resistor: voltage = r*i; r: 0..2 ohm")
    crosstalk = parse_expression("crosstalk: position_reading = c*i1; c: -1..1 um/A")
    laws = with_law(with_law(NO_LAWS, resistor, {"r": 0.5}), crosstalk, {"c": 2e-7})
    commands = np.full((500, 2), 0.4)
    commands[:, 0] += 0.1 * np.sin(2 * np.pi * 60 * np.arange(500) / RATE)
    found, plain = (run_rig(r, commands, rate=RATE, lead_in=0.4) for r in (rig.with_parts(laws=laws), rig))
    np.testing.assert_allclose(found.reading - plain.reading, 2e-7 * plain.current[:, 0], rtol=0, atol=1e-15)
    assert np.abs((found.voltage - plain.voltage) / 0.5 - plain.current).max() < 0.02
    assert law_sum(laws, VOLTAGE, np.array([0, 0, 3.0, 0, 6e-4, 0])) == 1.5


def test_a_law_is_hidden_at_its_size(servo, table) -> None:
    excitation = parse_excitation(
        "multisine:channel=independent,bias=0.4 A,amplitude=0.05 A,start=5 Hz,stop=200 Hz,duration=0.3 s", unit="A"
    )
    requests = parse_requests(["expression:drag=2%"], [DRAG])
    made = sealed_record(servo, table, requests, BenchOptions(seed=1, excitations=(excitation,)))
    (answer,) = made.answer["effects"]
    assert answer["effect"] == "expression:drag"
    assert answer["size"] == pytest.approx(0.02, rel=0.006)
    assert 0 < answer["parameters"]["a"] < 5000


def test_what_is_not_declared_is_refused() -> None:
    with pytest.raises(InputError, match="'expression:drag' is no effect; there are gap_offset"):
        parse_requests(["expression:drag=2%"])
