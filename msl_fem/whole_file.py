"""Files that appear whole or not at all."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from msl_fem.errors import InputError


def check_target(target: Path) -> None:
    """InputError, before the work begins, where `whole_file` could not put a file."""
    if target.is_dir():
        raise InputError(f"{target}: cannot be written (Is a directory); choose another name")
    nearest = next(parent for parent in target.absolute().parents if parent.exists())
    try:
        with tempfile.TemporaryFile(dir=nearest):
            return
    except OSError as err:
        raise InputError(f"{target}: cannot be written ({err.strerror}); choose another folder") from err


@contextlib.contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """A temporary path beside `target` that takes its place when the block ends well, and vanishes otherwise.

    Raises
    ------
    InputError : the folder cannot be written, or the target is a folder
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".part")
    except OSError as err:
        raise InputError(f"{target}: cannot be written ({err.strerror}); choose another folder") from err
    os.close(handle)
    partial = Path(name)
    try:
        yield partial
        partial.chmod(0o644)
        try:
            os.replace(partial, target)
        except OSError as err:
            raise InputError(f"{target}: cannot be written ({err.strerror}); choose another name") from err
    finally:
        partial.unlink(missing_ok=True)
