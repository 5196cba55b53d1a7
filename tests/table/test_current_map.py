"""A map over two currents: a coenergy comes back, and what is none is stated and not hidden."""

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.table.current_map import CurrentMap, fit_current_map

ONE, TWO = np.linspace(-10, 10, 17), np.linspace(-12, 12, 21)


def saturating(i: Array, j: Array, order: tuple[int, int]) -> Array:
    """W' = 0.4 i + s (sqrt(1 + (i^2/2 + j^2)/9) - 1), s = 3 J: a magnet with remanence and cross-saturation."""
    root = np.sqrt(1 + (i**2 / 2 + j**2) / 9)
    return {(1, 0): 0.4 + 3 * i / 18 / root, (0, 1): 3 * j / 9 / root}[order]


def fluxes(noise: float = 0.0, swirl: float = 0.0) -> tuple[Array, Array]:
    """Both flux linkages, with noise (Wb) and a part that has no coenergy: `swirl` times (-j, i)."""
    i, j = np.meshgrid(ONE, TWO, indexing="ij")
    rng = np.random.default_rng(3)
    one, two = (saturating(i, j, order) + noise * rng.standard_normal(i.shape) for order in ((1, 0), (0, 1)))
    return one - swirl * j, two + swirl * i


@pytest.fixture(scope="module")
def exact() -> CurrentMap:
    return fit_current_map(ONE, TWO, *fluxes())


def test_a_coenergy_comes_back_between_the_nodes(exact: CurrentMap) -> None:
    i, j = np.random.default_rng(1).uniform([-10, -12], [10, 12], (200, 2)).T
    one, two = exact.flux_linkages(i, j)
    assert one == pytest.approx(saturating(i, j, (1, 0)), abs=8e-3)
    assert two == pytest.approx(saturating(i, j, (0, 1)), abs=8e-3)
    assert exact.defect_coarse < 0.05


def test_it_is_reciprocal_to_rounding(exact: CurrentMap) -> None:
    h = 1e-4
    one = [exact.flux_linkages(3.3, 2.2 + s * h)[0] for s in (1, -1)]
    two = [exact.flux_linkages(3.3 + s * h, 2.2)[1] for s in (1, -1)]
    assert (one[0] - one[1]) == pytest.approx(two[0] - two[1], rel=1e-6)


def test_noise_is_smoothed_and_left_in_the_residuals() -> None:
    made = fit_current_map(ONE, TWO, *fluxes(noise=5e-3))
    assert np.sqrt(np.mean(made.residual_1**2)) == pytest.approx(5e-3, rel=0.35)
    i, j = np.meshgrid(ONE[2:-2], TWO[2:-2], indexing="ij")
    error = made.flux_linkages(i.ravel(), j.ravel())[0] - saturating(i, j, (1, 0)).ravel()
    assert np.sqrt(np.mean(error**2)) < 3e-3


def test_what_no_coenergy_has_is_stated_by_the_cell_and_not_fitted() -> None:
    """A swirl c (-j, i) has the circulation 2 c times the area of every cell, and stays in the residuals."""
    made = fit_current_map(ONE, TWO, *fluxes(swirl=1e-3))
    plain = fit_current_map(ONE, TWO, *fluxes())
    area = np.diff(ONE)[:, None] * np.diff(TWO)[None, :]
    assert made.circulation - plain.circulation == pytest.approx(2e-3 * area, abs=1e-12)
    coarse = (ONE[2:] - ONE[:-2])[:, None] * (TWO[2:] - TWO[:-2])[None, :]
    assert made.circulation_coarse - plain.circulation_coarse == pytest.approx(2e-3 * coarse, abs=1e-12)
    assert np.sqrt(np.mean(made.residual_1**2)) > 10 * np.sqrt(np.mean(plain.residual_1**2))


def test_an_exact_mirror_image_is_told(exact: CurrentMap) -> None:
    assert any("mirror image in current_2" in note for note in exact.notes)
    assert not any("mirror" in note for note in fit_current_map(ONE, TWO, *fluxes(noise=1e-4)).notes)


def test_a_measured_machine() -> None:
    """A synchronous machine's published map (measurements/pmsyrm_flux_map): its defect is the one that others found."""
    data = np.genfromtxt(ROOT / "measurements/pmsyrm_flux_map/flux_map_400rpm.csv", delimiter=",", names=True)
    i, j = np.unique(data["i_d_A"]), np.unique(data["i_q_A"])
    d, q = (data[name].reshape(i.size, j.size) for name in ("psi_d_Vs", "psi_q_Vs"))
    made = fit_current_map(i, j, d, q)
    assert made.defect == pytest.approx(0.051, abs=0.002)
    assert made.defect_coarse == pytest.approx(0.027, abs=0.003)
    assert np.sqrt(np.mean(made.residual_1**2)) < 5e-4
    assert np.sqrt(np.mean(made.residual_2**2)) < 1e-3
    worst = np.unravel_index(np.argmax(np.abs(made.circulation)), made.circulation.shape)
    assert (i[worst[0]], abs(j[worst[1]] + 1)) == (2.0, 1.0)
    assert len(made.notes) == 1


def test_outside_and_bad_maps_are_refused(exact: CurrentMap) -> None:
    one, two = fluxes()
    with pytest.raises(InputError, match="not extrapolated"):
        exact.flux_linkages(10.1, 0.0)
    with pytest.raises(InputError, match="6 or more"):
        fit_current_map(ONE[:5], TWO, one[:5], two[:5])
    with pytest.raises(InputError, match="shape"):
        fit_current_map(ONE, TWO, one.T, two)
    with pytest.raises(InputError, match="finite"):
        fit_current_map(ONE, TWO, np.where(one == one.max(), np.nan, one), two)
