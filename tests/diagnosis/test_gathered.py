"""Simulations of several fits run together: who waits gets its own rows, and a failure reaches all that wait for it."""

import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from msl_fem.diagnosis.gathered import GatheredRuns, gathered_here, in_gatherings
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.problem import FitProblem, Points
from msl_fem.diagnosis.refinement import AT_ONCE, Refinement
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns

BELIEVED = (("moving_mass", 0.01), ("stiffness", 0.01))
UNKNOWNS = Unknowns(BELIEVED, 0, ())
PROBLEM = cast(FitProblem, object())


def asked(gathered: GatheredRuns, rounds: Sequence[int], effect: str | None, simulated: object) -> list[np.ndarray]:
    """What a fit gets that asks for these numbers of rows one after the other, then ends; rows start at its rounds."""
    effects = (EffectUnknown(effect, "force"),) if effect else ()
    unknowns = Unknowns(BELIEVED, 0, (), effects)
    with gathered.one_of_them():
        found = []
        for n in rounds:
            rows = np.arange(n * unknowns.size, dtype=float).reshape(n, -1) + sum(rounds)
            found.append(gathered.spectra(PROBLEM, Points.of(unknowns, rows), simulated))  # type: ignore[arg-type]
            assert np.array_equal(found[-1][:, :2], rows[:, :2])
        return found


def test_fits_that_ask_for_different_numbers_of_rounds_get_their_own_rows_from_common_runs() -> None:
    calls: list[int] = []

    def simulated(points: Points) -> np.ndarray:
        calls.append(len(points.rows))
        assert points.effects is not None
        assert points.effects.shape[0] == len(points.rows)
        return np.hstack([points.rows, points.effects.sum(axis=1, keepdims=True)])

    fits = [((3, 1, 2), "coulomb_friction"), ((1,), None), ((2, 2), "force_offset")]
    gathered = GatheredRuns(len(fits))
    with ThreadPoolExecutor(len(fits)) as pool:
        jobs = [pool.submit(asked, gathered, *one, simulated) for one in fits]
        ends = [job.result(timeout=30) for job in jobs]
    assert [[len(rows) for rows in end] for end in ends] == [[3, 1, 2], [1], [2, 2]]
    assert calls == [6, 3, 2]
    assert len(set(ends[0][0][:, 2])) == 3  # amounts of an effect reach the runs


@pytest.mark.parametrize("threads", [1, 2])
def test_where_a_fit_ends_one_that_is_behind_takes_its_place(threads: int) -> None:
    """Of five fits two go on at the same time, so that with one thread each round of the longest runs with that of
    another; with two they meet nobody."""
    calls: list[int] = []

    def simulated(points: Points) -> np.ndarray:
        calls.append(len(points.rows))
        time.sleep(0.05)
        return points.rows

    def fit(rounds: int) -> int:
        for _ in range(rounds):
            gathered = gathered_here()
            assert gathered is not None
            gathered.spectra(PROBLEM, Points.of(UNKNOWNS, np.zeros((1, 2))), simulated)
        return rounds

    assert in_gatherings(fit, [1, 4, 1, 1, 1], at_once=2, threads=threads) == [1, 4, 1, 1, 1]
    assert calls == ([2, 2, 2, 2] if threads == 1 else [1] * 8)


def test_fits_meet_in_as_many_places_as_there_are_threads_and_each_is_simulated_by_its_own() -> None:
    places: dict[int, list[int]] = {}

    def fit(item: int) -> None:
        gathered = gathered_here()
        assert gathered is not None
        places.setdefault(id(gathered), []).append(gathered.threads)
        time.sleep(0.01)

    in_gatherings(fit, list(range(8)), at_once=8, threads=2)
    assert sorted(len(every) for every in places.values()) == [4, 4]
    assert {n for every in places.values() for n in every} == {1}
    assert gathered_here() is None


def test_a_place_that_all_have_left_leaves_its_threads_to_another_one() -> None:
    """Of two fits in two places the one that goes on alone is simulated by both threads."""
    other_has_left = threading.Event()
    threads: dict[int, list[int]] = {0: [], 1: []}

    def fit(item: int) -> None:
        gathered = gathered_here()
        assert gathered is not None
        threads[item].append(gathered.threads)
        if item == 0:
            return
        assert other_has_left.wait(30)
        threads[item].append(gathered.threads)

    leaves = GatheredRuns.takes_over

    def noted(self: GatheredRuns, other: GatheredRuns) -> None:
        leaves(self, other)
        other_has_left.set()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(GatheredRuns, "takes_over", noted)
        in_gatherings(fit, [0, 1], at_once=2, threads=2)
    assert threads == {0: [1], 1: [1, 2]}


@pytest.mark.parametrize(("is_cut", "most"), [(True, AT_ONCE), (False, 3 * AT_ONCE)])
def test_candidates_over_stretches_go_on_a_few_at_a_time(is_cut: bool, most: int) -> None:
    """Each holds the slopes of its own starts meanwhile; followed from start to end all go on at once."""
    refinement = object.__new__(Refinement)
    refinement.base = cast(Fit, SimpleNamespace(likelihood=SimpleNamespace(is_cut=is_cut, threads=1)))
    busy, seen, lock = 0, [0], threading.Lock()

    def step(item: int) -> int:
        nonlocal busy
        with lock:
            busy += 1
            seen.append(busy)
        gathered = gathered_here()
        assert gathered is not None
        gathered.spectra(PROBLEM, Points.of(UNKNOWNS, np.zeros((1, 2))), lambda points: points.rows)
        with lock:
            busy -= 1
        return item

    items = list(range(3 * AT_ONCE))
    assert refinement._together(step, items) == items
    assert max(seen) == most


def test_a_failure_reaches_every_fit_that_waits() -> None:
    def failing(points: Points) -> np.ndarray:
        raise FloatingPointError(f"{len(points.rows)} rows")

    gathered = GatheredRuns(2)
    with ThreadPoolExecutor(2) as pool:
        jobs = [pool.submit(asked, gathered, (2,), None, failing) for _ in range(2)]
        for job in jobs:
            with pytest.raises(FloatingPointError, match="4 rows"):
                job.result(timeout=30)


@pytest.mark.parametrize("at_once", [1, 2])
def test_so_many_fits_do_their_own_sums_at_once(at_once: int) -> None:
    gathered = GatheredRuns(6, at_once=at_once)
    busy, most, lock = 0, 0, threading.Lock()

    def summing() -> None:
        nonlocal busy, most
        with lock:
            busy += 1
            most = max(most, busy)
        time.sleep(0.01)
        with lock:
            busy -= 1

    def fit() -> None:
        with gathered.one_of_them():
            for _ in range(3):
                summing()
                gathered.spectra(PROBLEM, Points.of(UNKNOWNS, np.zeros((1, 2))), lambda points: points.rows)

    with ThreadPoolExecutor(6) as pool:
        for job in [pool.submit(fit) for _ in range(6)]:
            job.result(timeout=30)
    assert most == at_once
