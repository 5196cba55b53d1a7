"""Thin parts: meshed by their own thickness, their neighbours not; meshes beyond measure are refused."""

import pytest

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.magnetics.field.accuracy import LEVELS
from msl_fem.magnetics.field.magnet_field import solve
from msl_fem.magnetics.kinds.kind import MagnetKind
from msl_fem.magnetics.section import Section, rectangle
from msl_fem.magnetics.solver.mesh import MOST_TRIANGLES, refuse_too_many, triangulate

GAP = 5e-4
NORMAL = LEVELS["normal"].size


def magnet(servo: Actuator, **change: float) -> MagnetKind:
    return servo.magnet_kind().model_copy(update=change)


def test_thin_armatures_cost_in_proportion_to_their_length(servo: Actuator) -> None:
    """A core of 20 x 26 mm in squares of a foil of 0.1 mm would be 250 000 triangles."""
    sizes = {}
    for thickness in (2e-4, 1e-4):
        mesh = triangulate(magnet(servo, armature_thickness=thickness).section(GAP), NORMAL)
        core = mesh.elements("core").size
        assert core < 2000
        sizes[thickness] = mesh.triangles.shape[1] - core
    assert 1.5 < sizes[1e-4] / sizes[2e-4] < 2.5
    assert sizes[1e-4] < 10_000


def test_a_thick_armature_leaves_the_mesh_as_it_is(servo: Actuator) -> None:
    """Where the armature is no thinner than legs and yoke, one size holds in all iron."""
    assert servo.magnet_kind().section(GAP).thinnest_in("core") == pytest.approx(5e-3)
    assert servo.magnet_kind().section(GAP).thinnest_in("armature") == pytest.approx(6e-3)
    assert servo.magnet_kind().section(GAP).thinnest_in("air") is None


@pytest.mark.parametrize(("thickness", "current"), [(1e-3, 5.0), (2e-4, 1.0)])
def test_the_stated_error_covers_what_a_coarser_core_costs(servo: Actuator, thickness: float, current: float) -> None:
    thin = servo.model_copy(update={"magnet": magnet(servo, armature_thickness=thickness)})
    point = solve(thin, current, GAP)
    better = solve(thin, current, GAP, accuracy="fine")
    difference = abs(point.quantities.force / better.quantities.force - 1)
    assert difference <= point.force_error_estimate + better.force_error_estimate
    assert point.force_error_estimate < 5e-3


def test_what_would_never_end_is_refused_with_the_part_named(servo: Actuator) -> None:
    foil = magnet(servo, armature_thickness=2.1e-5, armature_overhang=0.5)
    with pytest.raises(InputError, match=r"at most 2\.5e\+05 are solved: most are for the armature, 0\.021 mm"):
        triangulate(foil.section(GAP), NORMAL)
    wide = Section(
        regions=(rectangle("core", 0, 1e-6, 1.0, 0.1), rectangle("armature", 0, -0.1, 1.0, 0.0)), corners=(), cuts=(),
        iron={"core": ("m19", 1.0), "armature": ("m19", 1.0)}, turns_density={}, depth=1.0, gap=1e-6,
    )  # fmt: skip
    with pytest.raises(InputError, match=r"most are for the gap, 0\.001 mm thin"):
        refuse_too_many(wide, NORMAL)


def test_what_is_expected_is_what_comes(servo: Actuator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Within a factor of three, where a thin part makes most of the mesh."""
    section = magnet(servo, armature_thickness=5e-5).section(GAP)
    counted = triangulate(section, NORMAL).triangles.shape[1]
    for limit, refused in ((counted / 3, True), (counted * 3, False)):
        monkeypatch.setattr("msl_fem.magnetics.solver.mesh.MOST_TRIANGLES", limit)
        if refused:
            with pytest.raises(InputError):
                refuse_too_many(section, NORMAL)
        else:
            refuse_too_many(section, NORMAL)
    assert counted < MOST_TRIANGLES
