"""Standard output that is closed, full or of another encoding; a disk that is full: one line, status 1."""

import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from targets import LOG, SERVO, TABLE, TYPED_COLUMNS

from msl_fem.cli import import_log
from msl_fem.cli.output import run_guarded
from msl_fem.files.whole_file import check_target, whole_file
from msl_fem.maps import guard, operating_map, write_map
from msl_fem.table import coenergy_surface, read_table

LOOKUP = f"lookup {TABLE} --current '2 A' --gap '0.4 mm'"


def shell(line: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A line of a shell in which `msl-fem` is this one."""
    program = f"{sys.executable} -m msl_fem.cli"
    return subprocess.run(
        ["bash", "-c", line.replace("msl-fem", program)], capture_output=True, text=True, check=False, timeout=120,
        env=os.environ | environment, encoding="utf-8", errors="replace",
    )  # fmt: skip


@pytest.mark.parametrize("option", ["", "--json"])
@pytest.mark.parametrize(("end", "said"), [(">&-", "is closed"), ("> /dev/full", "No space left on device")])
def test_output_that_nobody_takes_is_one_line(end: str, said: str, option: str) -> None:
    done = shell(f"msl-fem {LOOKUP} {option} {end}")
    assert done.returncode == 1
    [line] = done.stderr.splitlines()
    assert line.startswith("failed: standard output")
    assert said in line


def test_all_standard_streams_closed(tmp_path: Path) -> None:
    """A file that the command makes then has the number of standard output, and stays what it should be."""
    target = tmp_path / "t.csv"
    assert shell(f"msl-fem export {TABLE} --to csv -o {target} <&- >&- 2>&-").returncode == 1
    assert target.read_text().startswith("gap_m,")


def test_a_reader_who_goes_is_no_error() -> None:
    done = shell(f"msl-fem {LOOKUP} | head -c 1 | wc -c")
    assert done.stdout.strip() == "1"
    assert "Traceback" not in done.stderr
    assert "Exception" not in done.stderr


def test_an_ascii_terminal_gets_escapes(tmp_path: Path) -> None:
    write_map(operating_map(read_table(TABLE)), tmp_path / "m.json")
    done = shell(
        f"msl-fem guard {tmp_path}/m.json --current '4 A' --gap '0.3 mm'", PYTHONIOENCODING="ascii", LC_ALL="C"
    )
    assert done.returncode == 0, done.stderr
    assert r"\xb5m" in done.stdout
    wrong = shell(f"msl-fem guard {tmp_path}/ü.json --current '4 A' --gap '0.3 mm'", PYTHONIOENCODING="ascii")
    assert wrong.returncode == 2
    assert len(wrong.stderr.splitlines()) == 1


def test_a_full_disk_is_a_failure_that_names_the_folder(tmp_path: Path, capsys) -> None:
    def fill(target: Path) -> None:
        with whole_file(target):
            raise OSError(28, "No space left on device")

    assert run_guarded(lambda: fill(tmp_path / "a.csv")) == 1
    said = capsys.readouterr().err
    assert f"make room in {tmp_path} or choose another folder" in said
    assert list(tmp_path.iterdir()) == []
    assert run_guarded(lambda: check_target(Path("/proc/none/x"))) == 2


def test_an_import_without_room_for_its_picture_is_done(tmp_path: Path, msl_fem, monkeypatch) -> None:
    """The run is in the record then: to say that the import failed would be wrong, and the next try refused."""

    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    log = tmp_path / "log.csv"
    log.write_text(LOG)
    monkeypatch.setattr(import_log, "whole_file", fail)
    words = ("import", str(log), "--columns", TYPED_COLUMNS, "--actuator", str(SERVO), "-o", str(tmp_path / "rec"))
    done = msl_fem(*words, "--json")
    assert done.json["picture"] is None
    assert "note: the run is in the record, its picture is not there" in done.stderr
    assert (tmp_path / "rec" / "log.csv").is_file()


def test_a_warning_of_a_library_is_one_line_without_source(capsys) -> None:
    assert run_guarded(lambda: warnings.warn("odd\n  thing", UserWarning, stacklevel=1)) == 0
    assert capsys.readouterr().err == "warning: UserWarning: odd thing\n"


def test_no_compiled_function_is_given_what_numpy_warns_of(table, monkeypatch):
    """Numba asks a view that `broadcast_arrays` made whether it is writable, and numpy's warning met the user: a row
    of one node at one gap."""

    def look(*arrays):
        for one in arrays:
            getattr(one, "flags", np.zeros(1).flags).writeable  # noqa: B018

    monkeypatch.setattr(coenergy_surface, "evaluate_many", look)
    monkeypatch.setattr(guard, "_regions", look)
    judged = guard.Guard(operating_map(table))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        table.surface(np.array([1.0]), 3e-4)
        judged.regions(np.array([1.0]), 3e-4)
