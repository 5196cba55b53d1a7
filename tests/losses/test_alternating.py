"""Skin and proximity effect: limits in closed form, the slot's field by two routes, one of them the field solution."""

import math

import numpy as np
import pytest
from wound_coils import servo

from msl_fem.errors import InputError
from msl_fem.losses import SlotRows, choose_wire, negligible_below, resistance_factor, skin_depth, slot_rows
from msl_fem.magnetics.field.magnet_field import MagnetField, magnet_mesh
from msl_fem.magnetics.solver.postprocess import triangle_flux_density
from msl_fem.materials.constants import MU_0, resistivity

ROWS = SlotRows(rows=20, abreast=10, breadth=10e-3, diameter=0.71e-3)


def reduced(rows: SlotRows, frequency: float) -> float:
    height = rows.diameter * math.sqrt(math.pi) / 2
    return height * math.sqrt(rows.abreast * height / rows.breadth) / float(skin_depth(frequency))


def test_skin_depth_of_copper() -> None:
    """9.35 mm at 50 Hz and 20 degC."""
    assert float(skin_depth(50.0)) == pytest.approx(9.35e-3, rel=2e-3)


@pytest.mark.parametrize("rows", [1, 2, 20])
def test_low_and_high_frequency(rows: int) -> None:
    """F - 1 = (5 p^2 - 1)/45 D^4 for thin, F = D (1 + 2 (p^2 - 1)/3) for thick conductors (Dowell 1966)."""
    slot = SlotRows(rows, 10, 10e-3, 0.71e-3)
    low, high = 30.0, 1e8
    assert float(resistance_factor(slot, low)) - 1 == pytest.approx(
        (5 * rows**2 - 1) / 45 * reduced(slot, low) ** 4, rel=1e-3
    )
    assert float(resistance_factor(slot, high)) == pytest.approx(
        reduced(slot, high) * (1 + 2 * (rows**2 - 1) / 3), rel=1e-6
    )


def test_series_and_formula_meet() -> None:
    """No step where the series for small D gives way to the formula, and 1 at 0 Hz."""
    f = np.geomspace(1.0, 400.0, 400)
    excess = resistance_factor(ROWS, f) - 1
    assert np.abs(np.diff(np.log(excess)) / np.diff(np.log(f)) - 2).max() < 2e-2  # goes with f^2
    assert resistance_factor(ROWS, 0.0) == 1.0


def test_proximity_loss_by_the_field_at_the_wires() -> None:
    """Second route: a round wire in a transverse field B loses pi sigma w^2 B^2 d^4/128 a metre (Perry 1985).

    With the slot's field that grows evenly to mu_0 N i/w, its mean square is a third of the last. Dowell's foils have
    pi/3 times a round wire's loss: the fourth power of the side of the square of equal section.
    """
    f, sigma, turns = 200.0, 1 / resistivity(), ROWS.rows * ROWS.abreast
    b_square = (MU_0 * turns / ROWS.breadth) ** 2 / 3
    wire = math.pi * sigma * (2 * math.pi * f) ** 2 * b_square * ROWS.diameter**4 / 128
    direct = 1 / (sigma * math.pi * ROWS.diameter**2 / 4) / 2
    assert float(resistance_factor(ROWS, f)) - 1 == pytest.approx(math.pi / 3 * wire / direct, rel=5e-3)


def test_the_slots_field_is_that_of_the_field_solution() -> None:
    """The mean of B^2 over the coil, from finite elements: the field runs across the window and grows to the poles."""
    actuator = servo()
    magnet, current, gap = actuator.magnet, 1.0, 0.6e-3
    field = MagnetField(magnet, magnet_mesh(magnet, gap, "fast"), folder=actuator.folder, order=2)
    b = triangle_flux_density(field.model, field.solve(current, gap))
    mesh = field.model.mesh
    coil = mesh.elements("coil")
    (x0, x1, x2), (y0, y1, y2) = mesh.at_gap(gap)[:, mesh.triangles[:, coil]]
    area = np.abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) / 2
    mean_square = float(np.sum(b[:, coil] ** 2 * area) / area.sum())
    slot = (MU_0 * magnet.coil.turns * current / magnet.window_width) ** 2 / 3
    assert mean_square == pytest.approx(slot, rel=0.1)
    assert float(np.sum(b[0, coil] ** 2 * area)) > 0.9 * mean_square * area.sum()


def test_negligible_below() -> None:
    """For the reference coil the extra resistance passes 1 % at about 260 Hz: not negligible at its 1 kHz."""
    actuator = servo()
    rows = slot_rows(choose_wire(actuator).winding, actuator.magnet)
    limit = negligible_below(rows)
    assert limit == pytest.approx(263, rel=0.02)
    assert float(resistance_factor(rows, limit)) - 1 == pytest.approx(0.01, rel=1e-6)
    assert 0.1 < float(resistance_factor(rows, 1000.0)) - 1 < 0.2


def test_frequencies_that_are_none() -> None:
    with pytest.raises(InputError, match="not negative"):
        resistance_factor(ROWS, -1.0)
    with pytest.raises(InputError, match="finite"):
        resistance_factor(ROWS, float("nan"))
