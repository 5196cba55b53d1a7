"""Ctrl-C that falls into a library ends a command as Ctrl-C does."""

import os
import signal
import subprocess
import sys
import time
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


class Closing:
    """A library's handle that is interrupted while it is finalised, where Python swallows what is raised."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __del__(self) -> None:
        signal.raise_signal(self.number)


def closed_then_busy(number: int, seconds: float) -> None:
    Closing(number)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(0.01)


def test_it_is_heard_in_a_finaliser_too(capfd: pytest.CaptureFixture[str]) -> None:
    began = time.monotonic()
    assert run_guarded(lambda: closed_then_busy(signal.SIGTERM, 20.0)) == 130
    assert time.monotonic() - began < 10
    assert capfd.readouterr().err.split() == INTERRUPTED_LINE.split()


def test_what_ends_before_it_is_heard_has_ended(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_guarded(lambda: closed_then_busy(signal.SIGTERM, 0.0)) == 0
    time.sleep(0.2)
    assert capfd.readouterr().err == ""


def test_an_error_without_it_stays_one() -> None:
    with pytest.raises(ZeroDivisionError):
        run_guarded(lambda: 1 / 0)


def test_the_status_is_130_wherever_it_falls(tmp_path: Path) -> None:
    (tmp_path / "into_exec.py").write_text(INTO_EXEC)
    done = subprocess.run([sys.executable, "-m", "into_exec"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 130
    assert done.stderr.split() == INTERRUPTED_LINE.split()
