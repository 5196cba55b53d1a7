"""The MAT-file, read as Simscape's block would: order, signs, consistency, and by Octave where it is there."""

import shutil
import subprocess

import numpy as np
import pytest
from conftest import saturating_reluctance
from scipy.integrate import cumulative_simpson
from scipy.io import loadmat

from msl_fem.export import table_formats


@pytest.fixture(scope="module")
def read(table, tmp_path_factory):
    target = tmp_path_factory.mktemp("mat") / "t.mat"
    assert table_formats.write_mat(table, target) == (target,)
    return loadmat(target)


def test_rows_run_over_the_current_and_columns_over_the_gap(read):
    i, x = read["i"], read["x"]
    assert i.shape == (1, 77)
    assert x.shape == (1, 77)
    wanted = saturating_reluctance(i.T, x)
    for name, quantity, sign in (
        ("Phi", "flux_linkage", 1), ("dPhi_di", "incremental_inductance", 1), ("coenergy", "coenergy", 1),
        ("dPhi_dx", "force_current_slope", -1), ("F", "force", -1),
    ):  # fmt: skip
        scale = np.abs(wanted[quantity]).max()
        np.testing.assert_allclose(read[name], sign * wanted[quantity], rtol=0, atol=2e-4 * scale, err_msg=name)


def test_the_tables_own_nodes_are_there_to_the_last_bit(read, table):
    np.testing.assert_array_equal(read["x"][0, ::4], table.gap)
    np.testing.assert_array_equal(read["i"][0, ::4], table.current)


def test_force_pulls_towards_small_gaps(read):
    """The block's page: with x an air gap between case and plunger, the tabulated force is negative."""
    assert (read["F"][1:] < 0).all()
    assert (read["dPhi_dx"][1:] < 0).all()
    assert (np.diff(read["F"][-1]) > 0).all()


def test_without_current_there_is_nothing(read):
    """What the block demands of a current vector of positive currents alone."""
    assert read["i"][0, 0] == 0
    for name in ("Phi", "dPhi_dx", "F"):
        assert (read[name][0] == 0).all()
        assert not np.signbit(read[name][0]).any()


def test_force_is_the_integral_that_the_block_takes(read):
    """F = int_0^i dPhi/dx di, by quadrature of one matrix against the other."""
    integral = cumulative_simpson(read["dPhi_dx"], x=read["i"][0], axis=0, initial=0)
    assert np.abs(integral - read["F"]).max() < 1e-4 * np.abs(read["F"]).max()


def test_derivatives_of_the_flux_are_its_derivatives(read):
    over_current = np.gradient(read["Phi"], read["i"][0], axis=0, edge_order=2)
    over_gap = np.gradient(read["Phi"], read["x"][0], axis=1, edge_order=2)
    inner = (slice(2, -2), slice(2, -2))
    assert np.abs(over_current - read["dPhi_di"])[inner].max() < 5e-3 * np.abs(read["dPhi_di"]).max()
    assert np.abs(over_gap - read["dPhi_dx"])[inner].max() < 5e-3 * np.abs(read["dPhi_dx"]).max()


def test_the_rule_and_the_errors_are_said(read):
    assert "negative pulls R towards C" in str(read["rule"][0])
    assert "Rows: current i (A); columns: air gap x (m)" in str(read["rule"][0])
    assert 1e-5 < read["linear_interpolation_error"].item() < 5e-3
    assert np.isnan(read["mesh_error"].item())


def test_octave_reads_it(table, tmp_path):
    octave = shutil.which("octave-cli") or shutil.which("octave")
    if octave is None:
        pytest.skip("octave is not installed")
    table_formats.write_mat(table, tmp_path / "t.mat")
    code = "load t.mat; printf('%.17g ', interp2(x, i', F, 0.5e-3, 5.0, 'linear'), size(Phi)); disp(rule)"
    done = subprocess.run(
        [octave, "--quiet", "--norc", "--eval", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    force, *shape = done.stdout.split()[:3]
    assert float(force) == pytest.approx(-float(table.force(5.0, 0.5e-3)), rel=1e-2)
    assert shape == ["77", "77"]
