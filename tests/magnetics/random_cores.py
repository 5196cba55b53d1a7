"""Plausible E-cores at random, for tests that must hold for all of them."""

from typing import Any

import numpy as np

from msl_fem.actuator import ECore


def random_core(rng: np.random.Generator, *, largest: float = 30e-3) -> ECore:
    """Legs, yoke and armature of 2 mm to `largest`, with and without chamfer, overhang and clearances."""

    def length(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def sometimes(value: float) -> float:
        return value if rng.random() < 0.5 else 0.0

    leg, outer, window, height = (length(2e-3, largest) for _ in range(4))
    side, face = sometimes(0.3 * window * rng.random()), sometimes(0.3 * height * rng.random())
    coil: dict[str, Any] = {
        "turns": 100,
        "width": (window - side) * (1.0 if rng.random() < 0.3 else rng.uniform(0.5, 1.0)),
        "height": (height - face) * (1.0 if rng.random() < 0.3 else rng.uniform(0.5, 1.0)),
        "leg_clearance": side,
        "face_clearance": face,
        "fill_factor": 0.5,
    }
    return ECore.model_validate(
        {
            "kind": "e-core",
            "centre_leg_width": leg,
            "outer_leg_width": outer,
            "window_width": window,
            "window_height": height,
            "yoke_thickness": length(2e-3, largest),
            "armature_thickness": length(2e-3, largest),
            "armature_overhang": sometimes(2 * outer * rng.random()),
            "stack_depth": 0.02,
            "pole_chamfer": sometimes(min(leg / 2, outer) / 2 * rng.uniform(0.05, 1.0)),
            "coil": coil,
            "iron": {"core": "m19", "armature": "m19", "stacking_factor": 0.96},
        }
    )
