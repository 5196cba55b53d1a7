"""The ladder is diffusion in a sheet: against the closed form, and its currents in a run against a phasor."""

import numpy as np
import pytest
from bench_rigs import RATE, plain_rig
from scipy.linalg import eigvalsh_tridiagonal

from msl_fem.bench.iron import fastest_ladder_rate, ladder_matrix, ladder_response, sheet_response
from msl_fem.bench.plant import Ladder
from msl_fem.bench.running import run_rig

TIME, CONDUCTANCE = 2e-3, 1e-3


def worst(stages: int, largest_q: float) -> float:
    """Largest relative error up to |q| = largest_q."""
    ladder = Ladder(stages, CONDUCTANCE, TIME)
    w = np.linspace(0.01, largest_q, 60) ** 2 / TIME
    exact = sheet_response(ladder, w)
    return float(np.abs(ladder_response(ladder, w) / exact - 1).max())


def test_four_stages_meet_the_skin_effect() -> None:
    """Up to a sheet six skin depths thick (|q| = d/(sqrt(2) delta) = 4.2) within 2e-3."""
    assert worst(4, 4.2) < 2e-3
    assert worst(1, 4.2) > 0.05  # one lag is not diffusion


def test_every_stage_brings_the_ladder_closer() -> None:
    errors = [worst(stages, 2.0) for stages in (1, 2, 3)]
    assert errors[0] > 30 * errors[1] > 900 * errors[2]


def test_slow_fields_lose_as_thin_sheets_do() -> None:
    """i_e = G dL/dt at low frequency: the classical eddy loss, whatever the number of stages."""
    for stages in (1, 3):
        slow = ladder_response(Ladder(stages, CONDUCTANCE, TIME), np.array([1e-3 / TIME]))[0]
        assert slow == pytest.approx(CONDUCTANCE, rel=1e-4)


def test_poles_are_those_of_diffusion() -> None:
    """The slowest pole of a sheet is (pi/T^0.5)^2; a slow twin: finite differences across half the thickness."""
    n = 400  # q coth q has its poles at q = j pi k: H = 0 at the surface would give j pi (k - 1/2), given flux j pi k
    h = 1.0 / n
    diagonal = np.r_[1.0, np.full(n - 2, 2.0), 1.0] / h**2  # no field gradient through middle and surface
    slowest = eigvalsh_tridiagonal(diagonal, np.full(n - 1, -1.0) / h**2)[1] / TIME
    found = np.sort(-np.linalg.eigvals(ladder_matrix(Ladder(4, CONDUCTANCE, TIME))).real)
    assert found[0] == pytest.approx(slowest, rel=1e-4)
    assert fastest_ladder_rate(Ladder(4, CONDUCTANCE, TIME)) == pytest.approx(found[-1])


def test_the_coil_feels_the_ladder() -> None:
    """In a run at a held mover, what the coil takes beyond the magnetising current is G(jw) times the flux's rate."""
    rig = plain_rig("voltage")
    plant = rig.plant
    ladder = Ladder(4, 2e-3, TIME)
    held = rig.with_parts(motion=plant.motion._replace(mass=1e12), ladder=ladder)
    frequency, count = 200.0, 4000
    t = np.arange(count) / RATE
    commands = 0.4 * np.sin(2 * np.pi * frequency * t)[:, None] * np.ones(2)
    run = run_rig(held, commands, rate=RATE)
    last = slice(count - 500, count)  # ten periods
    turn = np.exp(-2j * np.pi * frequency * t[last])
    current, flux = (2 * np.mean(values[last, 0] * turn) for values in (run.current, run.flux_linkage))
    table = held.table
    assert table is not None
    inductance = 2 * float(table.evaluate(0.0, plant.magnets.nominal_gap)["incremental_inductance"])
    expected = flux / inductance + sheet_response(ladder, np.array([2 * np.pi * frequency]))[0] * flux * (
        2j * np.pi * frequency
    )
    assert abs(current / expected - 1) < 2e-3
    assert abs(expected / (flux / inductance) - 1) > 0.02
