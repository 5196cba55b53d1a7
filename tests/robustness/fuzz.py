"""Bad files against everything that reads files: no traceback, no half-written output, nothing run, nothing outside.

    python tests/robustness/fuzz.py --inputs 10000 --seed 1 --kept fuzz.jsonl

prints how each input ended; with --kept it goes on where an earlier call stopped. An input is judged in a child
process, through the same guard as a command's: what gets past it would be a traceback. Each must end with one line or
none; after a failure nothing may be left in the output folder; nothing else may change on disk; no library may warn;
nothing may take longer than half a minute or more than 4 GB.
"""

import argparse
import contextlib
import io
import json
import logging
import os
import re
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from hostile_values import CANARY
from later_targets import LATER_TARGETS
from record_targets import RECORD_TARGETS
from targets import TARGETS as FIRST_TARGETS
from targets import Target

from msl_fem.cli import output
from msl_fem.cli.output import run_guarded

TARGETS = (*FIRST_TARGETS, *LATER_TARGETS, *RECORD_TARGETS)
LONGEST = 30.0  # seconds of CPU time that an input may take
SILENT = 900.0  # seconds after which a process that says nothing is taken for hung, on a busy machine too
MEMORY = 4 * 2**30  # bytes of address space: a file that asks for more must be refused


_RAW_WARNING = re.compile(r"(warning: \w*Warning: |.*\.py:\d+: \w*Warning)")


@dataclass
class Verdict:
    """What came of the inputs of one target: how they ended, and what was wrong, with the seed that makes it again."""

    ends: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    slowest: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """What is kept of it."""
        return {"ends": self.ends, "wrong": self.wrong, "slowest": round(self.slowest, 3)}

    def add(self, other: "Verdict") -> None:
        """Takes another verdict into this one."""
        self.ends += other.ends
        self.wrong += other.wrong
        self.slowest = max(self.slowest, other.slowest)


def judge(target: Target, seed: int, root: Path, verdict: Verdict) -> None:
    """One input of a target, by its seed, judged."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory(dir=root) as place:
        inside, out, here = (Path(place, name) for name in ("in", "out", "here"))
        for folder in (inside, out, here):
            folder.mkdir()
        spoilt = target.prepare(inside)
        spoilt.write_bytes(target.spoil(rng, spoilt.read_bytes(), here))
        before = _files(inside)
        start = time.process_time()
        status, said = _run(target, inside, out, here)
        verdict.slowest = time.process_time() - start
        found = _complaints(status, said, out)
        if verdict.slowest > LONGEST:
            found.append(f"took {verdict.slowest:.0f} s")
        if _files(here) or _files(inside) != before:
            found.append("changed files that are not its own")
        if list(root.rglob(CANARY)):
            found.append("ran something")
        if {path.name for path in root.iterdir()} != {Path(place).name}:
            found.append("wrote outside its folder")
    verdict.ends[str(status)] += 1
    verdict.wrong += [f"{target.name}, seed {seed}: {one}" for one in found]


def _run(target: Target, inside: Path, out: Path, here: Path) -> tuple[int | str, str]:
    """(exit status, or the last lines of a traceback; what was said on stderr), in a working folder of its own."""
    errors, printed = io.StringIO(), io.StringIO()
    output.ERRORS.file = errors
    logged = logging.StreamHandler(errors)
    logged.setFormatter(logging.Formatter("warning: LoggedWarning: %(name)s: %(message)s"))
    logging.getLogger().addHandler(logged)
    came_from = Path.cwd()
    try:
        os.chdir(here)
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(errors), warnings.catch_warnings():
            warnings.simplefilter("always")
            status: int | str = run_guarded(lambda: target.use(inside, out))
    except Exception as err:
        frames = traceback.extract_tb(err.__traceback__)
        where = " < ".join(f"{Path(f.filename).name}:{f.lineno}" for f in reversed(frames[-4:]))
        status = f"{type(err).__name__}: {str(err)[:120]!r} at {where}"
    finally:
        os.chdir(came_from)
        logging.getLogger().removeHandler(logged)
        output.ERRORS.file = None  # type: ignore[assignment]
    return status, errors.getvalue()


def _complaints(status: int | str, said: str, out: Path) -> list[str]:
    if isinstance(status, str):
        return [status]
    found = []
    lines = [line for line in said.splitlines() if line.startswith(("error:", "failed:"))]
    if status not in (0, 1, 2):
        found.append(f"exit status {status}")
    if status and len(lines) != 1:
        found.append(f"exit status {status} with {len(lines)} lines of error: {said[:200]!r}")
    if any(not line.isprintable() for line in said.splitlines()):
        found.append(f"unprintable characters on stderr: {said[:200]!r}")
    if raw := next((line for line in said.splitlines() if _RAW_WARNING.match(line)), None):
        found.append(f"a raw warning: {raw[:200]}")
    if "Traceback" in said:
        found.append("a traceback on stderr")
    if status and _files(out):
        found.append(f"left {sorted(_files(out))} after a failure")
    if any(".part" in name or Path(name).name.startswith(".") for name in _files(out)):
        found.append(f"left a part: {sorted(_files(out))}")
    return found


def _files(folder: Path) -> dict[str, int]:
    return {str(path.relative_to(folder)): path.stat().st_size for path in folder.rglob("*") if path.is_file()}


def fuzz(n: int, *, seed: int, names: list[str] | None = None, root: Path) -> dict[str, Verdict]:
    """Target to verdict, of n inputs shared among the targets, in this process."""
    verdicts: dict[str, Verdict] = {}
    for name, verdict in judgements(n, seed=seed, names=names, root=root):
        verdicts.setdefault(name, Verdict()).add(verdict)
    return verdicts


def judgements(
    n: int, *, seed: int, names: list[str] | None, root: Path, first: int = 0
) -> Iterator[tuple[str, Verdict]]:
    """(target, verdict) of each input from the first to the n-th."""
    chosen = [target for target in TARGETS if not names or target.name in names]
    for k in range(first, n):
        target, verdict = chosen[k % len(chosen)], Verdict()
        judge(target, seed * 1_000_003 + k, root, verdict)
        yield target.name, verdict


def warm_up(names: list[str] | None, root: Path) -> None:
    """Good files once, unjudged: what is compiled on first use is no time that an input takes."""
    for target in TARGETS:
        if not names or target.name in names:
            good = Target(target.name, target.prepare, lambda rng, content, scratch: content, target.use)
            judge(good, 0, root, Verdict())


class Tally:
    """Verdicts by target, those of an earlier call included; each input's is appended to a file as it comes."""

    def __init__(self, kept: Path | None) -> None:
        self.verdicts: dict[str, Verdict] = {}
        self.done = 0
        self._kept: Path | None = None
        for line in kept.read_text().splitlines() if kept is not None and kept.is_file() else []:
            told = json.loads(line)
            self.add(told["target"], Verdict(Counter(told["ends"]), told["wrong"], told["slowest"]))
        self._kept = kept

    def add(self, name: str, verdict: Verdict) -> None:
        """One more input."""
        self.verdicts.setdefault(name, Verdict()).add(verdict)
        self.done += 1
        if self._kept is not None:
            with self._kept.open("a") as stream:
                stream.write(json.dumps({"target": name, **verdict.to_json()}) + "\n")


def _child(pipe: Any, n: int, seed: int, names: list[str] | None, first: int) -> None:
    """Judges inputs and tells the parent of each, until an input kills it."""
    with tempfile.TemporaryDirectory() as folder:
        warm_up(names, Path(folder))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        for told in judgements(n, seed=seed, names=names, root=Path(folder), first=first):
            pipe.send(told)


def fuzz_in_children(n: int, *, seed: int, names: list[str] | None, tally: Tally) -> None:
    """As `fuzz`, in a process of its own: an input that hangs or kills it is one more that went wrong."""
    context = get_context("spawn")
    chosen = [target.name for target in TARGETS if not names or target.name in names]
    while tally.done < n:
        ours, theirs = context.Pipe(duplex=False)
        child = context.Process(target=_child, args=(theirs, n, seed, names, tally.done), daemon=True)
        child.start()
        theirs.close()
        try:
            _listen(ours, n, tally)
        except KeyboardInterrupt:  # what was judged so far counts
            child.kill()
            break
        if tally.done < n:
            name = chosen[tally.done % len(chosen)]
            child.join(1)
            how = "went on for ever" if child.is_alive() else f"killed the process ({child.exitcode})"
            said = f"{name}, seed {seed * 1_000_003 + tally.done}: {how}"
            tally.add(name, Verdict(Counter([how]), [said]))
        child.kill()
        child.join()


def _listen(pipe: Any, n: int, tally: Tally) -> None:
    """Takes verdicts from a child until it is done, is silent or is gone."""
    with contextlib.suppress(EOFError):
        while tally.done < n and pipe.poll(SILENT):
            name, verdict = pipe.recv()
            tally.add(name, verdict)
            for one in verdict.wrong:
                print(one, file=sys.stderr, flush=True)


def print_table(verdicts: dict[str, Verdict]) -> None:
    """How the inputs of each target ended."""
    print("| what is read | inputs | accepted | refused (2) | failed (1) | wrong | slowest, CPU s |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for name, v in verdicts.items():
        cells = (sum(v.ends.values()), v.ends["0"], v.ends["2"], v.ends["1"], len(v.wrong), f"{v.slowest:.2f}")
        print(f"| {name} | {' | '.join(map(str, cells))} |")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--target", action="append", help="one target by its name; repeatable")
    parser.add_argument("--kept", type=Path, help="a file with a line for each input judged; a next call goes on")
    wanted = parser.parse_args()
    start = time.perf_counter()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends with the counts so far, as Ctrl-C does
    tally = Tally(wanted.kept)
    before = tally.done
    fuzz_in_children(wanted.inputs, seed=wanted.seed, names=wanted.target, tally=tally)
    print_table(tally.verdicts)
    wrong = [one for v in tally.verdicts.values() for one in v.wrong]
    now = f"{tally.done - before} of them in {time.perf_counter() - start:.0f} s"
    print(f"\n{tally.done} inputs, seed {wanted.seed}, {now}: {len(wrong)} wrong")
    for one in wrong[:200]:
        print(one)
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
