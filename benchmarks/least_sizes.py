"""The least size of each effect that a record of 4 s can show, before anything is measured: docs/diagnosis.md.

    python benchmarks/least_sizes.py

Records are planned ones: the usual excitations of the virtual bench, simulated by the believed model itself.
"""

import numpy as np
from diagnosis_study import DRIVES, ROOT, actuator_of
from marked_text import rewrite

from msl_fem.bench import BenchOptions, sealed_record
from msl_fem.diagnosis.fit import fit
from msl_fem.diagnosis.least_sizes import LeastSize, least_sizes
from msl_fem.diagnosis.prepare import prepared
from msl_fem.diagnosis.scene import scene
from msl_fem.diagnosis.scoring import scores
from msl_fem.diagnosis.variants import possible, variants
from msl_fem.files.quantity import format_quantity
from msl_fem.plant.effects import CATALOGUE, find_parameter
from msl_fem.prediction import ModelHypothesis, run_data
from msl_fem.table.magnetic_table import read_table

DOCUMENT = ROOT / "docs" / "diagnosis.md"
IDENTIFIABLE = 0.03


def of_drive(drive: str) -> dict[str, LeastSize]:
    """Least sizes in a drive, by effect."""
    actuator, table = actuator_of(drive), read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    record = sealed_record(actuator, table, (), BenchOptions(seed=1)).record
    belief = ModelHypothesis(record.actuator, table)
    likelihood, unknowns = prepared(belief, [run_data(record, record.runs[0])], record.tolerance)
    base = fit(likelihood, unknowns, np.zeros(unknowns.size))
    plant = likelihood.problem.plant.parameters
    tried = [v for e in possible(plant) for v in variants(e, scene(likelihood, base), plant)]
    return {one.effect: one for one in least_sizes(likelihood, base, scores(likelihood, base, tried))}


def table_of(found: dict[str, dict[str, LeastSize]]) -> str:
    head = ["effect", *(f"{drive}: least size | by other shapes | amount | all else known" for drive in found)]
    lines = ["| " + " | ".join(head) + " |", "| --- " * (1 + 4 * len(found)) + "|"]
    for effect in CATALOGUE:
        cells = [f"`{effect}`"]
        for drive in found:
            one = found[drive].get(effect)
            cells += ["-"] * 4 if one is None else _cells(one)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def not_seen(sizes: dict[str, LeastSize]) -> list[str]:
    """Effects that a drive cannot show at 3 %, or not by all shapes."""
    gone = [effect for effect in CATALOGUE if effect not in sizes or sizes[effect].size > IDENTIFIABLE]
    half = [effect for effect, one in sizes.items() if one.size <= IDENTIFIABLE < one.slowest]
    return [*gone, *(f"{effect} by some of its shapes" for effect in half)]


def _cells(one: LeastSize) -> list[str]:
    unit = find_parameter(one.effect, one.name).unit
    amount = format_quantity(one.amount, unit, digits=2) if unit else f"{one.amount:.2g}"
    slowest = f"to {100 * one.slowest:.2g} %" if one.slowest > 1.05 * one.size else ""
    return [f"{100 * one.size:.2g} %", slowest, f"{one.name} {amount}", f"{100 * one.alone:.1g} %"]


def main() -> None:
    found = {drive: of_drive(drive) for drive in DRIVES}
    text = table_of(found)
    said = "; ".join(f"{drive} drive: {', '.join(not_seen(sizes)) or 'all can'}" for drive, sizes in found.items())
    text += f"\n\nNot to be found at 3 % on such a record: {said}."
    print(text)
    rewrite(DOCUMENT, {"least sizes": text})


if __name__ == "__main__":
    main()
