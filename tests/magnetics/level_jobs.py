"""Magnets and solvers that the tests of the field map share."""

from functools import lru_cache

import numpy as np
from conftest import ROOT

from msl_fem.actuator import Actuator, ECore, load_actuator
from msl_fem.magnetics.field.magnet_field import MagnetField
from msl_fem.magnetics.field_map.gap_levels import CurrentContinuation, LevelJob, level_mesh, level_order, level_safety
from msl_fem.magnetics.field_map.readings import reader_of
from msl_fem.maps import parse_criterion

E1 = load_actuator(ROOT / "geometries" / "e1.toml")
SERVO = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml").model_copy(update={"end_effects": "none"})


def with_iron(actuator: Actuator, name: str, **more: float) -> Actuator:
    """The actuator with both irons exchanged."""
    magnet = actuator.magnet
    iron = magnet.iron.model_copy(update={"core": name, "armature": name, **more})
    return actuator.model_copy(update={"magnet": magnet.model_copy(update={"iron": iron})})


@lru_cache(maxsize=8)
def linear_field(relative_permeability: int) -> MagnetField:
    """E1 with a linear iron, coarse."""
    return field_at(with_iron(E1, f"linear:{relative_permeability}"), 5e-4)


def job_of(actuator: Actuator, gap: float, accuracy: str = "fast", criterion: str = "mean") -> LevelJob:
    """What a process gets for a map, meshed at the gap."""
    magnet: ECore = actuator.magnet
    where = parse_criterion(criterion)
    mesh = level_mesh(magnet, gap, accuracy, where)
    order, safety = level_order(magnet, accuracy, where), level_safety(accuracy, where)
    return LevelJob(magnet, mesh, actuator.folder, order, criterion=where, safety=safety)


def field_at(actuator: Actuator, gap: float, accuracy: str = "fast", criterion: str = "mean") -> MagnetField:
    """The field of a map's job, meshed at the gap."""
    job = job_of(actuator, gap, accuracy, criterion)
    return MagnetField(job.magnet, job.mesh, folder=job.folder, order=job.order)


def currents_at(
    actuator: Actuator,
    gap: float,
    levels: tuple[float, ...],
    accuracy: str = "fast",
    criterion: str = "mean",
    *,
    field: MagnetField | None = None,
) -> np.ndarray:
    """The levels' currents on a mesh of the gap's own, or on that of a field."""
    field = field or field_at(actuator, gap, accuracy, criterion)
    continuation = CurrentContinuation(field, reader_of(field, parse_criterion(criterion)), gap)
    return np.array([continuation.root(level, 40.0).current for level in levels])
