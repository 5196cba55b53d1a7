"""The motion before and after a diagnosis, played: where the mover was measured, and where each model has it."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.result import ChannelResiduals
from msl_fem.files.quantity import format_quantity
from msl_fem.report.page import Stage, Widget, html_from, page_part, script_text

FRAMES = 300
SPAN = 0.4  # s at most, of which the picture is made
LEFT, RIGHT = 40.0, 700.0  # of the tracks, in the drawing's own units; the block at its middle
SHOWN = 0.12  # of the track's length, that the largest distance from the measured place may take


@dataclass(frozen=True, eq=False)
class PlayedMotion:
    """A piece of a run as it is drawn.

    Attributes
    ----------
    time : (n_frame,) s
    measured : (n_frame,) m
    errors : model to (n_frame,) measured less modelled, m
    magnified : times as large as they are distances from the measured place are drawn, a round number
    """

    time: Array
    measured: Array
    errors: tuple[tuple[str, Array], ...]
    magnified: float

    def places(self) -> list[Array]:
        """Where the measured mover is drawn, and each model's."""
        low, high = float(self.measured.min()), float(self.measured.max())
        scale = (RIGHT - LEFT) * (1 - 2 * SHOWN) / (high - low)
        middle = (LEFT + RIGHT) / 2 + scale * (self.measured - (low + high) / 2)
        return [middle, *(middle - scale * self.magnified * error for _, error in self.errors)]


def motion_of(left: ChannelResiduals, measured: Array, models: Sequence[tuple[str, Array]]) -> PlayedMotion | None:
    """A piece of a run about the largest error of the first model; None where the mover hardly moves in it or a model
    does not follow.

    Parameters
    ----------
    models : name and residual (n_sample,) of each, the first with the larger errors
    """
    first = np.nan_to_num(models[0][1])
    width = min(first.size, max(2, round(SPAN * left.rate)))
    begin = int(np.clip(np.argmax(np.abs(first)) - width // 2, 0, first.size - width))
    at = begin + np.unique(np.linspace(0, width - 1, FRAMES).astype(int))
    errors = tuple((name, values[at]) for name, values in models)
    moved = float(np.ptp(measured[at]))
    largest = float(np.abs([values for _, values in errors]).max())
    if not (np.isfinite(largest) and largest > 0 and moved > 10 * left.sigma):
        return None
    room = SHOWN / (1 - 2 * SHOWN) * moved / largest
    return PlayedMotion(left.time[at], measured[at], errors, max(1.0, _round_below(room)))


def _round_below(value: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(factor * power for factor in (1, 2, 5) if factor * power <= value * (1 + 1e-9)))


def motion_stage(left: ChannelResiduals, motion: PlayedMotion) -> Stage:
    """The section of the page."""
    seconds = format_quantity(float(motion.time[-1] - motion.time[0]), "s", digits=3)
    larger = f"{motion.magnified:g} times as large as they are" if motion.magnified > 1 else "as they are"
    sentence = (
        f"Run {left.run} ({left.role}), {seconds} about the largest error, slowed down. Distances of models from the "
        f"measured place (dashed) are drawn {larger}."
    )
    return Stage("Evidence: the motion", sentence, (), widget=_widget(motion))


def _widget(motion: PlayedMotion) -> Widget:
    places = motion.places()
    names = ["measured", *(name for name, _ in motion.errors)]
    low, high = float(motion.measured.min()), float(motion.measured.max())
    across = LEFT + (RIGHT - LEFT) * np.linspace(0, 1, motion.time.size)
    up = 300 - 70 * (motion.measured - low) / (high - low)
    data = {
        "places": [np.round(one, 2).tolist() for one in places],
        "cursor": np.round(across, 2).tolist(),
        "time": [format_quantity(float(t), "s", digits=5) for t in motion.time],
    }
    html = html_from(
        "motion.html.j2",
        tracks=list(zip(names, ("measured", "before", "after"), [float(one[0]) for one in places], strict=False)),
        curve=" ".join(f"{x:.1f},{y:.1f}" for x, y in zip(across, up, strict=True)),
        left=LEFT,
        right=RIGHT,
        last=motion.time.size - 1,
        low=format_quantity(low, "m", digits=4),
        high=format_quantity(high, "m", digits=4),
        begin=data["time"][0],
        data=script_text(json.dumps(data)),
    )
    return Widget(html, page_part("motion.js"))
