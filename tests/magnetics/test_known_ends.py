"""What a kind knows of its ends: against solutions in three dimensions, by default, in a pair, in a table."""

import csv
import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT
from three_d_ends import actuator

from msl_fem.actuator import load_actuator
from msl_fem.errors import InputError
from msl_fem.magnetics.field.magnet_field import chosen_ends, field_of, solve
from msl_fem.magnetics.field.pair_field import PairField, PairQuantities, pair_magnet, pair_mesh
from msl_fem.magnetics.field.two_sided import field_of_both, solve_two_sided
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition
from msl_fem.magnetics.field_map import FieldMapSettings, decoupling_map
from msl_fem.magnetics.sweep.pair_sweep import pair_sweep
from msl_fem.magnetics.sweep.table_sweep import SweepSettings, sweep

GEOMETRIES = ROOT / "geometries"


def rows(name: str) -> list[dict[str, float]]:
    """Of a file of solutions in three dimensions."""
    lines = csv.DictReader((ROOT / "benchmarks" / f"three_d_{name}.csv").open())
    return [
        {k: float(v) for k, v in line.items() if k != "magnet"} for line in lines if line.get("magnet", "e1") == "e1"
    ]


@pytest.mark.parametrize("name", ["lifted", "fast_tool_servo", "deep", "u_core_ui60"])
def test_a_corrected_section_is_what_three_dimensions_say(name: str) -> None:
    """At points and magnets that no factor was fitted to, within what the kind states and the solution's own error."""
    it = actuator(name)
    known = it.magnet_kind().known_ends
    for row in rows(name):
        field = field_of(it, row["gap"], accuracy="fast", end_effects=True)
        found = field.quantities(field.solve(row["current"], row["gap"]))
        assert found.force == pytest.approx(row["force"], rel=known.force_error + row["force_error"])
        assert found.flux_linkage == pytest.approx(row["flux_linkage"], rel=known.flux_error + row["flux_error"])


@pytest.mark.parametrize(
    ("file", "named"), [("e1", ("E1", "reference actuator")), ("u_core_ui60", ("U-core", "the same"))]
)
def test_a_kind_states_the_largest_difference_that_was_seen(file: str, named: tuple[str, ...]) -> None:
    """Of all solutions in three dimensions in the page's table, those on finer grids included."""
    known = load_actuator(GEOMETRIES / f"{file}.toml").magnet_kind().known_ends
    lines = (ROOT / "docs" / "end_effects.md").read_text().splitlines()
    cells = [line.split("|") for line in lines if line.startswith(tuple(f"| {name}" for name in named))]
    assert len(cells) >= 2
    largest = {"force": 0.0, "flux": 0.0}
    for row in cells:
        for name, seen in zip(largest, row[4].split(", "), strict=True):
            largest[name] = max(largest[name], *(abs(float(number)) for number in re.findall(r"[+-][0-9.]+", seen)))
    for stated, name in ((known.force_error, "force"), (known.flux_error, "flux")):
        assert largest[name] <= 100 * stated + 1e-9 <= largest[name] + 0.25


def test_the_leakage_goes_with_the_turns_squared_and_the_end_turns_length() -> None:
    """E1's 0.326 mH of 200 turns; four times that with twice the turns, and longer turns in proportion."""
    magnet = load_actuator(GEOMETRIES / "e1.toml").magnet_kind()
    leakage = magnet.known_ends.factors.leakage
    assert leakage == pytest.approx(0.326e-3)
    doubled = magnet.model_copy(update={"coil": magnet.coil.model_copy(update={"turns": 2 * magnet.turns})})
    assert doubled.known_ends.factors.leakage == pytest.approx(4 * leakage)
    longer = magnet.model_copy(update={"window_width": magnet.window_width + 0.1 * magnet.centre_leg_width})
    share = (1.1 * magnet.centre_leg_width + magnet.window_width) / (magnet.centre_leg_width + magnet.window_width)
    assert longer.known_ends.factors.leakage == pytest.approx(share * leakage)


def test_ends_are_the_default_where_a_kind_has_them_and_its_file_does_not_say_none() -> None:
    servo, e1, pot = (load_actuator(GEOMETRIES / f"{n}.toml") for n in ("fast_tool_servo", "e1", "pot_core_holding"))
    assert chosen_ends(servo) == servo.magnet_kind().known_ends.factors
    assert chosen_ends(servo, False) is False
    assert chosen_ends(e1) is False
    assert chosen_ends(e1, True) == e1.magnet_kind().known_ends.factors
    assert chosen_ends(pot) is False
    with pytest.raises(InputError, match="states no ends"):
        chosen_ends(pot, True)
    plain, by_default = (
        solve(servo, 2.0, 6e-4, accuracy="fast", end_effects=ends).quantities.flux_linkage for ends in (False, None)
    )
    assert by_default > 1.1 * plain


def test_a_table_has_the_leakage_by_both_ways_and_states_what_is_left() -> None:
    """Solved in full and by a reduced field; flux linkage is the coenergy's derivative still."""
    servo = load_actuator(GEOMETRIES / "fast_tool_servo.toml")
    gaps, currents = np.geomspace(3e-4, 9e-4, 6), np.linspace(0.5, 8, 24)
    reduced, full = (
        sweep(servo, gaps, currents, settings=SweepSettings("fast", full=whole))[0] for whole in (False, True)
    )
    assert "certificate" in reduced.provenance
    for name, off in (("flux_linkage", 2e-3), ("incremental_inductance", 1e-2), ("coenergy", 2e-3)):
        assert reduced.nodes[name] == pytest.approx(full.nodes[name], rel=off), name  # the leakage is 2 to 16 % of them
    work = float(full.evaluate(2.01, 5e-4)["coenergy"] - full.evaluate(1.99, 5e-4)["coenergy"])
    assert work / 0.02 == pytest.approx(float(full.flux_linkage(2.0, 5e-4)), rel=1e-4)
    assert full.provenance["end_effects_error"] == {"force": 0.012, "flux_linkage": 0.014}
    assert full.provenance["end_factors"]["leakage"] == pytest.approx(0.326e-3)


def at(field: PairField, position: float, *currents: float) -> PairQuantities:
    solution = field.solve(position, *currents)
    return field.quantities(solution, (currents[0], currents[1]))


def test_a_pair_with_its_ends_is_near_three_dimensions() -> None:
    """Net force within 3.5 % where the plane errs by up to 28 %, flux linkages of a side that leads within 3.6 %."""
    e1 = load_actuator(GEOMETRIES / "e1.toml")
    mesh = pair_mesh(pair_magnet(e1), 6e-4, "fast")
    field = PairField(e1, mesh, gap_sum=1.2e-3, order=2, end_effects=True)
    for row in rows("pair"):
        if row["current_1"] != 6 and row["current_1"] != 3:
            continue
        found = at(field, 2e-4, row["current_1"], row["current_2"])
        assert found.force == pytest.approx(row["net_force"], rel=0.035)
        assert found.flux_linkage_1 == pytest.approx(row["flux_1"], rel=0.036)
        assert found.flux_linkage_2 == pytest.approx(row["flux_2"], rel=0.036)


def test_both_magnets_at_a_point_carry_their_ends_by_two_routes() -> None:
    """Virtual work and stress on the strips' middles; near three dimensions; a tilt has the plane section."""
    e1 = load_actuator(GEOMETRIES / "e1.toml")
    row = next(row for row in rows("pair") if row["current_2"] == 4)
    currents, place = (row["current_1"], row["current_2"]), TwoSidedPosition(row["gap_1"], row["gap_2"])
    found = solve_two_sided(e1, currents, place, accuracy="fast", end_effects=True)
    assert found.ends == e1.magnet_kind().known_ends.factors
    assert found.quantities.net_force_stress_tensor == pytest.approx(found.quantities.net_force, rel=5e-4)
    assert found.quantities.net_force == pytest.approx(row["net_force"], rel=0.035)
    assert found.quantities.flux_linkage_2 == pytest.approx(row["flux_2"], rel=0.036)
    assert not solve_two_sided(e1, currents, place, accuracy="fast").ends  # as its file says
    tilted = replace(place, tilt=1e-3)
    with pytest.raises(InputError, match="leave out end effects or the tilt"):
        solve_two_sided(e1, currents, tilted, accuracy="fast", end_effects=True)
    servo = load_actuator(GEOMETRIES / "fast_tool_servo.toml")
    assert field_of_both(servo, place, accuracy="fast").ends
    assert not field_of_both(servo, tilted, accuracy="fast").ends


def test_sides_are_compared_with_the_same_ends_as_both() -> None:
    """Far apart and with one side on the pair is two magnets; a pair with ends beside plane magnets is not."""
    servo = load_actuator(GEOMETRIES / "fast_tool_servo.toml")
    settings = FieldMapSettings(accuracy="fast", workers=1)
    found = decoupling_map(servo, levels=(1.2,), positions=(0.3e-3,), settings=settings)
    one_side_on = np.abs(found.force_error[0])[:, found.one_side_on()]
    assert np.nanmax(one_side_on) < 5e-3
    at = found.current[0, 0, 2]
    field = field_of(servo, 0.3e-3, accuracy="fast")
    densities = field.quantities(field.solve(float(at), 0.3e-3)).flux_density
    assert max(density.mean for density in densities.values()) == pytest.approx(1.2, rel=2e-3)


def test_a_pairs_numbers_are_derivatives_of_one_coenergy() -> None:
    servo = load_actuator(GEOMETRIES / "fast_tool_servo.toml")
    field = PairField(servo, pair_mesh(pair_magnet(servo), 6e-4, "fast"), gap_sum=1.2e-3, order=2, end_effects=True)
    x, i, j, dx, di = 2e-4, 5.0, -3.0, 2e-7, 5e-3
    here, low, high = at(field, x, i, j), at(field, x - dx, i, j), at(field, x + dx, i, j)
    less, more = at(field, x, i - di, j), at(field, x, i + di, j)
    assert here.force == pytest.approx((high.coenergy - low.coenergy) / (2 * dx), rel=1e-5)
    assert here.flux_linkage_1 == pytest.approx((more.coenergy - less.coenergy) / (2 * di), rel=1e-5)
    assert here.incremental_inductance_1 == pytest.approx(
        (more.flux_linkage_1 - less.flux_linkage_1) / (2 * di), rel=1e-4
    )
    assert here.mutual_inductance == pytest.approx((more.flux_linkage_2 - less.flux_linkage_2) / (2 * di), rel=1e-3)


def test_a_pairs_table_carries_its_ends() -> None:
    servo = load_actuator(GEOMETRIES / "fast_tool_servo.toml")
    grid = np.array([0.15e-3, 0.3e-3]), np.array([0.7, 2.8])
    table, _ = pair_sweep(servo, *grid, gap_sum=1.2e-3, settings=SweepSettings("fast"))
    field = PairField(servo, pair_mesh(pair_magnet(servo), 6e-4, "fast"), gap_sum=1.2e-3, order=2, end_effects=True)
    for currents in ((0.7, -2.8), (2.8, 2.8)):
        found, told = table.evaluate(0.15e-3, *currents), at(field, 0.15e-3, *currents)
        for name in ("coenergy", "flux_linkage_1", "flux_linkage_2"):
            assert float(found[name]) == pytest.approx(getattr(told, name), rel=5e-3), name
    assert table.one_sided.provenance["end_effects_error"] == table.provenance["end_effects_error"]
