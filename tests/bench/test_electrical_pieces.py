"""Amplifier, heat, lags and the iron in series against closed forms."""

import numpy as np
import pytest
from bench_rigs import RATE, plain_rig, setting_in
from scipy.integrate import quad, solve_ivp
from scipy.linalg import expm

from msl_fem.bench.electromagnetic_effects import MAGNETIC
from msl_fem.bench.equations import amplifier_rates, crossover, thermal_rates, warm_resistance
from msl_fem.bench.integrate import lagged
from msl_fem.bench.iron import series_current, side_coenergy, side_magnet
from msl_fem.bench.plant import Amplifier, Thermal
from msl_fem.bench.rig import magnet_surface
from msl_fem.bench.running import run_rig
from msl_fem.materials.material import laminated, load_iron

SLOW = Amplifier(2 * np.pi * 200, 0.7, np.inf, 0.0, 1.0)


def step_response(amplifier: Amplifier, size: float) -> tuple[np.ndarray, np.ndarray]:
    """(time, output) of the amplifier alone after a step of the command."""
    t = np.linspace(0, 0.02, 2001)
    found = solve_ivp(
        lambda _t, y: amplifier_rates(amplifier, size, y[0], y[1]), (0, 0.02), [0.0, 0.0], t_eval=t, rtol=1e-9,
        max_step=1e-5,
    )  # fmt: skip
    return t, found.y[0]


def test_amplifier_is_second_order_below_its_slew_limit() -> None:
    t, output = step_response(SLOW, 1.0)
    w, z = SLOW.frequency, SLOW.damping_ratio
    d = w * np.sqrt(1 - z**2)
    exact = 1 - np.exp(-z * w * t) * (np.cos(d * t) + z * w / d * np.sin(d * t))
    assert output == pytest.approx(exact, abs=1e-6)


def test_amplifier_never_exceeds_its_slew_limit() -> None:
    """A large step rises at the limit and still settles; a small one knows nothing of it."""
    limited = SLOW._replace(slew=200.0)
    t, output = step_response(limited, 1.0)
    assert 195.0 < np.diff(output).max() / np.diff(t)[0] <= 200.0
    assert output[-1] == pytest.approx(1.0, abs=5e-3)
    assert step_response(limited, 1e-3)[1] == pytest.approx(step_response(SLOW, 1e-3)[1], abs=1e-8)


def test_amplifier_in_a_run_delays_by_its_lag() -> None:
    """In current drive the currents follow the command later by 2 z/w."""
    rig = plain_rig("current")
    amplifier = rig.plant.amplifier._replace(frequency=2e4, damping_ratio=0.7)
    rate = 1e5  # so that the staircase of the commands is finer than the lag
    t = np.arange(10_000) / rate
    commands = 0.5 + 0.05 * np.sin(2 * np.pi * 100 * t)[:, None] * np.ones(2)
    turn = np.exp(-2j * np.pi * 100 * t[5000:])
    phases = [
        np.angle(np.mean(run_rig(one, commands, rate=rate, lead_in=0.5).current[5000:, 0] * turn))
        for one in (rig, rig.with_parts(amplifier=amplifier))
    ]
    assert (phases[0] - phases[1]) / (2 * np.pi * 100) == pytest.approx(2 * 0.7 / 2e4, rel=0.01)


def test_crossover_takes_the_same_from_both_sides() -> None:
    a = Amplifier(0.0, 0.7, np.inf, 0.3, 0.1)
    assert crossover(a, 5.0) == pytest.approx(4.7)
    assert crossover(a, -5.0) == pytest.approx(-4.7)
    assert abs(crossover(a, 0.01)) < 0.03


def test_heat_settles_at_the_sum_of_resistances_and_follows_its_two_times() -> None:
    t = Thermal(3.0, 1.5, 2.0, 20.0)
    system = np.array([thermal_rates(t, *unit, 0.0) for unit in ((1.0, 0.0), (0.0, 1.0))]).T
    drive = np.array(thermal_rates(t, 0.0, 0.0, 4.0))
    steady = -np.linalg.solve(system, drive)
    assert steady == pytest.approx([4.0 * 4.5, 4.0 * 1.5])
    half = steady + expm(system * 1.5) @ -steady
    assert 0 < half[0] < steady[0]
    assert warm_resistance(2.0, 10.0) == pytest.approx(2.0 * 1.0393)


def test_a_warm_coil_in_a_run() -> None:
    """At a held current in current drive the mean voltage grows as the two nodes say."""
    rig = plain_rig("current")
    thermal = Thermal(10.0, 2.0, 0.3, 3.0)
    run = run_rig(rig.with_parts(thermal=thermal), np.full((5000, 2), 0.5), rate=RATE, lead_in=0.5)
    r = rig.plant.circuit.resistance
    found = run.voltage[-1, 0] / 0.5 / r - 1
    twin = solve_ivp(
        lambda _t, y: thermal_rates(thermal, y[0], y[1], warm_resistance(r, y[0]) * 0.25), (0, 0.52), [0, 0], rtol=1e-9
    ).y[0, -1]
    assert found == pytest.approx(warm_resistance(1.0, twin) - 1, rel=2e-3)


@pytest.mark.parametrize("rate", [200.0, 1e4, 1e6])
def test_lag_of_a_cubic_is_exact(rate: float) -> None:
    cubic = np.polynomial.Polynomial([1.0, -2e3, 4e6, 3e9])
    slope, h = cubic.deriv(), 1e-4
    exact = np.exp(-rate * h) * 0.7 + quad(lambda s: rate * np.exp(-rate * (h - s)) * cubic(s), 0, h, epsabs=1e-14)[0]
    assert lagged(rate, h, 0.7, cubic(0), slope(0), cubic(h), slope(h)) == pytest.approx(exact, rel=1e-9)
    assert lagged(np.inf, h, 0.7, cubic(0), slope(0), cubic(h), slope(h)) == cubic(h)


def test_a_side_is_the_tables_magnets() -> None:
    """Flux, pull and slopes of a side against the table's own evaluation and its coenergy."""
    rig = plain_rig("voltage")
    table = rig.table
    assert table is not None
    surface = magnet_surface(table)
    for share in (1.0, 0.5):
        m = rig.plant.magnets._replace(share=share)
        for i, g in ((0.6, 5.5e-4), (-1.3, 7e-4)):
            inside, flux, pull, inductance, slope = side_magnet(surface, m, i, g)
            magnet = table.evaluate(share * i, g)
            assert inside
            assert flux == pytest.approx(2 * share * float(magnet["flux_linkage"]), rel=1e-12)
            assert pull == pytest.approx(2 * float(magnet["force"]), rel=1e-12)
            assert inductance == pytest.approx(2 * share**2 * float(magnet["incremental_inductance"]), rel=1e-12)
            assert slope == pytest.approx(-2 * share * float(magnet["force_current_slope"]), rel=1e-12)
            d = 1e-9
            energy = side_coenergy(surface, m, i, g + d) - side_coenergy(surface, m, i, g - d)
            assert pull == pytest.approx(-energy / (2 * d), rel=1e-5)
    assert not side_magnet(surface, rig.plant.magnets, 0.6, 1e-5)[0]


def test_early_saturation_is_the_irons_own_curve() -> None:
    """Ampere's law once more: the excess over the path's lengths, at a flux that saturates the yoke."""
    setting = setting_in("voltage")
    effect = next(one for one in MAGNETIC if one.name == "early_saturation")
    rig, _ = effect.hide(setting, setting.rig, 0.25)
    iron = laminated(load_iron("m19"), 0.96)
    flux = 1.2 * 0.02 * 0.01  # of a magnet: 1.2 T in the centre leg
    lengths = {0.023: (0.01, 0.01), 0.0175: (0.012, 0.012)}  # legs; yoke and armature: half sections are 6 mm
    force = 0.0
    for length, widths in lengths.items():
        for width in widths:
            b = flux / (width * 0.02)
            force += length * float(iron.magnetise(1.25 * b)[0] - iron.magnetise(b)[0])
    assert series_current(rig.plant.series_iron, 2 * 200 * flux) == pytest.approx(force / 200, rel=2e-3)
    assert series_current(rig.plant.series_iron, -2 * 200 * flux) == pytest.approx(-force / 200, rel=2e-3)
