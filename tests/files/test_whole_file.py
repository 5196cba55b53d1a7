"""Files that appear whole or not at all."""

import contextlib
import itertools
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from msl_fem.errors import InputError
from msl_fem.files import whole_file as module
from msl_fem.files.whole_file import check_target, staging_folder, whole_file


def test_file_appears_only_when_the_block_ends_well(tmp_path):
    target = tmp_path / "new" / "a.txt"
    with whole_file(target) as partial:
        partial.write_text("content")
        assert not target.exists()
        assert partial.parent == target.parent, "another file system would not let it move at once"
    assert target.read_text() == "content"
    assert [p.name for p in target.parent.iterdir()] == ["a.txt"]


def test_file_is_readable_by_others(tmp_path):
    with whole_file(tmp_path / "a.txt") as partial:
        partial.write_text("content")
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o644


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_failed_block_leaves_nothing_and_touches_nothing(tmp_path, error):
    target = tmp_path / "a.txt"
    target.write_text("old")

    def write() -> None:
        with whole_file(target) as partial:
            partial.write_text("half")
            raise error

    with pytest.raises(error):
        write()
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def interrupted_at_line(count: int) -> Callable[[FrameType, str, object], Any]:
    """A tracer that interrupts at the line of that number that is run in the module."""
    lines = itertools.count()

    def trace(frame: FrameType, event: str, _: object) -> Any:
        if frame.f_code.co_filename != module.__file__:
            return None
        if event == "line" and next(lines) == count:
            raise KeyboardInterrupt
        return trace

    return trace


@contextlib.contextmanager
def traced(trace: Callable[[FrameType, str, object], Any]) -> Iterator[None]:
    before = sys.gettrace()
    sys.settrace(trace)
    try:
        yield
    finally:
        sys.settrace(before)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("folder", [False, True])
def test_an_interrupt_at_any_line_leaves_no_part(tmp_path: Path, folder: bool) -> None:
    for count in itertools.count():
        whole = False
        with contextlib.suppress(KeyboardInterrupt), traced(interrupted_at_line(count)):
            if folder:
                with staging_folder(tmp_path / f"{count}.txt") as part:
                    (part / "a").write_text("content")
            else:
                with whole_file(tmp_path / f"{count}.txt") as part:
                    part.write_text("content")
            whole = True
        assert list(tmp_path.glob(".*")) == [], f"at line {count}"
        if whole:
            break
    assert count > 20


def test_two_writers_do_not_share_their_partial_files(tmp_path):
    with whole_file(tmp_path / "a.txt") as one, whole_file(tmp_path / "a.txt") as other:
        assert one != other
        one.write_text("one")
        other.write_text("other")
    assert (tmp_path / "a.txt").read_text() == "one", "the last to end wins, whole"


def test_folder_that_cannot_hold_it_is_an_input_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="another folder"), whole_file(tmp_path / "file" / "a.txt"):
        pytest.fail("the block must not begin")


def test_a_result_never_replaces_what_is_read(tmp_path):
    """By whatever name; the source itself, a link to it, not another file nor one that is not there yet."""
    source = tmp_path / "a.toml"
    source.write_text("a")
    (tmp_path / "link").symlink_to(source)
    for target in (source, tmp_path / "." / "a.toml", tmp_path / "link"):
        with pytest.raises(InputError, match="would be replaced"):
            check_target(target, apart_from=[tmp_path / "none", source])
    (tmp_path / "b.toml").write_text("b")
    check_target(tmp_path / "b.toml", apart_from=[source])
    check_target(tmp_path / "c.toml", apart_from=[source, tmp_path / "c.toml"])
    check_target(source)


def test_target_that_is_a_folder_is_an_input_error(tmp_path):
    (tmp_path / "a").mkdir()
    with pytest.raises(InputError, match="another name"), whole_file(tmp_path / "a") as partial:
        partial.write_text("content")
    assert [p.name for p in tmp_path.iterdir()] == ["a"]
