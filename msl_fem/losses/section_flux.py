"""The iron that each section of a magnet stands for, and the flux density in it between a table's nodes."""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RectBivariateSpline

from msl_fem.actuator import ECore
from msl_fem.errors import TableError
from msl_fem.files.quantity import format_quantity
from msl_fem.table.magnetic_table import SECTION, MagneticTable

Array = NDArray[np.float64]


def iron_volumes(magnet: ECore) -> dict[str, float]:
    """Section to the volume in m3 of the iron it stands for, sheets only: area of the part, stack depth, stacking.

    Legs reach from the pole faces to the yoke, outer_leg counts both, the yoke has the corners, the armature its
    overhang. The sum is the whole magnet.
    """
    depth, s, chamfer = magnet.stack_depth, magnet.iron, magnet.pole_chamfer**2
    core, armature = depth * s.core_stacking, depth * s.armature_stacking
    return {
        "centre_leg": core * (magnet.centre_leg_width * magnet.window_height - chamfer),
        "yoke": core * 2 * magnet.half_width * magnet.yoke_thickness,
        "outer_leg": core * 2 * (magnet.outer_leg_width * magnet.window_height - chamfer),
        "armature": armature * 2 * magnet.armature_half_width * magnet.armature_thickness,
    }


def iron_names(magnet: ECore) -> dict[str, str]:
    """Section to the name of its iron."""
    return {name: magnet.iron.armature if name == "armature" else magnet.iron.core for name in iron_volumes(magnet)}


class SectionFlux:
    """The signed flux density in the iron of a table's section, a spline over log(gap) and current, odd in the current.

    Raises TableError where the table has no such section or a value of it is not finite.
    """

    def __init__(self, table: MagneticTable, section: str) -> None:
        values = table.extras.get(SECTION + section)
        if values is None:
            raise TableError(
                f"the table holds no flux_density_{section}, so nothing can be said of its loss; "
                f"it has {', '.join(table.sections) or 'no sections'}; make one with 'msl-fem table'"
            )
        if not np.isfinite(values).all():
            m, n = np.argwhere(~np.isfinite(values))[0]
            raise TableError(
                f"flux_density_{section} is not finite at gap {format_quantity(table.gap[m], 'm')}, "
                f"current {table.current[n]:g} A"
            )
        self.table, self.values = table, values

    @cached_property
    def _spline(self) -> RectBivariateSpline:
        i, b = self.table.current, self.values
        odd = np.hstack([-b[:, :0:-1], b])
        return RectBivariateSpline(
            np.log(self.table.gap), np.r_[-i[:0:-1], i], odd, kx=min(3, self.table.gap.size - 1), ky=3
        )

    def __call__(self, current: ArrayLike, gap: ArrayLike) -> Array:
        """T at (current, gap), broadcast together; raises OutOfTable."""
        self.table.evaluate(current, gap)  # its complaint is the table's
        i, g = np.broadcast_arrays(np.asarray(current, dtype=float), np.asarray(gap, dtype=float))
        return np.asarray(self._spline.ev(np.log(g), i))
