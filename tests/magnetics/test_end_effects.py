"""End effects: closed form against a solved section, one coenergy for flux and force, size and limits, the sweep."""

import math

import numpy as np
import pytest
from conftest import ROOT
from random_cores import random_core

from msl_fem.actuator import Actuator, ECore, load_actuator
from msl_fem.magnetics.field.between_legs import REACH, excess_between
from msl_fem.magnetics.field.end_effects import (
    EndFactors,
    EndSection,
    FlushEdges,
    corner_excess,
    deeper_air,
    gap_edges,
    window_factor,
)
from msl_fem.magnetics.field.magnet_field import MagnetField, magnet_mesh
from msl_fem.magnetics.solver.postprocess import FieldQuantities
from msl_fem.magnetics.sweep.table_sweep import SweepSettings, sweep

GRID = ([2e-4, 6e-4], [2.0, 8.0])


@pytest.fixture(scope="module")
def e1() -> Actuator:
    return load_actuator(ROOT / "geometries" / "e1.toml")


@pytest.fixture(scope="module")
def field(e1) -> MagnetField:
    magnet = e1.magnet
    return MagnetField(magnet, magnet_mesh(magnet, 4e-4, "fast"), folder=ROOT, order=2, end_effects=EndFactors())


def at(field: MagnetField, current: float, gap: float) -> FieldQuantities:
    return field.quantities(field.solve(current, gap))


def both(magnet: ECore) -> tuple[MagnetField, MagnetField]:
    """Without and with end effects, on one mesh."""
    mesh = magnet_mesh(magnet, 4e-4, "fast")
    off, on = (MagnetField(magnet, mesh, folder=ROOT, order=2, end_effects=e) for e in (False, EndFactors()))
    return off, on


def with_linear_iron(magnet: ECore, **change: float) -> ECore:
    iron = magnet.iron.model_copy(update={"core": "linear:100000", "armature": "linear:100000"})
    return magnet.model_copy(update={"iron": iron, **change})


@pytest.mark.parametrize("height", [0.5, 2.0, 5.0])
def test_closed_form_agrees_with_a_solved_section(height):
    """Flux of two flush edges up to a height in gaps; the section's blocks are 40 gaps high, the formula's endless."""
    solved = EndSection(1.0, 40.0, 40.0).excess(height=height)
    assert corner_excess(2 * height)[0] / 2 == pytest.approx(solved, rel=5e-3)


def test_front_face_alone_has_the_known_excess():
    """(2 - ln 4)/pi: the limit of no side face."""
    assert corner_excess(1e-9)[0] == pytest.approx((2 - math.log(4)) / math.pi, abs=1e-5)


@pytest.mark.parametrize("ratio", [1.0, 3.0, 10.0, 100.0])
def test_closed_form_is_near_roters_probable_flux_paths(ratio):
    """A half cylinder and a half shell in series of two corners: 0.26 + ln(1 + h/s)/pi."""
    assert corner_excess(ratio)[0] / 2 == pytest.approx(0.26 + math.log1p(ratio) / math.pi, abs=0.05)


@pytest.mark.parametrize("gap", [1e-5, 3e-4, 5e-3])
def test_derivatives_of_the_factor(gap):
    edges, step = FlushEdges(20e-3, 6e-3), 1e-4 * gap
    _, slope, bend = edges.factor(gap)
    low, high = edges.factor(gap - step), edges.factor(gap + step)
    assert slope == pytest.approx((high[0] - low[0]) / (2 * step), rel=1e-6)
    assert bend == pytest.approx((high[1] - low[1]) / (2 * step), rel=1e-6)


def test_height_that_counts(e1):
    """The geometric mean of the heights at which the force is lost, by quadrature; at most the armature's thickness."""
    magnet = e1.magnet
    coil, low = magnet.coil, magnet.coil.face_clearance
    share = magnet.outer_leg_width / (magnet.centre_leg_width / 2 + magnet.outer_leg_width)
    heights = low + (np.arange(4000) + 0.5) / 4000 * share * coil.height
    assert gap_edges(magnet.stack_ends).reach == pytest.approx(np.exp(np.log(heights).mean()), rel=1e-5)
    thin = magnet.model_copy(update={"armature_thickness": 1e-3})
    assert gap_edges(thin.stack_ends).reach == 1e-3
    bare = magnet.model_copy(update={"coil": coil.model_copy(update={"face_clearance": 0.0})})
    assert gap_edges(bare.stack_ends).reach == pytest.approx(share * coil.height / math.e)


def test_deep_stack_needs_no_correction(e1):
    air = deeper_air(e1.magnet.model_copy(update={"stack_depth": 1e3}).stack_ends, 5e-4)
    k, slope, bend = air.strip(5e-4)
    assert k == pytest.approx(1, abs=1e-5)
    assert abs(slope) * 5e-4 < 1e-5
    assert abs(bend) * 5e-4**2 < 1e-5
    assert air.regions["window"](np.array([[8e-3, 8e-3], [0.0, 1e-2]])) == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_window_of_other_magnets_has_a_plausible_factor(seed):
    """Above that of the closed form for the smaller leg's face, below that of faces ten times as high."""
    magnet = random_core(np.random.default_rng(seed), largest=12e-3)
    window, smaller = magnet.window_width, min(magnet.centre_leg_width / 2, magnet.outer_leg_width)
    low, high = (1 + window * corner_excess(2 * n * smaller / window)[0] / magnet.stack_depth for n in (1, 10))
    assert low < window_factor(magnet.stack_ends) < high


@pytest.mark.parametrize(("current", "gap"), [(1.0, 6e-4), (10.0, 2e-4), (12.0, 9e-4)])
def test_flux_and_forces_are_derivatives_of_one_coenergy(field, current, gap):
    """Unsaturated and saturated: F = -dW'/dg, lambda = dW'/di, dF/di = -dlambda/dg, dF/dg, by central differences."""
    got = at(field, current, gap)
    dg, di = 1e-3 * gap, 1e-3 * current
    narrow, wide = at(field, current, gap - dg), at(field, current, gap + dg)
    less, more = at(field, current - di, gap), at(field, current + di, gap)
    assert got.force == pytest.approx((narrow.coenergy - wide.coenergy) / (2 * dg), rel=1e-5)
    assert got.flux_linkage == pytest.approx((more.coenergy - less.coenergy) / (2 * di), rel=1e-5)
    assert got.force_current_slope == pytest.approx((narrow.flux_linkage - wide.flux_linkage) / (2 * dg), rel=1e-4)
    assert got.force_current_slope == pytest.approx((more.force - less.force) / (2 * di), rel=1e-4)
    assert got.force_gap_slope == pytest.approx((wide.force - narrow.force) / (2 * dg), rel=1e-4)


def test_stress_in_mid_gap_agrees_with_virtual_work(field):
    got = at(field, 2.0, 6e-4)
    assert got.force_stress_tensor == pytest.approx(got.force, rel=5e-3)


def test_refined_field_is_corrected_too(field):
    """One degree more changes the force by the mesh's error, not by the correction."""
    assert at(field.refined(), 12.0, 8e-4).force == pytest.approx(at(field, 12.0, 8e-4).force, rel=5e-3)


def test_small_correction_is_the_first_order_change_of_the_coenergy(e1):
    """dW' = -dW at fixed A, so the force changes by d/dg of what the correction takes off the plane field's energy."""
    magnet = with_linear_iron(e1.magnet, stack_depth=20.0)
    off, on = both(magnet)
    gap, current, step = 6e-4, 1.0, 6e-6

    def taken_off(g: float) -> float:
        a = off.solve(current, g).potential
        return off.probes.scale * (off.model.energy(a, g) - on.model.energy(a, g))

    expected = (taken_off(gap - step) - taken_off(gap + step)) / (2 * step)
    change = at(on, current, gap).force - at(off, current, gap).force
    assert change == pytest.approx(expected, rel=5e-3)


def test_unsaturated_force_and_flux_grow_with_gap_over_depth(e1):
    """At a given magnetomotive force F goes with k - g k' = 1 + 2 h/(D q), about 1 + 2 g/(pi D); flux with k."""
    magnet = with_linear_iron(e1.magnet)
    off, on = both(magnet)
    for gap in (3e-4, 9e-4):
        plain, corrected = at(off, 1.0, gap), at(on, 1.0, gap)
        k, slope, _ = gap_edges(magnet.stack_ends).factor(gap)
        assert k - gap * slope == pytest.approx(1 + 2 * gap / (math.pi * magnet.stack_depth), rel=0.02)
        gain = (corrected.force / plain.force - 1) / (k - gap * slope - 1)
        assert 0.65 < gain < 1  # below 1 by what the plane section has of fringe itself
        assert corrected.flux_linkage / plain.flux_linkage > k


def test_without_correction_the_stiffness_is_that_of_the_plane(e1):
    magnet = e1.magnet
    model = MagnetField(magnet, magnet_mesh(magnet, 4e-4, "fast"), folder=ROOT, order=2).model
    a = np.zeros(model.n_dof)
    a[model.free] = np.random.default_rng(0).normal(size=model.free.size)
    (strip,) = model.strips
    x, y, rest = strip.x, strip.y, model._rest
    s = 3e-4 / model.mesh.gap
    first, second = model.strip_products(a, 3e-4)
    expected = s * (x @ a) + (y @ a) / s + rest @ a
    off = np.abs(model.linear_product(a, 3e-4) - expected)[model.free]
    assert off.max() <= 1e-14 * np.abs(expected).max()
    assert np.array_equal(first, (x @ a - (y @ a) / s**2) / model.mesh.gap)
    assert np.array_equal(second, 2 * (y @ a) / s**3 / model.mesh.gap**2)


def test_sweep_states_the_correction_and_keeps_its_rows_apart(e1, tmp_path):
    plain, _ = sweep(e1, *GRID, settings=SweepSettings("fast", cache=tmp_path))
    corrected, report = sweep(e1, *GRID, settings=SweepSettings("fast", cache=tmp_path, resume=True, end_effects=True))
    again, second = sweep(e1, *GRID, settings=SweepSettings("fast", cache=tmp_path, resume=True))
    assert report.reused_rows == 0
    assert second.reused_rows > 0
    assert np.array_equal(again.nodes["force"], plain.nodes["force"])
    assert plain.provenance["end_effects"].startswith("none")
    assert "closed form" in corrected.provenance["end_effects"]
    assert (corrected.nodes["flux_linkage"][:, 1:] > plain.nodes["flux_linkage"][:, 1:]).all()


def test_saturated_iron_takes_no_more_flux(field, e1):
    """The extra flux goes through the same iron: in saturation flux linkage grows by less than the gap's permeance."""
    magnet = e1.magnet
    off = MagnetField(magnet, field.model.mesh, folder=ROOT, order=2)
    gap = 2e-4
    small, large = (at(field, i, gap).flux_linkage / at(off, i, gap).flux_linkage - 1 for i in (0.5, 12.0))
    assert 0 < large < small
    assert at(field, 12.0, gap).force < at(off, 12.0, gap).force


@pytest.mark.parametrize(("upper", "lower", "mirror"), [(0.6, 0.5, True), (2.5, 0.3, True), (1.2, 1.2, False)])
def test_kept_excess_is_that_of_a_solved_section(upper, lower, mirror):
    """Two routes: the polynomial, and a section across the legs; what is beyond the polynomial's reach is solved."""
    kept = excess_between(upper, lower, mirror=mirror)
    assert kept == pytest.approx(EndSection(1.0, upper, lower, mirror=mirror).excess(), rel=5e-4 if mirror else 2e-3)


def test_beyond_the_reach_nothing_is_kept():
    assert excess_between(math.exp(REACH) * 1.01, 1.0, mirror=True) is None
    assert excess_between(1.0, math.exp(-REACH) / 1.01, mirror=True) is None
    assert excess_between(math.exp(REACH) * 0.99, 1.0, mirror=True) is not None
