"""Copies of frozen objects that keep what has been found of the original, and is the same of them."""

from typing import TypeVar

Copy = TypeVar("Copy")


def knowing(copy: Copy, original: object, *names: str) -> Copy:
    """The copy, with those cached properties of the original that have been computed."""
    vars(copy).update((name, vars(original)[name]) for name in names if name in vars(original))
    return copy
