"""A small share of the fuzzing (fuzz.py runs any number), and the judge itself judged."""

from pathlib import Path

import fuzz as fuzzing
import numpy as np
import pytest
from fuzz import TARGETS, Verdict, fuzz, judge
from hostile_values import CANARY
from targets import SERVO, Target, _one_file, _toml

from msl_fem.errors import InputError

SHARE = len(TARGETS)


def keep(rng: np.random.Generator, good: bytes, scratch: Path) -> bytes:
    return good


@pytest.mark.parametrize("target", TARGETS, ids=[target.name for target in TARGETS])
def test_the_good_files_are_good(target: Target, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzzing, "LONGEST", np.inf)  # on a fresh machine compiling takes longer than an input may
    verdict = Verdict()
    judge(Target(target.name, target.prepare, keep, target.use), 0, tmp_path, verdict)
    assert verdict.wrong == []
    assert verdict.ends == {"0": 1}


@pytest.mark.parametrize("seed", [11, 12])
def test_bad_files_end_in_one_line(seed: int, tmp_path: Path) -> None:
    verdicts = fuzz(SHARE, seed=seed, root=tmp_path)
    assert [one for v in verdicts.values() for one in v.wrong] == []
    assert sum(v.ends["2"] for v in verdicts.values()) > SHARE // 3
    assert sum(v.ends["0"] for v in verdicts.values()) > 0


def misbehave(folder: Path, out: Path) -> None:
    raise KeyError("a bug")


def leave_half(folder: Path, out: Path) -> None:
    (out / "half.csv").write_text("half")
    raise InputError("refused")


def write_elsewhere(folder: Path, out: Path) -> None:
    (out.parent.parent / "elsewhere.txt").write_text("x")


def run_something(folder: Path, out: Path) -> None:
    (out / CANARY).write_text("x")


def write_here(folder: Path, out: Path) -> None:
    Path("here.txt").write_text("x")


def spoil_the_input(folder: Path, out: Path) -> None:
    (folder / "a.toml").write_text("x")


@pytest.mark.parametrize(
    ("use", "said"),
    [
        (misbehave, "KeyError"),
        (leave_half, "after a failure"),
        (write_elsewhere, "wrote outside its folder"),
        (run_something, "ran something"),
        (write_here, "changed files that are not its own"),
        (spoil_the_input, "changed files that are not its own"),
    ],
)
def test_the_judge_sees_what_is_wrong(use, said: str, tmp_path: Path) -> None:
    verdict = Verdict()
    judge(Target("bad", _one_file("a.toml", SERVO.read_bytes()), _toml, use), 3, tmp_path, verdict)
    assert any(said in one for one in verdict.wrong)
