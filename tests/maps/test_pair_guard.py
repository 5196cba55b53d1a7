"""The guard of a pair: against fields, its symmetries, its file and its commands; what it must never accept."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.cli.app import app
from msl_fem.cli.output import run_guarded
from msl_fem.errors import InputError
from msl_fem.magnetics.field.pair_field import PairField, pair_magnet, pair_mesh
from msl_fem.maps.guard import REGIONS
from msl_fem.maps.map_file import read_map
from msl_fem.maps.pair_guard import PairGuard
from msl_fem.maps.pair_limits import AIDING, OPPOSING, PairMap, pair_map
from msl_fem.maps.pair_map_file import read_pair_map, write_pair_map
from msl_fem.table.pair_table import read_pair_table

GAP_SUM = 1.2e-3
TABLE = ROOT / "lookup_tables/fast_tool_servo_pair.nc"


@pytest.fixture(scope="module")
def made() -> PairMap:
    return pair_map(read_pair_table(TABLE))


@pytest.fixture(scope="module")
def guard(made: PairMap) -> PairGuard:
    return PairGuard(made)


def test_fresh_commands_never_exceed_the_level_of_their_region(guard: PairGuard) -> None:
    """Just inside the limits, on a mesh of its own: the section means of the field stay below the region's level."""
    servo = load_actuator(ROOT / "geometries/fast_tool_servo.toml")
    field = PairField(servo, pair_mesh(pair_magnet(servo), 3e-4, "fast"), gap_sum=GAP_SUM, order=3)
    rng = np.random.default_rng(11)
    judged = 0
    for _ in range(40):
        x, j = rng.uniform(-0.5e-3, 0.5e-3), rng.uniform(0, 6) * rng.choice([1.0, 0.2])
        relation, level = rng.integers(2), rng.integers(2)
        limit = guard._limits(int(relation), x, j)[level]
        i, other = 0.995 * min(limit, 6.0), j if relation == AIDING else -j
        region = int(guard.regions(i, other, x))
        if limit <= 0 or REGIONS[region] == "unacceptable":
            continue
        b = max(section.mean for section in field.flux_densities(field.solve(x, i, other)).values())
        assert b <= guard.pair_map.levels[region], (x, i, other)
        judged += 1
    assert judged >= 15


def test_two_currents_that_either_side_bears_alone_are_refused_together(guard: PairGuard) -> None:
    """0.1 mm and 1.1 mm at about 1.2 T: opposing they saturate the armature, and the force is 23 % off."""
    x = 0.5e-3
    assert guard.judge(0.7, 0.0, x).region == "preferred"
    assert guard.judge(0.0, 5.5, x).region == "preferred"
    opposing, aiding = guard.judge(0.886, -5.977, x), guard.judge(0.886, 5.977, x)
    assert opposing.region == "unacceptable"
    assert "opposing" in opposing.reason
    assert aiding.region != "unacceptable"
    assert "one side on" in guard.judge(0.7, 0.0, x).reason


def test_exchanging_the_sides_and_reversing_both_currents_change_nothing(guard: PairGuard) -> None:
    rng = np.random.default_rng(2)
    i, j, x = rng.uniform([-8, -8, -0.55e-3], [8, 8, 0.55e-3], (2000, 3)).T
    regions = guard.regions(i, j, x)
    assert np.array_equal(regions, guard.regions(j, i, -x))
    assert np.array_equal(regions, guard.regions(-i, -j, x))
    assert set(regions) == {0, 1, 2}


def test_less_current_is_never_judged_worse_on_one_side_alone(guard: PairGuard) -> None:
    i = np.linspace(0, 6, 200)
    for x in (-0.4e-3, 0.0, 0.4e-3):
        assert (np.diff(guard.regions(i, 0.0, x)) >= 0).all()


@pytest.mark.parametrize(
    "command", [(np.nan, 0, 0), (0, np.inf, 0), (0, 0, np.nan), (12.1, 0, 0), (0, -12.1, 0), (0, 0, 0.56e-3)]
)
def test_outside_is_unacceptable(guard: PairGuard, command: tuple[float, float, float]) -> None:
    judged = guard.judge(*command)
    assert judged.region == "unacceptable"
    assert judged.margin is None


def test_opposing_limits_fall_with_the_other_current_and_aiding_ones_hardly(made: PairMap) -> None:
    middle = made.position.size // 2
    opposing, aiding = made.current[OPPOSING, 0, middle], made.current[AIDING, 0, middle]
    assert opposing[-1] < 0.5 * opposing[0]
    assert aiding[-1] > 0.9 * aiding[0]
    assert opposing[0] == pytest.approx(3.89, rel=0.03), "one side alone: 1.2 T at 0.6 mm"


def test_what_a_polarity_costs_is_told(made: PairMap) -> None:
    """In the middle, against the field: just below no section has 1.2 T, 5 % more is too much."""
    opposing, aiding = made.equal_currents()
    servo = load_actuator(ROOT / "geometries/fast_tool_servo.toml")
    field = PairField(servo, pair_mesh(pair_magnet(servo), 3e-4, "fast"), gap_sum=GAP_SUM, order=3)
    for most, sign in ((opposing[0], -1), (aiding[0], 1)):
        for share, above in ((0.98, False), (1.05, True)):
            solution = field.solve(0.0, share * most, sign * share * most)
            assert (max(b.mean for b in field.flux_densities(solution).values()) > 1.2) is above
    assert (opposing < aiding).all()


def test_the_file_reads_back_and_is_not_taken_for_one_of_one_magnet(made: PairMap, tmp_path: Path) -> None:
    again = read_pair_map(write_pair_map(made, tmp_path / "pair.json"))
    assert np.array_equal(again.current, made.current)
    assert again.polarity == "opposing"
    with pytest.raises(InputError, match="both sides"):
        read_map(tmp_path / "pair.json")
    content = json.loads((tmp_path / "pair.json").read_text())
    for key, value in (
        ("position_m", [0.0]),
        ("current_A", [[1.0]]),
        ("levels_T", [10**400]),
        ("polarity", "none"),
        ("schema", 9),
    ):
        (tmp_path / "bad.json").write_text(json.dumps(content | {key: value}))
        with pytest.raises(InputError, match=r"bad\.json"):
            read_pair_map(tmp_path / "bad.json")


def test_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "pair.json"
    assert run_guarded(lambda: app(["map", str(TABLE), "-o", str(target)])) == 0
    assert "what side 1 bears" in capsys.readouterr().out
    where = ["--current", "0.886 A", "--current-2", "-5.977 A", "--position", "0.5 mm"]
    assert run_guarded(lambda: app(["guard", str(target), *where, "--json"])) == 0
    judged = json.loads(capsys.readouterr().out)
    assert judged["region"] == "unacceptable"
    assert len(judged["limits_A"]) == len(judged["limits_2_A"]) == 2
    for bad in (
        ["guard", str(target), "--current", "1 A", "--gap", "0.5 mm"],
        ["guard", str(target), *where[:4]],
        ["map", str(TABLE), "--criterion", "max"],
        ["map", str(TABLE), "--gaps", "0.5 mm"],
    ):
        assert run_guarded(lambda bad=bad: app(bad)) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1
