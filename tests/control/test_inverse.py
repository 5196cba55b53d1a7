"""The input transformation: exact, monotone, one side at a time, and honest about its domain."""

import dataclasses

import numpy as np
import pytest
from conftest import saturating_reluctance
from scipy.optimize import brentq
from servo_controllers import TABLE, servo, servo_map

from msl_fem.control.inverse import (
    SideModel,
    force_domain,
    force_limits,
    held_stiffness,
    inverse_of,
    magnet_current,
    magnet_force,
)
from msl_fem.errors import InputError
from msl_fem.maps.guard import Guard
from msl_fem.maps.level_currents import operating_map
from msl_fem.plant.plant import plant_parameters, surface_of

SURFACE = surface_of(TABLE)


def inverse(*, levels: tuple[float, ...] = (1.2, 1.6), **changes: dict[str, object]):
    return inverse_of(plant_parameters(servo(**changes)), Guard(servo_map(levels)), SideModel(SURFACE, 0.6e-3))


def test_the_current_gives_the_force_back():
    rng = np.random.default_rng(1)
    for gap in rng.uniform(0.05e-3, 1.2e-3, 60):
        top = magnet_force(SURFACE, 12.0, gap)
        for share in (1e-9, 1e-4, 0.03, 0.4, 0.97, 1.0):
            current = magnet_current(SURFACE, share * top, gap, 12.0)
            assert 0 < current <= 12.0
            assert magnet_force(SURFACE, current, gap) == pytest.approx(share * top, rel=1e-10)


def test_the_current_is_that_of_a_slow_root_finder_on_the_closed_form():
    """The table's interpolation error is all that lies between."""
    rng = np.random.default_rng(2)
    for gap, force in zip(rng.uniform(0.1e-3, 1.1e-3, 20), rng.uniform(1.0, 150.0, 20), strict=True):
        truth = brentq(lambda i, g=gap, f=force: saturating_reluctance(i, g)["force"] - f, 0, 12)
        assert magnet_current(SURFACE, force, gap, 12.0) == pytest.approx(truth, rel=2e-4)


def test_the_current_grows_with_the_force():
    forces = np.linspace(0, magnet_force(SURFACE, 12.0, 0.3e-3), 200)
    currents = [magnet_current(SURFACE, f, 0.3e-3, 12.0) for f in forces]
    assert currents[0] == 0.0
    assert (np.diff(currents) > 0).all()


@pytest.mark.parametrize(
    ("force", "gap", "largest"), [(-1.0, 3e-4, 5.0), (1e9, 3e-4, 5.0), (1.0, 1e-5, 5.0), (1.0, 3e-4, 20.0)]
)
def test_outside_its_domain_there_is_no_current(force, gap, largest):
    assert np.isnan(magnet_current(SURFACE, force, gap, largest))
    assert np.isnan(magnet_current(SURFACE, np.nan, gap, largest))


def test_the_guard_bounds_the_domain():
    made = inverse()
    domain = force_domain(made, 0.2e-3)
    limit = Guard(servo_map()).limit(0.4e-3)[-1]
    assert domain.current_highest == pytest.approx(limit)
    assert domain.highest == pytest.approx(2 * float(TABLE.force(limit, 0.4e-3)), rel=1e-12)
    assert domain.lowest == pytest.approx(-force_domain(made, -0.2e-3).highest, rel=1e-12)


def test_the_drive_bounds_the_domain_and_parallel_coils_share_its_current():
    series, parallel = inverse(drive={"current_limit": 1.5}), inverse(
        drive={"current_limit": 3.0}, sides={"connection": "parallel"}
    )  # fmt: skip
    one, two = force_domain(series, 0.0), force_domain(parallel, 0.0)
    assert (one.current_highest, two.current_highest) == (1.5, 3.0)
    assert one.highest == two.highest == pytest.approx(2 * float(TABLE.force(1.5, 0.6e-3)))


def test_beyond_the_map_and_without_a_side_there_is_no_force():
    assert force_domain(inverse(), 0.58e-3).highest == 0.0
    single = force_domain(inverse(sides={"count": 1}), 0.0)
    assert single.lowest == 0.0
    assert single.highest > 100.0


def test_limits_over_many_positions_are_those_of_single_ones():
    made, x = inverse(), np.linspace(-0.5e-3, 0.5e-3, 7)
    domains = [force_domain(made, float(p)) for p in x]
    np.testing.assert_array_equal(force_limits(made, x), [[d.lowest for d in domains], [d.highest for d in domains]])


@pytest.mark.parametrize("position", [-0.4e-3, -0.1e-3, 0.2e-3, 0.45e-3])
def test_held_stiffness_is_the_slope_of_the_force_at_held_current(position):
    force = 1.4e5 * position
    gap, h = 0.6e-3 - abs(position), 1e-8
    current = magnet_current(SURFACE, abs(force) / 2, gap, 12.0)
    slope = 2 * (magnet_force(SURFACE, current, gap - h) - magnet_force(SURFACE, current, gap + h)) / (2 * h)
    assert held_stiffness(inverse(), force, position) == pytest.approx(slope, rel=1e-5)
    assert held_stiffness(inverse(), 0.0, position) == 0.0


def test_a_force_beyond_the_domain_cannot_be_held():
    with pytest.raises(InputError, match="outside the"):
        held_stiffness(inverse(drive={"current_limit": 0.3}), 100.0, 0.0)


def test_a_table_whose_force_does_not_grow_is_refused():
    slope = np.array(TABLE.nodes["force_current_slope"])
    slope[10, 4] *= -1
    bad = dataclasses.replace(TABLE, nodes={**TABLE.nodes, "force_current_slope": slope})
    with pytest.raises(InputError, match="does not grow with the current"):
        inverse_of(plant_parameters(servo()), Guard(servo_map()), SideModel(surface_of(bad), 0.6e-3))


def test_a_map_beyond_the_table_is_refused():
    inner = dataclasses.replace(
        TABLE, gap=TABLE.gap[2:], nodes={k: v[2:] for k, v in TABLE.nodes.items()},
        extras={k: v[2:] for k, v in TABLE.extras.items()},
    )  # fmt: skip
    with pytest.raises(InputError, match="reach beyond the table's"):
        inverse_of(plant_parameters(servo()), Guard(servo_map()), SideModel(surface_of(inner), 0.6e-3))
    assert (
        inverse_of(plant_parameters(servo()), Guard(operating_map(inner)), SideModel(surface_of(inner), 0.6e-3)).magnets
        == 2
    )
