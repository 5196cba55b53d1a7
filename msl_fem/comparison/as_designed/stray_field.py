"""Flux that the table of one magnet in its plane section does not have: of the other side, and at the stack's ends.

Both are taken in linear iron: a tenth of the table's largest current.
"""

import numpy as np

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.errors import ActuatorError, InputError
from msl_fem.magnetics.field.accuracy import LEVELS
from msl_fem.magnetics.field.magnet_field import MagnetField, degree_of, magnet_mesh
from msl_fem.magnetics.field.pair_field import PairField, pair_magnet, pair_mesh
from msl_fem.plant.believed import BelievedValue
from msl_fem.table.magnetic_table import MagneticTable

LINEAR = 0.1  # of the table's largest current
MUTUAL = 0.05
"""Relative sigma of the mutual inductance: what the stack's ends and the air box do to it."""
ENDS = 0.3
"""Relative sigma of the end effects: fringes by three other methods, docs/end_effects.md."""
N_GAP = 5


def mutual_of_sides(actuator: Actuator, table: MagneticTable) -> tuple[BelievedValue, ...]:
    """The mutual inductance of the two sides over L_0, from their common field with the armature in the middle.

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
    share = sign * mutual / _inductance(table, gap)
    source = f"two-sided field in the middle: {1e3 * mutual:.4g} mH of one magnet on each side, {sides.polarity}"
    return (BelievedValue("mutual_inductance", "share", share, MUTUAL * abs(share), source),)


def _mutual_inductance(actuator: Actuator, gap: float, currents: tuple[float, float]) -> float:
    """d2W'/(di_1 di_2) in H of two magnets at equal gaps and these currents (A), whose equal signs aid."""
    mesh = pair_mesh(pair_magnet(actuator), gap, "fast")
    field = PairField(actuator, mesh, gap_sum=2 * gap, order=LEVELS["fast"].order)
    solution = field.solve(0.0, *currents)
    return field.quantities(solution, currents, field.by_currents(solution)).mutual_inductance


def end_flux(actuator: Actuator, table: MagneticTable) -> tuple[BelievedValue, ...]:
    """What the flux at the stack's ends adds over the travel: depth (force and flux), and leakage (flux alone).

    Least squares of the inductances with and without end effects, L_ends - L = depth_error L + leakage. None where
    the table has them, or was measured.

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
    plain, ends = _inductances(actuator, tuple(gaps.tolist()), LINEAR * float(table.current[-1]))
    (depth, leakage), *_ = np.linalg.lstsq(np.column_stack([plain, np.ones(N_GAP)]), ends - plain, rcond=None)
    share = float(leakage) / _inductance(table, gap)
    source = "air that is deeper than the stack (docs/end_effects.md), five gaps, linear iron"
    sides = actuator.sides.count if actuator.sides else 1
    leaks = [
        BelievedValue("leakage_inductance", f"share_{j}", share, ENDS * abs(share), source) for j in range(1, sides + 1)
    ]
    return BelievedValue("fringing", "depth_error", float(depth), ENDS * abs(float(depth)), source), *leaks


def _inductances(actuator: Actuator, gaps: tuple[float, ...], current: float) -> tuple[Array, Array]:
    """H at the gaps, without and with end effects: flux linkage over current."""
    magnet = actuator.magnet_kind()
    mesh, order = magnet_mesh(magnet, gaps[len(gaps) // 2], "fast"), degree_of(magnet, "fast")
    found = []
    for ends in (False, True):
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
