"""An FMU's shared library for this machine, compiled where gcc is there."""

import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from msl_fem.errors import ComputationError

FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden")
_LONGEST = 120  # seconds for the compiler


def compile_library(sources: dict[str, bytes], *, compiled: tuple[str, ...], place: str) -> dict[str, bytes]:
    """Path in the archive to library: one entry on 64-bit Linux with gcc, none elsewhere.

    `sources` are file names and contents, of which `compiled` are the compiler's; `place` is the library's path.

    Raises
    ------
    ComputationError : gcc ends with an error
    """
    gcc = shutil.which("gcc")
    if gcc is None or sys.platform != "linux" or platform.machine() not in ("x86_64", "AMD64"):
        return {}
    with tempfile.TemporaryDirectory() as folder:
        for name, text in sources.items():
            Path(folder, name).write_bytes(text)
        library = Path(folder, "library.so")
        try:
            done = subprocess.run(
                [gcc, *FLAGS, "-o", library.name, *compiled, "-lm"],
                cwd=folder, capture_output=True, text=True, check=False, timeout=_LONGEST,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as err:
            raise ComputationError(
                f"gcc could not compile the FMU ({err}); try again, or take gcc off the path"
            ) from err
        if done.returncode != 0:
            raise ComputationError(
                f"gcc could not compile the FMU: {done.stderr.strip()[:400]}; without gcc on the path the FMU is "
                "written with its sources alone"
            )
        return {place: library.read_bytes()}
