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
    assert set(flat) <= set(solid)
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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--dimension", "4"), "--dimension 4 is not known; choose 2 or 3"),
        (("--dimension", "3", "--current-2", "1 A"), "--dimension 3 solves one magnet"),
    ],
)
def test_what_is_refused(msl_fem: Run, options: tuple[str, ...], message: str) -> None:
    assert message in msl_fem("solve", E1, "--current", "1 A", "--gap", "1 mm", *options).complaint
