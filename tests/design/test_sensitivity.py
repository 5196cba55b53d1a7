"""Sensitivities against closed forms, a second route, and their own step."""

import numpy as np
import pytest
from small_magnets import HERE, job, nominal, nominal_of, wide_open

from msl_fem.design.tolerances.manufactured import NAMES, ManufacturingTolerance, manufactured_field
from msl_fem.design.tolerances.sensitivity import QUANTITIES, ManufacturingSolver, Sensitivity, sensitivities

LEVEL = (0.3,)


def tolerances(magnet, *names: str) -> list[ManufacturingTolerance]:  # type: ignore[no-untyped-def]
    nominal_values = {"gap": None, "stacking_factor": 1.0, "bh_polarisation": 1.0, "bh_field_strength": 1.0}
    return [
        ManufacturingTolerance(name, nominal_values.get(name, getattr(magnet, name, None)), 0.0, "", "test")
        for name in names
    ]


def by_name(found: tuple[Sensitivity, ...]) -> dict[str, Sensitivity]:
    return {s.tolerance.name: s for s in found}


@pytest.fixture(scope="module")
def linear() -> dict[float, dict[str, Sensitivity]]:
    """The wide-open magnet at two gaps, by name of the quantity."""
    found = {}
    for gap in (0.1e-3, 0.4e-3):
        nominal_job = nominal(wide_open(), gap)
        asked = job(nominal_job, gap, current=0.1, levels=LEVEL)
        names = ("gap", "centre_leg_width", "outer_leg_width", "stack_depth", "bh_field_strength")
        found[gap] = by_name(sensitivities(asked, tolerances(nominal_job.magnet, *names), HERE)[1])
    return found


def test_the_force_falls_with_the_square_of_the_gap(linear: dict[float, dict[str, Sensitivity]]) -> None:
    """F ~ (N i)^2 mu_0 A / g^2 where the gap takes all the field; fringing, of order g/width, takes a little."""
    narrow, wide = linear[0.1e-3]["gap"], linear[0.4e-3]["gap"]
    assert narrow.force == pytest.approx(-2, abs=0.03)
    assert wide.force == pytest.approx(-2, abs=0.1)
    assert narrow.force < wide.force
    assert narrow.flux_linkage == pytest.approx(-1, abs=0.1)
    assert narrow.current[0, 0, 0] == pytest.approx(1, abs=0.1), "B ~ i/g"


def test_the_stack_depth_is_exactly_linear(linear: dict[float, dict[str, Sensitivity]]) -> None:
    for found in linear.values():
        assert found["stack_depth"].force == pytest.approx(1, abs=1e-9)
        assert found["stack_depth"].flux_linkage == pytest.approx(1, abs=1e-9)
        assert found["stack_depth"].current == pytest.approx(0, abs=1e-9)


def test_the_force_grows_with_the_legs_area(linear: dict[float, dict[str, Sensitivity]]) -> None:
    """Centre and outer legs in series, each with half of the reluctance: F ~ 1/(1/A_c + 1/A_o), one half each."""
    narrow = linear[0.1e-3]
    for name in ("centre_leg_width", "outer_leg_width"):
        assert narrow[name].force == pytest.approx(0.5, abs=0.05)
        assert narrow[name].flux_linkage == pytest.approx(0.5, abs=0.08), "what leaks passes beside the faces"


def test_an_iron_that_takes_no_field_does_not_matter(linear: dict[float, dict[str, Sensitivity]]) -> None:
    assert abs(linear[0.4e-3]["bh_field_strength"].force) < 1e-3


@pytest.fixture(scope="module")
def saturated() -> dict[str, Sensitivity]:
    gap = 0.3e-3
    nominal_job = nominal_of("fast_tool_servo", gap)
    asked = job(nominal_job, gap, current=3.0, levels=(1.2, 1.6), sections=("centre_leg", "outer_leg"))
    names = ("gap", "centre_leg_width", "stack_depth", "bh_polarisation", "stacking_factor")
    wanted = [
        ManufacturingTolerance(t.name, 0.96 if t.name == "stacking_factor" else t.nominal, 0.0, "", "")
        for t in tolerances(nominal_job.magnet, *names)
    ]
    return by_name(sensitivities(asked, wanted, HERE)[1])


def test_the_gaps_sensitivity_is_the_exact_derivative(saturated: dict[str, Sensitivity]) -> None:
    """Two routes: differences of solutions; back-substitution of one solution's tangent."""
    gap = 0.3e-3
    field = manufactured_field(nominal_of("fast_tool_servo", gap), {})
    at = field.quantities(field.solve(3.0, gap))
    assert saturated["gap"].force == pytest.approx(at.force_gap_slope * gap / at.force, rel=1e-4)
    assert saturated["gap"].flux_linkage == pytest.approx(-at.force_current_slope * gap / at.flux_linkage, rel=1e-4)


@pytest.fixture(scope="module")
def solver() -> ManufacturingSolver:
    nominal_job, sections = nominal_of("fast_tool_servo", 0.3e-3), ("centre_leg", "outer_leg")
    return job(nominal_job, 0.3e-3, current=3.0, levels=(1.2, 1.6), sections=sections).solver()


@pytest.mark.parametrize("name", ["gap", "outer_leg_width", "bh_polarisation"])
def test_magnets_near_the_nominal_one_are_off_by_the_square_of_their_deviation(
    name: str, solver: ManufacturingSolver
) -> None:
    """Two routes to a made magnet: the nominal one's fields with their adjoints, and fields of its own (Taylor's test).

    Sections' currents saturated and not, force and flux linkage; with no deviation they are the same.
    """
    nominal_value = {"gap": 0.3e-3, "bh_polarisation": 1.0}.get(name) or getattr(solver.job.nominal.magnet, name)

    def off(share: float) -> np.ndarray:
        deviation = dict.fromkeys(NAMES, 0.0) | {name: share * nominal_value}
        near, own = solver._by_adjoints(deviation), solver._in_full(deviation, by_section=True)
        assert near is not None
        return np.array([np.abs(near[q] / own[q] - 1).max() for q in QUANTITIES])

    assert off(0.0).max() < 1e-9
    far, half = off(0.01), off(0.005)
    assert far.max() < 1e-3
    assert far / half == pytest.approx([4.0] * 3, abs=0.4)


def test_differences_do_not_depend_on_their_step(saturated: dict[str, Sensitivity]) -> None:
    for name, found in saturated.items():
        assert found.step_error < (6e-3 if name.startswith("bh") else 3e-3), name


def test_iron_in_the_stack_counts_as_polarisation_does(saturated: dict[str, Sensitivity]) -> None:
    """s J(H) p is symmetric in s and p but for the air between the sheets."""
    assert saturated["stacking_factor"].force == pytest.approx(saturated["bh_polarisation"].force, rel=0.02)


def test_a_wider_leg_needs_more_current_for_its_own_level_only(saturated: dict[str, Sensitivity]) -> None:
    centre, outer = saturated["centre_leg_width"].current[:, 0, 0]
    assert centre > 0.3
    assert outer < -0.2


def test_a_solid_iron_is_judged_from_below() -> None:
    """A stacking factor of 1 cannot rise; the one-sided differences agree with the central ones of 0.98's side."""
    gap = 0.3e-3
    nominal_job = nominal_of("e1", gap)
    wanted = [ManufacturingTolerance("stacking_factor", 1.0, 0.0, "", "")]
    solid = sensitivities(job(nominal_job, gap, current=4.0, levels=(1.2,)), wanted, HERE)[1][0]
    assert np.isfinite(solid.force)
    forces = []
    for stacking in (0.999, 0.997):
        field = manufactured_field(nominal_job, {"stacking_factor": stacking - 1})
        forces.append(field.quantities(field.solve(4.0, gap)).force)
    near = (np.log(forces[0]) - np.log(forces[1])) / (np.log(0.999) - np.log(0.997))
    assert solid.force == pytest.approx(near, rel=0.05)
