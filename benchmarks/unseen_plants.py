"""Loops on plants that their designs have not seen: within tolerances, alone and with the suspects that hurt most.

    python benchmarks/unseen_plants.py [--plants 500] [--kept unseen_plants.json] [--docs]

Each row is kept as soon as it is done; the same command again goes on. All of a row's plants are drawn with seeds of
their own, so that designs meet the same plants. With --docs the tables of docs/control.md are written anew.
"""

import argparse
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from controller_cases import DOCUMENT, SERVO, TABLE, design, sine
from marked_text import rewrite

from msl_fem.control import PlantUnderTest
from msl_fem.control.unseen_plants import SUSPECTS, on_unseen_plants, random_plant, suspected_plant
from msl_fem.files.whole_file import whole_file

SEED = 40817
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


def judged(table: str, case: Case, n: int) -> dict[str, Any]:
    kind, amplitude, frequency = case
    draw = partial(DRAWS[table][0], BELIEVED)
    suspects = SUSPECTS if table != "tolerances" else ()
    track = sine(amplitude, frequency, 1.0 if frequency < 20 else 0.5)
    return on_unseen_plants(design(kind), track, draw, n=n, seed=SEED, suspects=suspects).to_json()


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
    parser.add_argument("--most", type=int, default=100, help="rows that are computed now")
    parser.add_argument("--docs", action="store_true")
    asked = parser.parse_args()
    kept = json.loads(asked.kept.read_text()) if asked.kept.exists() else {}
    left = asked.most
    for table, (_, cases) in reversed(DRAWS.items()):
        for case in cases:
            key = json.dumps([table, *case, asked.plants, SEED])
            if key not in kept and left:
                left -= 1
                kept[key] = judged(table, case, asked.plants)
                with whole_file(asked.kept) as part:
                    part.write_text(json.dumps(kept))
            if key in kept:
                print(table, row(case, kept[key]), flush=True)
    if asked.docs:
        made = {}
        for table, (_, cases) in DRAWS.items():
            rows = [row(case, kept[json.dumps([table, *case, asked.plants, SEED])]) for case in cases]
            made[table] = HEAD + "\n".join(rows)
        rewrite(DOCUMENT, made)


if __name__ == "__main__":
    main()
