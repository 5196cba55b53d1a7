"""A small record of the reference actuator, as files that tests then spoil."""

from pathlib import Path

import numpy as np

RATE = 10e3
RIG = """
schema = 1
origin = "measured"
actuator = "fast_tool_servo"
[sampling]
rate = "10 kHz"
[[run]]
file = "noise.csv"
excitation = "band-limited noise"
role = "fit"
[[run]]
file = "sweep.csv"
excitation = "swept sine"
role = "held-out"
"""


def columns(count: int = 1000, *, seed: int = 1) -> dict[str, np.ndarray]:
    """What two sides of a current drive give: smooth signals with noise on them, (count,) each."""
    rng = np.random.default_rng(seed)
    time = np.arange(count) / RATE
    wave = np.sin(2 * np.pi * 30 * time)
    return {
        "time_s": time,
        "voltage_1_V": 2 * wave + 5e-3 * rng.normal(size=count),
        "voltage_2_V": -2 * wave + 5e-3 * rng.normal(size=count),
        "current_1_A": 0.6 + 0.3 * wave + 2e-3 * rng.normal(size=count),
        "current_2_A": 0.6 - 0.3 * wave + 2e-3 * rng.normal(size=count),
        "position_m": 1e-4 * wave + 50e-9 * rng.normal(size=count),
    }


def write_csv(path: Path, table: dict[str, np.ndarray]) -> None:
    lists = [np.asarray(column).tolist() for column in table.values()]
    rows = [",".join(table), *(",".join(map(str, row)) for row in zip(*lists, strict=True))]
    path.write_text("\n".join(rows) + "\n")


def make(folder: Path, *, rig: str = RIG, **spoilt: dict[str, np.ndarray]) -> Path:
    """A record's folder; `spoilt` gives other columns for a run by its name."""
    folder.mkdir(exist_ok=True)
    (folder / "rig.toml").write_text(rig, encoding="utf-8")
    for name in ("noise", "sweep"):
        write_csv(folder / f"{name}.csv", spoilt.get(name) or columns())
    return folder
