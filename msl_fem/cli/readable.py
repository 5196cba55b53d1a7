"""Fields of a JSON object as people read them: words instead of keys, mm, mA and % instead of SI numbers."""

import math

from msl_fem.files.quantity import format_quantity

UNITS = {
    "N_s_per_m": "N s/m",
    "N_per_m": "N/m",
    "N_per_A": "N/A",
    "N_per_V": "N/V",
    "m_per_s": "m/s",
    "W_per_kg": "W/kg",
    "K_per_W": "K/W",
    "W_per_K": "W/K",
    "A_per_m": "A/m",
    "kg": "kg",
    "Hz": "Hz",
    "Wb": "Wb",
    "ohm": "ohm",
    "deg": "deg",
    "dB": "dB",
    "Pa": "Pa",
    "m": "m",
    "A": "A",
    "V": "V",
    "N": "N",
    "H": "H",
    "J": "J",
    "W": "W",
    "T": "T",
    "K": "K",
    "s": "s",
}
"""Endings of keys to units; the longest that fits counts."""
SHARES = (
    "error", "error_estimate", "error_median", "error_95", "error_largest", "share", "share_at_least", "imbalance",
    "error_of_sides_apart", "effectivity_error",
)  # fmt: skip
"""Endings of keys whose numbers are shares."""
WHOLE = {
    "rms": "RMS",
    "nrmse": "NRMSE",
    "armax": "ARMAX",
    "ci95": "95 % interval",
    "cpu": "CPU",
    "aicc": "AICc",
    "iso": "ISO",
}
"""Words that are written otherwise."""


def readable_name(path: str) -> str:
    """The words of a key path: "runs.step.position_rms_m" is "runs, step: position RMS"."""
    if " " in path.partition(".")[0]:  # words already
        return path
    *outer, last = (part if " " in part else _words(_without_unit(part)) for part in path.split("."))
    return f"{', '.join(outer)}: {last}" if outer else last


def _words(key: str) -> str:
    return " ".join(WHOLE.get(word, word) for word in key.split("_"))


def unit_of_key(key: str) -> str:
    """The unit that a key ends in, "" where it has none."""
    return next((unit for ending, unit in UNITS.items() if key.endswith(f"_{ending}")), "")


def _without_unit(key: str) -> str:
    for ending in UNITS:
        if key.endswith(f"_{ending}"):
            return key[: -len(ending) - 1]
    return key


def readable_number(value: float, path: str) -> str:
    """A number of a key path with its unit: lengths from 0.1 mm on in mm, shares in per cent."""
    value += 0.0  # no -0
    key = next((part for part in reversed(path.split(".")) if unit_of_key(part) or part.endswith(SHARES)), "")
    unit = unit_of_key(key)
    if "fit_percent" in path:
        return f"{value:.4g} %"
    if not unit and key.endswith(SHARES) and not key.endswith("standard_error"):
        return f"{100 * value:.3g} %"
    if unit == "m" and 1e-4 <= abs(value) < 1.0:
        return f"{1e3 * value:.4g} mm"
    if unit in ("", "T", "dB", "deg") or not math.isfinite(value) or (unit == "s" and abs(value) >= 1e3):
        return f"{value:.4g} {unit}".rstrip()
    if unit == "K" and _without_unit(key).rpartition("_")[2] in ("temperature", "ambient"):
        return f"{value - 273.15:.4g} °C"
    return format_quantity(value, unit, digits=4)
