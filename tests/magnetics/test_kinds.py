"""Kinds of magnets against meshes and closed forms, and a toy kind of one file through all rooms."""

import tomllib
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import pytest
from conftest import ROOT
from field_problems import REFERENCE
from foreign_meshes import boxed, foreign
from published_magnets import roters

from msl_fem.actuator import Actuator, load_actuator, parse_actuator
from msl_fem.actuator.tolerances import LENGTHS
from msl_fem.design.tolerances.manufactured import tolerances_of
from msl_fem.errors import ActuatorError, InputError
from msl_fem.files.dimensions import Length
from msl_fem.losses import Cooling, choose_wire, iron_loss, thermal_network
from msl_fem.losses.section_loss import PeriodicOperation
from msl_fem.magnetics.field.foreign_mesh import solve_mesh_magnet
from msl_fem.magnetics.field.magnet_field import field_of, solve, solve_with_field
from msl_fem.magnetics.field.plunger import solve_plunger
from msl_fem.magnetics.field.two_sided import solve_two_sided
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition
from msl_fem.magnetics.field_map.level_map import FieldMapSettings, field_map
from msl_fem.magnetics.kinds.kind import PlaneMagnet, WindingSpace
from msl_fem.magnetics.kinds.parts import Air, Coil, IronSpec
from msl_fem.magnetics.section import IronPart, Line, Section, rectangle
from msl_fem.magnetics.sweep.table_sweep import SweepSettings, sweep
from msl_fem.materials.constants import MU_0
from msl_fem.report.field_picture import draw_field, save_picture

UI60 = ROOT / "geometries" / "u_core_ui60.toml"
ROTERS = ROOT / "geometries" / "roters_plunger.toml"
POT = ROOT / "geometries" / "pot_core_holding.toml"


@pytest.fixture(scope="module")
def u_core() -> Actuator:
    """Its plane section, as a mesh from a file has it."""
    return load_actuator(UI60).model_copy(update={"end_effects": "none"})


@pytest.mark.parametrize(("current", "gap"), [(1.0, 2.5e-3), (4.0, 0.5e-3)])
def test_a_u_core_is_the_mesh_of_its_whole_section(
    u_core: Actuator, tmp_path: Path, current: float, gap: float
) -> None:
    """Half the section with a free potential on x = 0 against all of it, force by another route: 0.1 %."""
    near = boxed(u_core)
    ours = solve(near, current, gap).quantities
    theirs = solve_mesh_magnet(foreign(near, gap, tmp_path), current).quantities
    assert theirs.force == pytest.approx(ours.force, rel=1e-3)
    assert theirs.flux_linkage == pytest.approx(ours.flux_linkage, rel=1e-3)
    assert theirs.coenergy == pytest.approx(ours.coenergy, rel=1e-3)


class Toy(PlaneMagnet):
    """A yokeless bar of iron in a coil over a plate: one leg on x = 0, no circuit, surface or ends stated."""

    TOLERANCED: ClassVar = ("width", "stack_depth")

    kind: Literal["toy"]
    width: Length
    window_height: Length
    yoke_thickness: Length
    armature_thickness: Length
    armature_overhang: Length
    stack_depth: Length
    coil: Coil
    iron: IronSpec
    air: Air | None = None

    @property
    def half_width(self) -> float:
        return self.width / 2

    def section(self, gap: float) -> Section:
        half, top, low = self.half_width, gap + self.height, -self.armature_thickness
        coil = self.coil
        left, bottom = half + coil.leg_clearance, gap + coil.face_clearance
        box = self.air_box.around(half=half, wide=self.armature_half_width, below=-low, above=self.height)
        bar = rectangle("core", 0, gap, half, top)
        plate = rectangle("armature", 0, low, self.armature_half_width, 0)
        regions = (
            rectangle("air", 0, -box.below, box.edge, gap + box.above),
            rectangle("strip", 0, 0, box.edge, gap),
            plate,
            bar,
            rectangle("coil", left, bottom, left + coil.width, bottom + coil.height),
        )
        middle = gap + self.height / 2
        return Section(
            regions=regions,
            corners=((half, gap, 1.0), (half, 0.0, 0.5), (half, top, 0.1), (self.armature_half_width, 0.0, 0.2)),
            cuts=(
                Line("bar", (0, middle), (half, middle)),
                Line("plate", (2 * half, low), (2 * half, 0)),
            ),
            iron=self.iron.by_region,
            turns_density={"coil": self.turns / self.winding_space.area},
            depth=self.stack_depth,
            gap=gap,
            far=box.far,
            parts=(IronPart("bar", "core", bar.vertices), IronPart("plate", "armature", plate.vertices)),
        )

    @property
    def winding_space(self) -> WindingSpace:
        coil = self.coil
        perimeter = 2 * (self.stack_depth + self.width)
        return WindingSpace(1, perimeter, coil.leg_clearance, coil.width, coil.height, coil.width, perimeter)


@pytest.fixture(scope="module")
def toy() -> Actuator:
    """The toy in an actuator; a file would need its name in `Magnet`, which is one line of the package."""
    magnet = Toy.model_validate(
        {
            "kind": "toy", "width": "10 mm", "window_height": "20 mm", "yoke_thickness": "5 mm",
            "armature_thickness": "8 mm", "armature_overhang": "20 mm", "stack_depth": "20 mm",
            "coil": {
                "turns": 200, "width": "6 mm", "height": "18 mm", "leg_clearance": "1 mm", "face_clearance": "3 mm",
                "fill_factor": 0.5,
            },
            "iron": {"core": "m19", "armature": "m19", "stacking_factor": 0.96},
        }
    )  # fmt: skip
    return Actuator(schema=1, name="toy").model_copy(update={"magnet": magnet})


@pytest.mark.filterwarnings("ignore:Pydantic serializer warnings")  # the toy is not in `Magnet`
def test_a_toy_kind_of_one_file_goes_through_all_rooms(toy: Actuator, tmp_path: Path) -> None:
    """Field, both sides, table, map by field, losses, wire, tolerances, picture: none of them names the kind."""
    point, field, solution = solve_with_field(toy, 2.0, 1e-3, accuracy="fast")
    assert point.quantities.force == pytest.approx(point.quantities.force_stress_tensor, rel=5e-3)
    assert set(point.quantities.flux_density) == {"bar", "plate"}
    table, _ = sweep(toy, [6e-4, 1e-3, 1.5e-3], [1.0, 2.0, 3.0], settings=SweepSettings(accuracy="fast"))
    assert float(table.force(2.0, 1e-3)) == pytest.approx(point.quantities.force, rel=0.02)
    made = field_map(toy, [6e-4, 1.5e-3], levels=[0.3], settings=FieldMapSettings(accuracy="fast"))
    assert np.all(np.diff(made.current) > 0)
    volumes = field.section.iron_volumes
    assert volumes["bar"] == pytest.approx(0.96 * 0.02 * 0.01 * 0.025)
    operation = PeriodicOperation(np.sin(np.arange(64) / 32 * np.pi), np.full(64, 1e-3), 50.0)
    loss = iron_loss(table, toy, operation=operation)
    assert {section.section for section in loss.sections} == set(volumes)
    assert choose_wire(toy).winding.turns == 200
    names = [tolerance.name for tolerance in tolerances_of(toy)]
    assert [name for name in names if name in LENGTHS] == [name for name in LENGTHS if name in Toy.TOLERANCED]
    both = solve_two_sided(toy, (2.0, 0.0), TwoSidedPosition(1e-3, 2e-3), accuracy="fast").quantities
    assert 0.5 < both.net_force / point.quantities.force < 1.5
    save_picture(draw_field(field, solution, title="toy"), tmp_path / "toy.png")
    assert (tmp_path / "toy.png").stat().st_size > 10_000


def test_what_a_kind_does_not_state_is_refused_with_the_reason(toy: Actuator) -> None:
    with pytest.raises(InputError, match="states no ends of a stack"):
        sweep(toy, [6e-4, 1e-3], [1.0, 2.0], settings=SweepSettings(accuracy="fast", end_effects=True))
    with pytest.raises(InputError, match="surfaces are not"):
        thermal_network(toy, Cooling())


@pytest.fixture(scope="module")
def pot_core() -> Actuator:
    return load_actuator(POT)


def test_a_pot_core_of_ideal_iron_tends_to_its_two_gaps_in_series(pot_core: Actuator) -> None:
    """F = Phi^2/(2 mu_0) (1/A_post + 1/A_ring), what is beyond it, the fringe, goes with the gap."""
    ideal = pot_core.magnet.iron.model_copy(update={"core": "linear:1e7", "armature": "linear:1e7"})
    magnet = pot_core.magnet.model_copy(update={"iron": ideal})
    inside = magnet.half_width - magnet.ring_width
    areas = np.pi * np.array([magnet.post_diameter**2 / 4, magnet.half_width**2 - inside**2])
    beyond, leaking = [], []
    for gap in (2e-4, 1e-4, 5e-5):
        quantities = solve(pot_core.model_copy(update={"magnet": magnet}), 1.0, gap).quantities
        flux = magnet.turns * MU_0 / gap / np.sum(1 / areas)
        beyond.append(quantities.force / (flux**2 / (2 * MU_0) * np.sum(1 / areas)) - 1)
        assert quantities.force_stress_tensor == pytest.approx(quantities.force, rel=3e-4)
        leaking.append(quantities.flux_density["post"].mean * areas[0] / flux - 1)
    assert beyond[0] / beyond[1] == pytest.approx(2.0, abs=0.3)
    assert np.array(leaking[:2]) / leaking[1:] == pytest.approx(2.0, abs=0.3)
    assert 0 < beyond[2] < 0.01


@pytest.mark.parametrize("file", [UI60, POT], ids=["u-core", "pot-core"])
def test_force_and_flux_are_the_coenergys_slopes(file: Path) -> None:
    actuator = load_actuator(file)
    field = field_of(actuator, 5e-4, accuracy="fast")

    def coenergy(current: float, gap: float) -> float:
        return field.quantities(field.solve(current, gap)).coenergy

    point, h, d = field.quantities(field.solve(1.5, 5e-4)), 1e-4, 1e-3
    by_gap = (coenergy(1.5, 5e-4 * (1 + h)) - coenergy(1.5, 5e-4 * (1 - h))) / (2 * h * 5e-4)
    by_current = (coenergy(1.5 + d, 5e-4) - coenergy(1.5 - d, 5e-4)) / (2 * d)
    assert point.force == pytest.approx(-by_gap, rel=1e-5)
    assert point.flux_linkage == pytest.approx(by_current, rel=1e-5)


def test_means_over_a_pot_cores_cuts_are_over_their_area(pot_core: Actuator) -> None:
    """Of A = r^2, that is B_z = 3 r, the mean over the post is twice its radius; ring and post carry the same flux."""
    magnet = pot_core.magnet
    field = field_of(pot_core, 5e-4, accuracy="fast")
    cut = field.probes.cuts["post"]
    squares = field.model.basis.doflocs[0] ** 2
    assert cut.mean(cut.along_x @ squares) == pytest.approx(magnet.post_diameter, rel=1e-3)
    cuts = solve(pot_core, 0.1, 5e-5, accuracy="fast").quantities.flux_density
    inside = magnet.half_width - magnet.ring_width
    ring = cuts["ring"].mean * (magnet.half_width**2 - inside**2)
    assert ring == pytest.approx(cuts["post"].mean * magnet.post_diameter**2 / 4, rel=0.02)


def test_a_pot_core_states_its_map_iron_winding_and_tolerances(pot_core: Actuator) -> None:
    made = field_map(pot_core, [3e-4, 6e-4], levels=[1.0], settings=FieldMapSettings(accuracy="fast"))
    field = field_of(pot_core, 6e-4, accuracy="fast")
    there = field.quantities(field.solve(float(made.current[0, 1]), 6e-4)).flux_density
    assert max(part.mean for part in there.values()) == pytest.approx(1.0, rel=5e-3)
    share = field_map(
        pot_core, [3e-4, 6e-4], levels=[1.0], criterion="percentile=50", settings=FieldMapSettings(accuracy="fast")
    )
    assert np.all(share.current > made.current)
    magnet = pot_core.magnet
    disc = np.pi * magnet.half_width**2 * magnet.yoke_thickness
    assert magnet.section(1e-3).iron_volumes["yoke"] == pytest.approx(disc)
    network = thermal_network(pot_core, Cooling())
    assert "no turns outside the core" in network.notes[0]
    assert choose_wire(pot_core).winding.resistance() == pytest.approx(magnet.winding_resistance, rel=0.2)
    names = {tolerance.name for tolerance in tolerances_of(pot_core)}
    assert "ring_width" in names
    assert "stack_depth" not in names


@pytest.mark.parametrize(
    ("file", "path", "value", "complaint"),
    [
        (UI60, "turns", 601, "coil.turns 601 is odd"),
        (UI60, "width", "12 mm", "coil.width with its clearance is "),
        (UI60, "height", "60 mm", "coil.height with its clearance"),
        (POT, "height", "16 mm", "coil.height with its clearance is 17 mm, more than the window's 16 mm"),
        (POT, "width", "1 um", "coil.width 1 µm is below"),
    ],
)
def test_bad_dimensions_are_one_line(file: Path, path: str, value: object, complaint: str) -> None:
    content = tomllib.loads(file.read_text())
    content["magnet"]["coil"][path] = value
    with pytest.raises(ActuatorError, match="magnet: ") as caught:
        parse_actuator(content)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def plunger() -> Actuator:
    return load_actuator(ROTERS)


@pytest.mark.parametrize("row", [2, 8, 15])
def test_a_plunger_pulls_as_roters_measured(plunger: Actuator, row: int) -> None:
    """Within 10 % from 0.2 to 1.5 in, as the same magnet solved on its own does."""
    inches, _, force = np.genfromtxt(REFERENCE / "roters" / "measured_force.csv", delimiter=",")[row]
    found = solve(plunger, 1.5, inches * 0.0254, accuracy="fast").quantities
    assert found.force == pytest.approx(force, rel=0.1)
    assert found.force_stress_tensor == pytest.approx(found.force, rel=5e-3)
    alone = solve_plunger(roters(), 1.5, -inches * 0.0254, order=2)
    assert found.force == pytest.approx(alone.force, rel=0.01)
    assert found.flux_linkage == pytest.approx(alone.flux_linkage, rel=0.01)


def test_a_plungers_table_holds_between_gaps_that_have_their_own_meshes(plunger: Actuator) -> None:
    gaps = np.array([0.0025, 0.003])
    table, report = sweep(plunger, gaps, [0.75, 1.5], settings=SweepSettings(accuracy="fast"))
    fresh = solve(plunger, 1.2, 0.00275, accuracy="fast").quantities
    assert float(table.force(1.2, 0.00275)) == pytest.approx(fresh.force, rel=3e-3)
    assert report.mesh_error < 1e-3
    assert report.reciprocity_error < 0.02


def test_a_mesh_that_follows_a_plunger_has_the_coenergys_slopes(plunger: Actuator) -> None:
    """Moved by 0.2 mm: force, its slope and B are those of the moved section, on one mesh and on another."""
    field = field_of(plunger, 0.0127, accuracy="fast")
    gap, h = 0.0129, 1e-6
    at, low, high = (field.quantities(field.solve(1.5, g)) for g in (gap, gap - h, gap + h))
    assert at.force == pytest.approx(-(high.coenergy - low.coenergy) / (2 * h), rel=1e-5)
    at = field.quantities(field.solve(1.5, gap))
    assert at.force_gap_slope == pytest.approx((high.force - low.force) / (2 * h), rel=1e-4)
    assert at.force == pytest.approx(solve(plunger, 1.5, gap, accuracy="fast").quantities.force, rel=2e-3)
    assert at.force_stress_tensor == pytest.approx(at.force, rel=5e-3)
    assert field.near(0.01271) is field
    assert field.near(0.015) is not field


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"plunger": [["0 mm", "0 mm"], ["30 mm", "0 mm"], ["0 mm", "50 mm"]]}, "the plunger reaches into the"),
        ({"plunger": [["-1 mm", "0 mm"], ["5 mm", "0 mm"], ["0 mm", "50 mm"]]}, "plunger has a point left of the axis"),
        ({"withdrawal": "up"}, "withdrawal"),
    ],
)
def test_bad_outlines_are_one_line(change: dict[str, object], complaint: str) -> None:
    content = tomllib.loads(ROTERS.read_text())
    content["magnet"] |= change
    with pytest.raises(ActuatorError, match=complaint) as caught:
        parse_actuator(content)
    assert "\n" not in str(caught.value)


def test_a_gap_at_which_a_plunger_hits_or_leaves_is_refused(plunger: Actuator) -> None:
    with pytest.raises(InputError, match="gap 100 mm is not allowed"):
        solve(plunger, 1.0, 0.1)
    boxed = plunger.magnet.model_copy(update={"air": Air(side=0.1, bottom=0.02, top=0.1)})
    with pytest.raises(InputError, match=r"leaves the air box, .* choose a smaller gap"):
        boxed.section(0.03)


@pytest.fixture(scope="module")
def bearing() -> Actuator:
    return load_actuator(ROOT / "geometries" / "bearing_pole_pair.toml")


def test_a_mesh_from_a_file_follows_the_gap(bearing: Actuator) -> None:
    """Force against the coenergy's slope and Maxwell's stress at gaps on either side of the mesh's own."""
    field = field_of(bearing, bearing.magnet.gap, accuracy="fast")
    for gap in (3e-4, 9e-4):
        point = solve(bearing, 3.0, gap, accuracy="fast")
        h = 1e-4 * gap
        low, high = (field.quantities(field.solve(3.0, g)).coenergy for g in (gap - h, gap + h))
        assert point.quantities.force == pytest.approx((low - high) / (2 * h), rel=1e-6)
        off = abs(point.quantities.force_stress_tensor / point.quantities.force - 1)
        assert off <= point.force_error_estimate * (1 + 1e-9) < 0.02


def test_a_moved_mesh_is_the_mesh_made_at_that_gap(u_core: Actuator, tmp_path: Path) -> None:
    made = foreign(boxed(u_core), 1e-3, tmp_path)
    ours = solve(boxed(u_core), 2.0, 1.6e-3, accuracy="fast").quantities
    moved = solve(made, 2.0, 1.6e-3, accuracy="fast").quantities
    assert moved.force == pytest.approx(ours.force, rel=3e-3)
    assert moved.coenergy == pytest.approx(ours.coenergy, rel=3e-3)
    assert solve(made, 2.0, 1e-3).quantities.force == pytest.approx(solve_mesh_magnet(made, 2.0).quantities.force)


def test_a_mesh_from_a_file_has_a_map_of_whole_regions_and_no_lengths(bearing: Actuator) -> None:
    made = field_map(bearing, [4e-4, 6e-4], levels=[0.5], settings=FieldMapSettings(accuracy="fast"))
    there = solve(bearing, float(made.current[0, 1]), 6e-4, accuracy="fast").quantities.flux_density
    assert max(part.mean for part in there.values()) == pytest.approx(0.5, rel=5e-3)
    assert {tolerance.name for tolerance in tolerances_of(bearing)}.isdisjoint(LENGTHS)


def test_what_a_mesh_cannot_follow_or_tell_is_refused(bearing: Actuator) -> None:
    for gap in (1e-4, 2e-3):
        with pytest.raises(InputError, match=r"above 0, at least 20\d.* and at most 1.25 mm"):
            solve(bearing, 1.0, gap)
    with pytest.raises(InputError, match="a mesh does not tell how its coil is wound"):
        choose_wire(bearing)
