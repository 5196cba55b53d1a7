"""Full disks, folders that cannot be written, devices, two runs at once: one clear line, nothing half written."""

import contextlib
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from targets import RUN, SERVO, STATIC, TABLE, _record

from msl_fem.errors import InputError
from msl_fem.files.whole_file import check_target, whole_file
from msl_fem.record import load_record
from msl_fem.table.magnetic_table import read_table, write_table

WRITERS = {
    "csv": ("export", str(TABLE), "--to", "csv", "-o", "OUT"),
    "c": ("export", str(TABLE), "--to", "c", "-o", "OUT"),
    "mat": ("export", str(TABLE), "--to", "mat", "-o", "OUT"),
    "modelica": ("export", str(TABLE), "--to", "modelica", "-o", "OUT"),
    "fmu": ("export", str(SERVO), "--table", str(TABLE), "--to", "fmu", "-o", "OUT"),
    "map": ("map", str(TABLE), "-o", "OUT"),
    "record": (
        "simulate", str(SERVO), "--table", str(TABLE), "--rate", "2 kHz", "-o", "OUT", "--excitation",
        "sine:channel=1,frequency=20 Hz,bias=0.3 A,amplitude=0.1 A,duration=0.6 s",
    ),
}  # fmt: skip
RUN_IT = "from msl_fem.cli.__main__ import main; import sys; sys.argv[0] = 'msl-fem'; main()"


def run(words: tuple[str, ...], out: Path, *, room: int | None = None) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own that may write files of at most `room` bytes."""

    def limit() -> None:
        if room is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    return subprocess.run(
        [sys.executable, "-B", "-c", RUN_IT, *(word.replace("OUT", str(out)) for word in words)],
        capture_output=True, text=True, check=False, preexec_fn=limit,
        env=os.environ | {"NUMBA_DISABLE_PERFORMANCE_WARNINGS": "1"},
    )  # fmt: skip


def one_line(done) -> str:
    """The one line of a failure, of a process or of a command run here."""
    status = done.returncode if isinstance(done, subprocess.CompletedProcess) else done.status
    assert status in (1, 2), (status, done.stderr)
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    [line] = [line for line in done.stderr.splitlines() if line.startswith(("error:", "failed:"))]
    return line


@contextlib.contextmanager
def little_room() -> Iterator[None]:
    """Files cannot grow beyond 3 kB, as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (3000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    """The whole process, to its end."""
    assert "File too large" in one_line(run(WRITERS["csv"], tmp_path / "out", room=3000))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["fmu", "record"])
def test_other_writers_on_a_full_disk(tmp_path: Path, kind: str, msl_fem) -> None:
    with little_room():
        done = msl_fem(*(word.replace("OUT", str(tmp_path / "out")) for word in WRITERS[kind]))
    said = one_line(done)
    assert "File too large" in said or "could not compile" in said
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_keeps_the_old_file(tmp_path: Path, msl_fem) -> None:
    (tmp_path / "out").write_text("precious")
    with little_room():
        one_line(msl_fem(*(word.replace("OUT", str(tmp_path / "out")) for word in WRITERS["map"])))
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"out": "precious"}


def test_a_table_on_a_full_disk(tmp_path: Path) -> None:
    """The HDF5 library finds out late, when it closes the file."""
    code = (
        "import resource, sys; from pathlib import Path; from msl_fem.table import read_table, write_table; "
        "from msl_fem.cli.output import run_guarded; table = read_table(sys.argv[1]); "
        "resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000)); "
        "sys.exit(run_guarded(lambda: write_table(table, sys.argv[2])))"
    )
    done = subprocess.run(
        [sys.executable, "-B", "-c", code, str(TABLE), str(tmp_path / "t.nc")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    one_line(done)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", WRITERS)
def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path, kind: str, msl_fem) -> None:
    """/proc takes no files, not even from root."""
    words = [word.replace("OUT", "/proc/none/x") for word in WRITERS[kind]]
    assert "cannot be written" in msl_fem(*words).complaint


@pytest.mark.parametrize("kind", WRITERS)
def test_a_device_is_not_replaced(tmp_path: Path, kind: str, msl_fem) -> None:
    """A file moved to /dev/null would take its place for the whole machine."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    said = msl_fem(*(word.replace("OUT", str(pipe)) for word in WRITERS[kind])).complaint
    assert "no file" in said or "is no folder" in said
    assert pipe.is_fifo()
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]


def test_devices_are_refused_before_the_work_and_when_writing() -> None:
    for check in (check_target, lambda path: whole_file(path).__enter__()):
        with pytest.raises(InputError, match="a device or a pipe, no file"):
            check(Path("/dev/full"))


def test_a_link_is_replaced_and_not_followed(tmp_path: Path) -> None:
    """What a link points to, outside the chosen folder, stays as it is."""
    outside, link = tmp_path / "outside.txt", tmp_path / "chosen" / "link.txt"
    outside.write_text("precious")
    link.parent.mkdir()
    link.symlink_to(outside)
    with whole_file(link) as partial:
        partial.write_text("new")
    assert outside.read_text() == "precious"
    assert link.read_text() == "new"
    assert not link.is_symlink()


def test_two_runs_at_once_on_one_file_leave_it_whole(tmp_path: Path) -> None:
    table, target = read_table(TABLE), tmp_path / "t.nc"
    code = (
        "import sys; from msl_fem.table import read_table, write_table; table = read_table(sys.argv[1])\n"
        "for _ in range(8): write_table(table, sys.argv[2])"
    )
    both = [subprocess.Popen([sys.executable, "-c", code, str(TABLE), str(target)]) for _ in range(2)]
    assert [one.wait() for one in both] == [0, 0]
    assert (read_table(target).nodes["force"] == table.nodes["force"]).all()
    assert [path.name for path in tmp_path.iterdir()] == ["t.nc"]
    assert write_table(table, target) == target


def test_two_runs_at_once_on_one_record_leave_it_whole(tmp_path: Path) -> None:
    """One waits for the other to put its record in place; what stands there in the end is a record."""
    source, target = tmp_path / "source", tmp_path / "out" / "rec"
    source.mkdir()
    target.parent.mkdir()
    _record("rig.toml")(source)
    code = (
        "import sys; from msl_fem.record import load_record, write_record; record = load_record(sys.argv[1])\n"
        "for _ in range(60): write_record(record, sys.argv[2])"
    )
    command = [sys.executable, "-c", code, str(source), str(target)]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    ended = [(*one.communicate(), one.returncode) for one in both]
    assert [code for _, _, code in ended] == [0, 0], [said for _, said, _ in ended]
    assert all(said == "" for _, said, _ in ended)
    assert load_record(target).runs[0].time.size == len(RUN.splitlines()) - 1
    assert len(STATIC.splitlines()) - 1 == load_record(target).static.gap.size
    assert [path.name for path in target.parent.iterdir()] == ["rec"]
