"""From a force to side currents under the guard: the exact input transformation, or a tangent about a bias."""

from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.control.both_sides import judged_together
from msl_fem.control.inverse import (
    Inverse,
    believed_gap,
    hand_over,
    level_limit,
    magnet_current,
    magnet_current_limit,
    magnet_force,
    side_surface,
)
from msl_fem.control.shared_force import NOTHING_SHARED, SharedForce, shared_force_at
from msl_fem.maps.guard import UNACCEPTABLE

INVERSE, BIAS = 0, 1

# What the guard and the limits say of a side's command; of a step counts the worst
PREFERRED, DISCOURAGED, FORCE_LIMITED, HEAT_LIMITED, VIOLATION = range(5)


class OutputStage(NamedTuple):
    """How a force becomes currents.

    INVERSE: the exact input transformation at the gap to come; with an overlap both sides pull near zero force, and
    what their armature shares is part of it where the table of the pair is known.
    BIAS: i_1 = bias + d, i_2 = bias - d with d = force/force_per_current, the tangent of the plant at the bias.
    """

    kind: int
    overlap: float  # N
    bias: float  # A, of a side
    force_per_current: float  # N/A
    shared: SharedForce = NOTHING_SHARED  # of the pulls in an overlap


HARD_HAND_OVER = OutputStage(INVERSE, 0.0, 0.0, 1.0)
"""The source paper's: one side pulls at a time."""


@compiled
def commanded_currents(
    stage: OutputStage, inverse: Inverse, force: float, positions: tuple[float, float], bearable: tuple[float, float],
    command: Array,
) -> tuple[float, int]:  # fmt: skip
    """(force in N that the belief expects, the worst verdict); side currents in A into command (2,).

    `positions` are the measured one and the one to come, m: currents are inverted at the one to come, and the stricter
    limit of the two counts. A current that the guard's last level forbids is cut to it, VIOLATION; one beyond what
    is `bearable` for the winding of a magnet of each side, A, is cut, HEAT_LIMITED; one beyond the drive or the table
    is cut, FORCE_LIMITED. Where the map of a pair is known it judges both currents together. A force that is no number
    gives no current, and VIOLATION.
    """
    command[0] = command[1] = 0.0
    if not np.isfinite(force):
        return 0.0, VIOLATION
    if stage.kind == BIAS:
        given, verdict = _about_bias(stage, inverse, force, positions[0], bearable, command)
    else:
        given, verdict = _pulls(stage, inverse, force, positions, bearable, command)
    if inverse.both.relation < 0:
        return given, verdict
    return _together(stage, inverse, positions, command, given, verdict)


@compiled
def _pulls(
    stage: OutputStage, inverse: Inverse, force: float, positions: tuple[float, float], bearable: tuple[float, float],
    command: Array,
) -> tuple[float, int]:  # fmt: skip
    """`commanded_currents` by the exact inverse, each side judged alone."""
    shared = shared_force_at(stage.shared, positions[1], force)
    pulls = hand_over(force - shared, stage.overlap)
    given, verdict = shared, PREFERRED
    for side in range(2):
        pull = pulls[0] if side == 0 else pulls[1]
        if pull > 0.0:
            if side >= inverse.sides:
                verdict = max(verdict, FORCE_LIMITED)
            else:
                borne = bearable[0] if side == 0 else bearable[1]
                side_force, side_verdict = _pull(inverse, side, pull, positions, borne, command)
                given += side_force if side == 0 else -side_force
                verdict = max(verdict, side_verdict)
    return given, verdict


@compiled
def _together(
    stage: OutputStage, inverse: Inverse, positions: tuple[float, float], command: Array, given: float, verdict: int
) -> tuple[float, int]:
    """(force, verdict) after the map of a pair has judged both currents, and cut them where it forbids them."""
    magnet = np.empty(2)
    magnet[0] = command[0] * inverse.current_share
    magnet[1] = command[1] * inverse.current_share
    now = armature_position(inverse, positions[0])
    coming = armature_position(inverse, positions[1])
    region = judged_together(inverse.both, now, coming, magnet)
    if region != UNACCEPTABLE:
        return given, max(verdict, region)
    for side in range(2):
        command[side] = magnet[side] / inverse.current_share
    if stage.kind == BIAS:
        return 0.5 * stage.force_per_current * (command[0] - command[1]), VIOLATION
    return _force_of(inverse, positions[1], magnet), VIOLATION


@compiled
def armature_position(inverse: Inverse, position: float) -> float:
    """Where the armature is towards side 1 in m, between the believed gaps of both sides."""
    return 0.5 * (believed_gap(inverse, 1, position) - believed_gap(inverse, 0, position))


@compiled
def _force_of(inverse: Inverse, position: float, magnet: Array) -> float:
    """The force in N of magnets with currents (2,) in A, both sides taken apart."""
    force = 0.0
    for side in range(2):
        if magnet[side] > 0.0:
            own = magnet_force(side_surface(inverse, side), magnet[side], believed_gap(inverse, side, position))
            force += inverse.magnets * own if side == 0 else -inverse.magnets * own
    return force


@compiled
def _pull(
    inverse: Inverse, side: int, pull: float, positions: tuple[float, float], bearable: float, command: Array
) -> tuple[float, int]:
    """(force given, verdict) of a side that is to pull with a force in N."""
    last = inverse.guard.limit.shape[0] - 1
    now = believed_gap(inverse, side, positions[0])
    gap = believed_gap(inverse, side, positions[1])
    if not level_limit(inverse, last, gap) >= 0:
        gap = now  # what is to come cannot be judged: the measured gap can, or nothing
    allowed = min(level_limit(inverse, last, now), level_limit(inverse, last, gap))
    if not allowed >= 0:
        return 0.0, VIOLATION
    surface = side_surface(inverse, side)
    largest = min(min(magnet_current_limit(inverse, gap), allowed), bearable)
    most = inverse.magnets * magnet_force(surface, largest, gap)
    if not pull <= most:
        command[side] = largest / inverse.current_share
        return most, _cut_by(inverse, largest, allowed, bearable)
    current = magnet_current(surface, pull / inverse.magnets, gap, largest)
    command[side] = current / inverse.current_share
    mild = min(level_limit(inverse, 0, now), level_limit(inverse, 0, gap))
    return pull, PREFERRED if current <= mild else DISCOURAGED


@compiled
def _cut_by(inverse: Inverse, largest: float, allowed: float, bearable: float) -> int:
    """What cut a current to the `largest`: the winding's heat, the guard's last level, or drive and table."""
    if bearable <= largest and bearable < allowed:
        return HEAT_LIMITED
    return VIOLATION if allowed <= inverse.current_limit else FORCE_LIMITED


@compiled
def _about_bias(
    stage: OutputStage, inverse: Inverse, force: float, position: float, bearable: tuple[float, float], command: Array
) -> tuple[float, int]:
    """(force by the tangent, the worst verdict): a side's current is cut at nothing and at its limits."""
    verdict = PREFERRED
    difference = force / stage.force_per_current
    for side in range(2):
        current = (stage.bias + difference if side == 0 else stage.bias - difference) * inverse.current_share
        gap = believed_gap(inverse, side, position)
        borne = bearable[0] if side == 0 else bearable[1]
        side_verdict = _about_bias_of_side(inverse, side, current, gap, borne, command)
        verdict = max(verdict, side_verdict)
    return 0.5 * stage.force_per_current * (command[0] - command[1]), verdict


@compiled
def _about_bias_of_side(
    inverse: Inverse, side: int, current: float, gap: float, bearable: float, command: Array
) -> int:
    """The verdict on a magnet's current, which is cut at nothing and at its limits."""
    allowed = level_limit(inverse, inverse.guard.limit.shape[0] - 1, gap)
    if not allowed >= 0:
        return VIOLATION
    largest = min(min(allowed, inverse.current_limit), bearable)
    command[side] = min(max(current, 0.0), largest) / inverse.current_share
    if current > largest:
        return _cut_by(inverse, largest, allowed, bearable)
    return DISCOURAGED if current > level_limit(inverse, 0, gap) else PREFERRED
