"""One run at a time on one output: the second is refused at once, and a killed one stops nobody."""

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

from msl_fem.errors import InputError
from msl_fem.files import sole_run as module
from msl_fem.files.sole_run import sole_run
from msl_fem.record import load_record

SERVO, TABLE = str(ROOT / "geometries" / "fast_tool_servo.toml"), str(ROOT / "lookup_tables" / "fast_tool_servo.nc")
EMPS = str(ROOT / "measurements" / "emps")
SINE = "sine:channel=1,frequency=20 Hz,bias=0.3 A,amplitude=0.1 A,duration=0.6 s"
HOLDER = """
import sys
from pathlib import Path
from msl_fem.files.sole_run import sole_run
with sole_run(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""
COMMANDS = {
    "study": ("study", SERVO, "-o", "OUT"),
    "diagnose": ("diagnose", EMPS, "-o", "OUT"),
    "compare": ("compare", EMPS, "-o", "OUT"),
    "simulate": ("simulate", SERVO, "--table", TABLE, "--excitation", SINE, "-o", "OUT"),
    "control": ("control", SERVO, "--table", TABLE, "-o", "OUT"),
    "bench": ("bench", SERVO, "--table", TABLE, "--seed", "1", "-o", "OUT"),
    "import": ("import", "LOG", "--columns", "position_m=x:unit=m,force_N=f:unit=N", "--rate", "1 kHz", "--actuator",
               SERVO, "-o", "OUT"),
}  # fmt: skip


def holder(output: Path) -> "subprocess.Popen[str]":
    """Another run on this output, until its input ends."""
    pipe = subprocess.PIPE
    process = subprocess.Popen([sys.executable, "-c", HOLDER, str(output)], stdin=pipe, stdout=pipe, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def refused(output: Path) -> str:
    with pytest.raises(InputError) as caught, sole_run(output):
        pytest.fail("two runs at once")
    return str(caught.value)


def test_the_second_run_is_told_of_the_first_and_others_go_on(tmp_path: Path) -> None:
    with sole_run(tmp_path / "new" / "out"):
        assert f"out: another run (process {os.getpid()} on " in refused(tmp_path / "new" / "out")
        assert "choose another" in refused(tmp_path / "new" / "out")
        with sole_run(tmp_path / "new" / "other"), sole_run(tmp_path / "out"), sole_run(None):
            pass
        refused(tmp_path / "new" / "out")
    with sole_run(tmp_path / "new" / "out"):
        pass
    assert names(tmp_path / "new") == []


def test_one_folder_under_several_names_is_one_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "out")
    monkeypatch.chdir(tmp_path / "out")
    with sole_run(tmp_path / "out"):
        for same in (Path("."), Path("../out"), tmp_path / "link", tmp_path / "out" / ".." / "out"):
            refused(same)


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_a_run_that_fails_lets_go(tmp_path: Path, error: type[BaseException]) -> None:
    with pytest.raises(error), sole_run(tmp_path / "out"):
        raise error
    assert names(tmp_path) == []


def test_a_killed_run_leaves_a_file_that_stops_nobody(tmp_path: Path) -> None:
    other = holder(tmp_path / "out")
    assert f"process {other.pid} " in refused(tmp_path / "out")
    other.send_signal(signal.SIGKILL)
    other.communicate()
    assert names(tmp_path) == [".out.lock"]
    with sole_run(tmp_path / "out"):
        assert f"process {os.getpid()} " in refused(tmp_path / "out")
    assert names(tmp_path) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_is_refused_before_it_works(command: str, tmp_path: Path, msl_fem) -> None:
    log = tmp_path / "log.csv"
    log.write_text("x,f\n" + "0,1\n" * 50)
    other = holder(tmp_path / "out")
    try:
        words = (word.replace("OUT", str(tmp_path / "out")).replace("LOG", str(log)) for word in COMMANDS[command])
        assert f"another run (process {other.pid} on " in msl_fem(*words).complaint
    finally:
        other.communicate("")
    assert names(tmp_path) == ["log.csv"]


def test_two_commands_at_once_leave_the_record_of_one(tmp_path: Path) -> None:
    """Started together: each is done or refused with one line, and what stands there is whole."""
    command = [sys.executable, "-m", "msl_fem.cli", *COMMANDS["simulate"], "--rate", "2 kHz"]
    command = [word.replace("OUT", str(tmp_path / "out")) for word in command]
    both = [subprocess.Popen([*command, "--seed", s], stderr=subprocess.PIPE, text=True) for s in "12"]
    said = [one.communicate()[1] for one in both]
    assert sorted(one.returncode for one in both) in ([0, 0], [0, 2]), said
    for one, text in zip(both, said, strict=True):
        assert "Traceback" not in text
        assert ("another run" in text) == (one.returncode == 2)
    assert load_record(tmp_path / "out").runs[0].time.size == 1200
    assert names(tmp_path) == ["out"]


def test_never_two_at_once_though_lock_files_come_and_go(tmp_path: Path) -> None:
    """Four processes take and drop the lock as fast as they can; a file that only one may make says if two had it."""
    code = (
        "import os, sys; from pathlib import Path; from msl_fem.files.sole_run import sole_run\n"
        "from msl_fem.errors import InputError\n"
        "out, alone, had = Path(sys.argv[1], 'out'), Path(sys.argv[1], 'alone'), 0\n"
        "while had < 200:\n"
        "    try:\n"
        "        with sole_run(out):\n"
        "            os.close(os.open(alone, os.O_CREAT | os.O_EXCL)); alone.unlink(); had += 1\n"
        "    except InputError as err:\n"
        "        assert 'another run' in str(err), err\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    all_four = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(4)]
    assert [one.communicate()[1] for one in all_four] == [""] * 4
    assert names(tmp_path) == []


def test_a_lock_file_removed_while_waiting_is_no_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between opening and locking, the run that had it ends: what is locked then has no name for a third."""
    first, lock = sole_run(tmp_path / "out"), module._lock
    first.__enter__()

    def just_then(handle: int) -> None:
        monkeypatch.setattr(module, "_lock", lock)
        first.__exit__(None, None, None)
        lock(handle)

    monkeypatch.setattr(module, "_lock", just_then)
    with sole_run(tmp_path / "out"):
        assert names(tmp_path) == [".out.lock"]
        refused(tmp_path / "out")
    assert names(tmp_path) == []


def test_where_the_parent_takes_no_files_the_lock_is_in_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where the folder is a mounted disk."""
    (tmp_path / "out").mkdir()
    opened = os.open

    def closed(file: Path, *more: int, **extra: int) -> int:
        if Path(file).parent == tmp_path:
            raise PermissionError(errno.EACCES, "Permission denied", str(file))
        return opened(file, *more, **extra)

    monkeypatch.setattr(module.os, "open", closed)
    with sole_run(tmp_path / "out"):
        assert names(tmp_path / "out") == [".lock"]
        refused(tmp_path / "out")
    assert names(tmp_path / "out") == []
    with pytest.raises(InputError, match="cannot be written"), sole_run(tmp_path / "not_there"):
        pytest.fail("nobody could write there")


def test_a_file_system_without_locks_stops_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(handle: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(module, "_lock", unknown)
    with sole_run(tmp_path / "out"), sole_run(tmp_path / "out"):
        pass
    assert names(tmp_path) == []


def test_a_link_in_place_of_the_lock_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("years of work")
    (tmp_path / ".out.lock").symlink_to(tmp_path / "precious")
    with pytest.raises(InputError, match="cannot be written"), sole_run(tmp_path / "out"):
        pytest.fail("a link is no lock")
    assert (tmp_path / "precious").read_text() == "years of work"
