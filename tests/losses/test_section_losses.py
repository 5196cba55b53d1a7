"""Iron losses of a magnet: the volumes, the flux densities between nodes, the field solution as a second route."""

import numpy as np
import pytest
from sheets_and_waveforms import servo, servo_table

from msl_fem.actuator import ECore
from msl_fem.errors import InputError, OutOfTable, TableError
from msl_fem.losses import (
    PeriodicOperation,
    SectionFlux,
    iron_loss,
    iron_volumes,
    mean_period,
    sine_operation,
    sinusoidal_loss,
)
from msl_fem.magnetics.field.magnet_field import MagnetField, magnet_mesh
from msl_fem.magnetics.solver.postprocess import triangle_flux_density
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.materials.material import load_iron
from msl_fem.table.magnetic_table import MagneticTable

SHEET = 0.36e-3


@pytest.fixture(scope="module")
def table() -> MagneticTable:
    return servo_table()


def areas(mesh: TriangleMesh, region: str) -> np.ndarray:
    (x0, x1, x2), (y0, y1, y2) = mesh.points[:, mesh.triangles[:, mesh.elements(region)]]
    return np.asarray(np.abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) / 2)


def chamfered() -> ECore:
    return servo().magnet.model_copy(update={"pole_chamfer": 0.8e-3, "armature_overhang": 3e-3})


@pytest.mark.parametrize("magnet", [servo().magnet, chamfered()], ids=["plain", "chamfered"])
def test_the_volumes_are_those_of_the_mesh(magnet: ECore) -> None:
    """Sheets only: the triangles' area times depth times stacking factor."""
    mesh = magnet_mesh(magnet, 0.6e-3, "fast")
    volumes = iron_volumes(magnet)
    armature = volumes.pop("armature")
    assert sum(volumes.values()) == pytest.approx(2 * areas(mesh, "core").sum() * 0.02 * 0.96, rel=1e-9)
    assert armature == pytest.approx(2 * areas(mesh, "armature").sum() * 0.02 * 0.96, rel=1e-9)


def test_flux_density_between_the_nodes(table: MagneticTable) -> None:
    """Exact at the nodes, odd in the current, and between them what the centre leg's flux linkage says (2 %)."""
    flux = SectionFlux(table, "centre_leg")
    for m, n in ((0, 1), (5, 3), (-1, -1)):
        node = table.extras["flux_density_centre_leg"][m, n]
        assert float(flux(table.current[n], table.gap[m])) == pytest.approx(node, rel=1e-9)
    i, g = np.array([0.7, 2.3, 4.1]), np.array([0.31e-3, 0.57e-3, 0.93e-3])
    assert flux(-i, g) == pytest.approx(-flux(i, g), rel=1e-12)
    assert float(flux(0.0, 0.4e-3)) == pytest.approx(0.0, abs=1e-12)
    area = 200 * 0.01 * 0.02 * 0.96
    assert flux(i, g) == pytest.approx(table.flux_linkage(i, g) / area, rel=0.1)  # leakage: less flux links all turns
    ratio = flux(i, g) * area / table.flux_linkage(i, g)
    assert np.ptp(ratio) < 0.02


def test_sections_add_up_and_scale(table: MagneticTable) -> None:
    """Small signals: B goes with i, so the eddy-current loss with its square; each section is density times volume."""
    losses = [
        iron_loss(table, servo(), operation=sine_operation(0.0, 0.8e-3, frequency=50.0, amplitude=a), thickness=SHEET)
        for a in (0.5, 1.0)
    ]
    assert losses[1].loss is not None
    assert losses[1].core_loss is not None
    parts = {s.section: s for s in losses[1].sections}
    assert losses[1].loss == pytest.approx(sum(s.loss or 0.0 for s in parts.values()), rel=1e-12)
    assert losses[1].core_loss == pytest.approx(losses[1].loss - (parts["armature"].loss or 0.0), rel=1e-12)
    for small, large in zip(losses[0].sections, losses[1].sections, strict=True):
        assert (large.eddy_loss or 0.0) / (small.eddy_loss or 1.0) == pytest.approx(4.0, rel=0.03)
    leg = parts["centre_leg"]
    peak = float(SectionFlux(table, "centre_leg")(1.0, 0.8e-3))
    assert leg.sheet.coefficients is not None
    exact = sum(sinusoidal_loss(leg.sheet.coefficients, leg.sheet, 50.0, peak))
    assert leg.loss == pytest.approx(0.01 * 0.02 * 0.02 * 0.96 * exact, rel=0.01)


def test_sections_against_the_field_solution(table: MagneticTable) -> None:
    """The integral of B^2 over the iron by finite elements: sections say 4 to 9 % more, 15 to 35 % in the armature."""
    actuator = servo()
    magnet, i, g = actuator.magnet, 2.0, 0.6e-3
    field = MagnetField(magnet, magnet_mesh(magnet, g, "fast"), folder=actuator.folder, order=2)
    b = np.hypot(*triangle_flux_density(field.model, field.solve(i, g))) / 0.96
    for region, low, high in (("core", 1.03, 1.12), ("armature", 1.1, 1.4)):
        cells = field.model.mesh.elements(region)
        whole = 2 * 0.02 * 0.96 * float(np.sum(b[cells] ** 2 * areas(field.model.mesh, region)))
        names = ["armature"] if region == "armature" else ["centre_leg", "yoke", "outer_leg"]
        by_section = sum(iron_volumes(magnet)[n] * float(SectionFlux(table, n)(i, g)) ** 2 for n in names)
        assert low < by_section / whole < high


def test_unknown_losses_stay_unknown(table: MagneticTable) -> None:
    """A core of M-19 under an armature of M-27: the sum is not known, the core's is, and the note says why."""
    actuator = servo()
    magnet = actuator.magnet
    iron = magnet.iron.model_copy(update={"armature": "m27"})
    other = actuator.model_copy(update={"magnet": magnet.model_copy(update={"iron": iron})})
    found = iron_loss(table, other, operation=sine_operation(1.0, 0.6e-3, frequency=50.0, amplitude=0.5))
    assert found.loss is None
    assert found.core_loss is not None
    (armature,) = (s for s in found.sections if s.section == "armature")
    assert armature.loss is None
    assert (armature.eddy_loss or 0.0) > 0
    assert any("m27" in note for note in found.notes)
    assert load_iron("m27").name == "m27"


def test_a_bias_is_said(table: MagneticTable) -> None:
    about_zero = sine_operation(0.0, 0.6e-3, frequency=50.0, amplitude=1.0)
    about_bias = sine_operation(2.0, 0.6e-3, frequency=50.0, amplitude=1.0)
    assert not any("bias" in n for n in iron_loss(table, servo(), operation=about_zero).notes)
    assert any("bias" in n for n in iron_loss(table, servo(), operation=about_bias).notes)


def test_operations_that_are_refused(table: MagneticTable) -> None:
    with pytest.raises(OutOfTable):
        iron_loss(table, servo(), operation=sine_operation(0.0, 0.6e-3, frequency=50.0, amplitude=50.0))
    with pytest.raises(OutOfTable):
        iron_loss(table, servo(), operation=sine_operation(0.0, 9e-3, frequency=50.0, amplitude=1.0))
    with pytest.raises(InputError, match="two equally long rows"):
        PeriodicOperation(np.zeros(64), np.zeros(63), 50.0)
    bare = MagneticTable(table.gap, table.current, table.nodes)
    with pytest.raises(TableError, match="no flux_density_centre_leg"):
        iron_loss(bare, servo(), operation=sine_operation(0.0, 0.6e-3, frequency=50.0, amplitude=1.0))


def test_the_mean_period_of_a_run() -> None:
    """A run of 2 s that settles: its last half is periodic, and the mean of its periods is the clean one."""
    t = np.arange(20000) * 1e-4
    clean = 1.0 + 0.5 * np.sin(2 * np.pi * 50 * t)
    noise = np.random.default_rng(3).normal(size=t.size) * 0.02
    gap = 0.6e-3 + 1e-5 * np.cos(2 * np.pi * 50 * t)
    operation, apart = mean_period(t, clean + np.exp(-t / 0.1) + noise, gap, frequency=50.0)
    assert operation.current.size == 200
    assert operation.current == pytest.approx(clean[:200], abs=0.02)
    assert operation.gap == pytest.approx(gap[:200], abs=1e-9)
    assert apart == pytest.approx(0.02 / 0.354, rel=0.1)
    assert operation.current_rms == pytest.approx(np.sqrt(1 + 0.5**2 / 2), rel=1e-3)


@pytest.mark.parametrize(
    ("frequency", "said"),
    [(47.0, "must be a whole number"), (40.0, "not periodic with 40 Hz"), (1.0, "whole period"), (0.0, "not allowed"),
     (1000.0, "32 or more")],
)  # fmt: skip
def test_runs_that_are_not_periodic(frequency: float, said: str) -> None:
    t = np.arange(20000) * 1e-4
    with pytest.raises(InputError, match=said):
        mean_period(t, np.sin(2 * np.pi * 53.3 * t), np.full(t.size, 6e-4), frequency=frequency)
