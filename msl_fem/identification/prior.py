"""Prior knowledge of the moving mass, its suspension and the rates of the forces, as polynomials A and B."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import cont2discrete

from msl_fem.errors import InputError
from msl_fem.identification.data import FloatArray


@dataclass(frozen=True)
class OscillatorPrior:
    """Believed mass (kg), damping (N s/m) and stiffness (N/m) of m x'' + c x' + k x = sum of gain * input.

    `force_gains` holds what is known of each input's gain (N per unit of the input, 1 for an external force); an
    input that is not named has its B fitted by least squares, given A and C.
    """

    mass: float
    damping: float = 0.0
    stiffness: float = 0.0
    force_gains: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mass) and self.mass > 0.0):
            raise InputError(f"prior mass {self.mass!r} kg: give a positive one")
        for name, value in (("damping", self.damping), ("stiffness", self.stiffness)):
            if not np.isfinite(value):
                raise InputError(f"prior {name} {value!r} is not finite; leave it out when it is unknown")


def discretised_oscillator(prior: OscillatorPrior, sampling_period: float) -> tuple[FloatArray, FloatArray]:
    """A (3,) and B (2,) of x for a force held between samples: A(q) x = (B[0] q^-1 + B[1] q^-2) f, in m/N.

    Exact for a zero-order hold (K. J. Astrom and B. Wittenmark, Computer-Controlled Systems, 3rd ed., sec. 2.3).
    """
    state = np.array([[0.0, 1.0], [-prior.stiffness / prior.mass, -prior.damping / prior.mass]])
    drive = np.array([[0.0], [1.0 / prior.mass]])
    read = np.array([[1.0, 0.0]])
    phi, gamma, *_ = cont2discrete((state, drive, read, np.zeros((1, 1))), sampling_period, method="zoh")
    a = np.array([1.0, -np.trace(phi), np.linalg.det(phi)])
    markov_1 = float(gamma[0, 0])
    markov_2 = float((phi @ gamma)[0, 0])
    return a, np.array([markov_1, markov_2 + a[1] * markov_1])
