"""Flux that the table of one magnet in its plane section does not have: of the other side, and at the stack's ends.

Both are taken in linear iron: a tenth of the table's largest current. Of both the plane field knows a part alone, and
what is missing is by solutions in three dimensions: beside the stack's ends flux passes the armature from leg to leg.
"""

from dataclasses import replace

import numpy as np

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.errors import ActuatorError, InputError
from msl_fem.magnetics.field.accuracy import LEVELS
from msl_fem.magnetics.field.end_effects import EndFactors
from msl_fem.magnetics.field.magnet_field import MagnetField, degree_of, magnet_mesh
from msl_fem.magnetics.field.pair_field import PairField, pair_magnet, pair_mesh
from msl_fem.magnetics.kinds.e_core import ECore
from msl_fem.magnetics.kinds.u_core import UCore
from msl_fem.plant.believed import BelievedValue
from msl_fem.table.magnetic_table import MagneticTable

LINEAR = 0.1  # of the table's largest current
MUTUAL_OF_SOLIDS = {ECore: (2.41, 0.05), UCore: (1.96, 0.1)}
"""Mutual inductance in three dimensions over the plane field's, and its relative sigma, docs/three_dimensions.md: the
mean of E1 at three gaps, where two other E-cores are within 4 %; one U-core, whose solution states 9 %."""
ENDS = 0.3
"""Relative sigma of the end effects of other kinds: fringes by three other methods, docs/end_effects.md."""
ENDS_OF_SOLIDS = 0.12
"""Of E- and U-cores: share of the ends that is missed at most in three dimensions, at points and magnets that were not
fitted: 0.10 (E1's shape with another iron, stack, window and armature), 0.15 (U-core, where ends are 3 %)."""
E1_LENGTH, E1_TURNS = 20e-3, 200  # centre leg and window together, as the end turns go around them, m
E1_ENDS = EndFactors(gap=1.237, window=1.198, outer=0.393, leakage=0.326e-3)
"""By twelve solutions of E1 in three dimensions: docs/three_dimensions.md."""
N_GAP = 5


def mutual_of_sides(actuator: Actuator, table: MagneticTable) -> tuple[BelievedValue, ...]:
    """The mutual inductance of the two sides over L_0: that of their plane field in the middle, with its stack's ends.

    Equal magnets face each other in pairs, so M/L_0 of the sides is that of two magnets, whatever the connection. None
    where there is one side, or the table is that of a pair.

    Raises
    ------
    ActuatorError : the magnets share no plane armature
    """
    sides, gap = actuator.sides, _nominal_gap(actuator)
    if sides is None or sides.count < 2 or table.shared is not None:
        return ()
    sign, current = 1.0 if sides.polarity == "aiding" else -1.0, LINEAR * float(table.current[-1])
    mutual = _mutual_inductance(actuator, gap, (current, sign * current))
    ratio, sigma = MUTUAL_OF_SOLIDS[type(actuator.magnet_kind())]
    share = sign * ratio * mutual / _inductance(table, gap)
    source = (
        f"two-sided field in the middle: {1e3 * mutual:.4g} mH of one magnet on each side, {sides.polarity}; times "
        f"{ratio:g}, as flux passes beside the stack's ends in three dimensions (docs/three_dimensions.md)"
    )
    return (BelievedValue("mutual_inductance", "share", share, sigma * abs(share), source),)


def _mutual_inductance(actuator: Actuator, gap: float, currents: tuple[float, float]) -> float:
    """d2W'/(di_1 di_2) in H of two magnets at equal gaps and these currents (A), whose equal signs aid."""
    mesh = pair_mesh(pair_magnet(actuator), gap, "fast")
    field = PairField(actuator, mesh, gap_sum=2 * gap, order=LEVELS["fast"].order)
    solution = field.solve(0.0, *currents)
    return field.quantities(solution, currents, field.by_currents(solution)).mutual_inductance


def end_flux(actuator: Actuator, table: MagneticTable) -> tuple[BelievedValue, ...]:
    """What the flux at the stack's ends adds over the travel: depth (force and flux), and leakage (flux alone).

    Least squares of the inductances with and without end effects, L_ends - L = depth_error L + leakage. An E-core's
    ends are those of E1 in three dimensions, the leakage of its end turns in proportion to their length and to the
    square of their number. None where the table has them, or was measured.

    Raises
    ------
    InputError : the magnet has no stack whose ends are known
    """
    if not str(table.provenance.get("end_effects", "")).startswith("none"):
        return ()
    magnet, gap = actuator.magnet, _nominal_gap(actuator)
    if not isinstance(magnet, MagnetKind) or magnet.stack_ends is None:
        raise InputError("this magnet has no stack whose ends are known")
    reach = 0.6 * float((actuator.motion and actuator.motion.range) or 0.5 * gap)
    gaps = np.linspace(gap - reach, gap + reach, N_GAP)
    factors, sigma, source = ends_of(magnet)
    plain, ends = _inductances(actuator, tuple(gaps.tolist()), LINEAR * float(table.current[-1]), factors)
    (depth, leakage), *_ = np.linalg.lstsq(np.column_stack([plain, np.ones(N_GAP)]), ends - plain, rcond=None)
    share = float(leakage) / _inductance(table, gap)
    sides = actuator.sides.count if actuator.sides else 1
    leaks = [
        BelievedValue("leakage_inductance", f"share_{j}", share, sigma * abs(share), source)
        for j in range(1, sides + 1)
    ]
    return BelievedValue("fringing", "depth_error", float(depth), sigma * abs(float(depth)), source), *leaks


def ends_of(magnet: MagnetKind) -> tuple[EndFactors, float, str]:
    """The factors of a magnet's end effects, their relative sigma and their source."""
    source = "air that is deeper than the stack (docs/end_effects.md), five gaps, linear iron"
    if isinstance(magnet, ECore):
        length = (magnet.centre_leg_width + magnet.window_width) / E1_LENGTH
        leakage = E1_ENDS.leakage * length * (magnet.coil.turns / E1_TURNS) ** 2
        solid = "; its factors by solutions in three dimensions of E1 (docs/three_dimensions.md)"
        return replace(E1_ENDS, leakage=leakage), ENDS_OF_SOLIDS, source + solid
    if isinstance(magnet, UCore):
        solid = "; as three dimensions have it within 0.8 % of the flux (docs/three_dimensions.md)"
        return EndFactors(), ENDS_OF_SOLIDS, source + solid
    return EndFactors(), ENDS, source


def _inductances(
    actuator: Actuator, gaps: tuple[float, ...], current: float, factors: EndFactors
) -> tuple[Array, Array]:
    """H at the gaps, without and with end effects: flux linkage over current."""
    magnet = actuator.magnet_kind()
    mesh, order = magnet_mesh(magnet, gaps[len(gaps) // 2], "fast"), degree_of(magnet, "fast")
    found = []
    for ends in (None, factors):
        field = MagnetField(magnet, mesh, folder=actuator.folder, order=order, end_effects=ends or False)
        linked = [field.quantities(field.solve(current, gap)).flux_linkage for gap in gaps]
        found.append(np.array(linked) / current + (ends.leakage if ends else 0.0))
    return found[0], found[1]


def _inductance(table: MagneticTable, gap: float) -> float:
    """H of one magnet at a gap without current."""
    return float(table.evaluate(0.0, gap)["incremental_inductance"])


def _nominal_gap(actuator: Actuator) -> float:
    if actuator.motion is None or actuator.motion.nominal_gap is None:
        raise ActuatorError(f"{actuator.name}: motion.nominal_gap is missing")
    return actuator.motion.nominal_gap
