"""The guard of a pair in the loop: no command that both sides' armature does not bear, by the map's own judgement."""

from functools import cache

import numpy as np
import pytest
from conftest import ROOT
from servo_controllers import servo

from msl_fem.computing.compiled import compiled
from msl_fem.control.both_sides import both_sides_of
from msl_fem.control.design_model import DesignModel, design_model_of
from msl_fem.control.inverse import force_domain, magnet_force, side_surface
from msl_fem.control.output_stage import BIAS, INVERSE, VIOLATION, OutputStage, commanded_currents
from msl_fem.errors import InputError
from msl_fem.maps import OperatingMap, operating_map
from msl_fem.maps.pair_guard import PairGuard
from msl_fem.maps.pair_limits import PairMap, pair_map
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_table import load_table, read_pair_table

FILE = ROOT / "lookup_tables" / "fast_tool_servo_pair.nc"
LEVELS = (1.2, 1.6)
STAGES = [OutputStage(INVERSE, 0.0, 0.0, 1.0), OutputStage(INVERSE, 90.0, 0.0, 1.0), OutputStage(BIAS, 0.0, 3.5, 120.0)]


@cache
def regions(polarity: str = "opposing") -> PairMap:
    return pair_map(read_pair_table(FILE), levels=LEVELS, polarity=polarity)


@cache
def of_each_side() -> tuple[MagneticTable, OperatingMap]:
    table = load_table(FILE)
    return table, operating_map(table, levels=LEVELS)


@cache
def belief(polarity: str = "opposing", *, together: bool = True) -> DesignModel:
    pair = regions(polarity) if together else None
    return design_model_of(servo(sides={"polarity": polarity}), *of_each_side(), pair)


def commands(stage: OutputStage, model: DesignModel, forces, positions):
    forces, positions = np.ascontiguousarray(forces, dtype=float), np.ascontiguousarray(positions, dtype=float)
    given, verdict, out = np.zeros(len(forces)), np.zeros(len(forces), dtype=np.int64), np.zeros((len(forces), 2))
    _commands(stage, model.inverse, forces, positions, given, verdict, out)
    return given, verdict, out


@compiled
def _commands(stage, inverse, forces, positions, given, verdict, out):
    """As one: the arguments of a single call take longer to hand over than its work."""
    for k in range(len(forces)):
        ahead = (positions[k, 0], positions[k, 1])
        given[k], verdict[k] = commanded_currents(stage, inverse, forces[k], ahead, (np.inf, np.inf), out[k])


@pytest.mark.parametrize("polarity", ["opposing", "aiding"])
@pytest.mark.parametrize("stage", STAGES, ids=["hard", "overlap", "bias"])
def test_no_command_is_beyond_what_both_sides_bear(stage: OutputStage, polarity: str) -> None:
    """Judged by the map's guard, at the position now and at that to come; apart, each side's own map lets some pass."""
    rng = np.random.default_rng(11)
    forces, positions = rng.uniform(-400, 400, 600), rng.uniform(-4e-4, 4e-4, (600, 2))
    positions[:, 1] = np.clip(positions[:, 0] + rng.uniform(-3e-5, 3e-5, 600), -4e-4, 4e-4)
    sign, judge = (1.0 if polarity == "aiding" else -1.0), PairGuard(regions(polarity))

    def forbidden(command: np.ndarray) -> np.ndarray:
        magnet = command * belief().inverse.current_share
        return np.max([judge.regions(magnet[:, 0], sign * magnet[:, 1], positions[:, k]) for k in (0, 1)], axis=0) == 2

    given, verdict, command = commands(stage, belief(polarity), forces, positions)
    alone = commands(stage, belief(polarity, together=False), forces, positions)
    assert not forbidden(command).any()
    assert forbidden(alone[2]).any() or polarity == "aiding"
    same = verdict != VIOLATION
    assert same.mean() > 0.2
    np.testing.assert_allclose(command[same], alone[2][same], rtol=1e-11, atol=1e-12)
    cut = forbidden(alone[2])
    assert (verdict[cut] == VIOLATION).all()
    if cut.any() and stage.kind == INVERSE:
        k = int(np.flatnonzero(cut)[0])
        assert given[k] == pytest.approx(force_of(command[k], positions[k, 1]), rel=1e-12)


def force_of(command: np.ndarray, x: float) -> float:
    inverse, pulls = belief().inverse, []
    for j, gap in ((0, 6e-4 - x), (1, 6e-4 + x)):
        pulls.append(magnet_force(side_surface(inverse, j), command[j] * inverse.current_share, gap))
    return inverse.magnets * (pulls[0] - pulls[1])


def test_the_domain_of_forces_ends_where_the_armature_does() -> None:
    """One side on: its own map and the pair's, whichever is lower."""
    inverse, judge = belief().inverse, PairGuard(regions())
    for x in (-3e-4, 0.0, 2e-4):
        current = force_domain(inverse, x).current_highest * inverse.current_share
        apart = force_domain(belief(together=False).inverse, x).current_highest * inverse.current_share
        bears = judge.judge(0.0, 0.0, x).limits_1
        assert bears is not None
        assert current == pytest.approx(min(apart, bears[-1]), rel=2e-12)


def test_outside_the_pairs_map_no_current_flows() -> None:
    inverse = belief().inverse
    beyond = inverse.both.guard.position_end + 1e-6
    _, verdict, command = commands(STAGES[1], belief(), [50.0], [(beyond, beyond)])
    assert verdict[0] == VIOLATION
    assert not command.any()


def test_maps_that_do_not_belong_together_are_refused() -> None:
    table = load_table(FILE)
    own = operating_map(table, levels=(1.0, 1.6))
    with pytest.raises(InputError, match=r"levels 1.2, 1.6 T and the map of one side 1, 1.6 T; make both"):
        design_model_of(servo(), table, own, regions())
    with pytest.raises(InputError, match=r"for aiding currents and sides.polarity of .* is 'opposing'"):
        design_model_of(servo(), table, operating_map(table, levels=LEVELS), regions("aiding"))
    with pytest.raises(InputError, match="judges two sides and the actuator has one"):
        both_sides_of(PairGuard(regions()), sides=1, levels=np.array(LEVELS))
