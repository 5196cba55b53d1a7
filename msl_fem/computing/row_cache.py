"""A folder of finished rows, under names that tell what they were computed from."""

import contextlib
import hashlib
import json
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.interrupts import interrupts_held_back
from msl_fem.files.whole_file import cannot_be_written, whole_file

Arrays = dict[str, Array]
"""What most solvers answer; `failed`, where it is there, says why it is no answer."""
ABANDONED = 60.0
"""Seconds after which an unfinished file belongs to a process that was killed: a row is written in milliseconds."""


def content_key(content: dict[str, Any]) -> str:
    """A name for a content: equal for equal contents, on every machine."""
    text = json.dumps(content, sort_keys=True, default=repr)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


class RowCache:
    """A folder of rows, one file each; a row appears whole or not at all, and two runs do not disturb each other."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def get(self, key: str) -> Arrays | None:
        """The row stored under a key, marked `reused`; None where there is none or it cannot be read."""
        try:
            # opened here: numpy leaves a damaged file open
            with (self.folder / f"{key}.npz").open("rb") as file, np.load(file, allow_pickle=False) as stored:
                return {name: stored[name] for name in stored.files} | {"reused": np.array(True)}
        except (OSError, ValueError, EOFError, KeyError, NotImplementedError, zipfile.BadZipFile):
            return None

    def put(self, key: str, row: Arrays) -> None:
        """Store a row; raises InputError where the folder cannot be written. An interrupt is answered behind it: an
        archive that is left half open tells so in a traceback."""
        file = self.folder / f"{key}.npz"
        with interrupts_held_back(), whole_file(file) as partial, partial.open("wb") as stream:
            np.savez(stream, **row)  # type: ignore[arg-type]

    def clear(self) -> None:
        """Remove the rows, what a killed process left unfinished, and the folder, if nothing else is in it."""
        for file in self.folder.glob("*.npz"):
            file.unlink(missing_ok=True)
        for file in self.folder.glob(".*.npz.*"):
            with contextlib.suppress(OSError):
                if time.time() - file.stat().st_mtime > ABANDONED:
                    file.unlink()
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def check_writable(self) -> None:
        """InputError, before the work begins, where rows cannot be stored."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as err:
            raise cannot_be_written(self.folder, err, "choose another output") from err
