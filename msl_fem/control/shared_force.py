"""The force of the sides' common armature in the hand-over: what both magnets' tables miss where both sides pull.

With pulls F_1 and F_2 of the sides taken apart and D the coenergy that they share, the force on the mover is
F_1 - F_2 + n dD/dx(x, i_1, i_2), n the magnets of a side. The pulls go by the hand-over of one force F', so for each
position and wanted force F there is an F' whose pulls give F. F - F' changes little over both (in linear iron the
product of the currents is the same for every F), and stands in an even grid, between whose nodes it is bilinear.
"""

from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.control.inverse import Inverse, force_limits, magnet_currents
from msl_fem.table.pair_surface import SharedCoenergy

_POSITIONS, _FORCES = 17, 49
_ROUNDS, _ENOUGH = 30, 1e-9  # N


class SharedForce(NamedTuple):
    """F - F' in N over position (m) and wanted force (N).

    Attributes
    ----------
    position, force : of the first node
    per_position, per_force : nodes per m and per N; 0 where nothing is shared
    values : (n_position, n_force)
    """

    position: float
    force: float
    per_position: float
    per_force: float
    values: Array


NOTHING_SHARED = SharedForce(0.0, 0.0, 0.0, 0.0, np.zeros((1, 1)))


@compiled
def shared_force_at(shared: SharedForce, position: float, force: float) -> float:
    """F - F' in N; beyond the grid that of its edge, 0 at a position that is no number."""
    if shared.per_force == 0.0 or not np.isfinite(position):
        return 0.0
    rows, columns = shared.values.shape
    u = min(max((position - shared.position) * shared.per_position, 0.0), rows - 1.0)
    v = min(max((force - shared.force) * shared.per_force, 0.0), columns - 1.0)
    m, n = min(int(u), rows - 2), min(int(v), columns - 2)
    u, v = u - m, v - n
    low = (1.0 - v) * shared.values[m, n] + v * shared.values[m, n + 1]
    high = (1.0 - v) * shared.values[m + 1, n] + v * shared.values[m + 1, n + 1]
    return float((1.0 - u) * low + u * high)


def shared_force(
    inverse: Inverse, both: SharedCoenergy, *, polarity: float, overlap: float, reach: tuple[float, float]
) -> SharedForce:
    """The grid over positions `reach` (m) and all forces of the inverse's domain there.

    `polarity` is the sign of side 2's currents in `both`.
    """
    positions = np.linspace(*reach, _POSITIONS)
    lowest, highest = force_limits(inverse, positions)
    forces = np.linspace(lowest.min(), highest.max(), _FORCES)
    wanted = np.clip(forces, lowest[:, None], highest[:, None])
    places = np.broadcast_to(positions[:, None], wanted.shape)
    armature = places + 0.5 * (inverse.gap_2 - inverse.gap_1)
    shared = np.zeros_like(wanted)
    for _ in range(_ROUNDS):
        before = shared
        currents = np.array(
            [magnet_currents(inverse, *at, overlap) for at in zip((wanted - before).flat, places.flat, strict=True)]
        )
        first, second = currents.T.reshape(2, *wanted.shape)
        shared = inverse.magnets * both.evaluate(armature, first, polarity * second)["x"]
        if np.abs(shared - before).max() <= _ENOUGH:
            break
    steps = positions[1] - positions[0], forces[1] - forces[0]
    return SharedForce(float(positions[0]), float(forces[0]), float(1 / steps[0]), float(1 / steps[1]), shared)
