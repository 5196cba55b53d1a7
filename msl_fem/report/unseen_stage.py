"""The section of a report on plants that a loop's design has not seen."""

from msl_fem.control.unseen_plants import UnseenPlants
from msl_fem.report.page import Stage


def unseen_stage(unseen: UnseenPlants) -> Stage:
    """How many were held, and how well."""
    figures = unseen.to_json()
    beside = f", each with {', '.join(unseen.suspects)}" if unseen.suspects else ""
    sentence = (
        f"Of {figures['plants']} plants within the tolerances of parameters{beside}, {unseen.held} were held: with "
        f"95 % confidence at least {100 * unseen.held_at_least:.0f} % of all such plants."
    )
    errors = {name: figures[name] for name in ("error_median", "error_95", "error_largest")}
    words = {"error_median": "RMS error, median", "error_95": "RMS error, 95 %", "error_largest": "RMS error, largest"}
    numbers = (
        *((words[name], "-" if error is None else f"{100 * error:.2f} %") for name, error in errors.items()),
        ("guard violations", f"{figures['guard_violations']}"),
        ("commands beyond the guard's first level", f"{100 * figures['guard_share']:.2g} %"),
    )
    return Stage("Plants that the design has not seen", sentence, numbers)
