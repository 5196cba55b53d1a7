"""Files that appear whole or not at all."""

import contextlib
import errno
import glob
import os
import secrets
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Collection, Iterator
from pathlib import Path

from msl_fem.errors import ComputationError, FolderWarning, InputError

if sys.platform != "win32":
    import fcntl

ASIDE = "old"
"""Name in a staging folder of what is there still and is to be replaced."""
BEGUN = ".new"
"""Ending of a part until it is locked; then it is PART, and without a lock its run is known to have ended."""
PART = ".part"
NEW = 5.0
"""Seconds in which a part is made and locked, whatever else the machine does."""
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


def make_folder(folder: Path) -> None:
    """Makes a folder and those above it where they lack, and says so by a FolderWarning; OSError where it cannot."""
    if not folder.exists():
        folder.mkdir(parents=True, exist_ok=True)
        warnings.warn(f"the folder {folder} was not there and has been made", FolderWarning, stacklevel=3)


@contextlib.contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """A temporary path beside `target` that takes its place when the block ends well, and vanishes otherwise.

    Raises
    ------
    InputError : the folder cannot be written, or the target is a folder or a device
    ComputationError : the disk is full
    """
    _refuse_what_is_no_file(target)
    part = _Part(target)
    try:
        try:
            make_folder(target.parent)
            part.begin_file()
        except OSError as err:
            raise cannot_be_written(target, err, "choose another folder") from err
        _remove_abandoned(target, apart_from=part.path)
        yield part.path
        part.path.chmod(0o644)
        try:
            os.replace(part.path, target)
        except OSError as err:
            raise cannot_be_written(target, err, "choose another name") from err
    except OSError as err:
        if err.errno not in NO_ROOM | {errno.EROFS}:
            raise
        raise cannot_be_written(target, err, "choose another folder") from err
    finally:
        part.end()


@contextlib.contextmanager
def staging_folder(target: Path) -> Iterator[Path]:
    """A new folder beside `target`, for what is moved into place once all of it is written; it vanishes at the end.

    What a killed run leaves of it the next one removes. OSError where the folder cannot be made.
    """
    part = _Part(target)
    try:
        part.begin_folder()
        _remove_abandoned(target, apart_from=part.path)
        yield part.path
    finally:
        part.end()


class _Part:
    """What a file or folder is written as, beside it; locked as long as its run works, where the system has locks.

    It has its name before it is made: an interrupt leaves none, whenever it comes.
    """

    handle: int | None = None

    def __init__(self, target: Path) -> None:
        self.begun = target.parent / f".{target.name}.{secrets.token_hex(4)}{BEGUN}"

    @property
    def path(self) -> Path:
        return self.begun.with_suffix(PART)

    def begin_file(self) -> None:
        self._lock(os.open(self.begun, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600))

    def begin_folder(self) -> None:
        self.begun.mkdir(0o700)
        self._lock(None if sys.platform == "win32" else os.open(self.begun, os.O_RDONLY))

    def _lock(self, handle: int | None) -> None:
        """A part without a lock is never one that works; on Windows an open file could not be renamed."""
        self.handle = handle
        if sys.platform == "win32":
            self._close()
        elif handle is not None:
            _lock(handle)
        self.begun.rename(self.path)

    def end(self) -> None:
        """Takes away what there is of it still."""
        for path in (self.begun, self.path):
            with contextlib.suppress(OSError):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        self._close()

    def __del__(self) -> None:
        if hasattr(self, "begun"):  # an interrupt may have come before it, as into the end
            self.end()

    def _close(self) -> None:
        handle, self.handle = self.handle, None
        if handle is not None:
            os.close(handle)


def _lock(handle: int) -> bool:
    """Whether this process now has the file for itself; False too where a file system or platform has no such locks."""
    if sys.platform == "win32":
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _remove_abandoned(target: Path, *, apart_from: Path) -> None:
    """Removes what killed runs left of a target: parts that no process has locked, and what is begun and not new."""
    name = glob.escape(target.name)
    for part in (*target.parent.glob(f".{name}.*{PART}"), *target.parent.glob(f".{name}.*{BEGUN}")):
        with contextlib.suppress(OSError):  # another process removed it, or may alone
            known = part.is_dir() or part.is_file()
            new = part.suffix == BEGUN and time.time() - part.stat().st_mtime < NEW
            if part == apart_from or not known or new:
                continue
            access = os.O_RDONLY if part.is_dir() else os.O_RDWR
            handle = os.open(part, access | getattr(os, "O_NOFOLLOW", 0))
            try:
                if _lock(handle):
                    _remove(part)
            finally:
                os.close(handle)


def _remove(part: Path) -> None:
    """Removes a part; not a folder that keeps what its run had set aside and could not put back."""
    if not part.is_dir():
        part.unlink()
    elif not (part / ASIDE).exists():
        shutil.rmtree(part)
