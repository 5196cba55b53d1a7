"""How much better a loop that knows more tracks than that of the belief, foretold on the plants that are possible.

Both loops run on the same plants with the same noise, so what chance makes alike falls out of their errors' ratio.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.control.unseen_plants import HELD_WITHIN, UnseenPlants
from msl_fem.files.numbers import json_value

_INTERVAL = (0.025, 0.5, 0.975)


@dataclass(frozen=True, eq=False)
class Improvement:
    """A loop and that of the belief on the same plants.

    Attributes
    ----------
    loop, belief : what each did, plant by plant
    """

    loop: UnseenPlants
    belief: UnseenPlants

    @property
    def factors(self) -> Array:
        """(n_plant,) error of the belief's loop over the loop's; inf where only the former, 0 where only the latter
        is not held, nan where none is."""
        error, before = (np.where(of.error < HELD_WITHIN, of.error, np.inf) for of in (self.loop, self.belief))
        with np.errstate(invalid="ignore"):
            return np.asarray(before / error)

    def to_json(self) -> dict[str, Any]:
        """The JSON object `over_belief` of a loop's sheet: the factor on half of the plants, and on 95 % of them."""
        low, middle, high = self.quantiles
        before = self.belief.to_json()
        return {
            "factor": json_value(middle),
            "factor_interval": [json_value(low), json_value(high)],
            "belief_held_share": before["held_share"],
            "belief_error_median": before["error_median"],
            "belief_guard_violations": before["guard_violations"],
        }

    @property
    def quantiles(self) -> tuple[float, float, float]:
        """The factor that 2.5, 50 and 97.5 % of the plants stay below; nan where no plant is held by either."""
        told = np.sort(self.factors[~np.isnan(self.factors)])
        if not told.size:
            return np.nan, np.nan, np.nan
        low, middle, high = np.quantile(told, _INTERVAL, method="nearest")
        return float(low), float(middle), float(high)
