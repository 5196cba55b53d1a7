"""The notebooks' cells run, in the order in which a reader runs them, and what lies beside them was made of them."""

import ast
import json
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT

sys.path.append(str(ROOT / "docs"))
from make_notebooks import FOLDER, cells_of

SCRIPTS = sorted(FOLDER.glob("*.py"))


def executed(code: str, names: dict[str, Any]) -> Any:
    """What a notebook shows of a cell: its last expression, None where it is none."""
    body = ast.parse(code).body
    last = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), "cell", "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_notebook_runs_and_shows_what_it_says(script: Path) -> None:
    names: dict[str, Any] = {}
    shown = [executed(text, names) for kind, text in cells_of(script.read_text("utf-8")) if kind == "code"]
    pictures = [it for it in shown if hasattr(it, "_repr_png_")]
    assert pictures
    assert all(len(picture._repr_png_()) > 5000 for picture in pictures)
    if script.stem == "record_to_cause":
        [(effect, parameters)] = shown[-1]
        assert effect == "gap_offset"
        assert parameters["offset"].low < names["hidden"] < parameters["offset"].high
    if script.stem == "cause_to_controller":
        plain, informed = (names["runs"][name].tracking_rms for name in ("plain", "informed"))
        assert informed < plain


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_the_stored_notebook_is_that_script_s(script: Path) -> None:
    stored = json.loads(script.with_suffix(".ipynb").read_text("utf-8"))
    assert [(c["cell_type"], "".join(c["source"])) for c in stored["cells"]] == cells_of(script.read_text("utf-8"))
    outputs = [o for c in stored["cells"] for o in c.get("outputs", [])]
    assert outputs
    assert not [o for o in outputs if o["output_type"] == "error"]
    assert "/work" not in json.dumps(stored)
    assert script.stem in (ROOT / "docs" / "gallery.md").read_text()


def test_the_packages_table_is_the_repositorys() -> None:
    example = ROOT / "msl_fem" / "table" / "examples" / "fast_tool_servo.nc"
    assert example.read_bytes() == (ROOT / "lookup_tables" / "fast_tool_servo.nc").read_bytes()
