"""The hand-over with what both sides' armature shares: the force of its currents by the table of the pair."""

import numpy as np
import pytest
from test_judged_together import belief, commands, force_of

from msl_fem.control.inverse import force_limits, hand_over
from msl_fem.control.lqr_design import stage_with_overlap
from msl_fem.control.output_stage import VIOLATION
from msl_fem.control.shared_force import NOTHING_SHARED, shared_force_at


def force_of_both(model, command: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """N on the mover, by each magnet's own table and what the pair's adds."""
    apart = np.array([force_of(row, x) for row, x in zip(command, positions, strict=True)])
    magnet = command * model.inverse.current_share
    return (
        apart
        + model.inverse.magnets
        * model.shared.evaluate(positions, magnet[:, 0], model.coupled.polarity * magnet[:, 1])["x"]
    )


@pytest.mark.parametrize("polarity", ["opposing", "aiding"])
@pytest.mark.parametrize("overlap", [2.0, 20.0, 80.0])
def test_the_currents_of_an_overlap_give_the_wanted_force(overlap: float, polarity: str) -> None:
    model = belief(polarity)
    stage, rng = stage_with_overlap(model, overlap), np.random.default_rng(5)
    x = rng.uniform(-3.5e-4, 3.5e-4, 300)
    lowest, highest = force_limits(model.inverse, x)
    wanted = rng.uniform(0.9 * lowest, 0.9 * highest)
    positions = np.column_stack([x, x])
    given, verdict, command = commands(stage, model, wanted, positions)
    whole = verdict < VIOLATION
    assert whole.mean() > 0.5
    missed = np.abs(force_of_both(model, command, x) - wanted)[whole].max()
    plain = commands(stage._replace(shared=NOTHING_SHARED), model, wanted, positions)
    before = np.abs(force_of_both(model, plain[2], x) - wanted)[whole & (plain[1] < VIOLATION)].max()
    print(f"{overlap:g} N, {polarity}: {before:.3f} N without, {missed:.4f} N with")
    assert missed < 0.12 * before
    np.testing.assert_allclose(given[whole], wanted[whole], rtol=1e-9)


def test_without_overlap_or_table_nothing_is_shared() -> None:
    assert stage_with_overlap(belief(), 0.0).shared is NOTHING_SHARED
    assert shared_force_at(NOTHING_SHARED, 0.0, 10.0) == 0.0
    shared = stage_with_overlap(belief(), 20.0).shared
    assert shared_force_at(shared, np.nan, 10.0) == 0.0
    assert shared_force_at(shared, 1.0, 1e9) == shared.values[-1, -1]
    assert np.abs(shared.values).max() < 0.2 * sum(hand_over(0.0, 20.0))
