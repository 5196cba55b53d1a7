"""The README's session prints what the commands print today."""

import re
import shlex
from pathlib import Path

import pytest
from conftest import ROOT

SESSION = re.search(r"^```console\n(.*?)^```", (ROOT / "README.md").read_text(encoding="utf-8"), re.M | re.S)


def test_the_session_of_the_readme_is_what_the_commands_print(
    msl_fem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Line by line; "..." stands for lines that are left out."""
    assert SESSION is not None
    for folder in ("geometries", "lookup_tables"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    commands = re.split(r"^\$ msl-fem ", SESSION.group(1), flags=re.M)[1:]
    assert len(commands) > 2
    for command in commands:
        words, _, shown = command.partition("\n")
        done = msl_fem(*shlex.split(words))
        assert done.status == 0, done.stderr
        printed = "".join(f"{line.rstrip()}\n" for line in done.stdout.splitlines())
        pattern = re.escape(shown).replace(re.escape("...\n"), r"(?:.*\n)+")
        assert re.fullmatch(pattern, printed), f"{words}\n{printed}"
