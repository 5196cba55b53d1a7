"""Suspects of the reference machine, ranked before any measurement, beside the virtual bench with each of them in it.

    python benchmarks/suspects.py [DRIVE ...] [--seed N]

The bench has physics of its own and takes the runs that the ranking took. Each suspect is put in at the expected size,
whose numbers are turned into what the bench asks for by the physics alone (a gap at the edge for a variance of the gap,
a conductance for a time constant); what the ranking leaves open the seed draws. Measured is the RMS change over RMS of
the channel that changes most. The tables of docs/comparison.md.
"""

import argparse
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from marked_text import rewrite
from study_rigs import ROOT, servo_in

from msl_fem.actuator import Actuator
from msl_fem.bench import INSIDE, BenchOptions
from msl_fem.bench.plant import Thermal
from msl_fem.bench.rig import Rig
from msl_fem.bench.sealed import prepared_setting
from msl_fem.bench.setting import BenchSetting, changes, channels, runs_of
from msl_fem.diagnosis.planning.ranking import Suspect, SuspectRanking, SuspectSettings, suspects
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.materials.constants import TEMPERATURE_COEFFICIENT
from msl_fem.plant.effects import find_parameter
from msl_fem.plant.excitation import DRIVE_UNIT, parse_excitation
from msl_fem.table.magnetic_table import MagneticTable, read_table

DOCUMENT = ROOT / "docs" / "comparison.md"
RATE, WITHIN = 1e4, 1.5
Strength = Callable[[BenchSetting, Suspect], float]


def _inductance(setting: BenchSetting) -> float:
    magnets = setting.rig.plant.magnets
    assert setting.table is not None
    slope = setting.table.evaluate(0.0, magnets.nominal_gap)["incremental_inductance"]
    return magnets.per_side * magnets.share**2 * float(slope)


def _per_strength(setting: BenchSetting, name: str, number: str) -> float:
    """A number that the bench states of an effect, at a strength of a thousandth, over that strength."""
    return INSIDE[name].hide(setting, setting.rig, 1e-3)[1][number] / 1e-3


STRENGTHS: dict[str, Strength] = {
    "armature_tilt": lambda s, one: math.sqrt(3 * one.cause.size),
    "fringing": lambda s, one: one.cause.size / _per_strength(s, "fringing", "flux_at_nominal_gap"),
    "eddy_currents": lambda s, one: one.cause.size / _inductance(s) / _per_strength(s, "eddy_currents", "conductance"),
    "mutual_inductance": lambda s, one: abs(one.cause.size),
    "cross_coupling": lambda s, one: 2 * one.cause.size,  # M is share (L_1 + L_2) here, share L_1 L_2/L there
    "stiffness_nonlinearity": lambda s, one: one.cause.size * s.scales.position**2 / s.rig.plant.motion.stiffness,
    "support_compliance": lambda s, one: one.cause.size * s.rig.plant.motion.stiffness,
    "position_sensor_nonlinearity": lambda s, one: one.cause.size * s.scales.position,
    "sensor_drift": lambda s, one: one.cause.size * s.scales.duration / math.sqrt(3),
}
"""What the bench asks for, where it is not the number of the catalogue."""


def _heat(rig: Rig, one: Suspect) -> Rig:
    """Winding and core with the drawn heat capacities and time constants."""
    told = one.cause.values
    coil_time, core_time = 1 / told["cooling_rate"], 1 / told["core_rate"]
    to_core = told["rise_per_joule"] / TEMPERATURE_COEFFICIENT * coil_time  # K/W: time constant over heat capacity
    return rig.with_parts(thermal=Thermal(to_core, to_core, coil_time, core_time))


def _mode(rig: Rig, one: Suspect) -> Rig:
    frequency = 2 * math.pi * one.cause.values["frequency"]
    return rig.with_parts(attached=rig.plant.attached._replace(frequency=frequency))


def _hum(rig: Rig, one: Suspect) -> Rig:
    frequency = 2 * math.pi * find_parameter(one.cause.effect, "frequency").neutral
    return rig.with_parts(disturbance=rig.plant.disturbance._replace(hum_frequency=frequency))


def _remanence(rig: Rig, one: Suspect) -> Rig:
    first, second = one.cause.values.values()
    return rig.with_parts(stray=rig.plant.stray._replace(remanent_1=first, remanent_2=second))


def _crosstalk(rig: Rig, one: Suspect) -> Rig:
    first, second = one.cause.values.values()
    return replace(rig, instruments=replace(rig.instruments, coil_reading=(first, second)))


AS_EXPECTED: dict[str, Callable[[Rig, Suspect], Rig]] = {
    "coil_heating": _heat,
    "structural_mode": _mode,
    "periodic_disturbance": _hum,
    "remanent_flux": _remanence,
    "position_sensor_crosstalk": _crosstalk,
}
"""Numbers that the bench draws for itself and the ranking states: signs, frequencies, heat capacities."""


def measured(setting: BenchSetting, one: Suspect) -> float | None:
    """The change on the bench; None where it has no such effect, or its runs do not bear it."""
    effect = INSIDE[one.cause.effect]
    strength = STRENGTHS.get(effect.name, lambda _, suspect: suspect.cause.size)(setting, one)
    try:
        rig, _ = effect.hide(setting, setting.rig, strength)
        rig = AS_EXPECTED.get(effect.name, lambda hidden, _: hidden)(rig, one)
        responses = runs_of(rig, setting.commands, setting.leads, rate=RATE)
    except (ComputationError, InputError):
        return None
    return max(changes(channels(rig, responses), channels(setting.rig, setting.responses)).values())


def beside_the_bench(actuator: Actuator, table: MagneticTable, seed: int) -> tuple[SuspectRanking, list[float | None]]:
    """The ranking, and the change of each suspect on a bench whose true parameters the seed draws."""
    ranking = suspects(actuator, table, SuspectSettings(rate=RATE))
    unit = DRIVE_UNIT[actuator.drive.kind]
    excitations = [parse_excitation(text, unit=unit) for text in ranking.excitations]
    setting = prepared_setting(actuator, table, excitations, BenchOptions(seed=seed, rate=RATE))
    return ranking, [measured(setting, one) for one in ranking.suspects]


def _size(one: Suspect) -> str:
    cause = one.cause
    text = format_quantity(cause.size, cause.unit, digits=3) if cause.unit else f"{cause.size:.2g}"
    return f"{cause.leading.removesuffix('_1').replace('_', ' ')} {text}"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.0f} %"


def _row(one: Suspect, found: float | None) -> str:
    ratio = "-" if not found or not np.isfinite(one.change) else f"{one.change / found:.2g}"
    cells = [
        f"`{one.cause.effect}`",
        _size(one),
        one.cause.source.partition(":")[0],
        f"{100 * one.change:.2g} %",
        "-" if found is None else f"{100 * found:.2g} %",
        ratio,
        _share(one.absorbed_by_refit),
        _share(one.absorbed_by_armax),
        one.shown_by,
    ]
    return f"| {' | '.join(cells)} |"


HEAD = ("suspect", "size", "from", "change", "bench", "ratio", "re-fit takes", "ARMAX takes", "shown by")


def table_of(drive: str, seed: int) -> str:
    """The table of a drive, and how many of its changes the bench confirms."""
    actuator, table = servo_in(drive), read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    ranking, found = beside_the_bench(actuator, table, seed)
    pairs = list(zip(ranking.suspects, found, strict=True))
    told = [(one.change, value) for one, value in pairs if value]
    near = sum(1 / WITHIN <= change / value <= WITHIN for change, value in told)
    lines = ["| " + " | ".join(HEAD) + " |", "| --- " * len(HEAD) + "|", *(_row(*pair) for pair in pairs)]
    share = f"{near} of {len(told)} within a factor {WITHIN:g}"
    return f"In {drive} drive, bench seed {seed}: {share}.\n\n" + "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("drives", nargs="*", default=["current", "voltage"])
    parser.add_argument("--seed", type=int, default=71)
    parser.add_argument("--docs", action="store_true", help="write the tables into the document")
    asked = parser.parse_args()
    text = "\n\n".join(table_of(drive, asked.seed) for drive in asked.drives)
    print(text)
    if asked.docs:
        rewrite(DOCUMENT, {"suspects": text})


if __name__ == "__main__":
    main()
