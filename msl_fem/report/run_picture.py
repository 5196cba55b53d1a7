"""A run as a picture: every channel over time, with what it was made of."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from msl_fem.files.whole_file import whole_file
from msl_fem.record import Run

PREFIXED = {"m", "A", "V", "N", "Wb", "T"}
SMALL = (("m", 1e3), ("µ", 1e6), ("n", 1e9))
MOST_POINTS = 20_000  # a channel; more are thinned by equal steps, and the title says so


def draw_run(run: Run, *, made_of: Mapping[str, str] | None = None) -> Figure:
    """One panel for each channel; `made_of` says for a column where it came from."""
    names = [name for name in run.columns if name != "time_s"]
    step = max(1, -(-run.time.size // MOST_POINTS))
    figure = Figure(figsize=(9.0, 1.0 + 1.7 * len(names)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for panel, name in zip(panels, names, strict=True):
        label, scale = _label(name, float(np.abs(run[name]).max()))
        panel.plot(run.time[::step], run[name][::step] * scale, linewidth=0.8, color="#0072B2")
        panel.set_ylabel(label)
        panel.margins(x=0.01)
        panel.grid(alpha=0.3)
        if made_of and name in made_of:
            panel.set_title(made_of[name], loc="right", fontsize=8)
    panels[-1].set_xlabel("time in s")
    thinned = f", one sample of {step} drawn" if step > 1 else ""
    rate = 1 / run.sampling_period
    figure.suptitle(f"{run.name}: {run.time.size} samples at {rate:.6g} Hz, role {run.role}{thinned}", fontsize=11)
    return figure


def _label(column: str, largest: float) -> tuple[str, float]:
    """What a panel's axis says, and the factor to its unit: with a prefix where the values are small.

    Units that take no prefix here ("m_per_s", "degC") keep their values as they are.
    """
    above, per, below = column.partition("_per_")
    quantity, _, unit = above.rpartition("_")
    unit += f"/{below}" if per else ""
    prefix, scale = "", 1.0
    if unit in PREFIXED and 0 < largest < 0.1:
        prefix, scale = next(((p, s) for p, s in SMALL if largest * s >= 1), SMALL[-1])
    return f"{quantity.replace('_', ' ')} in {prefix}{unit}", scale


def save_run_picture(run: Run, path: str | Path, *, made_of: Mapping[str, str] | None = None) -> Path:
    """The PNG written; it appears whole or not at all. Raises InputError where it cannot be written."""
    target = Path(path)
    figure = draw_run(run, made_of=made_of)
    with whole_file(target) as partial:
        figure.savefig(partial, dpi=120, format="png")
    return target
