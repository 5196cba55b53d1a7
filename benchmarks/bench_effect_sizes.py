"""What makes an effect of one per cent on the virtual bench, in either drive: the table of docs/bench.md.

python benchmarks/bench_effect_sizes.py [seed]
"""

import sys
import time
from pathlib import Path

from marked_text import rewrite

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.bench import INSIDE, OUTSIDE_BY_NAME, BenchOptions, usual_excitations
from msl_fem.bench.sealed import prepared_setting
from msl_fem.bench.setting import BenchEffect, BenchSetting, effect_of_size
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parent.parent
DOCUMENT = ROOT / "docs" / "bench.md"
SIZE, RATE = 0.01, 1e4
SHORT = {"voltage_1_V": "v", "voltage_2_V": "v", "current_1_A": "i", "current_2_A": "i", "position_m": "x"}


def in_voltage_drive(actuator: Actuator) -> Actuator:
    assert actuator.drive is not None
    return actuator.model_copy(
        update={"drive": actuator.drive.model_copy(update={"kind": "voltage", "bandwidth": None})}
    )


def _short(value: float, unit: str) -> str:
    """Two digits and a unit."""
    return format_quantity(float(f"{value:.2g}"), unit, digits=3)


def cell(setting: BenchSetting, effect: BenchEffect) -> str:
    """The strength that makes one per cent and the channel that shows it, or why there is none."""
    try:
        found = effect_of_size(setting, effect, SIZE, exact=True)
    except InputError as err:
        return (
            "not visible"
            if "not visible" in str(err)
            else f"at most {str(err).rpartition('at most ')[2].partition(' can')[0]}"
        )
    channel = SHORT[max(found.channels, key=lambda name: found.channels[name])]
    strength = f"{found.strength:.2g}" if effect.unit == "1" else _short(found.strength, effect.unit)
    if effect.least is not None:
        strength += f" (6 tolerances: {_short(effect.least(setting), effect.unit)})"
    return f"{strength}, {channel}"


def rows(settings: dict[str, BenchSetting]) -> list[str]:
    lines = ["| effect | strength | voltage drive | current drive |", "| --- | --- | --- | --- |"]
    for name, effect in (INSIDE | OUTSIDE_BY_NAME).items():
        begin = time.process_time()
        cells = [cell(setting, effect) for setting in settings.values()]
        said = f"`{name}`" if name in INSIDE else f"`outside:{name}`"
        lines.append(f"| {said} | {effect.parameter.replace('_', ' ')} | {' | '.join(cells)} |")
        print(f"{name:30} {' | '.join(cells):60} {time.process_time() - begin:6.1f} s", flush=True)
    return lines


def main() -> None:
    seed = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    servo = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    table = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    settings = {}
    for drive, actuator in (("voltage", in_voltage_drive(servo)), ("current", servo)):
        excitations = usual_excitations(actuator, table, rate=RATE)
        settings[drive] = prepared_setting(actuator, table, excitations, BenchOptions(seed=seed))
        for one in excitations:
            print(drive, one.spec)
    rewrite(DOCUMENT, {"sizes": "\n".join(rows(settings))})


if __name__ == "__main__":
    main()
