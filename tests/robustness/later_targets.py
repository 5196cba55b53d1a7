"""Readers of what the commands themselves wrote: tables and maps of a pair, identified models, states to go on from."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from hostile_files import spoilt_bytes, spoilt_netcdf
from targets import ROOT, SERVO, Target, _json, _one_file, _typed

from msl_fem.actuator import load_actuator
from msl_fem.cli.controllers import identified_plant, known_model
from msl_fem.cli.diagnose import STATE, memory_in
from msl_fem.computing.row_cache import RowCache
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.identification import ArmaxModel
from msl_fem.maps.pair_limits import pair_map
from msl_fem.maps.pair_map_file import write_pair_map
from msl_fem.table.pair_table import read_pair_table

PAIR = ROOT / "lookup_tables" / "fast_tool_servo_pair.nc"
SIDES = ("--current", "2 A", "--current-2", "1 A", "--position", "0.1 mm", "--json")
FITS = {"none: ": [0.25, -1.5], "none: time_delay": [0.3, -1.4], "time_delay: ": [0.1, 0.2]}
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


def _use_model(folder: Path, out: Path) -> None:
    model = known_model(folder / "a.json")
    assert isinstance(model, ArmaxModel)
    identified_plant(model, load_actuator(SERVO))


def _use_state(folder: Path, out: Path) -> None:
    memory = memory_in(folder, "mark", resume=True)
    for what in FITS:
        end = memory.end_of(what, Unknowns((("moving_mass", 0.01), ("stiffness", 0.01)), 0, ()))
        assert end is None or (end.shape == (2,) and np.isfinite(end).all())


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
    Target("row of a table", _made_once("a.npz", _kept_row), _bytes, _use_row),
)  # fmt: skip
