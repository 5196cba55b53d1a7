"""The belief that follows from an actuator file: all that its drawing tells beside the table of one magnet."""

from collections.abc import Callable

from msl_fem.actuator import Actuator
from msl_fem.comparison.as_designed.heat_and_sheets import eddy_time_constant, winding_heat
from msl_fem.comparison.as_designed.mover import film_of_faces, hardening_of_leaves
from msl_fem.comparison.as_designed.stray_field import end_flux, mutual_of_sides
from msl_fem.errors import ActuatorError, ComputationError, InputError, MaterialError
from msl_fem.plant.believed import AS_DESIGNED, Belief, BelievedValue
from msl_fem.plant.plant import drive_lags, plant_parameters
from msl_fem.table.magnetic_table import MagneticTable

Told = Callable[[Actuator, MagneticTable], tuple[BelievedValue, ...]]


def as_designed(actuator: Actuator, table: MagneticTable | None) -> Belief:
    """The belief of an actuator: mutual inductance, end effects, leaves, film, sheets and heat, each with its source.

    What the file does not tell, or the tools cannot compute for its kind of magnet, is left out and said so. With the
    table of a pair the mutual inductance is the table's, with a table of end effects, or a measured one, those are.
    """
    values = list(hardening_of_leaves(actuator))
    left_out: list[str] = []
    of_magnets: dict[str, Told] = {
        "mutual inductance of the sides": mutual_of_sides,
        "end effects": end_flux,
        "film of air": film_of_faces,
        "eddy currents in the sheets": eddy_time_constant,
        "heat of the windings": winding_heat,
    }
    for what, told in of_magnets.items():
        try:
            values += () if table is None else told(actuator, table)
        except (ActuatorError, InputError, MaterialError, ComputationError) as err:
            left_out.append(f"{what}: {err}")
    if values and actuator.drive is not None and not drive_lags(plant_parameters(actuator)):
        late = [one.name for one in values if one.effect == "eddy_currents"]
        values = [one for one in values if one.effect != "eddy_currents"]
        left_out += [f"{name}: the drive's current is taken to jump" for name in late]
    return Belief(AS_DESIGNED, tuple(values), tuple(left_out))
