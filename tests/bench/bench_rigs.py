"""Rigs and short settings for the tests of the virtual bench."""

from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.bench.rig import Rig, true_rig
from msl_fem.bench.sealed import BenchOptions, prepared_setting
from msl_fem.bench.setting import BenchSetting
from msl_fem.plant.excitation import parse_excitation
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.table.magnetic_table import MagneticTable, read_table

ROOT = Path(__file__).parent.parent.parent
SERVO = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
SERVO_TABLE = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
RATE = 10_000.0


def in_voltage_drive(actuator: Actuator) -> Actuator:
    """The actuator with an ideal voltage drive."""
    return actuator.model_copy(
        update={"drive": actuator.drive.model_copy(update={"kind": "voltage", "bandwidth": None})}
    )


VOLTAGE_SERVO = in_voltage_drive(SERVO)
MECHANICAL_RIG = SERVO.model_copy(
    update={
        "magnet": None,
        "sides": None,
        "drive": SERVO.drive.model_copy(update={"kind": "force", "bandwidth": None, "coil_resistance": None}),
    }
)


def excitations(drive: str, *, duration: float = 0.4) -> tuple[Excitation, ...]:
    """A short fit and a short held-out run that the servo bears in a drive."""
    unit, bias, noise, sweep = {
        "current": ("A", 0.5, 0.06, 0.03), "voltage": ("V", 1.0, 1.0, 0.4), "force": ("N", 0.0, 3.0, 2.0),
    }[drive]  # fmt: skip
    held = f"bias={bias} {unit},duration={duration} s"
    texts = (
        f"band-limited-noise:band=300 Hz,seed=3,amplitude={noise} {unit},{held}",
        f"swept-sine:start=20 Hz,stop=200 Hz,amplitude={sweep} {unit},role=held-out,{held}",
    )
    if drive == "force":
        texts = tuple(text + ",channel=1" for text in texts)
    return tuple(parse_excitation(text, unit=unit) for text in texts)


DRIVES: dict[str, tuple[Actuator, MagneticTable | None]] = {
    "current": (SERVO, SERVO_TABLE),
    "voltage": (VOLTAGE_SERVO, SERVO_TABLE),
    "force": (MECHANICAL_RIG, None),
}


def setting_in(drive: str, *, seed: int = 5, duration: float = 0.4) -> BenchSetting:
    """The true rig of a seed with its short runs."""
    actuator, table = DRIVES[drive]
    options = BenchOptions(seed=seed)
    return prepared_setting(actuator, table, excitations(drive, duration=duration), options)


def plain_rig(drive: str) -> Rig:
    """The rig with every effect off and the believed parameters."""
    return true_rig(*DRIVES[drive])


def noise_commands(drive: str, *, duration: float = 0.4) -> np.ndarray:
    """The commands of the fit run."""
    return setting_in(drive, duration=duration).commands[0]
