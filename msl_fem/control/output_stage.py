"""From a wanted force to side currents under the guard, compiled: by the exact inverse, or about a bias current."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.compiled import compiled
from msl_fem.control.inverse import (
    Inverse,
    hand_over,
    magnet_current,
    magnet_current_limit,
    magnet_force,
    side_gap,
    side_surface,
)
from msl_fem.maps.guard import limit_at

Array = NDArray[np.float64]

INVERSE, BIAS = 0, 1
# What the guard and the limits say of a side's command; of a step counts the worst
PREFERRED, DISCOURAGED, FORCE_LIMITED, VIOLATION = range(4)


class Stage(NamedTuple):
    """How a force becomes currents.

    INVERSE: the exact input transformation at the gap to come; with an overlap both sides pull near zero force.
    BIAS: i_1 = bias + d, i_2 = bias - d with d = force/force_per_current, the tangent of the plant at the bias.
    """

    kind: int
    overlap: float  # N
    bias: float  # A, of a side
    force_per_current: float  # N/A


HARD_HAND_OVER = Stage(INVERSE, 0.0, 0.0, 1.0)
"""The source paper's: one side pulls at a time."""


@compiled
def side_currents(
    stage: Stage, inverse: Inverse, force: float, positions: tuple[float, float], command: Array
) -> tuple[float, int]:
    """(force in N that the belief expects, the worst verdict); side currents in A into command (2,).

    `positions` are the measured one and the one to come, m: currents are inverted at the one to come, and the stricter
    limit of the two counts. A current that the guard's last level forbids is cut to it, VIOLATION; one beyond the drive
    or the table is cut, FORCE_LIMITED. A force that is no number gives no current, and VIOLATION.
    """
    command[0] = command[1] = 0.0
    if not np.isfinite(force):
        return 0.0, VIOLATION
    if stage.kind == BIAS:
        return _about_bias(stage, inverse, force, positions[0], command)
    pulls = hand_over(force, stage.overlap)
    given, verdict = 0.0, PREFERRED
    for side in range(2):
        pull = pulls[0] if side == 0 else pulls[1]
        if pull > 0.0:
            if side >= inverse.sides:
                verdict = max(verdict, FORCE_LIMITED)
            else:
                got, said = _pull(inverse, side, pull, positions, command)
                given += got if side == 0 else -got
                verdict = max(verdict, said)
    return given, verdict


@compiled
def _pull(
    inverse: Inverse, side: int, pull: float, positions: tuple[float, float], command: Array
) -> tuple[float, int]:
    """(force given, verdict) of a side that is to pull with a force in N."""
    last = inverse.guard.limit.shape[0] - 1
    now, gap = side_gap(inverse, side, positions[0]), side_gap(inverse, side, positions[1])
    if not limit_at(inverse.guard, last, gap) >= 0:
        gap = now  # what is to come cannot be judged: the measured gap can, or nothing
    allowed = min(limit_at(inverse.guard, last, now), limit_at(inverse.guard, last, gap))
    if not allowed >= 0:
        return 0.0, VIOLATION
    surface = side_surface(inverse, side)
    largest = min(magnet_current_limit(inverse, gap), allowed)
    most = inverse.magnets * magnet_force(surface, largest, gap)
    if not pull <= most:
        command[side] = largest / inverse.current_share
        return most, VIOLATION if allowed <= inverse.current_limit else FORCE_LIMITED
    current = magnet_current(surface, pull / inverse.magnets, gap, largest)
    command[side] = current / inverse.current_share
    mild = min(limit_at(inverse.guard, 0, now), limit_at(inverse.guard, 0, gap))
    return pull, PREFERRED if current <= mild else DISCOURAGED


@compiled
def _about_bias(stage: Stage, inverse: Inverse, force: float, position: float, command: Array) -> tuple[float, int]:
    """(force by the tangent, the worst verdict): a side's current is cut at nothing and at its limits."""
    last, verdict = inverse.guard.limit.shape[0] - 1, PREFERRED
    difference = force / stage.force_per_current
    for side in range(2):
        wanted = (stage.bias + difference if side == 0 else stage.bias - difference) * inverse.current_share
        gap = side_gap(inverse, side, position)
        allowed = limit_at(inverse.guard, last, gap)
        if not allowed >= 0:
            verdict = VIOLATION
            continue
        largest = min(allowed, inverse.current_limit)
        if wanted > largest:
            verdict = max(verdict, VIOLATION if allowed <= inverse.current_limit else FORCE_LIMITED)
        elif wanted > limit_at(inverse.guard, 0, gap):
            verdict = max(verdict, DISCOURAGED)
        command[side] = min(max(wanted, 0.0), largest) / inverse.current_share
    return 0.5 * stage.force_per_current * (command[0] - command[1]), verdict
