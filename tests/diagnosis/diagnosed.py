"""Records of the virtual bench, made and diagnosed once a session."""

from functools import cache
from pathlib import Path

import pytest
from short_menu import cut_menu

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.bench import BenchOptions, parse_requests, sealed_record
from msl_fem.bench.sealed import SealedRecord
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.result import Diagnosis
from msl_fem.plant.excitation import parse_excitation
from msl_fem.table.magnetic_table import MagneticTable, read_table

ROOT = Path(__file__).parent.parent.parent
TABLE: MagneticTable = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
SERVO: Actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
VOLTAGE_SERVO = SERVO.model_copy(
    update={"drive": SERVO.drive.model_copy(update={"kind": "voltage", "bandwidth": None})}
)
RUNS = (
    "band-limited-noise:amplitude=610 mV,bias=1.2 V,duration=1 s,seed=1,band=500 Hz,role=fit",
    "swept-sine:amplitude=300 mV,bias=1.2 V,duration=0.6 s,start=5 Hz,stop=300 Hz,role=held-out",
)


@cache
def bench_record(*hidden: str, seed: int = 7, noise: str = "coloured", rate: float = 1e4) -> SealedRecord:
    """A record of two short runs in voltage drive; effects have the size of 3 %."""
    excitations = tuple(parse_excitation(text, unit="V") for text in RUNS)
    options = BenchOptions(seed=seed, noise=noise, rate=rate, excitations=excitations)
    return sealed_record(VOLTAGE_SERVO, TABLE, parse_requests(hidden), options)


@cache
def diagnosed(*hidden: str, seed: int = 7, noise: str = "coloured", rate: float = 1e4) -> Diagnosis:
    record = bench_record(*hidden, seed=seed, noise=noise, rate=rate).record
    with pytest.MonkeyPatch.context() as patch:
        cut_menu(patch, entries=0)
        return diagnose(record, DiagnosisSettings(table=TABLE))
