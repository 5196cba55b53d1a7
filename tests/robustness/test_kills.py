"""A few kills (kills.py does any number), and the judge of what a next run says."""

from pathlib import Path

import pytest
from kills import Tally, finished, kill_often, same
from ready_commands import Command


def test_a_killed_command_leaves_nothing_and_the_next_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A kill -9 and a SIGTERM of a table, at moments drawn over the time that it takes after its imports."""
    monkeypatch.setattr("kills.start", lambda words, folder: Command(list(words), folder))
    total = Tally()
    for one in kill_often("table", 2, 1, tmp_path):
        total.add(one)
    assert total.wrong == []
    assert total.went_on == total.kills == 2
    assert total.lost == total.left_after_next == 0


def test_what_varies_from_run_to_run_is_no_other_result() -> None:
    result = {"points": 9, "cpu_seconds": 1.0, "fields": [{"force_N": 2.0}], "notes": []}
    assert same(result, result | {"cpu_seconds": 7.0, "reused_rows": 3})
    assert not same(result, result | {"fields": [{"force_N": 2.1}]})
    assert not same(result, result | {"points": 8})


def test_finished_work_is_counted(tmp_path: Path) -> None:
    (tmp_path / ".t.nc.rows").mkdir()
    for name in ("a.npz", "b.npz", ".c.npz.x.part"):
        (tmp_path / ".t.nc.rows" / name).write_bytes(b"")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "calibration.jsonl").write_text('{"seed": 0}\n{"seed": 1')
    assert len(finished(tmp_path)) == 3
