"""Threads of this process, for compiled code and large arrays, which run beside one another."""

from collections.abc import Callable, Sequence
from threading import Thread
from typing import TypeVar

Item = TypeVar("Item")
Made = TypeVar("Made")


def in_threads(made: Callable[[Item], Made], items: Sequence[Item], threads: int) -> list[Made]:
    """What is made of each item, so many at the same time, one of them in the thread that asks. Behind an error what is
    not begun is left."""
    found: dict[int, Made] = {}
    errors: list[BaseException] = []
    waiting = iter(range(len(items)))

    def go_on() -> None:
        for n in waiting:
            if errors:
                return
            try:
                found[n] = made(items[n])
            except BaseException as err:  # raised where it is waited for
                errors.append(err)

    others = [Thread(target=go_on) for _ in range(min(threads, len(items)) - 1)]
    for other in others:
        other.start()
    go_on()
    for other in others:
        while other.is_alive():
            try:
                other.join()
            except KeyboardInterrupt as err:  # what is begun ends, as in compiled code
                errors.append(err)
    if errors:
        raise errors[0]
    return [found[n] for n in range(len(items))]
