"""Measured loops of irons and ferrites, small and large, by one law, held-out ones too; its energy by two routes."""

from pathlib import Path

import numpy as np
import pytest

from msl_fem.record import loop_law
from msl_fem.record.columns import read_columns
from msl_fem.record.loop_law import HysteresisLoopLaw, fit_loops, loop_area

DATA = Path(__file__).parents[2] / "measurements" / "bh_loops"
CORES = ("m130_27s", "mnzn_a", "mnzn_b", "mnzn_hp")


def measured(core):
    """(H A/m, B T) of each loop, as current and flux linkage of one turn on a ring of 1 m and 1 m2."""
    columns = read_columns(DATA / f"loops_{core}.csv")
    field, flux, loop = (columns[key] for key in ("H_A_per_m", "B_T", "loop"))
    return [(field[loop == n], flux[loop == n]) for n in np.unique(loop)]


@pytest.mark.parametrize("core", CORES)
def test_loops_of_every_amplitude_hold(core):
    """MagNet's two measures: the field missed along a loop over its RMS, and the error of the loop's energy."""
    law = fit_loops(measured(core))
    assert law.n_parameter <= 14
    assert max(law.sequence_error) < 0.05
    assert np.abs(law.energy_error).max() < 3e-3


@pytest.mark.parametrize("core", CORES)
def test_a_loop_that_was_left_out_is_foretold(core):
    """Between a half and five times the amplitude of those that set the law."""
    loops = measured(core)
    for left in range(1, len(loops) - 1):
        law = fit_loops([loop for n, loop in enumerate(loops) if n != left])
        field, flux = loops[left]
        missed = law.current(flux) - field
        assert np.linalg.norm(missed) < 0.06 * np.linalg.norm(field)
        assert loop_area(law.current(flux), flux) == pytest.approx(loop_area(field, flux), rel=0.12)


@pytest.mark.parametrize(("core", "least"), [("m130_27s", 0.12), ("mnzn_a", 0.08), ("mnzn_b", 0.2), ("mnzn_hp", 0.1)])
def test_equal_stops_that_follow_the_flux_itself_do_not_hold(core, least, monkeypatch):
    """Without spacing, fall and widening the energies of small loops or large ones are wrong, whatever the width."""
    monkeypatch.setattr(loop_law, "LOWEST", (0.05, 0.9999, 1e-6, 1e-6))
    monkeypatch.setattr(loop_law, "HIGHEST", (1.5, 1.0001, 1e-5, 1e-5))
    monkeypatch.setattr(loop_law, "START", (0.6, 1.0, 5e-6, 5e-6))
    assert np.abs(fit_loops(measured(core)).energy_error).max() > least


def test_the_parts_of_the_reversible_curve_are_derivatives_of_one_another():
    law = HysteresisLoopLaw(0.3, np.linspace(1.0, 2.0, 11), 0.0, 0.2, 1.0, 0.0, 0.0)
    flux, step = np.linspace(-0.28, 0.29, 40), 1e-6
    (above, _, more), (below, _, less) = law.reversible(flux + step), law.reversible(flux - step)
    current, slope, _ = law.reversible(flux)
    assert slope == pytest.approx((above - below) / (2 * step), rel=1e-6)
    assert current == pytest.approx((more - less) / (2 * step), rel=1e-6, abs=1e-6)


def test_a_loop_of_one_amplitude_costs_what_its_stops_slip():
    """sum_k 4 s_k R_k (p(top) - R_k) over the stops that slip: the area by another route than along the path."""
    law = HysteresisLoopLaw(0.3, np.ones(11), 0.7, 0.2, 1.7, 0.4, 0.3)
    place = (np.arange(1, 17) / 16) ** 1.7
    widths = 0.2 * place * (1 + 0.3 * place**2)
    slopes = widths**-0.4
    slopes *= 0.7 / (slopes @ widths)
    for top in (0.05, 0.15, 0.29):
        rise = np.linspace(-top, top, 4001)
        path = np.r_[np.linspace(0, top, 2000), np.tile(np.r_[rise[::-1], rise], 2)]
        once = slice(-rise.size * 2, None)
        followed = top * (1 + 0.3 * (top / 0.2) ** 2)
        slipped = np.clip(followed - widths, 0.0, None)
        area = loop_area(law.current(path)[once], path[once])
        assert area == pytest.approx(4 * np.sum(slopes * widths * slipped), rel=2e-4)
