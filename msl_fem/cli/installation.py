"""What is installed here: packages with versions, programs, the cache of compiled code, threads and processors."""

import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_info

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
PROGRAMS = {
    "gcc": (("gcc",), "compiles exported FMUs, and what the tests export"),
    "chromium": (("chromium", "chromium-browser", "google-chrome"), "opens reports in the tests"),
    "octave": (("octave-cli", "octave"), "reads exported MAT-files in the tests"),
    "make": (("make",), "the README's two commands"),
    "git": (("git",), "fresh clones in the tests"),
}
"""Programs by the names they may have, and what for."""
WHAT_MATTERS = ("numpy", "scipy", "scikit-fem", "netgen-mesher", "numba", "qdldl", "xarray", "h5netcdf", "pydantic")
_ANSWERS_WITHIN = 10.0  # seconds
_CACHED = re.compile(r"_[0-9a-f]{12}-\d+\.py\d+\w*\.nbi$")
_EXTRA = re.compile(r"extra\s*==\s*['\"](\w+)['\"]")


def installed_version(name: str) -> str | None:
    """The version of an installed distribution; None where there is none."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def versions_that_matter() -> str:
    """Python, the libraries that results depend on, and the machine, on one line."""
    found = [f"{name} {installed_version(name) or 'missing'}" for name in WHAT_MATTERS]
    return ", ".join([f"Python {platform.python_version()}", *found, f"{platform.system()} {platform.machine()}"])


def packages() -> dict[str, dict[str, str | None]]:
    """Distribution to version (None: missing), by what needs it: "required" and the extras' names."""
    found: dict[str, dict[str, str | None]] = {"required": {}}
    for line in _requirements():
        extra = _EXTRA.search(line)
        name = re.split(r"[\s;<>=!~\[(]", line, maxsplit=1)[0]
        found.setdefault(extra[1] if extra else "required", {})[name] = installed_version(name)
    return found


def _requirements() -> list[str]:
    try:
        return requires("msl-fem") or []
    except PackageNotFoundError:  # a checkout that is not installed
        return []


def programs() -> dict[str, dict[str, str | None]]:
    """Program to its path and first line of version (None: not there), and what it is for."""
    return {name: _program(names) | {"used_for": used_for} for name, (names, used_for) in PROGRAMS.items()}


def _program(names: tuple[str, ...]) -> dict[str, str | None]:
    path = next(filter(None, map(shutil.which, names)), None)
    if path is None:
        return {"path": None, "version": None}
    try:
        done = subprocess.run(
            [path, "--version"], capture_output=True, text=True, errors="replace", timeout=_ANSWERS_WITHIN, check=False,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
        said = (done.stdout or done.stderr).strip().splitlines()
    except (OSError, subprocess.TimeoutExpired) as err:
        said = [f"does not answer ({type(err).__name__})"]
    return {"path": path, "version": said[0] if said else None}


def rendering() -> dict[str, Any]:
    """Whether VTK is there, and whether there is a display; drawing itself is tried by `solve --vtu` alone."""
    display = next((name for name in ("WAYLAND_DISPLAY", "DISPLAY") if os.environ.get(name)), None)
    return {"vtk": find_spec("vtkmodules") is not None, "pyvista": find_spec("pyvista") is not None, "display": display}


def blas() -> dict[str, Any]:
    """Thread pools of the loaded BLAS and OpenMP libraries, and the variables that set them."""
    pools = [
        {"library": pool.get("internal_api"), "version": pool.get("version"), "threads": pool["num_threads"]}
        for pool in threadpool_info()
    ]
    return {"pools": pools, "variables": {name: os.environ.get(name) for name in THREAD_VARIABLES}}


def processors() -> dict[str, Any]:
    """Processors of the machine, and those that this process may use; the load of the last minute over them."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    load = os.getloadavg()[0] / usable if hasattr(os, "getloadavg") else None
    return {"all": os.cpu_count(), "usable": usable, "load_per_processor": load}


def compiled_cache() -> dict[str, Any]:
    """The machine code that numba keeps beside the sources: of functions that the sources hold, and of former ones.

    A name in the cache is module.function_digest-line; the digest is that of `msl_fem.computing.compiled`, and the
    newest of a function counts.
    """
    folders = list(_cache_folders())
    files = [path for folder in folders for path in folder.glob("*.nb[ic]")]
    indices = [path for path in files if path.suffix == ".nbi"]
    names = {_CACHED.sub("", path.name) for path in indices}
    present = len(names & _compiled_functions())
    return {
        "functions": present,
        "stale_functions": len(indices) - present,
        "megabytes": sum(path.stat().st_size for path in files) / 1e6,
        "folder": str(folders[0]) if folders else None,
        "writable": _writable(_package()),
    }


def _compiled_functions() -> set[str]:
    """module.function of all compiled functions of the sources."""
    decorated = re.compile(r"^@compiled\ndef (\w+)", flags=re.MULTILINE)
    sources = ((path.stem, path.read_text(encoding="utf-8")) for path in _package().rglob("*.py"))
    return {f"{module}.{name}" for module, source in sources for name in decorated.findall(source)}


def _package() -> Path:
    return Path(__file__).parents[1]


def _cache_folders() -> Iterator[Path]:
    """Where numba puts its files: a folder for each of ours in NUMBA_CACHE_DIR, or beside the modules."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        yield from sorted(path for path in Path(chosen).glob("*") if path.is_dir())
        return
    yield from sorted(_package().rglob("__pycache__"))


def _writable(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def python_itself() -> dict[str, str]:
    """The interpreter and the machine."""
    return {
        "version": platform.python_version(),
        "executable": sys.executable,
        "system": platform.platform(),
        "machine": platform.machine(),
    }
