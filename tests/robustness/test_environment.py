"""Poor surroundings, the cheap share of environment.py: each test says what it leaves to the script."""

import resource
from pathlib import Path

import environment
import pytest
from environment import BARE, LOOKUP, SOLVE, many_solves, outcome, run

from msl_fem.errors import RecordError
from msl_fem.record.columns import LARGEST_TEXT, read_columns
from msl_fem.record.log_signals import read_log


def test_neither_home_nor_cache_nor_much_memory_is_needed(tmp_path: Path) -> None:
    """At once: the script tries more commands, and one thing after the other."""
    limits = {resource.RLIMIT_AS: 2 * 2**30, resource.RLIMIT_NOFILE: 256}
    assert outcome(run(SOLVE, tmp_path, limits=limits, environment=BARE)) == "done"


def test_memory_stays_where_it_is(tmp_path: Path) -> None:
    """Ten solves; the script takes 500."""
    many_solves(tmp_path, 10)


def test_memory_that_grows_is_seen(tmp_path: Path, monkeypatch) -> None:
    leaking = environment.SOLVES.replace("    solve(", "    kept.append(bytearray(2_000_000)); (lambda *_, **k: 0)(")
    monkeypatch.setattr(environment, "SOLVES", "kept = []\n" + leaking)
    with pytest.raises(AssertionError, match="MB more of"):
        many_solves(tmp_path, 40)  # which solve nothing


def test_a_run_of_more_text_than_fits_is_refused_unread(tmp_path: Path) -> None:
    run_file = tmp_path / "run.csv"
    with run_file.open("wb") as stream:
        stream.truncate(LARGEST_TEXT + 1)  # no blocks of a disk
    with pytest.raises(RecordError, match="more than 500 MB; write it as NetCDF, or cut it into runs"):
        read_columns(run_file)


def test_a_log_of_a_gigabyte_without_a_line_is_refused_soon(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t,a\n")
    with log.open("r+b") as stream:
        stream.truncate(10**9)
    with pytest.raises(RecordError, match="longer than 1000000 characters"):
        read_log(log, only={"t"})


def test_the_judge_of_an_outcome_sees_what_is_wrong(tmp_path: Path) -> None:
    assert outcome(run(LOOKUP, tmp_path)) == "done"
    with pytest.raises(AssertionError):
        outcome(run(("lookup", "none.nc", "--current", "1 A", "--gap", "1 mm"), tmp_path))
