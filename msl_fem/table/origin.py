"""Whether a table can be of an actuator's magnet: by the digest it carries, else by what closed equations say."""

import numpy as np

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.materials.constants import MU_0
from msl_fem.table.magnetic_table import MagneticTable

MAGNET_DIGEST = "magnet_sha256"
"""Key of a table's provenance: the digest of the magnet it was computed for."""
PLAUSIBLE = 3.0
"""Factor by which the inductance of pole faces and gaps alone may miss a table's: fringing, leakage, iron."""


ANOTHER_UNIT = 30.0
"""Factor that no magnet misses it by; a wrong unit does by 1000."""


def inductance_ratio(actuator: Actuator, table: MagneticTable) -> float | None:
    """A table's inductance over that of the magnet's gaps, pole faces and turns; None where those are not known."""
    magnet = actuator.magnet
    inductance = _gap_inductance(magnet, table) if isinstance(magnet, MagnetKind) else None
    return None if inductance is None else _table_inductance(table) / inductance


def doubt_about_table(actuator: Actuator, table: MagneticTable) -> str | None:
    """Why a table is hardly that of the actuator's magnet, in a sentence; None where nothing speaks against it."""
    magnet, provenance = actuator.magnet, table.provenance
    if not isinstance(magnet, MagnetKind) or provenance.get("actuator_sha256") == actuator.digest:
        return None
    of_table = provenance.get(MAGNET_DIGEST)
    if of_table == magnet.digest:
        return None
    inductance = _gap_inductance(magnet, table)
    stated = _table_inductance(table)
    if inductance is not None and not 1 / PLAUSIBLE <= stated / inductance <= PLAUSIBLE:
        return (
            f"its inductance is {stated:.3g} H where this [magnet] has about {inductance:.3g} H, by its gaps, pole "
            "faces and turns: it is of another magnet"
        )
    if of_table is not None:
        return "it was computed for a magnet of other dimensions, turns or irons than this [magnet] states"
    return None


def _middle(table: MagneticTable) -> int:
    return int(np.argmin(np.abs(np.log(table.gap**2 / (table.gap[0] * table.gap[-1])))))


def _table_inductance(table: MagneticTable) -> float:
    """Without current, in the middle of the gaps; in H."""
    return float(table.nodes["incremental_inductance"][_middle(table), 0])


def _gap_inductance(magnet: MagnetKind, table: MagneticTable) -> float | None:
    """mu_0 N^2/(g/A_1 + g/A_2) there: two gaps in series, the iron without resistance; None of an unknown kind."""
    if magnet.circuit is None:
        return None
    gap = float(table.gap[_middle(table)])
    return MU_0 * magnet.turns**2 / sum(gap / face.area for face in magnet.circuit.faces)
