"""A record whose readings are linear in what is unknown, so that posterior and evidence have closed forms."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.gathered import GatheredRuns
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.noise import NoiseWeights, weights_of
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns

Array = NDArray[np.float64]
OFFSET = EffectUnknown("force_offset", "force")
CUBIC = EffectUnknown("stiffness_nonlinearity", "cubic")
FRICTION = EffectUnknown("coulomb_friction", "force")
BOW = EffectUnknown("position_sensor_nonlinearity", "quadratic")


@dataclass(frozen=True, eq=False)
class LinearRecord:
    """`spectra`, `labels` and `weights` of a `Likelihood`: residual = data - columns z, a column each."""

    data: Array
    nuisances: Array
    of_effect: dict[str, Array]
    is_cut, begins, threads, threads_here = False, (), 1, 1
    strict = False

    def steps(self, times: int) -> int:
        return 1

    def gathering(self, runs: GatheredRuns | None) -> "LinearRecord":
        return self

    def nats_of_noise(self, unknowns: Unknowns, z: Array) -> float:
        return 0.0

    def excess(self, found: Fit) -> dict[str, float]:
        return {"reading": float(np.sqrt(np.mean(found.residual**2)))}

    @property
    def labels(self) -> NDArray[np.intp]:
        return np.zeros(self.data.size, dtype=np.intp)

    @property
    def ceilings(self) -> Array:
        return np.array([np.inf])

    def weights(self, residual: Array, unknowns: Unknowns) -> NoiseWeights:
        return weights_of(residual, self.labels, self.ceilings)

    def spectra(self, points: Points) -> Array:
        rows = []
        for n, z in enumerate(points.rows):
            model = self.nuisances @ z[: self.nuisances.shape[1]]
            for one in (OFFSET, CUBIC, FRICTION, BOW):
                if points.effects is not None and one.effect in self.of_effect:
                    model = model + self.of_effect[one.effect] * one.z_of(float(points.effects[n, one.place]))
            rows.append(self.data - model)
        return np.array(rows)


def record(
    *, size: float = 0.0, seed: int = 1, n: int = 4000, of: str = "force_offset"
) -> tuple[LinearRecord, Unknowns]:
    """Unit noise, three nuisances of unit normal truth, an effect of z = `size`, all columns of length sqrt(n)."""
    chance, n = np.random.default_rng(seed), 4000
    nuisances = chance.standard_normal((n, 3))
    of_effect = {
        "force_offset": chance.standard_normal(n) + nuisances[:, 0],
        "stiffness_nonlinearity": chance.standard_normal(n),
    }
    data = nuisances @ chance.standard_normal(3) + size * of_effect[of] + chance.standard_normal(n)
    believed = (("moving_mass", 0.01), ("stiffness", 0.01), ("damping", 0.01))
    return LinearRecord(data, nuisances, of_effect), Unknowns(believed, 0, (0,))


def with_effect(unknowns: Unknowns, *effects: EffectUnknown) -> Unknowns:
    return replace(unknowns, effects=effects)
