"""Files that appear whole or not at all."""

import contextlib
import errno
import os
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path

from msl_fem.errors import ComputationError, InputError

NO_ROOM = {errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO}
"""Numbers of the system's errors where a disk takes no more."""


def cannot_be_written(
    target: Path, err: OSError, way_out: str, *, error: type[InputError] = InputError
) -> InputError | ComputationError:
    """What to raise where the system refuses to write: a full disk is no wrong input; then the folder is named."""
    if err.errno in NO_ROOM:
        return ComputationError(
            f"{target}: cannot be written ({err.strerror}); make room in {target.absolute().parent} or choose another "
            "folder"
        )
    return error(f"{target}: cannot be written ({err.strerror}); {way_out}")


def check_target(target: Path, *, apart_from: Collection[Path] = ()) -> None:
    """InputError, before the work begins, where `whole_file` cannot put a file or would replace one `apart_from`."""
    _refuse_what_is_no_file(target)
    if target.exists() and any(source.exists() and target.samefile(source) for source in apart_from):
        raise InputError(f"{target}: is what the command reads, and would be replaced; choose another name")
    nearest = next(parent for parent in target.absolute().parents if parent.exists())
    try:
        with tempfile.TemporaryFile(dir=nearest):
            return
    except OSError as err:
        raise cannot_be_written(target, err, "choose another folder") from err


def _refuse_what_is_no_file(target: Path) -> None:
    """InputError where a folder or a device stands: a file would take the place of /dev/null itself."""
    if target.is_dir():
        raise InputError(f"{target}: cannot be written (Is a directory); choose another name")
    if target.exists() and not target.is_file():
        raise InputError(f"{target}: cannot be written (a device or a pipe, no file); choose another name")


@contextlib.contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """A temporary path beside `target` that takes its place when the block ends well, and vanishes otherwise.

    Raises
    ------
    InputError : the folder cannot be written, or the target is a folder or a device
    ComputationError : the disk is full
    """
    _refuse_what_is_no_file(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".part")
    except OSError as err:
        raise cannot_be_written(target, err, "choose another folder") from err
    os.close(handle)
    partial = Path(name)
    try:
        yield partial
        partial.chmod(0o644)
        try:
            os.replace(partial, target)
        except OSError as err:
            raise cannot_be_written(target, err, "choose another name") from err
    except OSError as err:
        if err.errno not in NO_ROOM | {errno.EROFS}:
            raise
        raise cannot_be_written(target, err, "choose another folder") from err
    finally:
        partial.unlink(missing_ok=True)
