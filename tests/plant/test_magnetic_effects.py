"""The physics of each magnetic effect, where its answer is known."""

import numpy as np
import pytest
from coupled_twin import changed, linear_table, locked
from effect_sets import ALL_EFFECTS, effects

from msl_fem.actuator import Actuator
from msl_fem.plant import kernel
from msl_fem.plant.effects import N_COEFFICIENT, EffectValues, kernel_coefficients
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.layout import I1, N_INTEGRATED, V, initial_state
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.preparation import effect_coefficients, small_signal_inductance, start_effects
from msl_fem.plant.simulate import Options, Simulation, simulate
from msl_fem.table.magnetic_table import MagneticTable


def held(
    servo: Actuator, table: MagneticTable, values: EffectValues | None, *, x: float, currents: tuple[float, float]
):
    """One sample of a locked mover at x with held currents: what the magnets link there."""
    run = simulate(
        locked(servo), table, Inputs(np.array([currents] * 2), 1e4), effects=values,
        options=Options(currents=currents, position=x),
    )  # fmt: skip
    return run.flux_linkage[0]


def net_force(servo: Actuator, table: MagneticTable, values: EffectValues, *, x: float, currents: tuple[float, float]):
    """The magnets' force on the mover at rest at x, from the kernel's acceleration."""
    plant, surface = plant_parameters(servo), surface_of(table)
    e = effect_coefficients(plant, surface, values, step=1e-5, n_step=10)
    state, dy = initial_state(plant, *currents, x, 0.0), np.zeros(N_INTEGRATED)
    start_effects(surface, plant, e, state)
    assert kernel.rates_at(surface, plant, e, state, np.zeros(5), dy)
    return plant.mass * dy[V] + plant.stiffness * x


def test_a_gap_offset_is_another_nominal_gap(servo: Actuator, table: MagneticTable) -> None:
    inputs = Inputs(np.tile([0.6, 0.4], (200, 1)), 1e4)
    one = simulate(servo, table, inputs, effects=effects("gap_offset", offset=2e-5))
    two = simulate(changed(servo, motion={"nominal_gap": 6.2e-4}), table, inputs)
    assert one.position == pytest.approx(two.position, rel=1e-11, abs=1e-18)
    assert one.voltage == pytest.approx(two.voltage, rel=1e-11)


def test_centring_shifts_the_magnets(servo: Actuator, table: MagneticTable) -> None:
    flux = held(servo, table, effects("gap_offset", centring=3e-5), x=5e-5, currents=(0.7, 0.5))
    assert flux == pytest.approx(held(servo, table, None, x=2e-5, currents=(0.7, 0.5)), rel=1e-12)


def test_early_saturation_leaves_small_currents_and_lowers_large_ones(servo: Actuator, table: MagneticTable) -> None:
    """lambda = lambda_0((1 + s) i)/(1 + s): the same inductance without current, 1/(1 + s) of the flux at the knee."""
    early = effects("early_saturation", knee_shift=0.1)
    for i in (1e-3, 1.0, 6.0):
        flux = held(servo, table, early, x=0.0, currents=(i, i))[0]
        assert flux == pytest.approx(2 * float(table.flux_linkage(1.1 * i, 6e-4)) / 1.1, rel=1e-12)
    plain = [2 * float(table.flux_linkage(i, 6e-4)) for i in (1e-3, 6.0)]
    assert held(servo, table, early, x=0.0, currents=(1e-3, 0.0))[0] == pytest.approx(plain[0], rel=1e-5)
    assert held(servo, table, early, x=0.0, currents=(6.0, 0.0))[0] < 0.96 * plain[1]


def test_fringing_deepens_the_section_with_the_gap(servo: Actuator, table: MagneticTable) -> None:
    values = effects("fringing", growth=50.0, depth_error=0.01, turns_error=0.02)
    for x in (-2e-4, 1e-4):
        flux = held(servo, table, values, x=x, currents=(0.8, 0.0))[0]
        g = 6e-4 - x
        assert flux == pytest.approx(2 * 1.02 * (1.01 + 50 * g) * float(table.flux_linkage(1.02 * 0.8, g)), rel=1e-12)


@pytest.mark.parametrize("edge", [3e-5, 1.2e-4])
def test_tilt_is_the_mean_over_the_face(servo: Actuator, table: MagneticTable, edge: float) -> None:
    """The mean of 401 strips whose gaps differ by up to 30, and 120 um from 0.35 mm: the latter is beyond the second
    order, which is 7 % too little there."""
    tilt = effects("armature_tilt", gap_variance=edge**2 / 3)
    flux = held(servo, table, tilt, x=2.5e-4, currents=(0.9, 0.0))[0]
    strips = 3.5e-4 + edge * (np.arange(401) - 200) / 200.5
    mean, middle = (2 * float(np.mean(table.flux_linkage(0.9, g))) for g in (strips, 3.5e-4))
    assert flux - middle == pytest.approx(mean - middle, rel=3e-3)
    assert flux > 1.001 * middle


MAGNETIC = EffectValues(
    {name: ALL_EFFECTS.stated[name] for name in ("gap_offset", "early_saturation", "fringing", "cross_coupling")}
    | {"armature_tilt": {"gap_variance": 4e-10}}
)


def coil_flux(servo: Actuator, table: MagneticTable, x: float, i_1: float, i_2: float) -> np.ndarray:
    return held(servo, table, MAGNETIC, x=x, currents=(i_1, i_2))


def test_effects_keep_force_and_flux_derivatives_of_one_coenergy(servo: Actuator, table: MagneticTable) -> None:
    """d lambda_1/di_2 = d lambda_2/di_1, dF/di_j = d lambda_j/dx at constant currents, by central differences."""
    x, i_1, i_2, h, d = 1e-4, 1.3, 0.6, 1e-4, 1e-8
    mutual = (coil_flux(servo, table, x, i_1, i_2 + h) - coil_flux(servo, table, x, i_1, i_2 - h))[0]
    other = (coil_flux(servo, table, x, i_1 + h, i_2) - coil_flux(servo, table, x, i_1 - h, i_2))[1]
    assert mutual == pytest.approx(other, rel=1e-7)
    assert abs(mutual) > 1e-7
    slope = (coil_flux(servo, table, x + d, i_1, i_2) - coil_flux(servo, table, x - d, i_1, i_2)) / (2 * d)
    for j, (low, high) in enumerate((((i_1 - h, i_2), (i_1 + h, i_2)), ((i_1, i_2 - h), (i_1, i_2 + h)))):
        force = [net_force(servo, table, MAGNETIC, x=x, currents=c) for c in (low, high)]
        assert (force[1] - force[0]) / (2 * h) == pytest.approx(slope[j], rel=1e-5)


def test_a_share_of_one_side_s_current_magnetises_the_other(servo: Actuator, table: MagneticTable) -> None:
    flux = held(servo, table, effects("cross_coupling", share=0.05), x=0.0, currents=(1.0, 0.0))
    one, two = 2 * float(table.flux_linkage(1.0, 6e-4)), 2 * float(table.flux_linkage(0.05, 6e-4))
    assert flux == pytest.approx([one + 0.05 * two, two + 0.05 * one], rel=1e-12)


def test_eddy_currents_delay_the_flux_of_a_coil_at_a_step_of_voltage(servo: Actuator) -> None:
    """v = R i + dlambda/dt, i = lambda/L + (tau/L) dlambda/dt: lambda = L v/R (1 - exp(-t/(L/R + tau)))."""
    bench = changed(locked(servo), drive={"kind": "voltage", "bandwidth": None})
    run = simulate(
        bench, linear_table(), Inputs(np.full((200, 2), [10.0, 4.0]), 1e3),
        effects=effects("eddy_currents", time_constant=2e-3), options=Options(substeps=64),
    )  # fmt: skip
    inductance = 2 * 1.08e-5 / 6.3e-4
    lag = inductance / 2.0 + 2e-3
    flux = inductance * 5.0 * (1 - np.exp(-run.time / lag))
    assert run.flux_linkage[:, 0] == pytest.approx(flux, rel=1e-8, abs=1e-12)
    current = flux / inductance + 2e-3 / inductance * (10.0 - 2.0 * flux / inductance) / (1 + 2e-3 * 2.0 / inductance)
    assert run.current[1:, 0] == pytest.approx(current[1:], rel=1e-8)
    assert run.audit.eddy_currents > 0.004 * run.audit.copper
    assert abs(run.audit.imbalance) < 1e-9


def test_eddy_currents_delay_the_flux_behind_the_current_in_phase(servo: Actuator) -> None:
    """Flux over current is L/(1 + j w tau): at w tau = 0.5 the phase is -atan 0.5."""
    rate, n, f, tau = 100e3, 1000, 200.0, 0.5 / (2 * np.pi * 200.0)
    phase = 2 * np.pi * f * np.arange(6 * n) / rate
    command = 1.0 + 0.2 * np.sin(phase)
    run = simulate(
        locked(servo), linear_table(), Inputs(np.column_stack([command, command]), rate),
        effects=effects("eddy_currents", time_constant=tau), options=Options(currents=(1.0, 1.0)),
    )  # fmt: skip
    turn = np.exp(-1j * phase[-n:])
    ratio = np.mean(run.flux_linkage[-n:, 0] * turn) / np.mean(run.current[-n:, 0] * turn)
    held_phase = np.exp(0.5j * 2 * np.pi * f / rate)  # the current jumps with its command and is read before the jump
    expected = 2 * 1.08e-5 / 6.3e-4 / (1 + 0.5j)
    assert abs(ratio) == pytest.approx(abs(expected), rel=2e-3)
    assert np.angle(ratio) == pytest.approx(-np.arctan(0.5), abs=3 * np.angle(held_phase))
    assert np.angle(ratio) == pytest.approx(np.angle(expected), abs=0.01)


def loop(servo: Actuator, *, rate: float, periods: int = 3, n: int = 2000, **shapes: float) -> Simulation:
    """Cycles of the current between 0.1 and 1.9 A at a locked mover with hysteresis, all as fast as the samples."""
    bench = changed(servo, drive={"bandwidth": rate / 2}, motion={"moving_mass": 1e24})
    command = 1.0 - 0.9 * np.cos(2 * np.pi * np.arange(periods * n) / n)
    return simulate(
        bench, linear_table(), Inputs(np.column_stack([command, 0 * command]), rate),
        effects=effects("magnetic_hysteresis", coercive_current=0.05, reversal_current=0.2, **shapes),
        options=Options(currents=(0.1, 0.0), substeps=20),
    )  # fmt: skip


def test_the_hysteresis_loop_closes_and_does_not_depend_on_time(servo: Actuator) -> None:
    slow, slower = loop(servo, rate=10.0), loop(servo, rate=2.5)
    n = 2000
    flux = slow.flux_linkage[:, 0]
    assert flux[2 * n :] == pytest.approx(flux[n : 2 * n], rel=3e-6), "the second loop and the third are the same"
    assert flux[: n // 4] != pytest.approx(flux[n : n + n // 4], rel=1e-4), "the first rise is another branch"
    assert slower.flux_linkage[:, 0] == pytest.approx(flux, rel=1e-6), "a quarter of the speed, the same loop"


@pytest.mark.parametrize(
    "shapes",
    [
        {},
        {"spacing": 2.0, "fall": 0.6, "widening": 0.01},
        {"spacing": 2.0, "fall": 0.6, "broadening": 0.7},
        {"spacing": 2.0, "fall": 0.6, "widening": 0.01, "broadening": 2.0},
    ],
)
def test_the_loop_s_area_is_what_the_ledger_lost(servo: Actuator, shapes: dict[str, float]) -> None:
    one, two = loop(servo, rate=10.0, periods=2, **shapes), loop(servo, rate=10.0, periods=3, **shapes)
    flux, current = two.flux_linkage[4000:, 0], two.current[4000:, 0]
    area = np.sum(np.diff(np.r_[flux, flux[0]]) * (current + np.r_[current[1:], current[0]]) / 2)
    lost = two.audit.hysteresis - one.audit.hysteresis
    assert area > 0
    assert lost == pytest.approx(area, rel=1e-4)
    assert abs(two.audit.imbalance) < 1e-6


def test_branches_are_a_coercive_current_apart_and_leave_remanence(servo: Actuator) -> None:
    """In the middle of a large loop the current up exceeds that down, at equal flux, by twice the coercive current."""
    run = loop(servo, rate=10.0)
    up, down = slice(4000, 5000), slice(5000, 6000)
    middle = run.flux_linkage[5000, 0] * 0.55
    rising = np.interp(middle, run.flux_linkage[up, 0], run.current[up, 0])
    falling = np.interp(middle, run.flux_linkage[down, 0][::-1], run.current[down, 0][::-1])
    assert rising - falling == pytest.approx(2 * 0.05, rel=1e-3)
    back = np.r_[np.linspace(0, 2, 500), np.linspace(2, 0, 500), np.zeros(10)]
    slow = changed(locked(servo), drive={"bandwidth": 5.0})
    remanent = simulate(
        slow, linear_table(), Inputs(np.column_stack([back, 0 * back]), 10.0),
        effects=effects("magnetic_hysteresis", coercive_current=0.05, reversal_current=0.2),
        options=Options(substeps=20),
    )  # fmt: skip
    inductance = 2 * 1.08e-5 / 6.3e-4
    assert remanent.current[-1, 0] == pytest.approx(0.0, abs=1e-9)
    assert remanent.flux_linkage[-1, 0] == pytest.approx(0.05 * inductance, rel=0.02)


def test_coefficients_of_neutral_effects_are_ones_and_zeros(servo: Actuator, table: MagneticTable) -> None:
    plant, surface = plant_parameters(servo), surface_of(table)
    inductance = small_signal_inductance(plant, surface)
    assert inductance == pytest.approx(2 * float(table.evaluate(0.0, 6e-4)["incremental_inductance"]), rel=1e-12)
    e = kernel_coefficients(plant, EffectValues().vector(), inductance=inductance, step=1e-5, n_step=10)
    assert e.shape == (N_COEFFICIENT,)
    assert e[:8] == pytest.approx([6e-4, 6e-4, 1, 1, 0, 0, 0, 1])
    assert I1 == 0
