"""What the pointer reads in the field's figure is the field."""

from pathlib import Path

import numpy as np
import pytest

from msl_fem.actuator import load_actuator
from msl_fem.magnetics.field.magnet_field import solve_with_field
from msl_fem.report.field_picture import field_plot, flux_density_grid, painted_field

ROOT = Path(__file__).parents[2]


def test_values_under_the_pointer_are_those_of_the_field() -> None:
    """E1's iron is solid, so the centre leg's mean over a line of the grid is the section's mean."""
    actuator = load_actuator(ROOT / "geometries" / "e1.toml")
    point, field, solution = solve_with_field(actuator, 3.0, 0.5e-3, accuracy="fast")
    painted = painted_field(field, solution)
    x, y, b = flux_density_grid(painted)
    magnet = field.magnet
    leg = np.abs(x) < magnet.centre_leg_width / 2 * 1e3
    middle = (point.gap + magnet.window_height / 2) * 1e3
    row = int(np.argmin(np.abs(y - middle)))
    assert b[row, leg].mean() == pytest.approx(point.quantities.flux_density["centre_leg"].mean, rel=0.01)
    assert np.isfinite(b).all(), "all of the shown area lies in the mesh"
    np.testing.assert_allclose(b, b[:, ::-1], atol=1e-12)
    window = (np.abs(x) > magnet.centre_leg_width / 2 * 1e3 + 2) & (np.abs(x) < magnet.centre_leg_width * 1e3)
    assert b[row, window].max() < 0.2 * b[row, leg].mean()
    figure = field_plot(field, solution)
    np.testing.assert_allclose(figure.data[0].z, b, rtol=1e-6)
    image = figure.layout.images[0]
    assert (image.x, image.x + image.sizex, image.y - image.sizey, image.y) == pytest.approx(painted.area)
