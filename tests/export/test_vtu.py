"""The VTU file holds the field that was solved."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from msl_fem.actuator import load_actuator
from msl_fem.export.vtu import write_vtu
from msl_fem.magnetics.field.magnet_field import field_of

ROOT = Path(__file__).parent.parent.parent


def test_a_reader_finds_flux_through_the_centre_leg(tmp_path: Path) -> None:
    """Mean B_y of the centre leg's triangles at mid height times its area is the flux, N times it the linkage."""
    actuator = load_actuator(ROOT / "geometries" / "e1.toml")
    field = field_of(actuator, 5e-4, accuracy="fast")
    solution = field.solve(2.0, 5e-4)
    write_vtu(field, solution, tmp_path / "f.vtu")
    read = meshio.read(tmp_path / "f.vtu")
    centres = read.points[read.cells_dict["triangle"]].mean(axis=1)
    leg = (centres[:, 0] < 0.005) & (np.abs(centres[:, 1] - 0.0105) < 0.004)
    b_y = read.cell_data["B"][0][leg, 1].mean()
    linkage = field.quantities(solution).flux_linkage
    assert abs(b_y) * 0.01 * 0.02 * 200 == pytest.approx(linkage, rel=0.02)
    assert set(read.cell_data) == {"B", "region", "solid"}
