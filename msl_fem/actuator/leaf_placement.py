"""Where leaves stand at the mover: in one plane across the motion, or in two at a distance."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Placement:
    """Where a leaf meets the mover, from the mover's centre of mass, in m.

    Attributes
    ----------
    along : along the motion
    across : along the leaf, with its sign
    sideways : along the leaf's width
    side : +1 or -1, the direction in which the leaf leaves the mover
    """

    along: float
    across: float
    sideways: float
    side: int


def placed(
    planes: tuple[float, ...], *, per_side: int, sides: tuple[int, ...], reach: float, pitch: float
) -> tuple[Placement, ...]:
    """Leaves in planes across the motion: in each, on each side, so many side by side.

    Parameters
    ----------
    planes : places along the motion in m
    reach : from the axis of the motion to where leaves meet the mover
    pitch : between the middles of neighbouring leaves
    """
    return tuple(
        Placement(plane, side * reach, (k - (per_side - 1) / 2) * pitch, side)
        for plane in planes
        for side in sides
        for k in range(per_side)
    )
