"""What the shapes of effects do: spread eddy currents, a core that warms, friction that falls over velocity, iron that
was magnetised before the run, branches that reverse over more flux where there is more."""

import numpy as np
import pytest
from coupled_twin import changed, linear_table, locked
from effect_sets import effects, rig, rough
from scipy.linalg import expm

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.effects.magnetic import EDDY_POLES, EDDY_WEIGHTS
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import run_lanes
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.simulate import Options, simulate
from msl_fem.plant.static_map import static_map

INDUCTANCE = 2 * 1.08e-5 / 6.3e-4  # of a side of two magnets of `linear_table`, H


@pytest.mark.parametrize("frequency", [50.0, 200.0, 800.0])
def test_eddy_currents_in_sheets_follow_the_diffusion_equation(servo: Actuator, frequency: float) -> None:
    """Current over flux is (1 + (3 tau/T)(q coth q - 1))/L, q^2 = j w T, up to two skin depths a sheet."""
    tau, diffusion, rate, n = 1e-3, 2e-3, 100e3, int(100e3 / frequency)
    turns = 2 * np.pi * frequency * np.arange(12 * n) / rate
    command = 1.0 + 0.2 * np.sin(turns)
    run = simulate(
        locked(servo), linear_table(), Inputs(np.column_stack([command, command]), rate),
        effects=effects("eddy_currents", time_constant=tau, diffusion_time=diffusion),
        options=Options(currents=(1.0, 1.0), substeps=8),
    )  # fmt: skip
    turn = np.exp(-1j * turns[-n:])
    ratio = np.mean(run.current[-n:, 0] * turn) / np.mean(run.flux_linkage[-n:, 0] * turn) * INDUCTANCE
    q = np.sqrt(2j * np.pi * frequency * diffusion)
    expected = 1 + 3 * tau / diffusion * (q / np.tanh(q) - 1)
    assert ratio - 1 == pytest.approx(expected - 1, rel=0.02)
    alone = 1 + 2j * np.pi * frequency * tau
    assert abs(expected - alone) > 2 * abs(ratio - expected), "a single loop is another thing"
    assert abs(run.audit.imbalance) < 5e-6, "the fastest modes change within a step"
    assert run.audit.eddy_currents > 0


def test_the_modes_of_the_sheets_are_the_closed_form_s() -> None:
    """3 (q coth q - 1)/q^2, q^2 = j w T, within 0.02 % of it up to w T = 5 10^5: five decades above the first pole."""
    w = np.geomspace(1e-3, 5e5, 400)
    q, poles, weights = np.sqrt(1j * w), np.array(EDDY_POLES), np.array(EDDY_WEIGHTS)
    exact = 3 * (q / np.tanh(q) - 1) / q**2
    rest = 1 - np.sum(weights / poles)
    assert rest > 0
    found = (weights / (q[:, None] ** 2 + poles)).sum(axis=1) + rest
    assert np.all(np.abs(found - exact) < 2e-4 * np.abs(exact))
    assert abs(exact[-1]) < 0.05, "far beyond where one mode would do"


def test_a_run_begins_with_what_sheets_have_not_followed_yet(servo: Actuator) -> None:
    """As the rest of a run whose currents were switched on 4 ms before, of a slowest mode of 20 ms; and in the closed
    form, i = lambda/L (1 + (6 tau/T) sum exp(-n^2 pi^2 t/T))."""
    tau, diffusion, rate, before = 2e-4, 0.2, 1e4, 40
    command = np.full((240, 2), 1.0)
    command[before:] += 0.05 * np.random.default_rng(2).standard_normal((200, 2))
    own = {"time_constant": tau, "diffusion_time": diffusion}
    whole = simulate(locked(servo), linear_table(), Inputs(command, rate), effects=effects("eddy_currents", **own))
    begins = Options(currents=(float(whole.current[before, 0]), float(whole.current[before, 1])))
    missed = []
    for since in (before / rate, 0.0):
        rest = simulate(
            locked(servo), linear_table(), Inputs(command[before:], rate),
            effects=effects("eddy_currents", **own, switched_on=since), options=begins,
        )  # fmt: skip
        missed.append(np.abs(rest.voltage - whole.voltage[before:])[1:].max())
        faded = np.exp(-((np.pi * np.arange(1, 200)) ** 2) * since / diffusion).sum() if since else 0.0
        expected = INDUCTANCE * rest.current[0, 0] / (1 + 6 * tau / diffusion * faded)
        assert rest.flux_linkage[0, 0] == pytest.approx(expected, rel=2e-3)
        assert abs(rest.audit.imbalance) < 1e-4
    assert 5 * missed[0] < missed[1], "but for the loop, in which the current rises"


@pytest.mark.parametrize("at", [None, 1.2], ids=["cube", "exponential"])
def test_iron_in_series_takes_its_current_and_gives_its_energy_back(servo: Actuator, at: float | None) -> None:
    """i = u + a y/(w + y) + k y^3 with y = lambda/L_0 = u on a linear table, at rest and in a closed ledger; with a
    knee at 1.2 A the cube's square is another one below it and beyond, as Brauer's law has it."""
    a, width, k = 0.02, 0.1, 0.01
    values = effects("early_saturation", low_field_current=a, low_field_width=width, knee_excess=k)
    if at is not None:
        shape = {"low_field_current": a, "low_field_width": width, "knee_excess": k, "knee_current": at}
        values = effects("early_saturation", **shape)
    command = 1.0 + 0.5 * np.sin(2 * np.pi * 20 * np.arange(2000) / 1e4)
    run = simulate(
        locked(servo), linear_table(), Inputs(np.column_stack([command, -command]), 1e4), effects=values,
        options=Options(currents=(1.0, -1.0)),
    )  # fmt: skip
    y = run.flux_linkage / INDUCTANCE
    square = y**2 if at is None else at**2 * np.expm1(7 * (y / at) ** 2) / np.expm1(7)
    assert run.current == pytest.approx(y + a * y / (width + np.abs(y)) + k * y * square, rel=1e-9)
    assert 1.2 < y[:, 0].max() < 1.46
    assert run.flux_linkage[0, 0] == pytest.approx(-run.flux_linkage[0, 1], rel=1e-12)
    assert abs(run.audit.imbalance) < 1e-7
    assert run.audit.hysteresis == 0.0


def test_a_knee_far_beyond_a_run_leaves_next_to_nothing_of_the_excess_and_one_within_its_cube(servo: Actuator) -> None:
    """7/(e^7 - 1) of the cube far below; at the knee's current the cube itself; where 7 y^2/y_k^2 is small by a series
    that goes over into the closed form."""
    plant, surface = plant_parameters(servo), surface_of(linear_table())
    gap, currents = np.full(4, plant.nominal_gap), np.array([0.1, 0.119, 0.121, 1.0])

    def excess(**shape: float) -> np.ndarray:
        values = effects("early_saturation", knee_excess=0.01, **shape)
        y = 2 * static_map(surface, plant, values, gap=gap, current=currents)[1] / INDUCTANCE
        return (currents - y) / y**3

    assert excess() == pytest.approx(0.01, rel=1e-6)
    far = 0.01 * 7 / np.expm1(7)
    assert excess(knee_current=50.0)[3] == pytest.approx(far, rel=2e-3)
    assert excess(knee_current=10.0)[:3] == pytest.approx(far * (1 + 3.5 * (currents[:3] / 10) ** 2), rel=1e-5)
    assert excess(knee_current=0.99)[3] == pytest.approx(0.01, rel=0.05)


@pytest.mark.parametrize("name", ["low_field_current", "knee_excess"])
def test_iron_in_series_needs_a_current_that_cannot_jump(servo: Actuator, name: str) -> None:
    ideal = changed(servo, drive={"bandwidth": None})
    with pytest.raises(InputError, match=f"early_saturation.{name} needs a drive whose current cannot jump"):
        simulate(
            ideal,
            linear_table(),
            Inputs(np.full((20, 2), 0.5), 1e3),
            effects=effects("early_saturation", **{name: 0.1}),
        )


@pytest.mark.parametrize("name", ["position_sensor_lag", "amplifier_bandwidth"])
@pytest.mark.parametrize("frequency", [50.0, 500.0])
def test_a_lag_of_two_poles_is_one_pole_and_a_delay(name: str, frequency: float) -> None:
    """Poles of 62 and 28 us: one of the root of their squares' sum, and the rest of the lag a delay."""
    first, second, rate, cycle = 62e-6, 28e-6, 1e4, int(1e4 / frequency)
    share = 1 - np.hypot(first, second) / (first + second)
    loose, turns = rig(stiffness="0 N/m", damping="200 N s/m"), 2 * np.pi * np.arange(1000) / cycle
    last = slice(1000 - 4 * cycle if cycle > 100 else 600, 1000)

    def amplitude(values: EffectValues | None) -> complex:
        found = simulate(loose, None, Inputs(20 * np.sin(turns)[:, None], rate), effects=values)
        read = found.measured_position[last]
        return complex(np.mean((read - read.mean()) * np.exp(-1j * turns[last])))

    ratio = amplitude(effects(name, lag=first + second, delay_share=float(share))) / amplitude(None)
    w = 2j * np.pi * frequency
    both = 1 / ((1 + w * first) * (1 + w * second))
    assert ratio == pytest.approx(both, rel=1e-3)
    assert abs(1 / (1 + w * (first + second)) - both) > abs(ratio - both), "one pole alone is farther away"


@pytest.mark.parametrize("damping", [0.6, 0.66, 0.75, 0.9])
@pytest.mark.parametrize("linear", [False, True])
def test_a_drive_of_second_order_is_a_pole_a_delay_and_where_it_overshoots_a_zero(damping: float, linear: bool) -> None:
    """At a tenth of the natural frequency, against its transfer function; without its share nothing comes as near."""
    lag, rate, cycle = 9e-5, 1e4, 40
    natural, loose = 2 * damping / lag, rig(stiffness="0 N/m", damping="200 N s/m")
    turns = 2 * np.pi * np.arange(1000) / cycle
    spread = 1 - 1 / (2 * damping**2)
    share = 1 - np.copysign(np.sqrt(abs(spread)), spread)

    def amplitude(share: float | None) -> complex:
        values = None if share is None else effects("amplifier_bandwidth", lag=lag, delay_share=float(share))
        inputs = Inputs(20 * np.sin(turns)[:, None], rate, hold="linear" if linear else "zero-order")
        read = simulate(loose, None, inputs, effects=values).measured_position[600:]
        return complex(np.mean((read - read.mean()) * np.exp(-1j * turns[600:])))

    w = 2 * np.pi * rate / cycle
    exact = natural**2 / (natural**2 - w**2 + 2j * damping * natural * w)
    ratio, one_pole, delay = (amplitude(one) / amplitude(None) for one in (share, 0.0, 1.0))
    assert abs(ratio) == pytest.approx(abs(exact), rel=5e-4 if linear else 3e-4)
    assert np.angle(ratio) == pytest.approx(np.angle(exact), abs=5e-4)
    assert abs(ratio - exact) < (0.8 if linear else 0.5) * min(abs(one_pole - exact), abs(delay - exact))


def test_a_coil_warms_towards_its_core(servo: Actuator) -> None:
    """rho' = h P - c (rho - kappa), kappa' = r (rho - kappa) with P = R (1 + rho) i^2 at a held current."""
    h, c, r, current = 0.02, 1.5, 0.3, 2.0
    run = simulate(
        locked(servo), linear_table(), Inputs(np.full((4000, 2), [current, 0.0]), 1e3),
        effects=effects("coil_heating", rise_per_joule=h, cooling_rate=c, core_rate=r),
        options=Options(currents=(current, 0.0)),
    )  # fmt: skip
    power = 2.0 * current**2  # two coils of 1 ohm in series
    matrix = np.array([[h * power - c, c, h * power], [r, -r, 0.0], [0.0, 0.0, 0.0]])
    rise = np.array([expm(matrix * t)[0, 2] for t in run.time[::500] + 0.5e-3])
    assert run.voltage[::500, 0] / current / 2.0 - 1 == pytest.approx(rise, rel=2e-3, abs=2e-6)
    assert rise[-1] > 1.15 * rise[4], "the core goes on warming"


def test_friction_at_a_steady_velocity_falls_as_stated() -> None:
    """Push = c v + F (1 + rise/(1 + (v/v_s)^2)) at the velocities where the mover settles."""
    loose = rig(stiffness="0 N/m", damping="40 N s/m")
    values = effects("coulomb_friction", force=1.0, presliding=1e-6, stribeck_rise=0.5, stribeck_velocity=5e-3)
    for push in (1.6, 2.5):
        run = simulate(loose, None, Inputs(np.full((4000, 1), push), 2e3), effects=values)
        v = float(np.diff(run.position[-200:]).mean() * 2e3)
        assert v > 1e-3
        assert push == pytest.approx(40 * v + 1.0 + 0.5 / (1 + (v / 5e-3) ** 2), rel=1e-4)
        assert abs(run.audit.imbalance) < 1e-5


def test_friction_that_passes_zero_with_the_velocity_creeps_as_stated() -> None:
    """Push = c v + F (1 + rise/(1 + (v/v_s)^2)) tanh(v/w), below F as well, where stops would hold the mover."""
    loose = rig(stiffness="0 N/m", damping="40 N s/m")
    shape = {"transition_velocity": 5e-3, "stribeck_rise": 0.5, "stribeck_velocity": 5e-3}
    values = effects("coulomb_friction", force=1.0, **shape)
    for push in (0.5, 2.5):
        run = simulate(loose, None, Inputs(np.full((4000, 1), push), 2e3), effects=values)
        v = float(np.diff(run.position[-200:]).mean() * 2e3)
        assert v > 1e-3
        friction = (1.0 + 0.5 / (1 + (v / 5e-3) ** 2)) * np.tanh(v / 5e-3)
        assert push == pytest.approx(40 * v + friction, rel=1e-6)
        assert abs(run.audit.imbalance) < 1e-6


def test_iron_was_demagnetised_before_the_currents_rose(servo: Actuator) -> None:
    """At the start of a run with 1 A the branch is the rising one: its flux is of 1 A less the coercive current."""
    slow = changed(servo, drive={"bandwidth": 50.0}, motion={"moving_mass": 1e24})
    run = simulate(
        slow, linear_table(), Inputs(np.full((20, 2), [1.0, 0.0]), 1e3),
        effects=effects("magnetic_hysteresis", coercive_current=0.05, reversal_current=0.2),
        options=Options(currents=(1.0, 0.0)),
    )  # fmt: skip
    assert run.flux_linkage[:, 0] == pytest.approx(INDUCTANCE * 0.95, rel=1e-9)
    assert run.current[:, 0] == pytest.approx(1.0, rel=1e-9)
    wider = simulate(
        slow, linear_table(), Inputs(np.full((20, 2), [1.0, 0.0]), 1e3),
        effects=effects("magnetic_hysteresis", coercive_current=0.05, reversal_current=0.2, widening=0.02),
        options=Options(currents=(1.0, 0.0)),
    )  # fmt: skip
    u = wider.flux_linkage[:, 0] / INDUCTANCE
    assert u + 0.05 * (1 + 3 * 0.02 * (u / 0.2) ** 2) == pytest.approx(1.0, rel=1e-9)
    assert np.ptp(u) < 1e-9


COERCIVE, REVERSAL = 0.05, 0.2  # A
OF_ONE = INDUCTANCE / 2  # of one magnet, H


def broad(broadening: float, **shapes: float) -> EffectValues:
    stated = {"coercive_current": COERCIVE, "reversal_current": REVERSAL, "broadening": broadening, **shapes}
    return EffectValues({"magnetic_hysteresis": stated})


def flux_of(servo: Actuator, current: np.ndarray, values: EffectValues) -> np.ndarray:
    """Flux linkage of one magnet of demagnetised iron along a path of the current."""
    gap = np.full(current.size, 6e-4)
    return static_map(surface_of(linear_table()), plant_parameters(servo), values, gap=gap, current=current)[1]


@pytest.mark.parametrize("widening", [0.0, 0.01])
def test_a_rise_of_demagnetised_iron_and_the_fall_after_it_have_a_closed_form(servo: Actuator, widening: float) -> None:
    """i = lambda/L + p'(lambda) sum_k s_k e_k: e_k = min(z, R_k) on the rise; from its end at z_t on, what the stop had
    there less z_t - z, down to -R_k."""
    broadening, spacing, fall, decay, n = 0.8, 1.5, 0.4, 1.7, 60
    values = broad(broadening, spacing=spacing, fall=fall, decay=decay, widening=widening)
    current = np.r_[np.linspace(0.0, 2.0, n), np.linspace(2.0, -0.5, n)]
    flux = flux_of(servo, current, values)
    y, place = flux / (OF_ONE * REVERSAL), (np.arange(1, 33) / 32) ** spacing
    followed, widths = (np.arcsinh(broadening * (q + widening * q**3)) / broadening for q in (y, place))
    slopes = widths**-fall * np.exp(-decay * widths)
    slopes *= COERCIVE / (slopes @ widths)
    top = followed[n - 1]
    rise = np.minimum(followed[:n, None], widths)
    back = np.maximum(np.minimum(top, widths) - (top - followed[n:, None]), -widths)
    memory = (1 + 3 * widening * y**2) * (np.vstack([rise, back]) @ slopes)
    assert flux / OF_ONE + memory == pytest.approx(current, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("broadening", [0.0, 0.5, 1.5])
def test_a_branch_reverses_over_more_flux_where_there_is_more(servo: Actuator, broadening: float) -> None:
    """All stops have turned over after 2 lambda_r sqrt(1 + (g lambda/lambda_r)^2), lambda in the middle of the branch,
    which has the width of the major loop at any flux."""
    reversal, changes = OF_ONE * REVERSAL, []
    for top in (1.0, 2.0, 4.0):
        current = np.r_[0.0, np.linspace(top, -top, 8001)]
        flux = flux_of(servo, current, broad(broadening))
        memory = current - flux / OF_ONE
        assert memory[1] == pytest.approx(COERCIVE, rel=1e-9)
        turned = int(np.argmax(memory < -COERCIVE * (1 - 1e-9)))
        change = flux[1] - flux[turned]
        middle = (flux[1] + flux[turned]) / 2
        if broadening:
            ends = np.arcsinh(broadening * flux[[1, turned]] / reversal)
            middle = reversal / broadening * np.sinh(ends.mean())
        assert change == pytest.approx(2 * reversal * np.hypot(1, broadening * middle / reversal), rel=4e-3)
        changes.append(change)
    assert (changes[2] > 2 * changes[0]) == (broadening > 0)


def test_stops_whose_slopes_decay_are_a_smooth_exponential(servo: Actuator) -> None:
    """Of the classical density rho exp(-R/r) on a rise: rho r^2 (1 - exp(-lambda/r)), here r = lambda_r/6; the 32 stops
    of it within 1 % of the coercive current."""
    decay, current = 6.0, np.linspace(0.0, 2.0, 400)
    flux = flux_of(servo, current, broad(0.0, decay=decay))
    memory, reach = current - flux / OF_ONE, decay * flux / (OF_ONE * REVERSAL)
    expected = COERCIVE * (1.0 - np.exp(-np.minimum(reach, decay))) / (1.0 - np.exp(-decay))
    assert np.abs(memory - expected).max() < 0.01 * COERCIVE
    straight = flux_of(servo, current, broad(0.0))
    assert np.abs(current - straight / OF_ONE - expected).max() > 0.2 * COERCIVE


def test_a_small_broadening_is_of_second_order(servo: Actuator) -> None:
    """Taylor: its first term goes with its square, so that at 0 it leaves what there was."""
    current = np.r_[np.linspace(0, 2, 50), np.linspace(2, -1, 70), np.linspace(-1, 1.5, 60)]
    shapes = {"spacing": 1.5, "fall": 0.3, "widening": 0.01}
    without = flux_of(servo, current, broad(0.0, **shapes))
    change = [np.abs(flux_of(servo, current, broad(g, **shapes)) - without).max() for g in (0.01, 0.005, 0.0025)]
    assert np.log2(change[0] / change[1]) == pytest.approx(2.0, abs=0.02)
    assert np.log2(change[1] / change[2]) == pytest.approx(2.0, abs=0.01)
    assert change[2] > 1e-6 * without.max()


@pytest.mark.parametrize("widening", [0.0, 0.01])
def test_broad_loops_keep_the_ledger_on_any_path(servo: Actuator, widening: float) -> None:
    """Small loops within large ones that shrink, about no flux and beside it, of both signs."""
    values, turns = broad(1.5, spacing=1.5, fall=0.4, widening=widening), np.linspace(0.0, 6 * np.pi, 900)
    command = 0.2 + 1.2 * np.sin(turns) * (1 - turns / 30) + 0.3 * np.sin(7 * turns)
    run = simulate(
        locked(servo), linear_table(), Inputs(np.column_stack([command, -command]), 1e4), effects=values,
        options=Options(substeps=40),
    )  # fmt: skip
    assert run.current.max() > 1.2
    assert run.flux_linkage[:, 1] == pytest.approx(-run.flux_linkage[:, 0], rel=1e-12)
    assert abs(run.audit.imbalance) < 2e-8
    assert run.audit.hysteresis > 0.01 * run.audit.electrical


def test_lanes_of_broad_and_even_loops_are_single_runs_to_the_last_bit(servo: Actuator) -> None:
    """Beside broad ones, loops without broadening are what they are alone."""
    plant, surface, inputs = plant_parameters(servo), surface_of(linear_table()), rough(100)
    sets = [broad(g, widening=0.01) for g in (0.0, 1e-3, 0.5, 4.0)]
    vectors = np.array([values.vector() for values in sets])
    run = run_lanes(surface, [plant] * 4, inputs, substeps=10, settings=LaneSettings(effects=vectors))
    for lane, values in enumerate(sets):
        alone = simulate(servo, linear_table(), inputs, effects=values, options=Options(substeps=10))
        assert np.array_equal(run.flux_linkage[lane], alone.flux_linkage)
        assert np.array_equal(run.true_position[lane], alone.position)
    assert not np.array_equal(run.flux_linkage[0], run.flux_linkage[1])
