"""Completion in a real bash, and lists of commands that load none of them."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from msl_fem.cli.app import COMMANDS

LISTS = "from msl_fem.cli.app import app; from msl_fem.cli.output import run_guarded; import sys; "


@pytest.fixture(scope="module")
def bash() -> str:
    found = shutil.which("bash")
    if found is None:
        pytest.skip("bash is not installed")
    return found


def completions(bash: str, words: list[str]) -> list[str]:
    """What bash offers for the last of the words, by the script that the command itself gives."""
    script = (
        'set -e; eval "$(_MSL_FEM_COMPLETE=source_bash msl-fem)"; complete -p msl-fem >/dev/null; '
        'COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _msl_fem_completion msl-fem; '
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        [bash, "--norc", "-c", script, "bash", *words],
        env={"PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin"}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout.split()


def test_bash_completes_commands_and_options(bash: str) -> None:
    assert completions(bash, ["msl-fem", "s"]) == [name for name in COMMANDS if name.startswith("s")]
    assert completions(bash, ["msl-fem", "lookup", "--cu"]) == ["--current", "--current-2"]
    assert completions(bash, ["msl-fem", "no-such"]) == []


@pytest.mark.parametrize(
    "start", ["sys.argv = ['msl-fem', '--help']", "import os; os.environ.update(_MSL_FEM_COMPLETE='complete_bash', "
              "COMP_WORDS='msl-fem ', COMP_CWORD='1')"]
)  # fmt: skip
def test_a_list_of_commands_loads_none_of_them(start: str) -> None:
    """All commands are named with their first sentence, and no mesher, no compiler, no numpy for it."""
    code = f"{LISTS}{start}; run_guarded(app); loaded = {{'skfem', 'netgen', 'numba', 'xarray'}} & set(sys.modules); "
    code += "print(loaded, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1] == "set()"
    for name in COMMANDS:
        assert name in done.stdout.split()
    if "--help" in start:
        assert "One field solution of one magnet" in done.stdout
