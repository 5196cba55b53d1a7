"""Parts of files that killed runs left are removed by the next run; those of a run that works are not."""

import os
import subprocess
import sys
import time
from pathlib import Path

from msl_fem.files.whole_file import ASIDE, BEGUN, NEW, staging_folder, whole_file


def made_old(path: Path) -> Path:
    os.utime(path, (time.time() - 2 * NEW,) * 2)
    return path


def left_by_a_killed_run(staging: str, target: Path, *, before: str = "pass") -> Path:
    """The only part beside a target after a run was killed in that function of `whole_file`."""
    code = (
        f"import os, sys; from pathlib import Path; from msl_fem.files.whole_file import {staging}\n"
        f"with {staging}(Path(sys.argv[1])) as part: {before}; os.kill(os.getpid(), 9)"
    )
    assert subprocess.run([sys.executable, "-c", code, str(target)], check=False).returncode == -9
    [left] = target.parent.glob(".*.part")
    return left


def test_what_a_killed_run_left_is_removed(tmp_path: Path) -> None:
    target = tmp_path / "t[1].nc"
    left = left_by_a_killed_run("whole_file", target)
    other = _touched(tmp_path / ".other.nc.abcdefgh.part")
    with whole_file(target) as partial:
        partial.write_text("new")
        assert not left.exists()
    assert other.exists(), "it belongs to another target"
    assert target.read_text() == "new"


def test_what_a_run_has_begun_and_not_locked_is_left_to_it_while_it_is_new(tmp_path: Path) -> None:
    target, begun = tmp_path / "t.nc", _touched(tmp_path / f".t.nc.abcdefgh{BEGUN}")
    with whole_file(target):
        assert begun.exists()
    made_old(begun)
    with whole_file(target):
        assert not begun.exists()


def test_what_a_killed_run_left_of_a_folder_is_removed(tmp_path: Path) -> None:
    """Not while its run works, and not where it keeps what was to be replaced."""
    target = tmp_path / "out"
    left = left_by_a_killed_run("staging_folder", target, before="(part / 'a').touch()")
    kept = tmp_path / ".out.abcdefgh.part"
    (kept / ASIDE).mkdir(parents=True)
    with staging_folder(target) as first:
        assert not left.exists()
        with staging_folder(target) as second:
            assert first.exists()
            assert second.exists()
    assert list(tmp_path.iterdir()) == [kept]


def _touched(path: Path) -> Path:
    path.touch()
    return path


def test_the_part_of_a_run_that_works_stays(tmp_path: Path) -> None:
    target = tmp_path / "t.nc"
    with whole_file(target) as first:
        first.write_text("first")
        with whole_file(target) as second:
            second.write_text("second")
            assert first.exists()
    assert target.read_text() == "first"
    assert [path.name for path in tmp_path.iterdir()] == ["t.nc"]
