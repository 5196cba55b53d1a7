"""What commands print: one JSON object or a table on stdout, progress and errors on stderr, and the exit status."""

import atexit
import contextlib
import errno
import io
import json
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from rich.console import Console
from rich.table import Table

from msl_fem.cli.readable import readable_name, readable_number
from msl_fem.errors import ComputationError, CostWarning, FolderWarning, InputError
from msl_fem.files.numbers import json_value
from msl_fem.files.whole_file import NO_ROOM, whole_file

ERRORS = Console(stderr=True, highlight=False, soft_wrap=True)
COMPUTATION_FAILED, INPUT_WRONG, INTERRUPTED = 1, 2, 130
LONGEST = 1200  # characters of an error's line
_ONCE_MORE = 0.05  # s
INTERRUPTED_LINE = (
    "interrupted: files are whole; the same command again goes on (table, map, tolerances, study, diagnose, calibrate: "
    "with --resume)"
)


def print_result(result: Mapping[str, Any], *, as_json: bool, title: str) -> None:
    """One JSON object on stdout, or a table of its fields for people, in words and units that are read."""
    if as_json:
        print_line(json.dumps(json_value(result), allow_nan=False))
        return
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)  # a name is searched for: whole, however narrow the window
    table.add_column(overflow="fold")
    told: set[str] = set()
    for key, value in _rows(json_value(result)):
        name = readable_name(key)
        table.add_row(f"{name}, at" if name in told else name, value)  # peak_dB, then peak_Hz
        told.add(name)
    _print_table(title, table)


def print_columns(columns: Mapping[str, list[str]], *, title: str) -> None:
    """A table for people, by columns of texts."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in columns:
        table.add_column(name, justify="right")
    for row in zip(*columns.values(), strict=True):
        table.add_row(*row)
    _print_table(title, table)


def _print_table(title: str, table: Table) -> None:
    """Title and table on stdout; a name in brackets is a name, no markup."""
    there, text = Console(), io.StringIO()
    console = Console(
        file=text, width=there.width, force_terminal=there.is_terminal, highlight=False, markup=False, emoji=False
    )
    console.print(title, style="italic", soft_wrap=True)
    console.print(table)
    _write(text.getvalue())


def print_closing(lines: Sequence[str], *, as_json: bool) -> None:
    """What a result means and what to do next, below its table; nothing beside JSON."""
    if not as_json:
        _write("\n" + "".join(f"{line}\n" for line in lines))


def print_line(text: str) -> None:
    """A line on stdout."""
    _write(text + "\n")


def _write(text: str) -> None:
    """A text on stdout, out at once, so that what cannot be written is known here.

    Raises
    ------
    ComputationError : stdout is closed, or a full disk
    BrokenPipeError : who read it has gone
    """
    if sys.stdout is None:  # closed by the shell: >&-
        raise ComputationError("standard output is closed, so the result cannot be printed; files are written")
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as err:
        raise ComputationError(
            f"standard output cannot be written ({err.strerror}); make room where it leads to; files are written"
        ) from err


def bear_any_output() -> None:
    """Texts of any characters go to any terminal; files never take the place of a closed standard stream.

    Where the encoding of a stream lacks a character, it is written as an escape. A stream that the shell closed leaves
    its number free for the next file opened, into which libraries would then print: it becomes /dev/null.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def drop_unwritten() -> None:
    """What stdout could not take is given up, or the interpreter would complain once more when it ends."""
    with contextlib.suppress(Exception):
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.stdout.flush()


def leave_interrupted() -> NoReturn:
    """The end of the process, with its status.

    Python itself would die by SIGINT where Ctrl-C fell into an `exec`, as of a library that is loaded, though it was
    answered; and threads of libraries may wait for what was interrupted.
    """
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()
    os._exit(INTERRUPTED)


def _rows(result: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in result.items():
        if isinstance(value, Mapping):
            yield from _rows(value, f"{prefix}{name}.")
        elif isinstance(value, list) and any(isinstance(element, Mapping) for element in value):
            for n, element in enumerate(value):
                inner = dict(element) if isinstance(element, Mapping) else {"": element}
                yield from _rows(inner, f"{prefix}{name}.{inner.pop('name', n)}.")
        elif isinstance(value, list) and not value:
            yield prefix + name, "-"
        elif isinstance(value, list) and len(value) > 8:
            yield (
                prefix + name,
                f"{_text(value[0], prefix + name)} ... {_text(value[-1], prefix + name)} ({len(value)} values)",
            )
        elif isinstance(value, list):
            yield prefix + name, ", ".join(_text(each, prefix + name) for each in value)
        else:
            yield prefix + name, _text(value, prefix + name)


def _text(value: Any, path: str) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return readable_number(value, path) if isinstance(value, float) else str(value)


@contextlib.contextmanager
def progress_bar(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on stderr that counts finished work and estimates the rest; the block calls it with (finished, all)."""
    from rich import progress as rich

    columns = (
        rich.TextColumn("{task.description}"),
        rich.BarColumn(),
        rich.MofNCompleteColumn(),
        rich.TimeElapsedColumn(),
        rich.TimeRemainingColumn(),
    )
    progress = rich.Progress(*columns, console=ERRORS)
    task = progress.add_task(what, total=None)

    def tell(done: int, total: int) -> None:
        progress.start()  # not before: what fails at once leaves one line, no empty bar above it
        progress.update(task, completed=done, total=total)

    try:
        yield tell
    finally:
        if progress.live.is_started:
            progress.stop()


@contextlib.contextmanager
def stages_bar() -> Iterator[Callable[[str, int, int], None]]:
    """A bar on stderr for each stage; the block calls it with (stage, finished, all)."""
    from rich import progress as rich

    text = rich.TextColumn("{task.description:16}")
    columns = (text, rich.BarColumn(), rich.MofNCompleteColumn(), rich.TimeElapsedColumn())
    with rich.Progress(*columns, console=ERRORS) as progress:
        tasks: dict[str, Any] = {}

        def tell(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=total)
            progress.update(tasks[stage], completed=done, total=total)

        yield tell


def write_json(content: dict[str, Any], path: Path) -> None:
    """A JSON file, whole or not at all."""
    with whole_file(path) as partial:
        partial.write_text(json.dumps(json_value(content), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def say(text: str) -> None:
    """A line of news on stderr; where that is full or closed, nobody can be told."""
    with contextlib.suppress(OSError):
        ERRORS.print(printable(text), markup=False)


def printable(text: str) -> str:
    """The text with a space for each character that is none to read: files can hold any."""
    return "".join(c if c.isprintable() or c == "\n" else " " for c in text)


def run_guarded(app: Callable[[], None]) -> int:
    """The exit status of a command: 0 done, 1 the computation failed, 2 the input is wrong, 130 interrupted.

    SIGTERM, by which systems and batch queues end jobs, interrupts as Ctrl-C does. So does whatever a library makes of
    Ctrl-C that falls into it.
    """
    interrupts: list[int] = []
    try:
        with _interrupted_into(interrupts), _raised_once_more(interrupts), _warnings_in_a_line():
            app()
    except InputError as err:
        say(f"error: {_one_line(err)}")
        return INPUT_WRONG
    except ComputationError as err:
        say(f"failed: {_one_line(err)}")
        return COMPUTATION_FAILED
    except KeyboardInterrupt:
        say(INTERRUPTED_LINE)
        return INTERRUPTED
    except BrokenPipeError:
        return COMPUTATION_FAILED
    except OSError as err:
        return _system_refused(err)
    except RecursionError:
        say("error: what was given is nested too deeply to be read; write it with fewer levels")
        return INPUT_WRONG
    except MemoryError as err:
        say(f"failed: out of memory ({_one_line(err) or 'no size given'}); ask for less, or use a larger machine")
        return COMPUTATION_FAILED
    except SystemExit as leaving:
        if leaving.code == INTERRUPTED:  # what typer makes of Ctrl-C
            say(INTERRUPTED_LINE)
        return leaving.code if isinstance(leaving.code, int) else (INPUT_WRONG if leaving.code else 0)
    except Exception:
        if not interrupts:
            raise
        say(INTERRUPTED_LINE)
        return INTERRUPTED
    return 0


@contextlib.contextmanager
def _warnings_in_a_line() -> Iterator[None]:
    """Warnings as a line of news each, without the source line that Python would add."""
    with warnings.catch_warnings():

        def show(message: Warning | str, category: type[Warning], *where: Any, **further: Any) -> None:
            kind = "note" if issubclass(category, FolderWarning) else "warning"
            said = "" if issubclass(category, CostWarning | FolderWarning) else f"{category.__name__}: "
            say(f"{kind}: {said}{_one_line(message)}")

        warnings.showwarning = show
        yield


@contextlib.contextmanager
def _interrupted_into(interrupts: list[int]) -> Iterator[None]:
    """SIGTERM and Ctrl-C raise KeyboardInterrupt and are noted; where Ctrl-C is ignored, it stays so."""
    if threading.current_thread() is not threading.main_thread():  # only that one may set handlers
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupts.append(number)
        raise KeyboardInterrupt

    heard = [signal.SIGTERM]
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        heard.append(signal.SIGINT)
    before = {number: signal.signal(number, interrupt) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)


@contextlib.contextmanager
def _raised_once_more(interrupts: list[int]) -> Iterator[None]:
    """An interrupt that fell into a finaliser, which no exception leaves, comes again when that has ended."""
    over, told = threading.Event(), sys.unraisablehook

    def again() -> None:
        if not over.is_set():
            signal.raise_signal(signal.Signals(interrupts[-1]))

    def swallowed(what: Any) -> None:
        if not (interrupts and what.exc_type is KeyboardInterrupt):
            told(what)
        elif not over.is_set():
            later = threading.Timer(_ONCE_MORE, again)
            later.daemon = True
            later.start()

    sys.unraisablehook = swallowed
    try:
        yield
    finally:
        over.set()
        sys.unraisablehook = told


def _system_refused(err: OSError) -> int:
    """The exit status of what the operating system refused, after a line about it."""
    what = f"{err.filename or 'a file'}: {err.strerror or err}"
    if err.errno in NO_ROOM:
        say(f"failed: {_one_line(what)}; make room on that disk, or write elsewhere")
        return COMPUTATION_FAILED
    way_out = {errno.ENAMETOOLONG: "; choose a shorter name", errno.EMFILE: "; allow more open files (ulimit -n)"}
    say(f"error: {_one_line(what)}{way_out.get(err.errno or 0, '')}")
    return INPUT_WRONG


def _one_line(err: Exception | str) -> str:
    """The message without line breaks; of a text given that is far too long, its middle is left out."""
    said = printable(" ".join(str(err).split()))
    return said if len(said) <= LONGEST else f"{said[: LONGEST // 2]} ... {said[-LONGEST // 2 :]}"
