"""The figures of docs/decoupling.md: how far the reference actuator's two sides are decoupled over its map.

    python benchmarks/decoupling.py [--accuracy fine] [--armature MM] [--picture FILE.png]

A quarter of a minute on one core, at the accuracy `fine` three minutes.
"""

import argparse
from pathlib import Path

import numpy as np

from msl_fem.actuator import load_actuator
from msl_fem.magnetics.field_map import DecouplingMap, FieldMapSettings, decoupling_map
from msl_fem.report.field_picture import save_picture
from msl_fem.report.pictures import draw_decoupling

SERVO = Path(__file__).parent.parent / "geometries" / "fast_tool_servo.toml"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--accuracy", default="normal", choices=("fast", "normal", "fine"))
    options.add_argument("--armature", type=float, help="another thickness of the armature, in mm")
    options.add_argument("--picture", type=Path)
    given = options.parse_args()
    settings = FieldMapSettings(accuracy=given.accuracy, end_effects=False)  # as the page says
    actuator = load_actuator(SERVO)
    if given.armature is not None:
        magnet = actuator.magnet.model_copy(update={"armature_thickness": given.armature * 1e-3})
        actuator = actuator.model_copy(update={"magnet": magnet})
    found = decoupling_map(actuator, settings=settings)
    print_shares(found)
    for name, error in zip(("aiding", "opposing"), found.force_error, strict=True):
        print_errors(found, name, error)
    print(f"\nuncertainty of these errors: {100 * found.uncertainty:.2g} %")
    print("\n".join(f"- {sentence}" for sentence in found.findings()))
    if given.picture is not None:
        save_picture(draw_decoupling(found), given.picture)


def print_shares(found: DecouplingMap) -> None:
    """The linked share over the gap of the side that is on."""
    levels = found.level[1:]
    print("| gap (mm) | " + " | ".join(f"{level:g} T" for level in levels) + " |")
    print("| ---: " * (levels.size + 1) + "|")
    share = found.linked_share[:, :, 1:].reshape(-1, levels.size)
    gap = found.gap.ravel()
    for m in np.unique(gap.round(9), return_index=True)[1]:
        print(f"| {gap[m] * 1e3:.3f} | " + " | ".join(f"{100 * s:.2f}" for s in share[m]) + " |")


def print_errors(found: DecouplingMap, name: str, error: np.ndarray) -> None:
    """The force error over the position, one side on and pairs of levels."""
    pairs = [(j, k) for j in range(1, found.level.size) for k in range(1, found.level.size)]
    print(f"\n{name}: one side on (worst up to the preferred level), then side 1 / side 2 in T")
    print("| position (mm) | one on | " + " | ".join(f"{found.level[j]:g}/{found.level[k]:g}" for j, k in pairs) + " |")
    print("| ---: " * (len(pairs) + 2) + "|")
    for p, position in enumerate(found.position):
        one = np.nanmax(np.abs(error[p][found.one_side_on() & found.both_preferred()]))
        row = [f"{100 * one:.2f}"] + [f"{100 * error[p, j, k]:.2f}" for j, k in pairs]
        print(f"| {position * 1e3:.3f} | " + " | ".join(row) + " |")


if __name__ == "__main__":
    main()
