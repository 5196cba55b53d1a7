"""Eddy currents in the sheets, and how the windings warm."""

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.errors import InputError
from msl_fem.losses.sheet_loss import eddy_coefficient
from msl_fem.losses.thermal_network import Cooling, thermal_network
from msl_fem.materials.constants import TEMPERATURE_COEFFICIENT
from msl_fem.materials.core_loss_data import sheet_of
from msl_fem.plant.believed import BelievedValue
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.preparation import small_signal_inductance
from msl_fem.table.magnetic_table import MagneticTable

CONDUCTIVITY = 0.3
"""Relative sigma of the sheets' eddy currents: excess losses, burrs, a gauge's spread."""
COOLING = 0.3  # of what the windings' heat does: insulation, fill factor, free surfaces


def eddy_time_constant(actuator: Actuator, table: MagneticTable) -> tuple[BelievedValue, ...]:
    """By how much the flux lags the current because of the sheets: tau = G L_0, G (dlambda/dt)^2 their eddy loss.

    A part of the flux path with the length l, the section A and the stacking factor s has the loss sigma d^2/12
    (dphi/dt)^2 l/(s A) (Bertotti, Hysteresis in Magnetism, 1998, eq. 12.9); a side's flux linkage is n share N phi.

    Raises
    ------
    InputError : the flux path or the sheets are not known
    """
    magnet = actuator.magnet
    if not isinstance(magnet, MagnetKind) or magnet.circuit is None:
        raise InputError("the lengths and areas of this magnet's flux path are not known")
    p = plant_parameters(actuator)
    stacking = {"core": magnet.iron.core_stacking, "armature": magnet.iron.armature_stacking}
    names = {"core": magnet.iron.core, "armature": magnet.iron.armature}
    lost = 0.0
    for part in magnet.circuit.parts:
        coefficient = eddy_coefficient(sheet_of(names[part.region]))
        if coefficient is None:
            raise InputError(f"the sheets of iron '{names[part.region]}' are not known")
        lost += coefficient * part.length / (stacking[part.region] * part.area)
    linked = p.magnets * p.current_share * magnet.turns
    tau = p.magnets * lost / linked**2 * small_signal_inductance(p, surface_of(table))
    source = "sheets' thickness and conductivity (materials), flux path of the magnet's closed equations"
    return (BelievedValue("eddy_currents", "time_constant", tau, CONDUCTIVITY * tau, source),)


def winding_heat(actuator: Actuator, table: MagneticTable) -> tuple[BelievedValue, ...]:
    """How a side's resistance follows its heat: the two nodes of `losses.thermal_network`, from cold.

    Raises
    ------
    InputError : the magnet's surfaces are not known
    """
    network, p = thermal_network(actuator, Cooling()), plant_parameters(actuator)
    between = -float(network.conductance[0, 1])
    winding, core = (float(capacity) for capacity in network.capacity)
    rise = TEMPERATURE_COEFFICIENT / (p.magnets * winding)
    source = f"copper's heat capacity; {network.notes[0]}"
    rates = {"cooling_rate": between / winding, "core_rate": between / core}
    amount = BelievedValue("coil_heating", "rise_per_joule", rise, COOLING * rise, source)
    shapes = (BelievedValue("coil_heating", name, rate, COOLING * rate, source) for name, rate in rates.items())
    return amount, *shapes
