"""What a change of geometry or iron does to the force, by amounts that closed forms give."""

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import ECore, load_actuator
from msl_fem.magnetics.field.magnet_field import MagnetField, magnet_mesh
from msl_fem.magnetics.solver.postprocess import FieldQuantities
from msl_fem.materials.constants import MU_0

E1 = load_actuator(ROOT / "geometries" / "e1.toml").magnet
STIFF = "linear:100000"  # iron without a drop worth naming


def changed(core: str, armature: str, stacking: float = 1.0, **dimensions: float) -> ECore:
    iron = E1.iron.model_copy(update={"core": core, "armature": armature, "stacking_factor": stacking})
    return E1.model_copy(update={"iron": iron, **dimensions})


def field(magnet: ECore, current: float, gap: float) -> FieldQuantities:
    it = MagnetField(magnet, magnet_mesh(magnet, gap, "fast"), folder=ROOT, order=2)
    return it.quantities(it.solve(current, gap))


def test_chamfer_takes_the_face_away_at_a_small_gap():
    """dP/dg of the poles in series, each a face and its corners' flux paths (Roters 1941): an arc of a quarter turn
    outside a plain corner, g + (pi/2) x long; at 45 degrees an arc of an eighth, g + (pi/4) x."""
    gap, chamfer = 1e-4, 1e-3

    def permeance(g: float, c: float) -> float:
        arc = np.pi / 2 if c == 0 else np.pi / 4
        reach = E1.window_width / 2 if c == 0 else c * 2**0.5
        corner = np.log1p(arc * reach / g) / arc
        centre = (E1.centre_leg_width / 2 - c) / g + corner
        outer = (E1.outer_leg_width - 2 * c) / g + 2 * corner
        return 1 / (1 / centre + 1 / outer)

    def estimate(c: float) -> float:
        step = 1e-4 * gap
        return -(permeance(gap + step, c) - permeance(gap - step, c)) / (2 * step)

    plain = field(changed(STIFF, STIFF), 0.5, gap)
    cut = field(changed(STIFF, STIFF, pole_chamfer=chamfer), 0.5, gap)
    assert cut.force / plain.force == pytest.approx(estimate(chamfer) / estimate(0.0), rel=0.03)
    assert cut.force < 0.8 * plain.force


def test_chamfer_concentrates_the_flux_of_a_saturating_core():
    """Where the flux is given by the iron, a smaller face makes a higher B^2 A: the force rises."""
    plain = field(changed("analytic:e1", "analytic:e1"), 2.0, 1e-4)
    cut = field(changed("analytic:e1", "analytic:e1", pole_chamfer=1e-3), 2.0, 1e-4)
    assert cut.flux_linkage < plain.flux_linkage
    assert cut.force > 1.02 * plain.force


@pytest.mark.parametrize("overhang", [1e-3, 4e-3])
def test_wider_armature_adds_the_outer_edge_s_fringe(overhang):
    """Two gaps of equal width in series; the outer edge's field, that met the armature's side, meets its surface."""
    gap = 5e-4
    plain = field(changed(STIFF, STIFF), 2.0, gap)
    wide = field(changed(STIFF, STIFF, armature_overhang=overhang), 2.0, gap)
    fringe = gap * np.log1p(np.pi * overhang / (2 * gap)) * 2 / np.pi  # of the width, upper bound: nothing was there
    gain = wide.flux_linkage / plain.flux_linkage - 1
    assert 0.1 * fringe / (2 * E1.outer_leg_width) < gain < fringe / (2 * E1.outer_leg_width)
    assert wide.force > plain.force


@pytest.mark.parametrize("part", ["armature", "core"])
def test_a_poorer_iron_adds_its_reluctance(part):
    """mu_r 300 in one of both: 1/lambda rises by l/(mu_0 mu_r A) of that part; leakage and corners: a fifth."""
    mu_r, gap, current = 300.0, 5e-4, 1.0
    poor = f"linear:{mu_r:g}"
    good = field(changed(STIFF, STIFF), current, gap)
    bad = field(changed(poor if part == "core" else STIFF, poor if part == "armature" else STIFF), current, gap)
    across = E1.centre_leg_width / 4 + E1.window_width + E1.outer_leg_width / 2
    legs = 2 * (E1.window_height + E1.yoke_thickness / 2) / E1.outer_leg_width  # a half section's legs are 5 mm each
    path = across / E1.armature_thickness if part == "armature" else across / E1.yoke_thickness + legs
    # a half section's circuit in one depth: gap 2 g/w, with the fringe that its flux linkage shows
    gaps = E1.coil.turns**2 * current * 2 * E1.stack_depth * MU_0 / good.flux_linkage
    want = 1 / (1 + path / mu_r / gaps)
    assert bad.flux_linkage / good.flux_linkage == pytest.approx(want, abs=0.2 * (1 - want))
    assert bad.force / good.force == pytest.approx(want**2, abs=0.2 * (1 - want**2))


def test_stacking_factor_of_linear_iron_is_a_permeability():
    """Sheets and insulation side by side along the flux: mu = s mu_r + 1 - s; the sheets carry nearly B/s."""
    half = field(changed("linear:1000", "linear:1000", 0.5), 1.0, 5e-4)
    same = field(changed("linear:500.5", "linear:500.5"), 1.0, 5e-4)
    full = field(changed("linear:1000", "linear:1000"), 1.0, 5e-4)
    assert half.force == pytest.approx(same.force, rel=1e-6)
    assert half.flux_linkage == pytest.approx(same.flux_linkage, rel=1e-6)
    assert 0.85 < half.force / full.force < 0.97  # the gap's own reluctance stays
    sheets, mean = half.flux_density["centre_leg"].mean, same.flux_density["centre_leg"].mean
    assert sheets / mean == pytest.approx(1000 / 500.5, rel=1e-6)


def test_stacking_factor_of_saturated_iron_scales_the_flux():
    """Deep in saturation the legs carry s J_s and the air its own: the force falls nearly like s^2."""
    s = 0.8
    full, less = (field(changed("m19", "m19", k), 12.0, 1e-4) for k in (1.0, s))
    assert s**2 < less.force / full.force < s**2 + 0.08
    assert s < less.flux_linkage / full.flux_linkage < s + 0.08
    assert less.flux_density["centre_leg"].mean == pytest.approx(full.flux_density["centre_leg"].mean, rel=0.03)
