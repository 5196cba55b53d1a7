"""The sections of a report on plants that a loop's design has not seen, and on what a diagnosis is worth there."""

import numpy as np

from msl_fem.control.improvement import Improvement
from msl_fem.control.unseen_plants import UnseenPlants
from msl_fem.report.page import Stage


def unseen_stage(unseen: UnseenPlants) -> Stage:
    """How many were held, and how well."""
    figures = unseen.to_json()
    suspects = [name.replace("_", " ") for name in unseen.suspects]
    beside = f", each with {', '.join(suspects)}" if suspects else ""
    kind = "within the tolerances of parameters" if unseen.suspects else "that are possible"
    sentence = (
        f"Of {figures['plants']} plants {kind}{beside}, {unseen.held} were held: with "
        f"95 % confidence at least {100 * unseen.held_at_least:.0f} % of all such plants."
    )
    errors = {name: figures[name] for name in ("error_median", "error_95", "error_largest")}
    words = {"error_median": "RMS error, median", "error_95": "RMS error, 95 %", "error_largest": "RMS error, largest"}
    numbers = (
        *((words[name], "-" if error is None else f"{100 * error:.2f} %") for name, error in errors.items()),
        ("guard violations of all these plants", f"{figures['guard_violations']}"),
        ("commands beyond the guard's first level", f"{100 * figures['guard_share']:.2g} %"),
    )
    return Stage("Plants that the design has not seen", sentence, numbers)


def improvement_stage(over: Improvement) -> Stage:
    """How much better the loop is foretold to track than that of the belief."""
    low, middle, high = (_times(factor) for factor in over.quantiles)
    before, after = (_percent(of.to_json()["error_median"]) for of in (over.belief, over.loop))
    sentence = (
        f"On the plants that the diagnosis leaves possible this loop is foretold to track {middle} better than that "
        f"designed on the belief: RMS error {after} of the amplitude in place of {before}. On 95 % of them it "
        f"is {low} to {high} better. A run on the machine should show this factor."
    )
    numbers = (
        ("better than the belief's loop, half of the plants", middle),
        ("95 % of the plants", f"{low} ... {high}"),
        ("held by the belief's loop", f"{over.belief.held} of {over.belief.error.size}"),
        ("guard violations of the belief's loop", f"{int(over.belief.violations.sum())}"),
    )
    return Stage("Foretold gain over the loop of the belief", sentence, numbers)


def _times(factor: float) -> str:
    if np.isnan(factor):
        return "not to be said"
    return f"{factor:.2g} times" if np.isfinite(factor) else "infinitely (the other is not held)"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.2g} %"
