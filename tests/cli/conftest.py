"""Running a command in this process, as the console script does."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from msl_fem.cli.app import app
from msl_fem.cli.output import run_guarded


@dataclass(frozen=True)
class Outcome:
    """Exit status and what was printed."""

    status: int
    stdout: str
    stderr: str

    @property
    def json(self) -> dict[str, Any]:
        """The one JSON object on stdout, and nothing else there."""
        assert self.status == 0, self.stderr
        return dict(json.loads(self.stdout, parse_constant=lambda name: pytest.fail(f"{name} in JSON")))

    @property
    def complaint(self) -> str:
        """The one line of a user's mistake: exit 2, nothing on stdout, no traceback."""
        assert self.status == 2, (self.status, self.stderr)
        assert self.stdout == ""
        lines = [line for line in self.stderr.splitlines() if line.strip() and "━" not in line and "/" not in line[:30]]
        assert "Traceback" not in self.stderr
        assert len([line for line in lines if line.startswith("error:")]) == 1, self.stderr
        return next(line for line in lines if line.startswith("error:"))


@pytest.fixture
def msl_fem(capfd: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Runs `msl-fem` with the arguments given."""

    def run(*arguments: str) -> Outcome:
        capfd.readouterr()
        status = run_guarded(lambda: app(list(arguments)))
        printed = capfd.readouterr()
        return Outcome(status, printed.out, printed.err)

    return run
