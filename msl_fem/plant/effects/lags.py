"""Lags of several poles: one pole and a delay, alike up to the second order in frequency and, nearly, the third."""

from collections.abc import Mapping
from typing import Any


def pole_and_delay(values: Mapping[tuple[str, str], Any], effect: str) -> tuple[Any, Any]:
    """(time constant, delay) in s of an effect with `lag` and `delay_share`, numbers or arrays."""
    lag, share = values[effect, "lag"], values[effect, "delay_share"]
    return (1.0 - share) * lag, share * lag


def position_delay(values: Mapping[tuple[str, str], Any]) -> Any:
    """By how much the position is read late, in s, beside its sensor's pole."""
    return values["time_delay", "position"] + pole_and_delay(values, "position_sensor_lag")[1]
