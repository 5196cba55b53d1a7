"""Physical constants in SI units."""

from math import pi

MU_0 = 4e-7 * pi
"""Permeability of vacuum in H/m: the value fixed by the SI up to 2019, which B-H data and references use."""

COPPER_RESISTIVITY = 1.724e-8
"""Resistivity of annealed copper at 20 degC in ohm m (IEC 60028)."""
