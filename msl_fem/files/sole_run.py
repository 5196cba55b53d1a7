"""One run at a time on one output: two would leave a mixture of their files."""

import contextlib
import errno
import os
import platform
import sys
from collections.abc import Iterator
from pathlib import Path

from msl_fem.errors import InputError
from msl_fem.files.whole_file import cannot_be_written, make_folder

if sys.platform == "win32":
    import msvcrt

    def _lock(handle: int) -> None:
        os.lseek(handle, 1 << 20, os.SEEK_SET)  # beyond the text, which others may then read
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


_TAKEN = {errno.EAGAIN, errno.EACCES, errno.EDEADLK}


class _Taken(Exception):  # noqa: N818 - reads as the sentence it stands for
    """Another run has the lock; the message says which one."""


@contextlib.contextmanager
def sole_run(output: Path | None) -> Iterator[None]:
    """Has the output, a file or a folder, for this run alone while the block works; without one there is nothing to do.

    Other runs see it by a locked file `.NAME.lock` beside the output, or `.lock` in the folder where its parent takes
    no files. The lock is the system's and ends with its process, however that ends: a file that a killed run leaves
    stops nobody. Where a file system has no locks, runs are not kept apart.

    Raises
    ------
    InputError : another run works there; no file can be made there
    """
    if output is None:
        yield
        return
    file, handle = _taken(output)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            file.unlink()  # before the lock ends, or it might be that of the next run
        os.close(handle)


def _taken(output: Path) -> tuple[Path, int]:
    """The lock file and its handle."""
    target = Path(os.path.realpath(output))
    try:
        try:
            beside = target.parent / f".{target.name}.lock"
            with contextlib.suppress(FileExistsError):  # a file in its place: opening says so
                make_folder(beside.parent)
            return beside, _locked(beside)
        except OSError:
            if not target.is_dir():
                raise
            return target / ".lock", _locked(target / ".lock")
    except _Taken as other:
        raise InputError(
            f"{output}: another run{other} is working there; wait until it ends, or choose another output with -o"
        ) from None
    except OSError as err:
        raise cannot_be_written(output, err, "choose another folder") from err


def _locked(file: Path) -> int:
    """The handle of the file under this name, locked; _Taken where another run has it."""
    while True:
        handle = _opened(file)
        try:
            _lock(handle)
        except OSError as err:
            if err.errno not in _TAKEN:
                return handle  # no locks here
            who = _text(handle)
            os.close(handle)
            raise _Taken(who) from err
        if _is_still(handle, file):
            _sign(handle)
            return handle
        os.close(handle)  # the run that had it removed it in between


def _opened(file: Path) -> int:
    not_a_link = getattr(os, "O_NOFOLLOW", 0)
    try:
        return os.open(file, os.O_RDWR | os.O_CREAT | not_a_link, 0o644)
    except PermissionError:
        if not file.is_file():
            raise
        return os.open(file, os.O_RDONLY | not_a_link)  # another user's, left by a killed run: enough for a lock


def _is_still(handle: int, file: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), os.lstat(file))
    except FileNotFoundError:
        return False


def _sign(handle: int) -> None:
    """This process as the file's text, for those who come later."""
    with contextlib.suppress(OSError):  # of another user
        os.ftruncate(handle, 0)
        os.lseek(handle, 0, os.SEEK_SET)
        os.write(handle, f"process {os.getpid()} on {platform.node()}".encode())


def _text(handle: int) -> str:
    with contextlib.suppress(OSError):
        os.lseek(handle, 0, os.SEEK_SET)
        text = os.read(handle, 100).decode(errors="replace")
        return f" ({text})" if text else ""
    return ""
