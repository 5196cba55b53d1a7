"""Threads beside one another: all of them at work, answers in order, errors told and nothing begun behind them."""

from threading import Barrier, get_ident

import pytest

from msl_fem.computing.threads import in_threads


@pytest.mark.parametrize("threads", [1, 2, 3, 9])
def test_answers_stand_in_the_order_of_the_items(threads: int) -> None:
    assert in_threads(lambda n: n**2, range(7), threads) == [n**2 for n in range(7)]
    assert in_threads(lambda n: n**2, [], threads) == []


def test_so_many_are_at_work_at_the_same_time_and_the_one_that_asks_is_among_them() -> None:
    together = Barrier(3, timeout=20)

    def met(_: int) -> int:
        together.wait()
        return get_ident()

    found = in_threads(met, range(3), 3)
    assert len(set(found)) == 3
    assert get_ident() in found


@pytest.mark.parametrize("threads", [1, 2])
def test_an_error_is_raised_and_what_is_not_begun_is_left(threads: int) -> None:
    begun: list[int] = []
    together = Barrier(threads, timeout=20)

    def fails(n: int) -> None:
        begun.append(n)
        together.wait()
        raise ValueError(f"item {n}")

    with pytest.raises(ValueError, match=r"item [01]"):
        in_threads(fails, range(10), threads)
    assert sorted(begun) == list(range(threads))


def test_threads_may_ask_for_threads() -> None:
    assert in_threads(lambda n: sum(in_threads(lambda m: n * m, range(5), 2)), range(6), 2) == [
        10 * n for n in range(6)
    ]
