"""Names and texts that want to leave a comment, through every exported header and a real compiler."""

import re
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from c_programs import STRICT, compiler
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.control import ControllerDesign, design_controller
from msl_fem.export.c_controller import ControllerSource, controller_header
from msl_fem.export.c_guard import guard_header
from msl_fem.export.c_pair_guard import pair_guard_header
from msl_fem.export.c_table import table_header
from msl_fem.export.c_text import c_comment
from msl_fem.export.fmu import fmu_files
from msl_fem.export.formats import ModelSource
from msl_fem.export.table_formats import modelica_text
from msl_fem.maps import OperatingMap, operating_map
from msl_fem.maps.pair_limits import PairMap
from msl_fem.table.magnetic_table import MagneticTable, read_table

CRAFTED = (
    "*/ int evil = 1; /*", "x */\nint evil;\n#include \"/etc/passwd\"\n/*", "ends in a backslash \\", "??/\nint evil;",
    "*??/\n/ int evil;", "/* nested", "// int evil;\\\nint evil;", "\r\nint evil;", "*\\\n/ int evil;",
    "\";int evil;\"", "%:include <evil>", "_Pragma(\"evil\")", "\u2028int evil;", "\x00*/int evil;",
)  # fmt: skip
HARMLESS = "harmless"
SERVO = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
TABLE = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
MAP = operating_map(TABLE)


def with_text(text: str) -> MagneticTable:
    told = {"actuator": text, "actuator_sha256": text, "notes": [text], "solver": text, "date": text, text: text}
    return replace(TABLE, provenance=told)


def map_with(text: str) -> OperatingMap:
    sections = tuple((text,) * MAP.gap.size for _ in MAP.levels)
    return replace(MAP, actuator=text, digest=text, warnings=(text, text), section=sections, provenance={text: text})


def table_of(text: str) -> str:
    return table_header(with_text(text), name="m")


def guard_of(text: str) -> str:
    return guard_header(map_with(text), name="m")


def pair_guard_of(text: str) -> str:
    values = np.ones((2, 1, 2, 2))
    axes = (np.array([1.2]), np.array([-1e-3, 1e-3]), np.array([0.0, 1.0]))
    return pair_guard_header(PairMap(*axes, values, 0 * values, "opposing", text, text, {text: text}), name="m")


def controller_of(text: str) -> str:
    named = replace(design(), actuator=SERVO.model_copy(update={"name": text}))
    return controller_header(ControllerSource(named, map_with(text)), name="m")


@cache
def design() -> ControllerDesign:
    return design_controller(SERVO, TABLE, MAP)


def preprocessed(header: str, folder: Path) -> str:
    """What a compiler sees of a header behind its comments, trigraphs replaced; a warning is an error."""
    path = folder / "header.h"
    path.write_text(header)
    (folder / "program.c").write_text('#include "header.h"\nint main(void) { return 0; }\n')
    flags = ("-std=c99", "-trigraphs", "-Wno-unused-function", "-Wcomment", *STRICT)
    done = subprocess.run(
        [compiler("gcc"), *flags, "-fsyntax-only", folder / "program.c"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[:2000]
    return subprocess.run(
        [compiler("gcc"), *flags, "-E", "-P", path], capture_output=True, text=True, check=True
    ).stdout  # fmt: skip


@pytest.mark.parametrize("made", [table_of, guard_of, pair_guard_of, controller_of])
def test_a_header_of_crafted_texts_is_the_code_of_a_harmless_one(made, tmp_path: Path) -> None:
    harmless = preprocessed(made(HARMLESS), tmp_path)
    crafted = made(" ".join(CRAFTED[:3]))
    assert crafted != made(HARMLESS)
    assert preprocessed(crafted, tmp_path) == harmless


def test_each_text_stays_in_its_comment(tmp_path: Path) -> None:
    """The comment filter alone, all texts in one file, each between two lines of code."""
    lines = [f"/* {c_comment(text)} */\nint x{k};" for k, text in enumerate(CRAFTED)]
    code = "".join(f"int x{k};\n" for k in range(len(CRAFTED)))
    assert preprocessed("\n".join(lines), tmp_path) == code


@pytest.mark.parametrize("text", CRAFTED)
def test_modelica_keeps_them_in_its_comments(text: str) -> None:
    """Lines that are no comment are those of a harmless export."""

    def plain(lines: str) -> list[str]:
        return [line for line in lines.splitlines() if not line.startswith("#")]

    assert plain(modelica_text(with_text(text))) == plain(modelica_text(with_text(HARMLESS)))


def test_an_fmu_keeps_them_in_its_comments() -> None:
    """Its sources without comments are those of a harmless export, up to the identifiers made of the name."""
    crafted, harmless = (
        fmu_files(ModelSource(SERVO.model_copy(update={"name": name}), with_text(name)))
        for name in (" ".join(CRAFTED), HARMLESS)
    )
    sources = [path for path in harmless if path.endswith((".c", ".h"))]
    assert sources
    for path in sources:
        code, other = (re.sub(r"/\*.*?\*/", "", files[path].decode(), flags=re.DOTALL) for files in (crafted, harmless))
        apart = [(a, b) for a, b in zip(code.splitlines(), other.splitlines(), strict=True) if a != b]
        assert all(re.fullmatch(r'#define [A-Z_]+ "?[\w{}-]*"?', a) for a, _ in apart), (path, apart[:3])
