"""Rates of loops that run within one another."""


def whole_multiple(rate: float, of: float) -> int | None:
    """How many times as high a rate is as another, Hz both, within rounding; None where that is no whole number."""
    times = round(rate / of)
    return times if times >= 1 and abs(times * of / rate - 1) <= 1e-9 else None
