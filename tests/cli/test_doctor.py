"""The command `doctor`, and the versions of what results depend on."""

import re
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from msl_fem.cli import doctor

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py


def test_it_names_what_is_installed(msl_fem: Run) -> None:
    found = msl_fem("doctor", "--json").json
    assert found["msl_fem"] == version("msl-fem")
    assert found["python"]["executable"] == sys.executable
    assert found["packages"]["required"]["numpy"] == version("numpy")
    assert found["packages"]["test"]["hypothesis"] == version("hypothesis")
    assert found["compiled_cache"]["functions"] >= 0
    assert found["processors"]["usable"] >= 1
    assert found["blas"]["variables"].keys() >= {"OMP_NUM_THREADS"}


def test_it_is_read_by_people_too(msl_fem: Run) -> None:
    printed = msl_fem("doctor").stdout
    assert f"numpy {version('numpy')}" in re.sub(r"\s+", " ", printed)
    assert re.search(r"^missing: ", printed, flags=re.MULTILINE)
    assert re.search(r"^slow: ", printed, flags=re.MULTILINE)


def test_a_program_is_found_by_what_it_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = {"gcc": "echo 'gcc 99.1'; echo more", "octave-cli": "echo oct >&2", "git": "exit 3"}
    for name, does in answers.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{does}\n")
        (tmp_path / name).chmod(0o755)
    (tmp_path / "make").write_bytes(b"\x00no program")
    (tmp_path / "make").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin")
    found = doctor.programs()
    assert found["gcc"]["version"] == "gcc 99.1"
    assert found["octave"]["version"] == "oct"
    assert found["git"]["version"] is None
    assert "does not answer" in str(found["make"]["version"])


def examined(**changes: Any) -> dict[str, Any]:
    """What a machine without faults would answer, with changes."""
    good = {
        "packages": {"required": {"numpy": "2", "qdldl": "1"}, "test": {"pytest": "9"}},
        "programs": {"gcc": {"path": "/usr/bin/gcc", "version": "1", "used_for": "compiles"}},
        "rendering": {"vtk": True, "pyvista": True, "display": None},
        "processors": {"all": 4, "usable": 4, "load_per_processor": 0.1},
        "blas": {"pools": [{"library": "openblas", "version": "1", "threads": 1}], "variables": {}},
        "compiled_cache": {"functions": 200, "stale_functions": 0, "writable": True},
    }
    return good | changes


def test_a_good_machine_has_no_complaint() -> None:
    assert doctor.missing(examined()) == []
    assert doctor.slow(examined()) == []


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"packages": {"required": {"numpy": None, "scipy": None}}}, "numpy, scipy: required; install them with"),
        ({"packages": {"required": {}, "docs": {"mkdocs": None}}}, "mkdocs: for the extra 'docs'; pip install"),
        ({"programs": {"gcc": {"path": None, "version": None, "used_for": "compiles FMUs"}}}, "gcc: compiles FMUs"),
        ({"rendering": {"vtk": False, "pyvista": False, "display": None}}, "pyvista: draws solid scenes"),
    ],
)
def test_what_is_missing_is_said_with_the_way_out(changes: dict[str, Any], said: str) -> None:
    [sentence] = doctor.missing(examined(**changes))
    assert sentence.startswith(said)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"compiled_cache": {"functions": 3, "stale_functions": 0, "writable": True}}, "the cache holds 3 compiled"),
        ({"compiled_cache": {"functions": 0, "stale_functions": 0, "writable": False}}, "set NUMBA_CACHE_DIR"),
        (
            {"compiled_cache": {"functions": 99, "stale_functions": 7, "writable": True}},
            "7 compiled functions of former",
        ),
        (
            {"blas": {"pools": [{"library": "mkl", "version": "1", "threads": 8}], "variables": {}}},
            "mkl uses 8 threads a process",
        ),
        ({"packages": {"required": {"qdldl": None}}}, "qdldl is missing: field solutions use SciPy's SuperLU"),
        ({"processors": {"all": 4, "usable": 1, "load_per_processor": None}}, "one processor may be used"),
        ({"processors": {"all": 4, "usable": 2, "load_per_processor": 0.2}}, "2 of 4 processors may be used"),
        ({"processors": {"all": 4, "usable": 4, "load_per_processor": 3.0}}, "the machine is busy: 3.0"),
    ],
)
def test_what_is_slow_is_said_with_its_cause(changes: dict[str, Any], said: str) -> None:
    [sentence] = doctor.slow(examined(**changes))
    assert said in sentence


def test_a_cache_that_others_may_write_is_unsafe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What numba keeps there is code, and run by whoever loads it."""
    folder = tmp_path / "kernel_0123"
    folder.mkdir(mode=0o755)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert doctor.unsafe(examined(compiled_cache=doctor.compiled_cache())) == []
    folder.chmod(0o777)
    [said] = doctor.unsafe(examined(compiled_cache=doctor.compiled_cache()))
    assert said.startswith(f"{folder} holds compiled code and may be written by others")


def test_the_cache_counts_the_functions_of_the_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A function is counted once however often it was compiled; what no source holds is stale."""
    folder = tmp_path / "maps_x"
    folder.mkdir()
    present, former, gone = (
        "guard.region_of_0123456789ab-52",
        "guard.region_of_ba9876543210-52",
        "guard.rgn_0123456789ab-1",
    )
    for name in (f"{present}.py311.nbi", f"{present}.py311.1.nbc", f"{former}.py311.nbi", f"{gone}.py311.nbi"):
        (folder / name).write_bytes(bytes(1000))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    found = doctor.compiled_cache()
    assert (found["functions"], found["stale_functions"]) == (1, 2)
    assert found["megabytes"] == pytest.approx(4e-3)


def test_an_uninstalled_checkout_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "installed_version", lambda name: None)
    monkeypatch.setattr(doctor, "_requirements", lambda: ["numpy>=2.0", 'pytest>=8; extra == "three-d"', "a[b]>1"])
    assert doctor.packages() == {"required": {"numpy": None, "a": None}, "three-d": {"pytest": None}}
    assert "numpy missing" in doctor.versions_that_matter()


def test_version_names_what_results_depend_on(msl_fem: Run) -> None:
    first, second = msl_fem("--version").stdout.splitlines()
    assert first == f"msl-fem {version('msl-fem')}"
    for name in ("numpy", "scipy", "scikit-fem", "netgen-mesher", "numba"):
        assert f"{name} {version(name)}" in second
    assert second.startswith(f"Python {sys.version.split()[0]}")
