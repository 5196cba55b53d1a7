"""The command `doctor`: what is installed, what is missing, what is slow and why."""

import os
import platform
import re
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import typer
from threadpoolctl import threadpool_info

from msl_fem.cli.options import Json
from msl_fem.cli.output import print_result

KERNELS = 40
"""Compiled functions below which the cache is not that of a machine on which everything ran once."""
BUSY = 1.5


def command(json: Json = False) -> None:
    """What is installed, with versions; what is missing; what is slow, why, and the way out."""
    found = installation()
    if json:
        print_result(found, as_json=True, title="")
        return
    print_result(findings(found), as_json=False, title=f"msl-fem {found['msl_fem']}")
    for name in ("missing", "slow", "unsafe"):
        for sentence in found[name] or ["nothing"]:
            typer.echo(f"{name}: {sentence}")


def findings(found: dict[str, Any]) -> dict[str, str]:
    """What people want to see of it, a line a topic."""
    cache, blas = found["compiled_cache"], found["blas"]["pools"]
    lines = {"python": f"{found['python']['version']}, {found['python']['system']}"}
    for group, names in found["packages"].items():
        here = [f"{name} {version}" for name, version in names.items() if version]
        lines["packages" if group == "required" else f"extra {group}"] = ", ".join(here) or "-"
    lines |= {name: it["version"] or it["path"] or "-" for name, it in found["programs"].items()}
    return lines | {
        "processors": f"{found['processors']['usable']} of {found['processors']['all']}",
        "BLAS": ", ".join(f"{p['library']} {p['version']}, {p['threads']} thread(s)" for p in blas) or "none loaded",
        "compiled functions": f"{cache['functions']} in the cache, {cache['stale_functions']} stale, "
        f"{cache['megabytes']:.0f} MB",
    }


def installation() -> dict[str, Any]:
    """All that is known of this installation, and `missing`, `slow` and `unsafe` as sentences."""
    found: dict[str, Any] = {
        "msl_fem": installed_version("msl-fem"),
        "python": python_itself(),
        "packages": packages(),
        "programs": programs(),
        "rendering": rendering(),
        "processors": processors(),
        "blas": blas(),
        "compiled_cache": compiled_cache(),
    }
    return found | {"missing": missing(found), "slow": slow(found), "unsafe": unsafe(found)}


def missing(found: dict[str, Any]) -> list[str]:
    """What is not there, and what does not work without it."""
    said = []
    for group, names in found["packages"].items():
        absent = [name for name, version in names.items() if version is None]
        if absent and group == "required":
            said.append(f"{', '.join(absent)}: required; install them with pip install -e .")
        elif absent:
            said.append(f"{', '.join(absent)}: for the extra '{group}'; pip install -e '.[{group}]' brings them")
    said += [f"{name}: {it['used_for']}" for name, it in found["programs"].items() if it["path"] is None]
    if not found["rendering"]["pyvista"]:
        said.append("pyvista: draws solid scenes; pip install -e '.[scenes]' brings it, pictures come without it")
    return said


def unsafe(found: dict[str, Any]) -> list[str]:
    """Where others of this machine could make commands run what they like: numba's cache is code that it loads."""
    folder = found["compiled_cache"].get("open_to_others")
    if folder is None:
        return []
    return [f"{folder} holds compiled code and may be written by others; take that right away (chmod go-w)"]


def slow(found: dict[str, Any]) -> list[str]:
    """What costs time here, why, and the way out."""
    said = []
    cache, threads, cores = found["compiled_cache"], found["blas"]["pools"], found["processors"]
    if not cache["writable"] and not found["blas"]["variables"].get("NUMBA_CACHE_DIR"):
        said.append(
            "the package's folder cannot be written, so every process compiles its kernels anew (up to minutes); set "
            "NUMBA_CACHE_DIR to a folder that can"
        )
    elif cache["functions"] < KERNELS:
        said.append(
            f"the cache holds {cache['functions']} compiled functions of the present sources: the first run of each "
            "command compiles its kernels (up to minutes), later ones do not"
        )
    if cache["stale_functions"]:
        said.append(
            f"{cache['stale_functions']} compiled functions of former sources take room in the cache and no time; "
            "remove the folders __pycache__ to be rid of them"
        )
    many = [pool for pool in threads if pool["threads"] > 1]
    if many:
        said.append(
            f"{many[0]['library']} uses {many[0]['threads']} threads a process, which small problems pay for; the "
            "command line sets one unless told otherwise: unset OMP_NUM_THREADS and its like, or set them to 1"
        )
    if found["packages"].get("required", {}).get("qdldl", "") is None:
        said.append("qdldl is missing: field solutions use SciPy's SuperLU, which is slower")
    if cores["usable"] == 1:
        said.append("one processor may be used: tables and studies solve their rows one after the other")
    elif cores["usable"] < (cores["all"] or 1):
        said.append(f"{cores['usable']} of {cores['all']} processors may be used; sweeps start as many processes")
    if cores["load_per_processor"] is not None and cores["load_per_processor"] > BUSY:
        said.append(f"the machine is busy: {cores['load_per_processor']:.1f} processes wait for each processor")
    return said


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
_EXTRA = re.compile(r"extra\s*==\s*['\"]([\w-]+)['\"]")


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
        "open_to_others": next((str(folder) for folder in folders if _open_to_others(folder)), None),
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


def _open_to_others(folder: Path) -> bool:
    """Whether the folder's group or everyone may write into it; never on Windows, whose rights lie elsewhere."""
    return os.name == "posix" and bool(folder.stat().st_mode & (stat.S_IWGRP | stat.S_IWOTH))


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
