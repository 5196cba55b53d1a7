"""The files of a diagnosis in a folder: all of them, or none."""

import json
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator, TableMagnet
from msl_fem.diagnosis.result import Diagnosis
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.extended_model import ExtendedModel, write_extended_model
from msl_fem.prediction import ModelHypothesis
from msl_fem.record import Record
from msl_fem.report.diagnosis_page import diagnosis_page
from msl_fem.report.page import write_page
from msl_fem.table.magnetic_table import MagneticTable, write_table

DIAGNOSIS, REPORT, MODEL, TABLE = "diagnosis.json", "report.html", "extended_model.toml", "corrected_table.nc"
FILES = (TABLE, MODEL, REPORT, DIAGNOSIS)
"""What may stand in the folder, in the order in which the files appear: what names a file comes after it."""


def write_diagnosis(record: Record, found: Diagnosis, folder: Path, *, table: MagneticTable | None) -> dict[str, Path]:
    """The files written, by name; those of an earlier diagnosis that this one does not have are removed.

    Parameters
    ----------
    table : the believed one, from which a corrected one is told

    Raises
    ------
    InputError : the folder cannot be written
    """
    target = folder.resolve()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.", suffix=".part"))
    except OSError as err:
        raise InputError(f"{folder}: cannot be written ({err.strerror}); choose another folder") from err
    try:
        _write_all(record, found, staging, table=table)
        return _moved(staging, target)
    except OSError as err:
        raise InputError(f"{folder}: cannot be written ({err.strerror}); make room or choose another folder") from err
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _write_all(record: Record, found: Diagnosis, folder: Path, *, table: MagneticTable | None) -> None:
    if found.extended is not None:
        model = model_of(found.extended, folder, believed=table)
        if found.extended.table is not None and found.extended.table is not table:
            write_table(found.extended.table, folder / TABLE)
        write_extended_model(model, folder / MODEL)
    write_page(diagnosis_page(record, found), folder / REPORT)
    text = json.dumps(as_numbers(found.fields()), indent=1, allow_nan=False)
    (folder / DIAGNOSIS).write_text(f"{text}\n", encoding="utf-8")


def _moved(staging: Path, target: Path) -> dict[str, Path]:
    target.mkdir(exist_ok=True)
    for name in FILES:
        if (target / name).is_dir():
            raise InputError(f"{target / name}: is a folder; choose another one for the diagnosis")
    made = {}
    for name in FILES:
        if (staging / name).is_file():
            os.replace(staging / name, target / name)
            made[name] = target / name
        else:
            (target / name).unlink(missing_ok=True)
    return made


def model_of(belief: ModelHypothesis, folder: Path, *, believed: MagneticTable | None) -> ExtendedModel:
    """The extended model as its file says it: magnets whose table was corrected are known by that table alone."""
    actuator = belief.actuator
    if belief.table is not None and belief.table is not believed:
        actuator = known_by_table(actuator, folder)
    return ExtendedModel(actuator, belief.effects or EffectValues())


def known_by_table(actuator: Actuator, folder: Path) -> Actuator:
    """The actuator with the table in a folder in place of its magnet's geometry; the winding's resistance is kept."""
    drive = actuator.drive
    if drive is not None:
        drive = drive.model_copy(update={"coil_resistance": actuator.coil_resistance()})
    sources = {key: text for key, text in actuator.sources.items() if not key.startswith("magnet")}
    sources["magnet"] = f"the table of {actuator.name}, corrected within its tolerance by the diagnosis of a record"
    magnet = TableMagnet(kind="table", table=TABLE)
    return actuator.model_copy(update={"magnet": magnet, "drive": drive, "sources": sources, "file": folder / MODEL})


def as_numbers(value: Any) -> Any:
    """Lists, dicts, numbers and texts for JSON; what is not finite becomes None."""
    if isinstance(value, dict):
        return {name: as_numbers(v) for name, v in value.items()}
    if isinstance(value, list | tuple):
        return [as_numbers(v) for v in value]
    if isinstance(value, np.generic):
        return as_numbers(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
