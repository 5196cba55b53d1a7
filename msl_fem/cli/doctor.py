"""The command `doctor`: what is installed, what is missing, what is slow and why."""

from typing import Any

import typer

from msl_fem.cli import installation
from msl_fem.cli.options import Json
from msl_fem.cli.output import print_result

KERNELS = 40
"""Compiled functions below which the cache is not that of a machine on which everything ran once."""
BUSY = 1.5


def command(json: Json = False) -> None:
    """What is installed, with versions; what is missing; what is slow, why, and the way out."""
    found = examine()
    if json:
        print_result(found, as_json=True, title="")
        return
    print_result(summary(found), as_json=False, title=f"msl-fem {found['msl_fem']}")
    for name in ("missing", "slow"):
        for sentence in found[name] or ["nothing"]:
            typer.echo(f"{name}: {sentence}")


def summary(found: dict[str, Any]) -> dict[str, str]:
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


def examine() -> dict[str, Any]:
    """All that is known of this installation, and `missing` and `slow` as sentences."""
    found: dict[str, Any] = {
        "msl_fem": installation.installed_version("msl-fem"),
        "python": installation.python_itself(),
        "packages": installation.packages(),
        "programs": installation.programs(),
        "rendering": installation.rendering(),
        "processors": installation.processors(),
        "blas": installation.blas(),
        "compiled_cache": installation.compiled_cache(),
    }
    return found | {"missing": missing(found), "slow": slow(found)}


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
