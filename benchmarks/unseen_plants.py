"""Loops on plants that their designs have not seen: within tolerances, alone and with the suspects that hurt most.

    python benchmarks/unseen_plants.py [--plants 500] [--kept unseen_plants.json] [--docs]

Every part of a row is kept as soon as it is done; the same command again goes on. Plants are drawn with seeds of their
own, so that designs meet the same ones. With --docs the tables of docs/control.md are written anew.
"""

import argparse
import json
import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from controller_cases import DOCUMENT, SERVO, TABLE, design, sine
from marked_text import rewrite

from msl_fem.control import PlantUnderTest
from msl_fem.control.unseen_plants import UnseenPlants, on_unseen_plants, random_plant, suspected_plant
from msl_fem.files.whole_file import whole_file

SEED = 40817
PART = 25  # plants
LOST = 1e9  # error of a plant whose run ended early
BELIEVED = PlantUnderTest(SERVO, TABLE)
Case = tuple[str, float, float]  # design, amplitude in m, frequency in Hz
TOLERANCES: tuple[Case, ...] = (
    ("lqr", 0.4e-3, 2.0),
    ("robust", 0.4e-3, 2.0),
    ("scheduled", 0.4e-3, 2.0),
    ("pid", 0.3e-3, 2.0),
)
WITH_SUSPECTS: tuple[Case, ...] = (
    ("robust", 0.2e-3, 2.0),
    ("scheduled", 0.2e-3, 2.0),
    ("lqr", 0.2e-3, 2.0),
    ("pid", 0.2e-3, 2.0),
    ("robust", 0.4e-3, 2.0),
    ("scheduled", 0.4e-3, 2.0),
    ("robust", 0.1e-3, 60.0),
    ("scheduled", 0.1e-3, 60.0),
)
DRAWS: dict[str, tuple[Callable[..., PlantUnderTest], tuple[Case, ...]]] = {
    "tolerances": (random_plant, TOLERANCES),
    "tolerances and effects": (suspected_plant, WITH_SUSPECTS),
}
HEAD = (
    "| design | sine | held | of all such plants, at least | error: median | 95 % | largest | guard violations |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- |\n"
)


def judged(table: str, case: Case, n: int, seed: int) -> dict[str, list[float]]:
    """What a design did on `n` plants of a seed."""
    kind, amplitude, frequency = case
    draw = partial(DRAWS[table][0], BELIEVED)
    track = sine(amplitude, frequency, 1.0 if frequency < 20 else 0.5)
    found = on_unseen_plants(design(kind), track, draw, n=n, seed=seed)
    rows = np.nan_to_num(np.stack([found.error, found.violations, found.guarded]), nan=LOST)
    return {"rows": rows.tolist()}


def together(parts: list[dict[str, list[float]]]) -> dict[str, Any]:
    """The figures of all parts of a row."""
    error, violations, guarded = np.hstack([np.array(part["rows"]) for part in parts])
    return UnseenPlants((), np.where(error >= LOST, np.nan, error), violations, guarded).to_json()


def row(case: Case, found: dict[str, Any]) -> str:
    kind, amplitude, frequency = case
    errors = [found[name] for name in ("error_median", "error_95", "error_largest")]
    texts = ["-" if error is None else f"{100 * error:.2f} %" for error in errors]
    return (
        f"| {kind} | {amplitude * 1e3:g} mm, {frequency:g} Hz | {found['held']} of {found['plants']} "
        f"| {100 * found['held_share_at_least']:.1f} % | {' | '.join(texts)} | {found['guard_violations']} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plants", type=int, default=500)
    parser.add_argument("--kept", type=Path, default=Path("unseen_plants.json"))
    parser.add_argument("--seconds", type=float, default=math.inf, help="after which no further part is begun")
    parser.add_argument("--only", nargs="*", default=[], help="designs; without, all of them")
    parser.add_argument("--docs", action="store_true")
    asked = parser.parse_args()
    kept = json.loads(asked.kept.read_text()) if asked.kept.exists() else {}
    begun, written = time.monotonic(), {}
    for table, (_, cases) in reversed(DRAWS.items()):
        rows = []
        for case in cases:
            if asked.only and case[0] not in asked.only:
                continue
            parts = []
            for k in range(asked.plants // PART):
                key = json.dumps([table, *case, SEED + k])
                if key not in kept and time.monotonic() - begun < asked.seconds:
                    kept[key] = judged(table, case, PART, SEED + k)
                    with whole_file(asked.kept) as part:
                        part.write_text(json.dumps(kept))
                parts += [kept[key]] if key in kept else []
            if parts:
                rows.append(row(case, together(parts)))
                print(table, rows[-1], flush=True)
        written[table] = HEAD + "\n".join(rows)
    if asked.docs:
        rewrite(DOCUMENT, written)


if __name__ == "__main__":
    main()
