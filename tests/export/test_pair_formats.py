"""A pair's table as CSV and MAT-file, read back as their users do; what cannot leave with it is refused."""

import csv
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from scipy.interpolate import RegularGridInterpolator
from scipy.io import loadmat

from msl_fem.table.pair_table import PairTable, read_pair_table

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
PAIR = str(ROOT / "lookup_tables" / "fast_tool_servo_pair.nc")
SERVO = str(ROOT / "geometries" / "fast_tool_servo.toml")


@cache
def pair() -> PairTable:
    return read_pair_table(PAIR)


def test_a_lookup_in_three_dimensions_gives_force_and_flux(msl_fem: Run, tmp_path: Path) -> None:
    target = tmp_path / "pair.mat"
    assert msl_fem("export", PAIR, "--to", "mat", "-o", str(target)).status == 0
    content = loadmat(target)
    axes = [content[name].ravel() for name in ("x", "i_1", "i_2")]
    rng = np.random.default_rng(4)
    points = rng.uniform([-4e-4, -5, -5], [4e-4, 5, 5], (200, 3))
    truth = pair().evaluate(*points.T)
    for short, name in (("F", "force"), ("Phi_2", "flux_linkage_2")):
        found = RegularGridInterpolator(axes, content[short])(points)
        error = np.abs(found - truth[name]).max() / np.abs(content[short]).max()
        assert error <= content["linear_interpolation_error"].item() * 1.5
    assert "Equal signs of the currents aid" in content["rule"].item()
    every = np.ix_(*(range(0, a.size, 2) for a in axes))
    assert np.allclose(content["F"][every], pair().nodes["force"], rtol=1e-9, atol=1e-9)


def test_a_row_of_the_csv_is_a_node(msl_fem: Run, tmp_path: Path) -> None:
    target = tmp_path / "pair.csv"
    assert msl_fem("export", PAIR, "--to", "csv", "-o", str(target)).status == 0
    with target.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == pair().nodes["force"].size
    row = rows[1234]
    at = [float(row[name]) for name in ("position_m", "current_1_A", "current_2_A")]
    assert float(row["force_N"]) == pytest.approx(float(pair().evaluate(*at)["force"]), rel=1e-9)


@pytest.mark.parametrize("what", [("mat",), ("c", "--what", "table"), ("c", "--what", "guard")])
def test_what_is_of_one_magnet_is_made_of_its_table(msl_fem: Run, tmp_path: Path, what: tuple[str, ...]) -> None:
    target = tmp_path / "made"
    complaint = msl_fem("export", SERVO, "--table", PAIR, "--to", *what, "-o", str(target)).complaint
    assert "is of two magnets with one armature" in complaint
    assert not target.exists()
