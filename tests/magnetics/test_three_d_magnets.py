"""Magnets in three dimensions: the plane limit, what the ends do, the U-core, and what is refused."""

import builtins
from pathlib import Path

import numpy as np
import pytest

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.errors import InputError
from msl_fem.magnetics.field.magnet_field import solve
from msl_fem.magnetics.three_d.magnet_boxes import magnet_boxes
from msl_fem.magnetics.three_d.magnet_point import read_point, solve_solid
from msl_fem.magnetics.three_d.scalar_potential import solve_potential
from tests.magnetics.field_problems import reference

GEOMETRIES = Path(__file__).parents[2] / "geometries"


@pytest.fixture(scope="module")
def e1() -> Actuator:
    return load_actuator(GEOMETRIES / "e1.toml")


def with_magnet(actuator: Actuator, **changes: object) -> Actuator:
    stated = actuator.magnet.model_dump(mode="python") | changes
    return actuator.model_copy(update={"magnet": type(actuator.magnet).model_validate(stated)})


def plane_point(actuator: Actuator, current: float, gap: float):
    model = magnet_boxes(actuator.magnet_kind(), gap, actuator.folder, ends=False)
    return read_point(model, solve_potential(model.problem(0.6), current), gap)


def test_one_layer_between_flux_lines_is_the_plane_section(e1: Actuator) -> None:
    """Nonlinear, against the converged values of the plane problem; E1 in saturation."""
    rows = reference("reference.csv")
    (row,) = rows[(rows["current_A"] == 6) & (rows["gap_mm"] == 0.5)]
    point = plane_point(e1, 6.0, 0.5e-3)
    assert point.force == pytest.approx(row["force_N"], rel=3e-3)
    assert point.flux_linkage == pytest.approx(row["flux_linkage_Wb"], rel=3e-3)
    assert point.coenergy == pytest.approx(row["coenergy_J"], rel=3e-3)


def test_one_layer_of_constant_permeability_is_the_linear_plane_section(e1: Actuator) -> None:
    rows = reference("reference_linear.csv")
    (row,) = rows[(rows["current_A"] == 1) & (rows["gap_mm"] == 0.5)]
    iron = e1.magnet.iron.model_copy(update={"core": "linear:1000", "armature": "linear:1000"})
    point = plane_point(with_magnet(e1, iron=iron.model_dump()), 1.0, 0.5e-3)
    assert point.force == pytest.approx(row["force_N"], rel=3e-3)
    assert point.flux_linkage == pytest.approx(row["flux_linkage_Wb"], rel=3e-3)
    assert point.incremental_inductance == pytest.approx(point.flux_linkage, rel=1e-6)


def test_one_layer_of_a_u_core_is_its_plane_section() -> None:
    """Two coils, a plane of symmetry that the field crosses at right angles, sheets with insulation between them."""
    u_core = load_actuator(GEOMETRIES / "u_core_ui60.toml")
    flat, point = solve(u_core, 1.0, 0.5e-3, end_effects=False), plane_point(u_core, 1.0, 0.5e-3)
    assert point.force == pytest.approx(flat.quantities.force, rel=4e-3)
    assert point.flux_linkage == pytest.approx(flat.quantities.flux_linkage, rel=4e-3)


def test_ends_add_flux_and_take_force_in_saturation(e1: Actuator) -> None:
    """At 6 A and 0.5 mm a grid of 75 600 unknowns gives 210.6 N and 69.12 mWb; the plane section 245.1 and 65.19."""
    shares: list[int] = []
    point, _, _ = solve_solid(e1, 6.0, 0.5e-3, accuracy="fast", progress=lambda done, _: shares.append(done))
    assert point.force == pytest.approx(210.6, rel=5e-3)
    assert point.flux_linkage == pytest.approx(69.12e-3, rel=3e-3)
    assert point.force_stress == pytest.approx(point.force, rel=0.01)
    assert abs(point.force - 210.6) < point.force_error * 210.6 < 4.0
    assert shares == sorted(shares)
    assert shares[-1] == 100


def test_a_pot_core_is_its_axisymmetric_section() -> None:
    """Saturated steel; a quarter of a turn in three boxes, beside a vector potential in the half plane."""
    pot = load_actuator(GEOMETRIES / "pot_core_holding.toml")
    section = solve(pot, 2.0, 0.3e-3, accuracy="fast").quantities
    point, model, solution = solve_solid(pot, 2.0, 0.3e-3, accuracy="fast")
    assert model.copies * model.grid(0.5).cells[2] >= 12
    assert point.force == pytest.approx(section.force, rel=5e-3)
    assert point.force_stress == pytest.approx(section.force, rel=5e-3)
    assert point.flux_linkage == pytest.approx(section.flux_linkage, rel=5e-3)
    assert point.coenergy == pytest.approx(section.coenergy, rel=6e-3)
    assert point.flux_density["post"].mean == pytest.approx(section.flux_density["post"].mean, rel=5e-3)
    assert point.flux_density["ring"].mean == pytest.approx(section.flux_density["ring"].mean, rel=5e-3)
    around = solution.state.strength[..., 2]
    assert np.abs(around).max() < 1e-4 * np.abs(solution.state.strength).max()


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"pole_chamfer": 0.5e-3}, "take no chamfered poles"), (None, "solved for e-core, u-core and pot-core")],
    ids=["chamfer", "plunger"],
)
def test_what_the_boxes_cannot_be_is_refused(e1: Actuator, changes: dict[str, float] | None, message: str) -> None:
    other = with_magnet(e1, **changes) if changes else load_actuator(GEOMETRIES / "roters_plunger.toml")
    with pytest.raises(InputError, match=message):
        solve_solid(other, 1.0, 0.5e-3, accuracy="fast")


def test_a_pot_core_of_sheets_is_refused() -> None:
    pot = load_actuator(GEOMETRIES / "pot_core_holding.toml")
    iron = pot.magnet.iron.model_copy(update={"stacking_factor": 0.95})
    with pytest.raises(InputError, match="pot core of solid iron"):
        solve_solid(with_magnet(pot, iron=iron.model_dump()), 1.0, 0.5e-3, accuracy="fast")


def test_without_pyamg_one_line_says_what_to_install(e1: Actuator, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *args: object, **kwargs: object) -> object:
        if name == "pyamg":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"pip install 'msl-fem\[three-d\]'"):
        solve_solid(e1, 1.0, 0.5e-3, accuracy="fast")


def test_the_coil_of_a_quarter_holds_the_ampere_turns_of_the_magnet(e1: Actuator) -> None:
    """T_0 in the leg times the coil's height is N i, and its curl ends where the coil ends."""
    coil = magnet_boxes(e1.magnet_kind(), 0.5e-3, e1.folder).coil
    x = np.array([0.0, 4e-3, 5.9e-3, 10e-3, 14.1e-3])
    inside = coil.current_potential(x, np.full(5, 10e-3), np.zeros(5)) * 16e-3
    assert inside == pytest.approx([200, 200, 200, 100, 0])
    corner = coil.current_potential(np.array([5e-3 + 5e-3 / np.sqrt(2)]), np.array([10e-3]), 10e-3 + 5e-3 / np.sqrt(2))
    assert corner * 16e-3 == pytest.approx([100])
