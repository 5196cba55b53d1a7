"""Numbers read from a field: the mid-gap line, cuts, what rests on a saturation tail."""

import numpy as np
import pytest
from conftest import ROOT
from field_problems import structured_mesh

from msl_fem.actuator import load_actuator
from msl_fem.magnetics.field.magnet_field import MagnetField, field_of, magnet_mesh
from msl_fem.magnetics.section import Line, Section
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution
from msl_fem.magnetics.solver.postprocess import Probes
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import laminated, linear_iron, load_iron


@pytest.fixture(scope="module")
def e1_field() -> MagnetField:
    return field_of(load_actuator(ROOT / "geometries" / "e1.toml"), 5e-4, accuracy="fast")


def prescribed(layers: int, stacking: float = 1.0) -> tuple[FieldModel, Probes, FieldSolution]:
    """A prescribed A = 0.3 x y + 2 x - 0.5 y (Wb/m, in m) on iron below a strip of so many layers, 1 m deep."""
    g = 0.4
    y = np.r_[-1.0, -0.5, np.linspace(0, g, layers + 1), 0.9]
    mesh = structured_mesh(
        np.linspace(0, 1, 4), y, lambda u, v: "iron" if v < 0 else "strip" if v < g else "air", gap=g
    )
    model = FieldModel(mesh, {"iron": laminated(linear_iron(10.0), stacking)}, turns_density={})
    cuts = (Line("across", (0.0, -0.75), (1.0, -0.75)),)
    probes = Probes(model, Section((), (), cuts, {}, {}, depth=0.5, gap=g))
    x, y = model.basis.doflocs
    return model, probes, FieldSolution(0.3 * x * y + 2 * x - 0.5 * y, 1.0, g, ())


@pytest.mark.parametrize("layers", [1, 2, 3, 4])
def test_stress_is_integrated_over_the_whole_line_whatever_the_layers(layers):
    """With an even number of layers nodes lie in mid-gap, and triangles only touch the line there."""
    _, probes, solution = prescribed(layers)
    assert probes.line_weight.sum() == pytest.approx(1.0)
    height = probes.model.mesh.gap / 2 if layers % 2 else None
    # B_x = 0.3 x - 0.5, B_y = -(0.3 y + 2)
    b_x_squared = 0.09 / 3 - 0.3 / 2 + 0.25
    levels = [height] if height else [0.5 * 0.4 + 0.4 / layers / 2]
    wanted = ((0.3 * levels[0] + 2) ** 2 - b_x_squared) / (2 * MU_0)
    assert probes.force_stress_tensor(solution) == pytest.approx(wanted, rel=1e-10)


def test_stress_at_another_gap_sees_the_stretched_strip():
    """Stretched by s, dA/dy and with it B_x shrink by 1/s; B_y stays."""
    _, probes, solution = prescribed(3)
    doubled = FieldSolution(solution.potential, 1.0, 0.8, ())
    wanted = ((0.3 * 0.2 + 2) ** 2 - (0.09 / 3 - 0.3 / 2 + 0.25) / 4) / (2 * MU_0)
    assert probes.force_stress_tensor(doubled) == pytest.approx(wanted, rel=1e-10)


@pytest.mark.parametrize("stacking", [1.0, 0.9])
def test_cut_reads_the_flux_density_in_the_sheets(stacking):
    """At y = -0.75: |B| between sheets and insulation, and less the insulation's share in the sheets."""
    _, probes, solution = prescribed(3, stacking)
    x = np.linspace(0, 1, 20001)
    average = np.hypot(0.3 * x - 0.5, 0.3 * -0.75 + 2)
    mu_mean = stacking * 10 + (1 - stacking)
    got = probes.section_flux_density(solution.potential)["across"]
    assert got.mean == pytest.approx(average.mean() * 10 / mu_mean, rel=1e-4)
    assert got.max == pytest.approx(average.max() * 10 / mu_mean, rel=5e-3)


def test_flux_density_is_continuous_along_a_magnetic_path(e1_field):
    """No iron carries more than the coil links; the yoke, thicker than the outer leg, carries less than it."""
    got = e1_field.quantities(e1_field.solve(5.0, 5e-4))
    section = e1_field.magnet
    linked = got.flux_linkage / section.coil.turns / section.stack_depth
    leg = got.flux_density["centre_leg"].mean * section.centre_leg_width
    assert leg == pytest.approx(linked, rel=0.02)
    assert got.flux_density["yoke"].mean < got.flux_density["outer_leg"].mean < got.flux_density["centre_leg"].mean


def test_results_say_when_an_iron_rests_on_its_tail(servo):
    """m270_35a ends at 1.8 T: its core goes there at 40 A, and the armature of a longer curve does not."""
    magnet = servo.magnet
    iron = magnet.iron.model_copy(update={"core": "m270_35a_pyleecan", "armature": "pure_iron"})
    magnet = magnet.model_copy(update={"iron": iron})
    field = MagnetField(magnet, magnet_mesh(magnet, 3e-4, "fast"), folder=ROOT, order=2)
    assert field.quantities(field.solve(1.0, 3e-4)).rests_on_tail == ()
    assert field.quantities(field.solve(40.0, 3e-4)).rests_on_tail == ("core",)


def test_section_flux_density_is_in_the_iron_not_the_average(servo):
    """The sheets of a stack at 0.8 carry 1/0.8 of the average, less a little in the insulation."""
    magnet = servo.magnet
    magnet = magnet.model_copy(update={"iron": magnet.iron.model_copy(update={"stacking_factor": 0.8})})
    field = MagnetField(magnet, magnet_mesh(magnet, 3e-4, "fast"), folder=ROOT, order=2)
    solution = field.solve(6.0, 3e-4)
    got = field.quantities(solution).flux_density["centre_leg"].mean
    _, along_x, along_y, *_ = field.probes.cuts["centre_leg"]
    average = np.hypot(along_x @ solution.potential, along_y @ solution.potential).mean()
    h = float(load_iron("m19").magnetise(np.array([got]))[0][0])
    assert average == pytest.approx(0.8 * got + 0.2 * MU_0 * h, rel=1e-4)
