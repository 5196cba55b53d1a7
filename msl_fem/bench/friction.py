"""Friction by bristles (Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE Trans. Autom. Control 40, 1995): LuGre.

    z' = v - s0 |v| z/G(v),   F = s0 z + s1 z',   G(v) = F_c + (F_s - F_c) exp(-(v/v_s)^2)

Below the break-away force F_s the contact is a spring of stiffness s0; at constant speed the force is G(v).
"""

import numpy as np

from msl_fem.bench.plant import Friction
from msl_fem.compiled import compiled


@compiled
def friction_force(f: Friction, velocity: float, bristle: float) -> tuple[float, float]:
    """(force against the motion in N, rate of the bristles' deflection in m/s) at a deflection in m."""
    ratio = velocity / f.stribeck_velocity
    level = f.coulomb + (f.breakaway - f.coulomb) * np.exp(-ratio * ratio)
    rate = velocity - f.bristle_stiffness * abs(velocity) * bristle / level
    return f.bristle_stiffness * bristle + f.bristle_damping * rate, rate
