"""Flux that the table of one magnet in its plane section does not have: of the other side, and at the stack's ends.

Both are taken in linear iron: a tenth of the table's largest current. Of both the plane field knows a part alone, and
what is missing is by solutions in three dimensions: beside the stack's ends flux passes the armature from leg to leg.
"""

import numpy as np

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.errors import ActuatorError, InputError
from msl_fem.magnetics.field.accuracy import LEVELS
from msl_fem.magnetics.field.magnet_field import MagnetField, degree_of, magnet_mesh
from msl_fem.magnetics.field.pair_field import PairField, pair_magnet, pair_mesh
from msl_fem.magnetics.kinds.e_core import ECore
from msl_fem.magnetics.kinds.ends import EndFactors
from msl_fem.magnetics.kinds.u_core import UCore
from msl_fem.plant.believed import BelievedValue
from msl_fem.table.magnetic_table import MagneticTable

LINEAR = 0.1  # of the table's largest current
MUTUAL_OF_SOLIDS = {ECore: (2.41, 0.05), UCore: (1.96, 0.1)}
"""Mutual inductance in three dimensions over the plane field's, and its relative sigma, docs/three_dimensions.md: the
mean of E1 at three gaps, where two other E-cores are within 4 %; one U-core, whose solution states 9 %."""
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
    return field.quantities(solution, currents).mutual_inductance


def end_flux(actuator: Actuator, table: MagneticTable) -> tuple[BelievedValue, ...]:
    """What the flux at the stack's ends adds over the travel: depth (force and flux), and leakage (flux alone).

    Least squares of the inductances with and without end effects, L_ends - L = depth_error L + leakage, with the
    factors that the magnet's kind knows. To a table that has the kind's ends nothing is added: both are 0, with the
    sigma that the ends are known by. None where the table has other ends, or was measured.

    Raises
    ------
    InputError : the magnet has no stack whose ends are known
    """
    there = "end_effects_error" in table.provenance
    if not there and not str(table.provenance.get("end_effects", "")).startswith("none"):
        return ()
    magnet, gap = actuator.magnet, _nominal_gap(actuator)
    if not isinstance(magnet, MagnetKind) or magnet.stack_ends is None:
        raise InputError("this magnet has no stack whose ends are known")
    reach = 0.6 * float((actuator.motion and actuator.motion.range) or 0.5 * gap)
    gaps = np.linspace(gap - reach, gap + reach, N_GAP)
    known = magnet.known_ends
    source = f"air that is deeper than the stack (docs/end_effects.md), five gaps, linear iron; {known.source}"
    plain, ends = _inductances(actuator, tuple(gaps.tolist()), LINEAR * float(table.current[-1]), known.factors)
    (depth, leakage), *_ = np.linalg.lstsq(np.column_stack([plain, np.ones(N_GAP)]), ends - plain, rcond=None)
    share, missing = float(leakage) / _inductance(table, gap), 0.0 if there else 1.0
    if there:
        source = f"nothing beside the table's own end effects, which are as sure as this: {source}"
    sides = actuator.sides.count if actuator.sides else 1
    leaks = [
        BelievedValue("leakage_inductance", f"share_{j}", missing * share, known.share * abs(share), source)
        for j in range(1, sides + 1)
    ]
    deeper = missing * float(depth)
    return BelievedValue("fringing", "depth_error", deeper, known.share * abs(float(depth)), source), *leaks


def _inductances(
    actuator: Actuator, gaps: tuple[float, ...], current: float, factors: EndFactors
) -> tuple[Array, Array]:
    """H at the gaps, without and with end effects: flux linkage over current."""
    magnet = actuator.magnet_kind()
    mesh, order = magnet_mesh(magnet, gaps[len(gaps) // 2], "fast"), degree_of(magnet, "fast")
    found = []
    for ends in (False, factors):
        field = MagnetField(magnet, mesh, folder=actuator.folder, order=order, end_effects=ends)
        linked = [field.quantities(field.solve(current, gap)).flux_linkage for gap in gaps]
        found.append(np.array(linked) / current)
    return found[0], found[1]


def _inductance(table: MagneticTable, gap: float) -> float:
    """H of one magnet at a gap without current."""
    return float(table.evaluate(0.0, gap)["incremental_inductance"])


def _nominal_gap(actuator: Actuator) -> float:
    if actuator.motion is None or actuator.motion.nominal_gap is None:
        raise ActuatorError(f"{actuator.name}: motion.nominal_gap is missing")
    return actuator.motion.nominal_gap
