"""Fixtures that several parts share; helper modules of every folder, and the benchmarks' scripts, can be imported."""

import gc
import json
import os
import sys
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from devtools import Browser, find_browser, started
from hypothesis import settings
from threadpoolctl import threadpool_limits

from msl_fem import study as study_module
from msl_fem.actuator import Actuator, load_actuator
from msl_fem.cli.app import app
from msl_fem.cli.output import run_guarded
from msl_fem.plant.effects import declared
from msl_fem.table.magnetic_table import MagneticTable

ROOT = Path(__file__).parent.parent
WORKER = os.environ.get("PYTEST_XDIST_WORKER", "")
sys.path += [str(folder) for folder in sorted((ROOT / "tests").iterdir()) if folder.is_dir()]
sys.path.append(str(ROOT / "benchmarks"))
settings.register_profile("untimed", deadline=None)  # a loaded machine is no error of the code
settings.load_profile("untimed")
gc.set_threshold(20_000, 20, 20)  # at 700 one second in six of the imports goes into looks for cycles
threadpool_limits(limits=1, user_api="blas")  # as the verbs and `make` have it: threads of a BLAS only cost time here


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Generator[None, Any, Any]:
    """Every second worker goes through a folder from its end, so that each translates half of the tests for both."""
    report = yield
    if isinstance(collector, pytest.Dir) and WORKER[-1:] in tuple("13579"):
        report.result.reverse()
    return report


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """All workers have the tests in the same order."""
    if WORKER:
        items.sort(key=lambda item: item.nodeid.partition("::")[0])


def pytest_collection_finish() -> None:
    """What is imported stays for the whole run: not looked through for cycles again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _no_causes_left_behind() -> Iterator[None]:
    """What a test declares by a law is in the catalogue of that test alone."""
    with declared():
        yield


def saturating_reluctance(current: np.ndarray, gap: np.ndarray) -> dict[str, np.ndarray]:
    """A closed-form magnet: W' = L(g) s (sqrt(s^2 + i^2) - s), L = a/(g + b), s = c + d g, and its derivatives.

    Linear for i << s (inductance L), saturated beyond; of about the size of the reference actuator's magnet.
    """
    a, b, c, d = 1.08e-5, 3e-5, 2.0, 8e3
    i, g = np.broadcast_arrays(np.asarray(current, float), np.asarray(gap, float))
    ind, ind_g, ind_gg = a / (g + b), -a / (g + b) ** 2, 2 * a / (g + b) ** 3
    s = c + d * g
    r = np.sqrt(s**2 + i**2)
    f, f_i, f_ii = s * (r - s), s * i / r, s**3 / r**3
    f_g, f_gg = d * (r + s**2 / r - 2 * s), d**2 * (3 * s / r - s**3 / r**3 - 2)
    f_ig = d * (i / r - s**2 * i / r**3)
    return {
        "coenergy": ind * f,
        "flux_linkage": ind * f_i,
        "force": -(ind_g * f + ind * f_g),
        "incremental_inductance": ind * f_ii,
        "force_current_slope": -(ind_g * f_i + ind * f_ig),
        "force_gap_slope": -(ind_gg * f + 2 * ind_g * f_g + ind * f_gg),
    }


def closed_form_table(*, n_gap: int = 20, n_current: int = 20) -> MagneticTable:
    """The closed-form magnet as a table, 0.05 ... 1.2 mm and 0 ... 12 A."""
    gap, current = np.geomspace(5e-5, 1.2e-3, n_gap), 12.0 * np.linspace(0, 1, n_current) ** 1.5
    nodes = saturating_reluctance(*np.meshgrid(current, gap))
    centre_leg = nodes["flux_linkage"] / (200 * 0.01 * 0.02)
    return MagneticTable(
        gap, current, nodes, {"flux_density_centre_leg": centre_leg, "flux_density_yoke": 0.9 * centre_leg}
    )


@pytest.fixture(scope="session")
def table() -> MagneticTable:
    return closed_form_table()


@pytest.fixture(scope="session")
def servo() -> Actuator:
    return load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")


@pytest.fixture(scope="session")
def study_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a study that `msl-fem study` made, on a grid of 8 by 14 at accuracy fast; one for all workers of
    pytest-xdist, the first that needs it makes it."""
    import fcntl  # not on Windows, where the other tests run

    base = tmp_path_factory.getbasetemp()
    common = base.parent if WORKER else base
    folder, whole = common / "study", common / "study.whole"
    with (common / "study.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not whole.exists():
            make_study(folder)
            whole.touch()
    return folder


def make_study(folder: Path) -> None:
    """A small study of the reference actuator."""
    servo = ROOT / "geometries" / "fast_tool_servo.toml"
    with pytest.MonkeyPatch.context() as patch:
        gaps, currents = np.geomspace(5e-5, 1.2e-3, 8), 12 * np.linspace(0, 1, 14) ** 2
        patch.setattr(study_module, "default_grid", lambda actuator: (gaps, currents))
        arguments = ["study", str(servo), "-o", str(folder), "--accuracy", "fast", "--workers", "1", "--json"]
        assert run_guarded(lambda: app(arguments)) == 0


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One headless browser for all tests of pages."""
    program = find_browser()
    if program is None:
        if os.environ.get("CI"):
            pytest.fail("no Chromium here; continuous integration installs one (.ci/run)")
        pytest.skip("no Chromium here; install one (Debian: apt-get install chromium)")
    with started(program, tmp_path_factory.mktemp("profile")) as it:
        yield it


@pytest.fixture(scope="session")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where tests write a page that they open: the browser keeps what it compiled of the scripts of an address, and
    compiling plotly.js is a third of what opening a page takes."""
    return tmp_path_factory.mktemp("page") / "page.html"


@dataclass(frozen=True)
class Outcome:
    """Exit status of a command and what it printed."""

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
        assert "Traceback" not in self.stderr
        errors = [line for line in self.stderr.splitlines() if line.startswith("error:")]
        assert len(errors) == 1, self.stderr
        return errors[0]


@pytest.fixture
def msl_fem(capfd: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Runs `msl-fem` with the arguments given."""

    def run(*arguments: str) -> Outcome:
        capfd.readouterr()
        status = run_guarded(lambda: app(list(arguments)))
        printed = capfd.readouterr()
        return Outcome(status, printed.out, printed.err)

    return run
