"""Small magnets and jobs for the tests of tolerances."""

import tomllib
from functools import lru_cache
from pathlib import Path

from msl_fem.actuator import Actuator, parse_actuator
from msl_fem.computing.jobs import Executor
from msl_fem.design.tolerances.sensitivity import ManufacturingJob, Questions, RowRun
from msl_fem.magnetics.field.accuracy import LEVELS
from msl_fem.magnetics.field.magnet_field import magnet_mesh
from msl_fem.magnetics.sweep.rows import FieldJob

ROOT = Path(__file__).parent.parent.parent


def wide_open(iron: str = "linear:1e6") -> Actuator:
    """E1's magnet with an iron that takes no field, so that the gap alone counts."""
    content = tomllib.loads((ROOT / "geometries" / "e1.toml").read_text(encoding="utf-8"))
    content["magnet"]["iron"] = {"core": iron, "armature": iron, "stacking_factor": 1.0}
    return parse_actuator(content)


@lru_cache
def nominal_of(actuator_name: str, gap: float) -> FieldJob:
    content = tomllib.loads((ROOT / "geometries" / f"{actuator_name}.toml").read_text(encoding="utf-8"))
    return nominal(parse_actuator(content), gap)


def nominal(actuator: Actuator, gap: float) -> FieldJob:
    magnet = actuator.magnet
    return FieldJob(magnet, magnet_mesh(magnet, gap, "fast"), actuator.folder, LEVELS["fast"].order)


def job(
    nominal_job: FieldJob,
    gap: float,
    *,
    current: float,
    levels: tuple[float, ...] = (),
    sections: tuple[str, ...] = ("centre_leg",),
) -> ManufacturingJob:
    return ManufacturingJob(nominal_job, Questions((gap,), levels, sections, 100.0, current, gap))


HERE = RowRun(Executor())
