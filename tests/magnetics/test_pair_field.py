"""Both sides on one mesh: derivatives of one coenergy, exchange of the sides, and the section meshed anew."""

import dataclasses

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.errors import ActuatorError
from msl_fem.magnetics.field.accuracy import LEVELS
from msl_fem.magnetics.field.pair_field import PairField, PairQuantities, pair_magnet, pair_mesh
from msl_fem.magnetics.field.two_sided import solve_two_sided
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition
from msl_fem.magnetics.solver.magnetostatics import NewtonSettings

GAP_SUM = 1.2e-3


@pytest.fixture(scope="module")
def servo() -> Actuator:
    return load_actuator(ROOT / "geometries/fast_tool_servo.toml")


@pytest.fixture(scope="module")
def field(servo: Actuator) -> PairField:
    mesh = pair_mesh(pair_magnet(servo), 2.4e-4, "fast")
    return PairField(servo, mesh, gap_sum=GAP_SUM, order=LEVELS["fast"].order)


def at(field: PairField, x: float, i: float, j: float) -> PairQuantities:
    solution = field.solve(x, i, j)
    return field.quantities(solution, (i, j))


def test_all_slopes_are_derivatives_of_one_coenergy(field: PairField) -> None:
    """Central differences at a point where the armature begins to saturate."""
    x, i, j = 3e-4, 2.0, -3.0
    q = at(field, x, i, j)
    for along, step, first, seconds in (
        ((0, 1, 0), 1e-4, "flux_linkage_1", {
            "flux_linkage_1": "incremental_inductance_1", "flux_linkage_2": "mutual_inductance",
            "force": "force_current_slope_1",
        }),
        ((0, 0, 1), 1e-4, "flux_linkage_2", {
            "flux_linkage_2": "incremental_inductance_2", "flux_linkage_1": "mutual_inductance",
            "force": "force_current_slope_2",
        }),
        ((1, 0, 0), 1e-8, "force", {
            "force": "force_position_slope", "flux_linkage_1": "force_current_slope_1",
            "flux_linkage_2": "force_current_slope_2",
        }),
    ):  # fmt: skip
        point, d = np.array([x, i, j]), step * np.array(along)
        after, before = at(field, *(point + d)), at(field, *(point - d))

        def slope(name: str, after=after, before=before, step=step) -> float:
            return (getattr(after, name) - getattr(before, name)) / (2 * step)

        assert slope("coenergy") == pytest.approx(getattr(q, first), rel=1e-6)
        for name, of in seconds.items():
            assert slope(name) == pytest.approx(getattr(q, of), rel=1e-6), of


def test_exchanging_the_sides_changes_names_alone(field: PairField) -> None:
    q, exchanged = at(field, 2e-4, 3.0, -1.5), at(field, -2e-4, -1.5, 3.0)
    assert exchanged.force == pytest.approx(-q.force, rel=1e-9)
    assert exchanged.flux_linkage_2 == pytest.approx(q.flux_linkage_1, rel=1e-9)
    assert exchanged.mutual_inductance == pytest.approx(q.mutual_inductance, rel=1e-6)
    reversed_ = at(field, 2e-4, -3.0, 1.5)
    assert reversed_.force == pytest.approx(q.force, rel=1e-9)
    assert reversed_.flux_linkage_1 == pytest.approx(-q.flux_linkage_1, rel=1e-9)


@pytest.mark.parametrize(("x", "i", "j"), [(0.0, 2.0, 1.0), (5e-4, 0.886, -5.977), (-2.5e-4, 3.0, 3.0)])
def test_it_is_what_the_section_meshed_at_its_place_says(
    servo: Actuator, field: PairField, x: float, i: float, j: float
) -> None:
    """0.1 mm and 1.1 mm at 1.2 T each, opposing: the armature saturates, and independent sides would say 95 N."""
    q = at(field, x, i, j)
    other = solve_two_sided(
        servo, (i, j), TwoSidedPosition(6e-4 - x, 6e-4 + x), accuracy="normal", end_effects=False
    ).quantities
    assert q.force == pytest.approx(other.net_force, rel=2e-3)
    assert q.flux_linkage_1 == pytest.approx(other.flux_linkage_1, rel=2e-3)
    assert q.flux_linkage_2 == pytest.approx(other.flux_linkage_2, rel=2e-3)


def test_mutual_inductance_hardly_knows_the_position(field: PairField) -> None:
    """Below saturation both fluxes meet in fixed paths: an independent solver has 0.283 to 0.290 mH over the travel.

    Were it a share of both inductances, it would grow 2.6 times.
    """
    mutual = np.array([at(field, x, 0.6, 0.6).mutual_inductance for x in (0.0, 2.5e-4, 5e-4)])
    assert mutual == pytest.approx(2.86e-4, rel=0.05)


def test_a_degree_more_moves_the_force_little(field: PairField) -> None:
    x, i, j = 3e-4, 2.0, -3.0
    assert at(field.refined(), x, i, j).force == pytest.approx(at(field, x, i, j).force, rel=3e-3)


def test_magnets_without_a_shared_armature_are_refused() -> None:
    plate = load_actuator(ROOT / "geometries/u_core.toml")
    with pytest.raises(ActuatorError, match="both sides"):
        pair_magnet(plate)


def test_sections_of_both_sides_are_read(field: PairField) -> None:
    solution = field.solve(0.0, 2.0, 1.0)
    b = field.flux_densities(solution)
    assert b["centre_leg_1"].mean > 1.5 * b["centre_leg_2"].mean
    mirrored = field.flux_densities(field.solve(0.0, 1.0, 2.0))
    assert mirrored["centre_leg_2"].mean == pytest.approx(b["centre_leg_1"].mean, rel=1e-9)
    assert {name for name in b if name[-2:] not in ("_1", "_2")} == {"armature"}
    assert dataclasses.is_dataclass(b["armature"])


def test_second_derivatives_are_those_of_refined_responses(field: PairField) -> None:
    """With the factors of another tangent, one rough step of Newton's before."""
    solution = field.solve(3e-4, 2.0, -3.0, settings=NewtonSettings(tolerance=0.1))
    found, products = field.responses(solution)
    pull, _ = field.model.strip_products(solution.potential, solution.gap)
    rights = np.stack([-pull, *field.sources])
    refined = np.stack([field.model.tangent.refined_substitute(right, solution.tangent) for right in rights])
    sizes = np.sqrt(np.outer(*2 * [np.diag(products)]))
    assert (np.abs(products - rights @ refined.T) < 1e-9 * sizes).all()
    assert (np.abs(products - rights @ found.T) > 1e-4 * sizes).any()
