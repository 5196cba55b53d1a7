"""The table of two sides at points of a plant at rest: what `mutual_flux` computes in the time loop, in numpy."""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.plant.plant import PlantParameters
from msl_fem.table.magnetic_table import MagneticTable

Currents = tuple[float, float]
_SAME_GAP = 1e-6  # of the nominal gap: what two statements of it may differ by


def shared_by_sides(
    plant: PlantParameters, table: MagneticTable | None, *, currents: Currents, position: Array
) -> dict[str, Array] | None:
    """What one magnet of each side adds in common: D and its slopes, see `SharedCoenergy.evaluate`, currents those of
    the sides' magnets, of side 2 as `polarity` counts them; None where the table knows one magnet alone.

    Raises
    ------
    InputError : the table is of two sides at another distance, or the plant has one side
    OutOfTable : a position or current outside the table
    """
    if table is None or table.shared is None:
        return None
    check_shared(plant, table)
    first, second = (plant.current_share * current for current in currents)
    return table.shared.evaluate(position, np.asarray(first), np.asarray(plant.polarity * second))


def check_shared(plant: PlantParameters, table: MagneticTable) -> None:
    """InputError where a table of two sides is not that of this plant."""
    if table.shared is None:
        return
    if plant.sides != 2:
        raise InputError(
            f"the table is of two magnets with one armature, the actuator has {plant.sides} side(s) with coils; take "
            "the table of one magnet"
        )
    between = abs(table.shared.gap_sum - 2 * plant.nominal_gap)
    if between > _SAME_GAP * plant.nominal_gap:
        raise InputError(
            f"the table is of two magnets whose gaps are {table.shared.gap_sum * 1e3:.6g} mm together, the actuator's "
            f"are {2e3 * plant.nominal_gap:.6g} mm (twice motion.nominal_gap); make the table of this actuator"
        )
