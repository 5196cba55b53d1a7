"""The Preisach operator: memory, congruency, loss, Rayleigh's law, and a slow twin made of many stops."""

import numpy as np
import pytest
from bench_rigs import RATE, plain_rig

from msl_fem.bench.iron import COUNT, pinned_current, settle_memory, virgin_memory
from msl_fem.bench.plant import Hysteresis
from msl_fem.bench.running import run_rig

IRON = Hysteresis(0.3, 2e-3, 4.0)
STRAIGHT = Hysteresis(0.3, 2e-3, 1e9)  # h(b) = b


def path(corners: list[float], steps: int = 60) -> np.ndarray:
    return np.concatenate([np.linspace(a, b, steps, endpoint=False) for a, b in zip(corners, corners[1:], strict=False)]
                          + [np.array(corners[-1:])])  # fmt: skip


def along(flux: np.ndarray, iron: Hysteresis = IRON) -> np.ndarray:
    memory, found = virgin_memory(), []
    for value in flux:
        found.append(pinned_current(iron, memory, value))
        settle_memory(iron, memory, value)
    return np.array(found)


def test_a_slow_twin_of_stops() -> None:
    """An exponential spread of thresholds is a sum of stop operators (Prandtl): the same on any path."""
    edges = np.linspace(0.0, 20.0, 8001)
    threshold = 0.5 * (edges[1:] + edges[:-1])
    weight = STRAIGHT.amplitude * (np.exp(-edges[:-1]) - np.exp(-edges[1:]))
    flux = 2e-3 * np.cumsum(np.random.default_rng(1).standard_normal(400)) * 0.4
    stops, held, twin = np.zeros(threshold.size), 0.0, []
    for value in flux / STRAIGHT.flux_scale:
        stops = np.clip(stops + value - held, -threshold, threshold)
        held = value
        twin.append(weight @ stops / 1.0)
    scale = np.cumsum(weight[::-1])[::-1]  # d/dz of the virgin curve is the share of stops that still move
    assert scale[0] == pytest.approx(STRAIGHT.amplitude, rel=1e-6)
    assert along(flux, STRAIGHT) == pytest.approx(np.array(twin), abs=2e-3 * STRAIGHT.amplitude)


def test_minor_loops_between_the_same_ends_are_congruent() -> None:
    """Whatever came before: Preisach's property, in the fluxes themselves."""
    from_above = along(path([0, 8e-3, 1e-3, 3e-3, 1e-3, 3e-3]))[-121:]
    from_below = along(path([0, -9e-3, 3e-3, 1e-3, 3e-3, 1e-3, 3e-3]))[-121:]
    assert from_above - from_above[0] == pytest.approx(from_below - from_below[0], abs=1e-12)
    assert abs(from_above[0] - from_below[0]) > 0.01


def test_a_closed_loop_is_forgotten() -> None:
    """Return point memory: back at the outer turning point, the inner loop leaves no trace."""
    straight = along(path([0, 6e-3, -6e-3, 4e-3]))
    detour = along(path([0, 6e-3, -6e-3, 1e-3, -2e-3, 0.5e-3, -2e-3, 1e-3, 4e-3]))
    assert detour[-1] == pytest.approx(straight[-1], abs=1e-12)
    memory = virgin_memory()
    for value in path([0, 6e-3, -6e-3, 1e-3, -2e-3, 1e-3, 7e-3]):
        settle_memory(IRON, memory, value)
    assert memory[COUNT] == 0  # beyond all turning points: the virgin curve


def test_a_turn_and_an_overtaking_within_one_step() -> None:
    """A step that turns and passes turning points at once ends where small steps end."""
    coarse = [0.0, 6e-3, 1e-3, 3e-3, 2e-3, 4e-3, -7e-3, 6.5e-3, 8e-3]
    fine = along(path(coarse, 200))[::200]
    assert along(np.array(coarse)) == pytest.approx(fine, abs=1e-12)


@pytest.mark.parametrize("centre", [0.0, 5e-3])
def test_loops_take_energy(centre: float) -> None:
    loops = path([centre, centre + 2e-3, centre - 2e-3, centre + 2e-3, centre - 2e-3, centre + 2e-3])
    current = along(loops)
    last = slice(-121, None)
    loss = float(np.sum(0.5 * (current[last][1:] + current[last][:-1]) * np.diff(loops[last])))
    assert loss > 1e-5


def test_small_loops_follow_rayleigh() -> None:
    """The loss of a small loop goes with the cube of its amplitude."""
    losses = []
    for size in (1e-5, 2e-5, 4e-5):
        loops = path([0, size, -size, size], 400)
        current = along(loops)
        last = slice(-801, None)
        losses.append(np.sum(0.5 * (current[last][1:] + current[last][:-1]) * np.diff(loops[last])))
    order = np.log2(np.array(losses[1:]) / np.array(losses[:-1]))
    assert order == pytest.approx([3.0, 3.0], abs=0.05)


def test_a_run_leaves_remanence() -> None:
    """After a current and back to none, flux remains; without hysteresis none does."""
    commands = np.zeros((1500, 2))
    commands[:500] = 2.0
    plain = plain_rig("voltage")
    left = {}
    for name, rig in (("none", plain), ("iron", plain.with_parts(hysteresis=Hysteresis(0.05, 5e-3, 4.0)))):
        left[name] = run_rig(rig, commands, rate=RATE).flux_linkage[-1, 0]
    assert abs(left["none"]) < 1e-5
    assert left["iron"] > 1e-4
