"""A log read in a process of its own: a library's native code may end the process that reads a damaged file.

The process answers with a line of JSON, which has names, shapes and units, or what was wrong, and the numbers behind.
"""

import json
import os
import subprocess
import sys
import warnings
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.files.schema import reason
from msl_fem.record.log_limits import not_read

SignalsAndUnits = tuple[dict[str, Array], dict[str, str]]
Reader = Callable[[Path, Collection[str] | None], SignalsAndUnits]
_ANSWER = "from msl_fem.record.log_apart import answer; from {} import {} as read; answer(read)"


def read_apart(reader: Reader, path: Path, only: Collection[str] | None) -> SignalsAndUnits:
    """What a reader, a function of a module, reads of a log.

    Raises
    ------
    RecordError : as the reader; the process ended without an answer
    """
    asked = json.dumps([str(path), None if only is None else sorted(only)])
    code = _ANSWER.format(reader.__module__, reader.__name__)
    found = os.pathsep.join(place for place in sys.path if place)
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, asked], capture_output=True, check=False, stdin=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": found},
    )  # fmt: skip
    head, _, numbers = done.stdout.partition(b"\n")
    try:
        told = json.loads(head)
    except ValueError:
        how = f"a signal {-done.returncode}" if done.returncode < 0 else f"status {done.returncode}"
        raise RecordError(f"{path}: cannot be read (its reader ended by {how}); save it anew as .mat or CSV") from None
    if "error" in told:
        raise RecordError(told["error"])
    signals, at = {}, 0
    for name, shape, taken in told["signals"]:
        if not taken:
            signals[name] = not_read(tuple(shape))
            continue
        count = int(np.prod(shape))
        signals[name] = np.frombuffer(numbers, np.float64, count, at).reshape(shape)
        at += 8 * count
    return signals, told["units"]


def answer(reader: Reader) -> NoReturn:
    """Answers the question in the process's first argument."""
    file, only = json.loads(sys.argv[1])
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    arrays: list[Array] = []
    try:
        with warnings.catch_warnings():
            for doubtful in (UserWarning, RuntimeWarning):
                warnings.simplefilter("error", doubtful)
            signals, units = reader(Path(file), only)
        taken = {one: only is None or any(values.strides) for one, values in signals.items()}
        arrays = [values for one, values in signals.items() if taken[one]]
        told: dict[str, Any] = {"signals": [[n, list(v.shape), taken[n]] for n, v in signals.items()], "units": units}
    except RecordError as err:
        told = {"error": str(err)}
    except Exception as err:  # the readers raise errors of many kinds on a damaged file
        told = {"error": f"{file}: cannot be read ({reason(err)}); save it anew as .mat or CSV"}
    out.write(json.dumps(told).encode() + b"\n")
    for values in arrays:
        out.write(np.ascontiguousarray(values, dtype=np.float64).tobytes())
    out.flush()
    os._exit(0)  # without finalisers, which a damaged file may end too
