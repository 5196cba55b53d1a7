"""Constants in SI units: of vacuum, of air, of annealed copper over temperature (resistivity, density, heat)."""

from math import pi

from msl_fem.errors import InputError

MU_0 = 4e-7 * pi
"""Permeability of vacuum in H/m: the value fixed by the SI up to 2019, which B-H data and references use."""

COPPER_RESISTIVITY = 1.724e-8
"""Resistivity of annealed copper at 20 degC in ohm m (IEC 60028)."""


REFERENCE_TEMPERATURE = 293.15
"""K; that of resistances as stated, 20 degC (IEC 60028)."""

TEMPERATURE_COEFFICIENT = 3.93e-3
"""1/K of resistance, referred to 20 degC (IEC 60028)."""

COPPER_DENSITY = 8890.0
"""kg/m3 at 20 degC (IEC 60028)."""

COPPER_SPECIFIC_HEAT = 385.0
"""J/(kg K) at 20 ... 100 degC (Incropera and DeWitt, Fundamentals of Heat and Mass Transfer, table A.1)."""

AIR_VISCOSITY = 1.82e-5
"""Pa s, dynamic, of dry air at 20 degC (Incropera and DeWitt, Fundamentals of Heat and Mass Transfer, table A.4)."""

COLDEST, HOTTEST = 173.15, 573.15
"""K; between them the resistance is straight in temperature to 1 % (NBS Handbook 100, 1966)."""


def resistance_ratio(temperature: float) -> float:
    """Resistance at a temperature in K over that at 20 degC: 1 + alpha (T - 293.15 K), IEC 60028.

    Raises
    ------
    InputError : a temperature outside -100 ... 300 degC, where the straight line does not hold
    """
    if not COLDEST <= temperature <= HOTTEST:
        raise InputError(
            f"a winding at {temperature - 273.15:.4g} degC is not allowed; the copper's resistance is known for "
            f"{COLDEST - 273.15:g} ... {HOTTEST - 273.15:g} degC"
        )
    return 1.0 + TEMPERATURE_COEFFICIENT * (temperature - REFERENCE_TEMPERATURE)


def resistivity(temperature: float = REFERENCE_TEMPERATURE) -> float:
    """Resistivity in ohm m at a temperature in K; raises as `resistance_ratio`."""
    return COPPER_RESISTIVITY * resistance_ratio(temperature)
