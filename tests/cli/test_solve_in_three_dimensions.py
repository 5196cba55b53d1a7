"""`solve --dimension 3`: numbers, picture, VTU, progress, and what it refuses."""

from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest
from cli_paths import E1

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
POINT = ("--current", "1 A", "--gap", "1 mm", "--dimension", "3", "--accuracy", "fast")


def test_numbers_picture_and_field(msl_fem: Run, tmp_path: Path) -> None:
    picture, vtu = tmp_path / "e1.png", tmp_path / "e1.vtu"
    flat = msl_fem("solve", E1, "--current", "1 A", "--gap", "1 mm", "--accuracy", "fast", "--json").json
    solid = msl_fem("solve", E1, *POINT, "--picture", str(picture), "--vtu", str(vtu), "--json").json
    assert set(flat) - {"end_effects"} <= set(solid), "ends are no correction there"
    assert 1.0 < solid["force_N"] / flat["force_N"] < 1.05
    assert 1.1 < solid["flux_linkage_Wb"] / flat["flux_linkage_Wb"] < 1.3
    linear = solid["flux_linkage_Wb"] * 1.0 / 2
    assert solid["coenergy_J"] == pytest.approx(linear, rel=0.01)
    assert solid["force_current_slope_N_per_A"] == pytest.approx(2 * solid["force_N"], rel=0.01)
    assert 0 < solid["force_error_estimate"] < 0.05
    assert picture.read_bytes().startswith(b"\x89PNG")
    field = meshio.read(vtu)
    leg = (field.cell_data["iron"][0] == 0) & (np.linalg.norm(field.cell_data["B"][0], axis=1) > 0.2)
    assert leg.any()
    assert field.cell_data["turns"][0].any()
    mean = solid["flux_density_T"]["centre_leg"]["mean"]
    assert np.median(np.linalg.norm(field.cell_data["B"][0][leg], axis=1)) == pytest.approx(mean, rel=0.3)


def test_a_pot_core_in_three_dimensions(msl_fem: Run, tmp_path: Path) -> None:
    """Beside its section; in the VTU file boxes and flux turn about the axis."""
    pot = str(Path(E1).with_name("pot_core_holding.toml"))
    picture, vtu = tmp_path / "pot.png", tmp_path / "pot.vtu"
    flat = msl_fem("solve", pot, "--current", "1 A", "--gap", "1 mm", "--accuracy", "fast", "--json").json
    solid = msl_fem("solve", pot, *POINT, "--picture", str(picture), "--vtu", str(vtu), "--json").json
    assert solid["force_N"] == pytest.approx(flat["force_N"], rel=0.02)
    assert picture.read_bytes().startswith(b"\x89PNG")
    field = meshio.read(vtu)
    corners = field.points[field.cells[0].data]
    middle, b = corners.mean(axis=1), field.cell_data["B"][0]
    assert np.hypot(*field.points[:, [0, 2]].T).max() == pytest.approx(field.points[:, 0].max())
    assert field.points[:, 2].max() == pytest.approx(field.points[:, 0].max())
    strong = np.linalg.norm(b[:, [0, 2]], axis=1) > 0.1 * np.linalg.norm(b, axis=1)
    turned = b[:, 0] * middle[:, 2] - b[:, 2] * middle[:, 0]
    across = np.linalg.norm(b[:, [0, 2]], axis=1) * np.hypot(middle[:, 0], middle[:, 2])
    assert strong.any()
    assert np.abs(turned[strong] / across[strong]).max() < 1e-3


def test_both_magnets_in_three_dimensions(msl_fem: Run, tmp_path: Path) -> None:
    """Equal gaps and opposing currents: no net force, and more mutual flux than the plane pair's 0.28 mH."""
    both = ("--current-2", "-1 A", "--gap-2", "1 mm", "--json")
    picture, vtu = tmp_path / "pair.png", tmp_path / "pair.vtu"
    solid = msl_fem("solve", E1, *POINT, *both, "--picture", str(picture), "--vtu", str(vtu)).json
    flat = msl_fem("solve", E1, *POINT[:4], *POINT[6:], *both).json
    assert {"net_force_N", "flux_linkage_1_Wb", "coenergy_J", "notes"} <= set(flat) & set(solid)
    assert abs(solid["net_force_N"]) < 1e-3
    assert solid["flux_linkage_1_Wb"] == pytest.approx(-solid["flux_linkage_2_Wb"], rel=1e-5)
    assert solid["flux_linkage_1_Wb"] > 1.1 * flat["flux_linkage_1_Wb"]
    assert solid["mutual_inductance_H"] == pytest.approx(0.575e-3, rel=0.05)
    assert picture.read_bytes().startswith(b"\x89PNG")
    field = meshio.read(vtu)
    middle = field.points[field.cells[0].data].mean(axis=1)
    b, turns = field.cell_data["B"][0], field.cell_data["turns"][0] == 1
    legs = (field.cell_data["iron"][0] == 0) & (np.abs(middle[:, 0]) < 4e-3) & (np.abs(middle[:, 2]) < 9e-3)
    upper, lower = (b[legs & side, 1] for side in (middle[:, 1] > 3e-3, middle[:, 1] < -9e-3))
    assert middle[turns, 1].max() > 0 > middle[turns, 1].min()
    assert upper.mean() == pytest.approx(-lower.mean(), rel=1e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--dimension", "4"), "--dimension 4 is not known; choose 2 or 3"),
        (("--dimension", "3", "--current-2", "1 A", "--gap-2", "1 mm", "--tilt", "1 mrad"), "neither --tilt nor"),
    ],
)
def test_what_is_refused(msl_fem: Run, options: tuple[str, ...], message: str) -> None:
    assert message in msl_fem("solve", E1, "--current", "1 A", "--gap", "1 mm", *options).complaint
