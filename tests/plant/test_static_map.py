"""Static maps with the magnetic effects."""

import numpy as np
import pytest
from coupled_twin import changed, linear_table
from effect_sets import effects

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError, OutOfTable
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.simulate import Options, simulate
from msl_fem.plant.static_map import static_map
from msl_fem.table.magnetic_table import MagneticTable


def test_without_effects_it_is_the_table(servo: Actuator, table: MagneticTable) -> None:
    gap, current = np.array([2e-4, 6e-4, 1.1e-3]), np.array([0.5, -3.0, 11.0])
    force, flux = static_map(surface_of(table), plant_parameters(servo), EffectValues(), gap=gap, current=current)
    assert force == pytest.approx(table.force(current, gap), rel=1e-12)
    assert flux == pytest.approx(table.flux_linkage(current, gap), rel=1e-12)


def test_an_offset_and_a_depth_error(servo: Actuator, table: MagneticTable) -> None:
    values = EffectValues({"gap_offset": {"offset": 2e-5}, "fringing": {"depth_error": 0.01}})
    force, flux = static_map(surface_of(table), plant_parameters(servo), values, gap=[3e-4], current=[2.0])
    assert force[0] == pytest.approx(1.01 * float(table.force(2.0, 3.2e-4)), rel=1e-12)
    assert flux[0] == pytest.approx(1.01 * float(table.flux_linkage(2.0, 3.2e-4)), rel=1e-12)


def test_hysteresis_knows_the_order(servo: Actuator) -> None:
    """Up and down are branches apart; a new sequence begins demagnetised; a slow run of the model goes the same way."""
    table, values = linear_table(), effects("magnetic_hysteresis", coercive_current=0.05, reversal_current=0.2)
    current = np.r_[np.linspace(0, 2, 101), np.linspace(2, 0, 101)[1:]]
    gap = np.full(current.size, 6e-4)
    plant, surface = plant_parameters(servo), surface_of(table)
    force, flux = static_map(surface, plant, values, gap=gap, current=current)
    inductance = 1.08e-5 / 6.3e-4
    assert flux[150] - flux[50] == pytest.approx(2 * 0.05 * inductance, rel=1e-6)
    assert force[150] > 1.05 * force[50]
    again = static_map(surface, plant, values, gap=np.tile(gap, 2), current=np.tile(current, 2),
                       sequence=np.repeat([1, 2], current.size))[1]  # fmt: skip
    assert np.array_equal(again[current.size :], flux)
    bench = changed(
        servo, drive={"bandwidth": 5.0}, motion={"moving_mass": 1e24}, sides={"count": 1, "magnets_per_side": 1}
    )
    held = np.repeat(current, 20)
    run = simulate(bench, table, Inputs(held[:, None], 10.0), effects=values, options=Options(substeps=20))
    settled = run.flux_linkage[19::20, 0]
    assert settled == pytest.approx(flux, rel=2e-3, abs=1e-6)


def test_rows_that_cannot_be_are_refused(servo: Actuator, table: MagneticTable) -> None:
    plant, surface = plant_parameters(servo), surface_of(table)
    with pytest.raises(OutOfTable, match=r"row 1: gap 0\.002 m"):
        static_map(surface, plant, EffectValues(), gap=[6e-4, 2e-3], current=[1.0, 1.0])
    with pytest.raises(InputError, match="differ; give rows of one length"):
        static_map(surface, plant, EffectValues(), gap=[6e-4, 5e-4], current=[1.0])
