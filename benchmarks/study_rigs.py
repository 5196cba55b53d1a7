"""The four actuators of the diagnosis study, with tables in closed form, and a record of each on the bench.

    python benchmarks/study_rigs.py

prints what each is and how long a record of it takes. Tables: a gap g in series with iron of the length b of gap, whose
flux saturates at a c (Roters, Electromagnetic Devices, 1941, ch. 5, with one smooth knee):

    W' = a c^2 q (r - 1),  q = g + b,  r = sqrt(1 + (i/(c q))^2);   F = a c^2 (1 - 1/r),  lambda = a i/(q r)
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator, ECore, load_actuator
from msl_fem.actuator.current_loop import CurrentLoop
from msl_fem.bench import BenchOptions, ClosedLoop, parse_nuisances, parse_requests, sealed_record
from msl_fem.control import design_controller
from msl_fem.control.stepper import Stepper, stated
from msl_fem.maps import operating_map
from msl_fem.plant.excitation import parse_excitation
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.table.magnetic_table import MagneticTable, read_table

ROOT = Path(__file__).parent.parent
MU_0, SATURATION = 4e-7 * np.pi, 1.6  # T
NAMES = ("servo", "small", "large", "levitator")
RATES = (1e3, 5e3, 20e3)
LOOP_BANDWIDTH, LOOP_PEAK = 30.0, 2.2  # Hz; of the levitator's loop
_LENGTHS = (
    "centre_leg_width", "outer_leg_width", "window_width", "window_height", "yoke_thickness", "armature_thickness",
    "stack_depth",
)  # fmt: skip


def servo_in(drive: str) -> Actuator:
    """The reference actuator in a current or voltage drive."""
    return study_rig("servo").in_drive(drive)


@dataclass(frozen=True)
class StudyRig:
    """An actuator as believed, its table, and the excitations of a record's runs, by drive."""

    actuator: Actuator
    table: MagneticTable
    excitations: dict[str, tuple[str, ...]]

    def in_drive(self, kind: str) -> Actuator:
        """The actuator in a current or voltage drive."""
        assert self.actuator.drive is not None
        bandwidth = self.actuator.drive.bandwidth if kind == "current" else None
        drive = self.actuator.drive.model_copy(update={"kind": kind, "bandwidth": bandwidth})
        return self.actuator.model_copy(update={"drive": drive})


def gap_table(actuator: Actuator, *, gaps: tuple[float, float], current: float) -> MagneticTable:
    """The closed form for the E-core of an actuator over gaps (m) and up to a current (A) of one magnet.

    That is a quarter beyond the drive's limit: within the tolerances a current that is held there is a little larger.
    """
    magnet = actuator.magnet
    assert isinstance(magnet, ECore)
    turns, area = magnet.coil.turns, magnet.centre_leg_width * magnet.stack_depth
    path = 2 * (magnet.window_height + magnet.window_width + magnet.yoke_thickness)
    a, b, c = MU_0 * turns**2 * area / 2, path / (2 * 3000.0), 2 * SATURATION / (MU_0 * turns)
    g, i = np.geomspace(*gaps, 32), np.linspace(0.0, current, 17)
    q, i_of = (g + b)[:, None], i[None, :]
    r = np.sqrt(1 + (i_of / (c * q)) ** 2)
    nodes = {
        "coenergy": a * c**2 * q * (r - 1),
        "flux_linkage": a * i_of / (q * r),
        "force": a * c**2 * (1 - 1 / r),
        "incremental_inductance": a / (q * r**3),
        "force_current_slope": a * i_of / (q**2 * r**3),
        "force_gap_slope": -a * c**2 * (r**2 - 1) / (q * r**3),
    }
    density = nodes["flux_linkage"] / (turns * area)
    return MagneticTable(g, i, nodes, extras={"flux_density_centre_leg": density})


def study_rig(name: str) -> StudyRig:
    """One of "servo", "levitator", "small", "large"; KeyError for another."""
    return {"servo": _servo, "levitator": _levitator, "small": _small, "large": _large}[name]()


def _changed(scale: float, name: str, **sections: dict[str, object]) -> Actuator:
    """The reference servo with an E-core `scale` times as large, and keys of its sections replaced."""
    servo = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    assert isinstance(servo.magnet, ECore)
    magnet = servo.magnet.model_copy(update={key: scale * getattr(servo.magnet, key) for key in _LENGTHS})
    update = {key: getattr(servo, key).model_copy(update=keys) for key, keys in sections.items()}
    return servo.model_copy(update={"name": name, "magnet": magnet, **update})


def _runs(noise: str, sweep: str) -> tuple[str, ...]:
    return f"band-limited-noise:{noise},seed=1,role=fit", f"swept-sine:{sweep},role=held-out"


def _servo() -> StudyRig:
    servo = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    table = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    return StudyRig(servo, table, {
        "current": _runs("bias=0.5 A,band=200 Hz,amplitude=50 mA", "bias=0.5 A,start=5 Hz,stop=150 Hz,amplitude=30 mA"),
        "voltage": _runs("bias=1 V,band=200 Hz,amplitude=1 V", "bias=1 V,start=5 Hz,stop=150 Hz,amplitude=0.4 V"),
    })  # fmt: skip


def _small() -> StudyRig:
    """As large as a voice coil: 20 g, 0.2 mm of gap."""
    actuator = _changed(
        0.3, "small_magnet",
        motion={"moving_mass": 0.02, "stiffness": 5e3, "damping": 0.4, "nominal_gap": 0.2e-3, "range": 0.15e-3},
        drive={"bandwidth": 2e3, "voltage_limit": 24.0, "current_limit": 2.0, "coil_resistance": 2.5},
        sides={"magnets_per_side": 1},
        position_sensor={"noise": 10e-9}, current_sensor={"noise": 0.5e-3},
    )  # fmt: skip
    return StudyRig(actuator, gap_table(actuator, gaps=(0.03e-3, 0.4e-3), current=2.5), {
        "current": _runs("bias=0.1 A,band=200 Hz,amplitude=10 mA", "bias=0.1 A,start=5 Hz,stop=150 Hz,amplitude=6 mA"),
        "voltage": _runs("bias=0.2 V,band=200 Hz,amplitude=60 mV", "bias=0.2 V,start=5 Hz,stop=90 Hz,amplitude=30 mV"),
    })  # fmt: skip


def _large() -> StudyRig:
    """A gap of 16 mm, 40 kg on springs."""
    actuator = _changed(
        10.0, "large_magnet",
        motion={"moving_mass": 40.0, "stiffness": 4e5, "damping": 800.0, "nominal_gap": 16e-3, "range": 12e-3},
        drive={"bandwidth": 200.0, "voltage_limit": 400.0, "current_limit": 60.0, "coil_resistance": 0.8},
        sides={"magnets_per_side": 1},
        position_sensor={"noise": 2e-6}, current_sensor={"noise": 20e-3},
    )  # fmt: skip
    return StudyRig(actuator, gap_table(actuator, gaps=(3e-3, 32e-3), current=75.0), {
        "current": _runs("bias=12 A,band=60 Hz,amplitude=2 A", "bias=12 A,start=2 Hz,stop=50 Hz,amplitude=0.8 A"),
        "voltage": _runs("bias=9 V,band=60 Hz,amplitude=20 V", "bias=9 V,start=2 Hz,stop=50 Hz,amplitude=8 V"),
    })  # fmt: skip


def _levitator() -> StudyRig:
    """One side against gravity, no spring: 0.5 kg at 3 mm, held by the controller of `control`, around a voltage drive
    with a current loop as fast as the controller."""
    actuator = _changed(
        1.0, "levitator",
        motion={
            "moving_mass": 0.5, "stiffness": 0.0, "damping": 0.5, "nominal_gap": 3e-3, "range": 1.5e-3,
            "constant_force": -0.5 * 9.81,
        },
        drive={
            "bandwidth": 2e3, "voltage_limit": 60.0, "current_limit": 6.0, "current_loop": CurrentLoop(rate=5e3),
        },
        controller={"rate": 5e3},
        sides={"count": 1, "magnets_per_side": 1},
        position_sensor={"noise": 0.5e-6},
    )  # fmt: skip
    closed = "loop=closed,duration=4 s"
    runs = (
        f"multisine:start=1 Hz,stop=40 Hz,amplitude=0.1 mm,seed=2,role=fit,{closed}",
        f"swept-sine:start=1 Hz,stop=30 Hz,amplitude=0.1 mm,role=held-out,{closed}",
    )
    table = gap_table(actuator, gaps=(0.8e-3, 6e-3), current=7.5)
    return StudyRig(actuator, table, {"current": runs, "voltage": runs})


def excitations_of(rig: StudyRig, kind: str, *, seconds: float = 4.0) -> tuple[Excitation, ...]:
    """The runs of a record in a drive, `seconds` each where they do not say so."""
    unit = "A" if kind == "current" else "V"
    texts = [t if "duration" in t else f"{t},duration={seconds} s" for t in rig.excitations[kind]]
    return tuple(parse_excitation(text, unit=unit) for text in texts)


def loop_of(rig: StudyRig, kind: str) -> ClosedLoop | None:
    """The controller of runs in closed loop; None in open loop."""
    if not any("loop=closed" in text for text in rig.excitations[kind]):
        return None
    actuator = rig.in_drive(kind)
    design = design_controller(
        actuator, rig.table, operating_map(rig.table), bandwidth=LOOP_BANDWIDTH, peak_sensitivity=LOOP_PEAK
    )
    return ClosedLoop(Stepper(design), stated(design))


def main() -> None:
    print("| actuator | drive | rate | seconds | largest motion over the range |")
    print("|---|---|---|---|---|")
    for name in NAMES:
        rig = study_rig(name)
        for kind in rig.excitations:
            for rate in RATES if name != "levitator" else (5e3, 20e3):
                start = time.perf_counter()
                how = BenchOptions(
                    seed=3, rate=rate, excitations=excitations_of(rig, kind), loop=loop_of(rig, kind),
                    nuisances=parse_nuisances(["all=1"]),
                )  # fmt: skip
                found = sealed_record(rig.in_drive(kind), rig.table, parse_requests(["coulomb_friction=3%"]), how)
                largest = max(float(np.abs(run["position_m"]).max()) for run in found.record.runs)
                assert rig.actuator.motion is not None
                assert rig.actuator.motion.range is not None
                taken = time.perf_counter() - start
                share = largest / rig.actuator.motion.range
                print(f"| {name} | {kind} | {rate:g} Hz | {taken:.1f} | {share:.2g} |", flush=True)


if __name__ == "__main__":
    main()
