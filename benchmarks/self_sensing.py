"""Position by the coil over the preferred region, on plants with more and less that the observer does not know.

    python benchmarks/self_sensing.py [--docs]

With --docs the table of docs/self_sensing.md is written anew.
"""

import argparse
from pathlib import Path

import numpy as np
from controller_cases import SERVO, TABLE
from marked_text import rewrite

from msl_fem.comparison.as_designed import as_designed
from msl_fem.control.self_sensing import SelfSensing, self_sensing
from msl_fem.control.unseen_plants import with_more
from msl_fem.maps import Guard, operating_map
from msl_fem.plant.effects import EffectValues

DOCUMENT = Path(__file__).parent.parent / "docs" / "self_sensing.md"
UNKNOWN: dict[str, dict[str, dict[str, float]]] = {
    "as designed": {},
    "and leakage 3 % off": {"leakage_inductance": {"share_1": 0.03}},
    "and the gap's depth 1 % off": {"fringing": {"depth_error": 0.01}},
    "and eddy currents of 50 us": {"eddy_currents": {"time_constant": 50e-6}},
    "and a remanent flux of 30 mA": {"remanent_flux": {"current_1": 0.03}},
}
HEAD = (
    "| plant | within 2 times the bound | bound, median | error: median | worst | mean error, median |\n"
    "| --- | --- | --- | --- | --- | --- |\n"
)


def row(name: str, found: SelfSensing) -> str:
    bound, error, bias = (np.median(np.abs(part)) * 1e6 for part in (found.bound, found.error, found.bias))
    worst = found.error.max() * 1e6
    return f"| {name} | {100 * found.share:.0f} % | {bound:.1f} um | {error:.1f} um | {worst:.0f} um | {bias:.1f} um |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--docs", action="store_true")
    asked = parser.parse_args()
    guard = Guard(operating_map(TABLE))
    rows = [row("nothing unknown", self_sensing(SERVO, TABLE, guard))]
    print(rows[-1], flush=True)
    known = as_designed(SERVO, TABLE).effects or EffectValues()
    for name, more in UNKNOWN.items():
        found = self_sensing(SERVO, TABLE, guard, effects=with_more(known, more), known=known)
        rows.append(row(name, found))
        print(rows[-1], flush=True)
    if asked.docs:
        rewrite(DOCUMENT, {"self-sensing": HEAD + "\n".join(rows)})


if __name__ == "__main__":
    main()
