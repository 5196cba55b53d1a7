"""Threads of this process, for compiled code and large arrays, which run beside one another."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Made = TypeVar("Made")


def in_threads(made: Callable[[Item], Made], items: Sequence[Item], threads: int) -> list[Made]:
    """What is made of each item, so many at the same time."""
    if threads == 1 or len(items) == 1:
        return [made(item) for item in items]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(made, items))
