"""What can be exported, and into which formats: a new one is a function that writes, and an entry here."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.maps import OperatingMap
from msl_fem.maps.pair_limits import PairMap
from msl_fem.plant.effects import EffectValues
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_table import PairTable

ACTUATOR, TABLE, MAP, MODEL, CONTROLLER = "actuator", "table", "map", "model", "controller"
PAIR_MAP, PAIR_TABLE = "pair map", "pair table"


@dataclass(frozen=True, eq=False)
class ModelSource:
    """What the coupled model is made of: an actuator, the table of its magnets and effects; None where it has none."""

    actuator: Actuator
    table: MagneticTable | None
    effects: EffectValues | None = None


@dataclass(frozen=True)
class Format:
    """One entry.

    Attributes
    ----------
    to : the format's name
    what : what of it is exported
    needs : the record that the writer takes: ACTUATOR, TABLE, MAP, MODEL for a `ModelSource`, CONTROLLER for a
        `ControllerSource`
    writer : "module:function"; `function(record, target, *, name)` writes and returns the files
    named : whether names in the file begin with one that can be chosen
    asked : whether it is written only where its part is asked for by name
    """

    to: str
    what: str
    needs: str
    writer: str
    named: bool = False
    asked: bool = False

    def write(self, record: Any, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
        """The files written. Raises InputError, for instance where the folder cannot be written."""
        if name is not None and not self.named:
            raise InputError(f"--name is the beginning of C names; --to {self.to} has none, leave it out")
        module, _, function = self.writer.partition(":")
        write: Callable[..., tuple[Path, ...]] = getattr(import_module(module), function)
        return write(record, target, name=name)


FORMATS = (
    Format("c", "guard", MAP, "msl_fem.export.c_guard:write", named=True),
    Format("c", "guard", PAIR_MAP, "msl_fem.export.c_pair_guard:write", named=True),
    Format("c", "table", TABLE, "msl_fem.export.c_table:write", named=True),
    Format("c", "controller", CONTROLLER, "msl_fem.export.c_controller:write", named=True, asked=True),
    Format("csv", "table", TABLE, "msl_fem.export.table_formats:write_csv"),
    Format("mat", "table", TABLE, "msl_fem.export.table_formats:write_mat"),
    Format("c", "table", PAIR_TABLE, "msl_fem.export.c_pair_table:write", named=True),
    Format("csv", "table", PAIR_TABLE, "msl_fem.export.pair_formats:write_pair_csv"),
    Format("mat", "table", PAIR_TABLE, "msl_fem.export.pair_formats:write_pair_mat"),
    Format("modelica", "table", PAIR_TABLE, "msl_fem.export.pair_modelica:write_pair_modelica", named=True),
    Format("modelica", "table", TABLE, "msl_fem.export.table_formats:write_modelica"),
    Format("simulink", "table", TABLE, "msl_fem.export.simulink:write"),
    Format("dxf", "section", ACTUATOR, "msl_fem.export.dxf_section:write"),
    Format("femm", "section", ACTUATOR, "msl_fem.export.femm_section:write"),
    Format("fmu", "model", MODEL, "msl_fem.export.fmu:write", named=True),
    Format("fmu3", "model", MODEL, "msl_fem.export.fmu:write_fmi3", named=True),
)
_MADE_FROM = {
    ACTUATOR: (ACTUATOR,), MODEL: (ACTUATOR,), CONTROLLER: (ACTUATOR,), TABLE: (TABLE, ACTUATOR),
    MAP: (MAP, TABLE, ACTUATOR), PAIR_MAP: (PAIR_MAP,), PAIR_TABLE: (PAIR_TABLE,),
}  # fmt: skip
"""The sources from which each record can be had."""


def find_format(to: str, what: str | None, source: str) -> Format:
    """The entry that is wished for; without `what`, the one that needs least to be made of the source.

    Raises
    ------
    InputError : there is none, or the source does not hold what it needs; the message says what there is
    """
    of_name = [f for f in FORMATS if f.to == to]
    if not of_name:
        raise InputError(f"--to {to} is not available; there is {', '.join(dict.fromkeys(f.to for f in FORMATS))}")
    wished = [f for f in of_name if what == f.what or (what is None and not f.asked)]
    if not wished:
        raise InputError(
            f"--what {what} is not available as {to}; there is {', '.join(dict.fromkeys(f.what for f in of_name))}"
        )
    able = [f for f in wished if source in _MADE_FROM[f.needs]]
    if not able:
        needs = " or ".join(dict.fromkeys(_MADE_FROM[wished[0].needs]))
        raise InputError(f"--to {to} --what {wished[0].what} needs a file with {needs}; this is one with a {source}")
    return min(able, key=lambda f: _MADE_FROM[f.needs].index(source))


def export_as(record: Any, target: str | Path, *, to: str, what: str | None = None, name: str | None = None) -> None:
    """Writes a table, a map, an actuator or a `ModelSource` in a format, as `msl-fem export --to` does.

    `what` names the part where a record has several, `name` is the beginning of names in the file.

    Raises
    ------
    InputError : there is no such format of this record; the message says what there is
    """
    kinds = {
        MagneticTable: TABLE,
        OperatingMap: MAP,
        PairMap: PAIR_MAP,
        PairTable: PAIR_TABLE,
        ModelSource: MODEL,
        Actuator: ACTUATOR,
    }
    kind = next((kind for of, kind in kinds.items() if isinstance(record, of)), None)
    if kind is None:
        known = ", ".join(of.__name__ for of in kinds)
        raise InputError(f"a {type(record).__name__} cannot be exported; give one of {known}")
    able = [f for f in FORMATS if (f.to, f.needs) == (to, kind) and what in (None, f.what)]
    if not able:
        formats = ", ".join(dict.fromkeys(f.to for f in FORMATS if f.needs == kind))
        raise InputError(f"--to {to} is not available of a {type(record).__name__}; there is {formats}")
    able[0].write(record, Path(target), name=name)
