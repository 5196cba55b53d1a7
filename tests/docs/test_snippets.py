"""Every block of the tutorial and the how-to pages does what the page says, on grids smaller than a reader's."""

import math
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Outcome
from docs_walk import ROOT, TRIED, Block, blocks
from short_menu import cut_menu

from msl_fem import study as study_module
from msl_fem.actuator import Actuator
from msl_fem.cli import study as study_command
from msl_fem.cli import table as table_command
from msl_fem.cli.app import app
from msl_fem.cli.output import run_guarded

FOLDERS = ("geometries", "lookup_tables", "measurements", "requirements")
TOLERANCE = 0.01
_NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


def small_grid(actuator: Actuator) -> tuple[np.ndarray, np.ndarray]:
    """A grid over the actuator's whole range with few points."""
    assert actuator.motion is not None
    assert actuator.drive is not None
    nominal, span = actuator.motion.nominal_gap, actuator.motion.range
    assert nominal is not None
    assert span is not None
    top = actuator.drive.current_limit or 10.0
    gaps = np.union1d(np.geomspace(0.5 * (nominal - span), nominal + 1.2 * span, 7), [nominal])
    return gaps, top * np.linspace(0, 1, 14) ** 2


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder as a reader has it: the repository's data beside what the page makes."""
    for name in FOLDERS:
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(study_module, "default_grid", small_grid)
    monkeypatch.setattr(table_command, "default_grid", small_grid)
    for command in (table_command, study_command):  # a small grid is not worth a process that imports everything
        monkeypatch.setattr(command, "default_workers", lambda: 1)
    cut_menu(monkeypatch)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    return tmp_path


def commands(text: str) -> list[list[str]]:
    """The command lines of a shell block, without comments; a backslash at its end goes on with the next line."""
    lines = text.replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True) for line in lines if line.strip()]


def run_command(words: list[str], capfd: pytest.CaptureFixture[str]) -> Outcome:
    assert words[0] == "msl-fem", f"a page's shell blocks call msl-fem, not {words[0]}"
    capfd.readouterr()
    status = run_guarded(lambda: app(words[1:]))
    printed = capfd.readouterr()
    return Outcome(status, printed.out, printed.err)


def alike(said: str, printed: str) -> bool:
    """Whether a word of the page is the printed one, numbers to the tolerance."""
    if _NUMBER.fullmatch(said.rstrip(",")) and _NUMBER.fullmatch(printed.rstrip(",")):
        return math.isclose(float(said.rstrip(",")), float(printed.rstrip(",")), rel_tol=TOLERANCE)
    return said == printed


def is_printed(line: str, printed: str) -> bool:
    """Whether a line of the page stands in what was printed."""
    said = line.split()
    candidates = (other.split() for other in printed.splitlines())
    return any(len(o) == len(said) and all(map(alike, said, o)) for o in candidates)


@pytest.mark.parametrize("page", TRIED, ids=lambda page: page.stem)
def test_a_page_does_what_it_says(page: Path, desk: Path, capfd: pytest.CaptureFixture[str]) -> None:
    names: dict[str, Any] = {"__name__": page.stem}
    printed = ""
    for block in blocks(page):
        where = f"{page.name}, line {block.line}"
        if block.title:
            (desk / block.title).write_text(block.text, encoding="utf-8")
        if block.language == "sh":
            outcomes = [(words, run_command(words, capfd)) for words in commands(block.text)]
            for words, outcome in outcomes:
                assert outcome.status == 0, f"{where}: {shlex.join(words)}\n{outcome.stderr}"
            printed = "\n".join(outcome.stdout for _, outcome in outcomes)
        elif block.language == "python":
            exec(compile(block.text, where, "exec"), names)
        elif block.language == "text" and printed:
            for line in block.text.splitlines():
                assert is_printed(line, printed), f"{where}: not printed: {line}\n{printed}"
        if block.language != "sh":
            printed = ""


def test_c_on_the_boards_page_compiles_and_says_what_its_comment_says(desk: Path) -> None:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler here")
    page = next(p for p in TRIED if p.stem == "my_board")
    for block in blocks(page):
        if block.title:
            (desk / block.title).write_text(block.text, encoding="utf-8")
        for words in commands(block.text) if block.language == "sh" else []:
            assert run_guarded(lambda words=words: app(words[1:])) == 0
    subprocess.run([compiler, "-std=c99", "-O2", "board.c", "-lm", "-o", "board"], check=True, cwd=desk)
    said = subprocess.run(["./board"], check=True, cwd=desk, capture_output=True, text=True).stdout
    assert said.split() == ["0", "1", "2"]
    assert "# 0 1 2" in page.read_text(encoding="utf-8")


def test_the_walk_finds_blocks_and_notices_what_is_not_printed(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text('a\n\n```toml title="x.toml"\na = 1\n```\n\n```sh\nmsl-fem lookup\n```\n', encoding="utf-8")
    assert blocks(page) == [Block("toml", "x.toml", "a = 1\n", 3), Block("sh", "", "msl-fem lookup\n", 7)]
    assert is_printed("force_N  83.46", "a\nforce_N    83.4623   \n")
    assert not is_printed("force_N  85.46", "force_N    83.4623")
    assert not is_printed("forces_N  83.46", "force_N    83.4623")
    assert not is_printed("limits_A  2.86, 4.6", "limits_A  2.86498, 4.4311")
    assert sys.version_info >= (3, 11)
