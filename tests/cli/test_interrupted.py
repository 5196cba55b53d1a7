"""Ctrl-C that falls into a library ends a command as Ctrl-C does."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from msl_fem.cli.output import INTERRUPTED_LINE, run_guarded

INTO_EXEC = """
import signal
import msl_fem.cli.app as commands
from msl_fem.cli.__main__ import main
signal.signal(signal.SIGINT, signal.default_int_handler)
commands.app = lambda: exec("signal.raise_signal(signal.SIGINT)")
main()
"""


def interrupted(number: int) -> None:
    """As pydantic does where Ctrl-C falls into its making of a record."""
    try:
        os.kill(os.getpid(), number)
    except KeyboardInterrupt as err:
        raise ValueError("a record cannot be made: KeyboardInterrupt") from err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_a_library_makes_of_it_is_no_error(number: int, capsys: pytest.CaptureFixture[str]) -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    try:
        assert run_guarded(lambda: interrupted(number)) == 130
        assert capsys.readouterr().err.split() == INTERRUPTED_LINE.split()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_an_error_without_it_stays_one() -> None:
    with pytest.raises(ZeroDivisionError):
        run_guarded(lambda: 1 / 0)


def test_the_status_is_130_wherever_it_falls(tmp_path: Path) -> None:
    (tmp_path / "into_exec.py").write_text(INTO_EXEC)
    done = subprocess.run([sys.executable, "-m", "into_exec"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 130
    assert done.stderr.split() == INTERRUPTED_LINE.split()
