# ruff: noqa: E501 - prose of the pages
"""The reference pages and JSON Schema files of all files that people write, made from the records that read them.

python docs/make_reference.py
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

from api_page import api_page

from msl_fem.actuator import Actuator
from msl_fem.design.sizing.requirement import Requirement
from msl_fem.export.key_reference import FileKey, json_schema, markdown_table, sections_of
from msl_fem.plant.effects import CATALOGUE
from msl_fem.plant.excitation_kinds import KINDS
from msl_fem.record.columns import CHANNELS
from msl_fem.record.rig_file import OVERRIDES, RigFile

DOCS = Path(__file__).parent
FILES = {
    "actuator": (Actuator, "Actuator file", "What `--help` calls ACTUATOR: `geometries/fast_tool_servo.toml` is one."),
    "rig": (RigFile, "rig.toml", "What an experimenter states of a bench, in the folder of a [record](../howto/my_record.md)."
            " Sections of the actuator file may be stated anew, key by key."),
    "requirement": (Requirement, "Requirement", "What `msl-fem size` sizes a magnet for ([sizing](../sizing.md))."),
}  # fmt: skip
QUANTITIES = (
    'Quantities are texts with a unit, like `"0.6 mm"`; any unit of the right dimension will do. Pure numbers stand without '
    "quotes. An unknown key is an error that names those there are."
)


def file_page(name: str) -> str:
    """The page of a file's keys."""
    model, title, intro = FILES[name]
    parts = [f"# Keys: {title}", "", intro, "", QUANTITIES, "",
             f"For editors: [{name}.schema.json](../schemas/{name}.schema.json) (JSON Schema); with taplo or the TOML extension of an "
             f"editor, write `#:schema ./{name}.schema.json` into the first line.", ""]  # fmt: skip
    for section in dict.fromkeys(sections_of(model)):  # coil, iron and air of several kinds are the same
        head = f"[{section.path}]" if section.path else "At the top"
        kind = f', kind = "{section.kind}"' if section.kind else ""
        parts += [f"## `{head}`{kind}" if section.path else f"## {head}", "", section.meaning, ""]
        parts += [markdown_table(section), ""] if section.keys else []
    return "\n".join(parts)


def excitation_key(key: FileKey) -> FileKey:
    """A key as people write it: sizes in the unit of the command or reference, a duration that may be its file's."""
    if key.name in ("amplitude", "bias"):
        bound = ", above 0" if key.name == "amplitude" else ""
        default = key.default and ("none" if key.default == "none" else f"{key.default} of that unit")
        return replace(key, value=f"quantity in A, V, N or m{bound}", default=default)
    return replace(key, default="the file's") if key.default == "0 s" and key.name == "duration" else key


def excitations_page() -> str:
    """Kinds of excitations and references with their keys."""
    parts = [
        "# Excitations and references", "",
        "An excitation is a text, `name:key=value,key=value`, or an `[[excitation]]` of a TOML file with the same keys. "
        "`simulate --excitation`, `bench --excitation` and `control --reference` take them. Amplitude and bias are in A, V or N, by "
        "the actuator's `drive.kind`; those of a reference, and with `loop=closed`, are in m. The path of a CSV file alone is the signal in it (kind `csv`).", "",
        '    msl-fem simulate servo.toml --excitation "step:channel=1,bias=0.5 A,amplitude=0.1 A,duration=1 s" -o run', "",
        "`channel` says where the signal s goes with the bias b: `1` or `2`: b + s on that side, b on the other; `common`: b + s on "
        "both; `differential`: b + s and b - s, without a bias the side by the sign of s; `independent`: two draws (noise and "
        "multisine). An actuator of one side has channel 1.", "",
    ]  # fmt: skip
    for name, kind in KINDS.items():
        [section] = sections_of(kind)
        keys = tuple(excitation_key(k) for k in section.keys if k.name not in ("name", "unit"))
        section = type(section)(section.path, "", section.meaning, keys)
        parts += [f"## `{name}`", "", section.meaning, "", markdown_table(section), ""]
    return "\n".join(parts)


def columns_page() -> str:
    """Columns of runs and of static maps."""
    rows = ["| column | quantity | unit |", "| --- | --- | --- |"]
    rows += [f"| `{one.column}` | {one.quantity.replace('_', ' ')} | {one.unit} |" for one in CHANNELS.values()]
    return "\n".join([
        "# Columns of a record", "",
        "A run is a CSV file with these names in its first line, or a NetCDF file with them over a dimension `time`. Missing columns "
        "are fine where the drive makes them redundant; others are kept, named in a warning, and ignored.", "",
        *rows, "",
        "A column `valid` (1, or 0 in rows that are not) cuts the run; `valid_position_m` and so on say which readings of one channel "
        "count.", "",
        "`static.csv` has `gap_m`, `current_A` and one or more of `force_N`, `flux_linkage_Wb` and `flux_density_T` (of a probe at one "
        "place: in proportion to the flux linkage, by a factor that a fit finds). It may have `direction` (`up`, `down`), `sequence` "
        "(numbers of separate loops), `role`, `unit` (which of several magnets of one kind), and `sigma_force_N` and so on: one sigma of "
        "each row.", "",
        "`msl-fem import --columns` takes `column=name-in-the-log`, each with `:unit=mA`, `:scale=-1`, `:offset=2 mm` `:time=its-own-clock` or `:curve=calibration.csv` behind it.", "",
    ])  # fmt: skip


def effects_page() -> str:
    """The catalogue of effects with all parameters."""
    parts = ["# Effects", "", "What a coupled model can have beside the plain plant, and what a diagnosis may name; how each is modelled "
             "stands in [the coupled model](../coupled_model.md). Names and parameters are those of `extended_model.toml` and "
             "`diagnosis.json`.", ""]  # fmt: skip
    for name, entry in CATALOGUE.items():
        rows = ["| parameter | unit | without the effect | meaning |", "| --- | --- | --- | --- |"]
        rows += [f"| `{p.name}` | {p.unit or '1'} | {p.neutral:g} | {p.meaning} |" for p in entry.parameters]
        parts += [
            f"## `{name}`",
            "",
            f"{entry.sentence[:1].upper()}{entry.sentence[1:]}. To look at: {entry.advice}.",
            "",
            *rows,
            "",
        ]
    return "\n".join(parts)


def pages() -> dict[str, str]:
    """All files by their path below docs."""
    made = {f"reference/{name}.md": file_page(name) for name in FILES}
    made |= {"reference/excitations.md": excitations_page(), "reference/columns.md": columns_page()}
    made |= {"reference/effects.md": effects_page(), "reference/api.md": api_page()}
    for name, (model, title, _) in FILES.items():
        schema = json_schema(model, title=f"msl_fem: {title}")
        if model is RigFile:  # states sections of the actuator file anew
            schema["properties"].pop("overrides", None)
            schema["properties"] |= {section: {"type": "object"} for section in OVERRIDES}
        made[f"schemas/{name}.schema.json"] = json.dumps(schema, indent=1) + "\n"
    return made


def main() -> int:
    """Write them all."""
    for path, text in pages().items():
        target = DOCS / path
        target.parent.mkdir(exist_ok=True)
        target.write_text(text.rstrip() + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
