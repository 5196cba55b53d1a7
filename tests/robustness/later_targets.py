"""Readers of what the commands themselves wrote: tables and maps of a pair, identified models, diagnoses, states to go
on from."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from hostile_files import spoilt_bytes, spoilt_json, spoilt_netcdf
from targets import ROOT, SERVO, TABLE, Target, _json, _one_file, _text, _toml, _typed

from msl_fem.actuator import load_actuator
from msl_fem.cli.calibrate import ROWS, known_rows, summary
from msl_fem.cli.controllers import identified_plant, known_model
from msl_fem.cli.diagnose import STATE, memory_in
from msl_fem.cli.experiments import question_after
from msl_fem.cli.told import DIAGNOSIS, MARK, MODEL, mark_of, told_by
from msl_fem.computing.row_cache import RowCache
from msl_fem.control import PlantUnderTest
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.identification import ArmaxModel
from msl_fem.maps.pair_limits import pair_map
from msl_fem.maps.pair_map_file import write_pair_map
from msl_fem.plant import plant_parameters
from msl_fem.table.magnetic_table import read_table
from msl_fem.table.pair_table import read_pair_table

PAIR = ROOT / "lookup_tables" / "fast_tool_servo_pair.nc"
SIDES = ("--current", "2 A", "--current-2", "1 A", "--position", "0.1 mm", "--json")
FITS = {"none: ": [0.25, -1.5], "none: time_delay": [0.3, -1.4], "time_delay: ": [0.1, 0.2]}
FOUND = Path(__file__).parent / "found"
CALIBRATED = [
    {"record": "mark", "seed": k, "verdict": verdict, "names": names, "nats": nats, "reason": ""}
    for k, (verdict, names, nats) in enumerate(
        [("nothing-found", [], 1.5), ("named", ["time_delay"], 12.5), ("nothing-found", [], None)]
    )
]
_MADE: dict[str, bytes] = {}


def _made_once(name: str, make: Callable[[Path], object]) -> Callable[[Path], Path]:
    """A file that `make` writes, from memory after the first time."""

    def prepare(folder: Path) -> Path:
        path = folder / name
        if name not in _MADE:
            make(path)
            _MADE[name] = path.read_bytes()
        path.write_bytes(_MADE[name])
        return path

    return prepare


def _bytes(rng: np.random.Generator, good: bytes, scratch: Path) -> bytes:
    return spoilt_bytes(rng, good)


def _lines(rng: np.random.Generator, good: bytes, scratch: Path) -> bytes:
    """One of the lines spoilt, the others as they are."""
    lines = good.splitlines()
    at = int(rng.integers(len(lines)))
    return b"\n".join([*lines[:at], spoilt_json(rng, lines[at]), *lines[at + 1 :]]) + b"\n"


def _use_model(folder: Path, out: Path) -> None:
    model = known_model(folder / "a.json")
    assert isinstance(model, ArmaxModel)
    identified_plant(model, load_actuator(SERVO))


def _use_state(folder: Path, out: Path) -> None:
    memory = memory_in(folder, "mark", resume=True)
    for what in FITS:
        end = memory.end_of(what, Unknowns((("moving_mass", 0.01), ("stiffness", 0.01)), 0, ()))
        assert end is None or (end.shape == (2,) and np.isfinite(end).all())


def _found(spoilt: str) -> Callable[[Path], Path]:
    """The folder of a diagnosis."""

    def prepare(folder: Path) -> Path:
        shutil.copytree(FOUND, folder, dirs_exist_ok=True)
        shutil.copyfile(TABLE, folder / "corrected_table.nc")
        return folder / spoilt

    return prepare


def _use_posterior(folder: Path, out: Path) -> None:
    """As `control --from`: the plants that the diagnosis leaves possible, and the believed one, are plants."""
    told = told_by(folder)
    table = read_table(TABLE)
    fitted = PlantUnderTest(told.model.actuator, table, told.model.effects)
    drawn = [told.posterior.draw(fitted, np.random.default_rng(k)) for k in range(3)]
    for plant in (*drawn, PlantUnderTest(told.believed.actuator, table, told.believed.effects)):
        motion = plant.actuator.motion
        assert motion is not None
        assert motion.nominal_gap is not None
        assert min(motion.moving_mass, motion.nominal_gap, plant.actuator.coil_resistance()) > 0
        plant_parameters(plant.actuator)
        assert plant.effects is None or np.isfinite(plant.effects.vector()).all()


def _use_question(folder: Path, out: Path) -> None:
    """As `experiments`, without the plan, which takes a minute."""
    question = question_after(folder, None, None)
    assert len(question.asked) > 1
    assert set(question.asked) <= question.possible.keys()
    assert 0 < question.rig.rate < np.inf
    assert all(np.isfinite(list(cause.values.values())).all() for cause in question.possible.values())


def _use_calibrated(folder: Path, out: Path) -> None:
    known = known_rows(folder / ROWS, "mark")
    assert all(isinstance(seed, int) and seed >= 0 for seed in known)
    told = summary(list(known.values()))
    assert 0 <= told["named"] <= told["records"] == len(known)
    json.dumps(told, allow_nan=False)


def _use_mark(folder: Path, out: Path) -> None:
    assert isinstance(mark_of(folder), str)


def _use_row(folder: Path, out: Path) -> None:
    row = RowCache(folder).get("a")
    assert row is None or all(isinstance(values, np.ndarray) for values in row.values())


def _kept_row(path: Path) -> None:
    with path.open("wb") as stream:
        np.savez(stream, force=np.linspace(0, 9, 40), gap=np.array(4e-4), iterations=np.arange(40))


LATER_TARGETS = (
    Target("lookup PAIR_TABLE", _one_file("a.nc", PAIR.read_bytes()), spoilt_netcdf,
           _typed("lookup", "IN/a.nc", *SIDES)),
    Target("export PAIR_TABLE", _one_file("a.nc", PAIR.read_bytes()), spoilt_netcdf,
           _typed("export", "IN/a.nc", "--to", "csv", "-o", "OUT/t.csv", "--json")),
    Target("guard PAIR_MAP", _made_once("a.json", lambda path: write_pair_map(pair_map(read_pair_table(PAIR)), path)),
           _json, _typed("guard", "IN/a.json", *SIDES)),
    Target("identified model", _one_file("a.json", (Path(__file__).parent / "armax.json").read_bytes()),
           _json, _use_model),
    Target("state of a diagnosis", _one_file(STATE, json.dumps({"record": "mark", "fits": FITS})),
           _json, _use_state),
    Target("diagnosis, control", _found(DIAGNOSIS), _json, _use_posterior),
    Target("diagnosis, experiments", _found(DIAGNOSIS), _json, _use_question),
    Target("diagnosis, its model", _found(MODEL), _toml, _use_posterior),
    Target("mark of a diagnosis", _one_file(MARK, "0123456789abcdef\n"), _text, _use_mark),
    Target("lines of a calibration", _one_file(ROWS, "".join(json.dumps(row) + "\n" for row in CALIBRATED)),
           _lines, _use_calibrated),
    Target("row of a table", _made_once("a.npz", _kept_row), _bytes, _use_row),
)  # fmt: skip
