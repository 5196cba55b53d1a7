"""One sentence on which model is best on held-out runs, from the numbers."""

from collections.abc import Mapping, Sequence

import numpy as np

from msl_fem.comparison.judged import ModelAccuracy
from msl_fem.comparison.models import ARMAX, COUPLED, REFITTED
from msl_fem.comparison.residuals import LocatedResidual
from msl_fem.comparison.static_map import StaticError
from msl_fem.prediction.run_data import POSITION_COLUMN

WORDS = {
    "free_run": "in free run", "closed_loop": "in closed loop", "ten_step": "ten samples ahead",
    "one_step": "one sample ahead",
}  # fmt: skip
LEVEL = 1.05  # two models whose errors are within this factor are level
WORSE, POWERFUL = 3.0, 1e-3  # of a band: errors to compare, share of the power that counts as excited


def score(judged: Sequence[ModelAccuracy], model: str, kind: str) -> float | None:
    """RMS over the held-out runs of a model's position NRMSE; None where one is missing."""
    values = [
        j.nrmse[kind] for j in judged if j.model == model and j.role == "held-out" and j.channel == POSITION_COLUMN
    ]
    if not values or any(v is None for v in values):
        return None
    return float(np.sqrt(np.mean([v**2 for v in values if v is not None])))


def judging_kind(judged: Sequence[ModelAccuracy]) -> str | None:
    """The hardest prediction that two models at least bear on all held-out runs, or one where there is one alone."""
    names = {j.model for j in judged}
    for wanted in (min(2, len(names)), 1):
        for kind in WORDS:
            if sum(score(judged, name, kind) is not None for name in names) >= wanted:
                return kind
    return None


def comparison_verdict(
    judged: Sequence[ModelAccuracy],
    residuals: Sequence[LocatedResidual],
    floor: Mapping[str, float],
    static: Sequence[StaticError],
) -> str:
    """The sentence; `floor` holds the position's noise over its standard deviation by held-out run."""
    kind = judging_kind(judged)
    if kind is None or not floor:
        return _static_verdict(static) if static else "No model could be judged on a held-out run."
    names = list(dict.fromkeys(j.model for j in judged))
    scores = {name: value for name in names if (value := score(judged, name, kind)) is not None}
    best = min(scores, key=lambda name: scores[name])
    limit = float(np.sqrt(np.mean(np.square(list(floor.values())))))
    level = [n for n in scores if n != best and scores[n] <= LEVEL * scores[best]]
    also = f" (level with {' and '.join(level)})" if level else ""
    parts = [
        f"On held-out runs '{best}' is best {WORDS[kind]}{also}: position NRMSE {scores[best]:.3g}, "
        f"{scores[best] / limit:.3g} times the noise floor"
    ]
    if COUPLED in scores and REFITTED in scores:
        gain = scores[COUPLED] / scores[REFITTED]
        parts.append(
            f"the re-fit gains a factor of {gain:.3g} over the model as believed ({scores[COUPLED]:.3g})"
            if gain > LEVEL
            else f"the re-fit gains nothing over the model as believed ({scores[COUPLED]:.3g})"
        )
    if ARMAX in names and COUPLED in scores:
        parts.append(_armax_clause(scores, kind, residuals))
    missing = [n for n in names if n not in scores]
    if missing:
        parts.append(f"{' and '.join(missing)} could not be judged {WORDS[kind]}")
    return "; ".join(p for p in parts if p) + "."


def _armax_clause(scores: Mapping[str, float], kind: str, residuals: Sequence[LocatedResidual]) -> str:
    if ARMAX not in scores:
        return ""
    ratio = scores[COUPLED] / scores[ARMAX]
    if ratio > LEVEL:
        text = f"the coupled model as believed loses to ARMAX ({scores[ARMAX]:.3g}) by a factor of {ratio:.3g}"
    elif ratio < 1 / LEVEL:
        text = f"ARMAX ({scores[ARMAX]:.3g}) loses to the coupled model as believed by a factor of {1 / ratio:.3g}"
    else:
        text = f"ARMAX ({scores[ARMAX]:.3g}) and the coupled model as believed are level"
    outside = armax_outside_its_band(residuals)
    return f"{text}, and fails outside its band, {outside}" if outside else text


def armax_outside_its_band(residuals: Sequence[LocatedResidual]) -> str:
    """The held-out band that the fit runs hardly excited and where ARMAX errs most, in words; none: an empty text."""
    own = [r for r in residuals if r.judged.model == ARMAX]
    fit = [r for r in own if r.judged.role == "fit"]
    if not fit:
        return ""
    excited: dict[float, float] = {}
    for r in fit:
        power = r.bands.measured**2
        for low, share in zip(r.bands.edges[:-1], power / np.nansum(power), strict=True):
            excited[float(low)] = max(excited.get(float(low), 0.0), float(np.nan_to_num(share)))
    inside: list[tuple[float, float, float]] = []
    outside: list[tuple[float, float, float]] = []
    for r in own:
        if r.judged.role != "held-out":
            continue
        power = r.bands.measured**2 / np.nansum(r.bands.measured**2)
        for n, error in enumerate(r.bands.nrmse):
            low, high = float(r.bands.edges[n]), float(r.bands.edges[n + 1])
            if np.isfinite(error) and power[n] > POWERFUL:
                (inside if excited.get(low, 0.0) > POWERFUL else outside).append((float(error), low, high))
    if not outside or not inside:
        return ""
    worst = max(outside)
    typical = float(np.median([e for e, _, _ in inside]))
    if worst[0] < WORSE * typical:
        return ""
    return f"{worst[1]:.3g} ... {worst[2]:.3g} Hz: NRMSE {worst[0]:.2g} there, {typical:.2g} in its band"


def _static_verdict(static: Sequence[StaticError]) -> str:
    judged = [s for s in static if s.role == "held-out"] or list(static)
    where = "held-out rows" if judged[0].role == "held-out" else "the rows of the map, all of which are marked fit,"
    best = min(judged, key=lambda s: s.of_full_scale)
    return (
        f"On {where} the table of '{best.model}' is best: {best.quantity.rsplit('_', 1)[0].replace('_', ' ')} off by "
        f"{100 * best.of_full_scale:.2g} % of full scale (RMS), measured over computed {best.scale:.4g}."
    )
