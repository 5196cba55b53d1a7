"""Numbers as the pages say them."""

import numpy as np


def millimetres(length: float) -> str:
    """A length in m, in mm."""
    return f"{length * 1e3:.3g} mm"


def words(name: str) -> str:
    """A name of the files as words."""
    return name.replace("_", " ")


def percent(share: float) -> str:
    """A share in per cent."""
    return f"{100 * share:.2g} %"


def fit_text(percent: float | None) -> str:
    """A fit in per cent; a free run that left all bounds has none."""
    return "diverged" if percent is None else f"{percent:.2f} %"


def hertz(frequency: float) -> str:
    """A frequency in whole Hz; not finite where none was reached."""
    return f"{frequency:.0f} Hz" if np.isfinite(frequency) else "beyond the frequencies tried"


def round_values(low: float, high: float) -> list[float]:
    """The ends and some of 1, 2, 3, 5, 8 times a power of ten between, at most seven in all, no two nearly alike."""
    powers = range(int(np.floor(np.log10(low))) - 1, int(np.ceil(np.log10(high))) + 1)
    between = [round(step * 10.0**power, 12) for power in powers for step in (1, 2, 3, 5, 8)]
    inside = [value for value in between if 1.15 * low < value < high / 1.15]
    kept = inside[:: max(1, -(-len(inside) // 5))] if len(inside) > 5 else inside
    return [low, *kept, high]
