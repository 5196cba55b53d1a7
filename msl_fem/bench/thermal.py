"""The coil's resistance as its copper warms up: a network of two nodes, coil and core, for each side."""

from msl_fem.bench.plant import Thermal
from msl_fem.computing.compiled import compiled

COPPER_COEFFICIENT = 3.93e-3  # 1/K, IEC 60028 at 20 degC


@compiled
def warm_resistance(cold: float, coil: float) -> float:
    """Resistance in ohm of a coil that is `coil` K above where its resistance is `cold`."""
    return cold * (1.0 + COPPER_COEFFICIENT * coil)


@compiled
def thermal_rates(t: Thermal, coil: float, core: float, loss: float) -> tuple[float, float]:
    """Rates in K/s of both temperature rises (K) under a copper loss (W).

    Heat flows from the coil to the core through one resistance and on to the air through the other; the heat
    capacities follow from the stated time constants, each with the node's own resistance.
    """
    flow = (coil - core) / t.coil_to_core
    coil_rate = (loss - flow) * t.coil_to_core / t.coil_time
    return coil_rate, (flow - core / t.core_to_air) * t.core_to_air / t.core_time
