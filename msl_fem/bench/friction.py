"""Friction by bristles (Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE Trans. Autom. Control 40, 1995): LuGre.

    z' = v - s0 |v| z/G(v),   F = s0 z + s1 exp(-(v/v_s)^2) z',   G(v) = F_c + (F_s - F_c) exp(-(v/v_s)^2)

Below the break-away force F_s the contact is a spring of stiffness s0; at constant speed the force is G(v). The damping
of the bristles falls with the speed: were it constant, a contact that reverses fast would resist with s1 v, many times
its break-away force, and give energy back (Olsson, Astrom, Canudas de Wit, Gafvert and Lischinsky, Eur. J. Control 4,
1998, sec. 4.4).
"""

import numpy as np

from msl_fem.bench.plant import Friction
from msl_fem.computing.compiled import compiled


@compiled
def friction_force(f: Friction, velocity: float, bristle: float) -> tuple[float, float]:
    """(force against the motion in N, rate of the bristles' deflection in m/s) at a deflection in m."""
    ratio = velocity / f.stribeck_velocity
    slow = np.exp(-ratio * ratio)
    level = f.coulomb + (f.breakaway - f.coulomb) * slow
    rate = velocity - f.bristle_stiffness * abs(velocity) * bristle / level
    return f.bristle_stiffness * bristle + f.bristle_damping * slow * rate, rate
