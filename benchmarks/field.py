"""E1's 60 points: msl_fem beside NGSolve in one run, alternating, one thread: CPU seconds and largest errors.

    python benchmarks/field.py [--runs 5] [--peer-python PYTHON_WITH_NGSOLVE] [--readme]

NGSolve comes with the extra `bench`. Its settings are the best found at each error. The result is a Markdown table;
with --readme it also takes its place in README.md.
"""

import argparse
import csv
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
REFERENCE = HERE.parent / "tests" / "reference" / "reference.csv"
OURS: dict[str, dict[str, object]] = {
    "fast": {"accuracy": "fast"},
    "normal, reduced": {"accuracy": "normal", "reduced": True},
    "normal": {"accuracy": "normal"},
    "fine, reduced": {"accuracy": "fine", "reduced": True},
    "fine": {"accuracy": "fine"},
}
PEER = {
    "P3, 2 layers": {"order": 3, "levels": 2, "corner": 1.5},
    "P3, 2 layers, finer": {"order": 3, "levels": 2, "corner": 1.0},
    "P4, 2 layers": {"order": 4, "levels": 2, "corner": 1.5},
    "P4, 2 layers, finer": {"order": 4, "levels": 2, "corner": 1.2},
    "P4, 3 layers, finest": {"order": 4, "levels": 3, "corner": 0.7},
}

PAIRS = (
    ("normal, reduced", "P3, 2 layers, finer", "about as exact"),
    ("normal", "P3, 2 layers, finer", "about as exact"),
    ("fine", "P4, 2 layers", "the cheapest that reaches 1e-4, the reference's uncertainty taken off"),
    ("fine", "P4, 3 layers, finest", "about as exact"),
)
"""Ours against the peer's, and why that one: no cheaper setting of it does the same."""
BEGIN, END = "<!-- benchmarks/field.py writes from here -->", "<!-- to here -->"


def run(python: str, script: str, settings: dict[str, object]) -> dict[str, object]:
    """One run in its own process with one thread; its JSON line."""
    environment = dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
    command = [python, str(HERE / script), json.dumps(settings)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return dict(json.loads(done.stdout.strip().splitlines()[-1]))


def errors(found: dict[str, object]) -> tuple[float, float, float]:
    """Largest relative error of the force, the same less the reference's own uncertainty, and of the flux linkage.

    Over the reference's points, which the values have in the order of gaps and currents.
    """
    with REFERENCE.open() as stream:
        rows = sorted(csv.DictReader(stream), key=lambda r: (float(r["gap_mm"]), float(r["current_A"])))
    every = {}
    for name, column in (("force", "force_N"), ("flux_linkage", "flux_linkage_Wb")):
        values = found[name]
        assert isinstance(values, list)
        every[name] = [abs(v / float(r[column]) - 1) for v, r in zip(values, rows, strict=True)]
    net = max(e - float(r["force_rel_uncertainty"]) for e, r in zip(every["force"], rows, strict=True))
    return max(every["force"]), net, max(every["flux_linkage"])


def into_readme(text: str) -> None:
    """Puts the text between README.md's two marks."""
    path = HERE.parent / "README.md"
    before, rest = path.read_text().split(BEGIN)
    path.write_text(before + BEGIN + "\n" + text + END + rest.split(END)[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--peer-python", default=sys.executable)
    parser.add_argument("--readme", action="store_true", help="write the table into README.md")
    given = parser.parse_args()
    seconds: dict[str, list[float]] = {}
    worst: dict[str, tuple[float, float, float]] = {}
    memory: dict[str, float] = {}
    for _ in range(given.runs):
        for tool, python, script, cases in (
            ("msl_fem", sys.executable, "ours_field.py", OURS),
            ("NGSolve", given.peer_python, "peer_ngsolve.py", PEER),
        ):
            for name, settings in cases.items():
                label = f"{tool}, {name}"
                found = run(python, script, settings)
                seconds.setdefault(label, []).append(float(str(found["cpu_seconds"])))
                worst[label] = errors(found)
                memory[label] = float(str(found.get("peak_memory_MB", "nan")))
    lines = [
        "| solver | CPU s, median (min ... max) | largest force error | less the reference's uncertainty "
        "| largest flux error | peak memory |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for label, values in seconds.items():
        spread = f"{statistics.median(values):.2f} ({min(values):.2f} ... {max(values):.2f})"
        size = f"{memory[label]:.0f} MB" if memory[label] == memory[label] else "-"
        lines.append(f"| {label} | {spread} | {' | '.join(f'{e:.1e}' for e in worst[label])} | {size} |")
    for ours, peer, why in PAIRS:
        ratios = [a / b for a, b in zip(seconds[f"msl_fem, {ours}"], seconds[f"NGSolve, {peer}"], strict=True)]
        spread = f"{statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"
        pairs = f"median of {len(ratios)} alternated pairs"
        lines += ["", f"CPU time of `{ours}` over NGSolve's ({peer}: {why}), {pairs}: {spread}."]
    text = "\n".join(lines) + "\n"
    print(text)
    if given.readme:
        into_readme(text)


if __name__ == "__main__":
    main()
