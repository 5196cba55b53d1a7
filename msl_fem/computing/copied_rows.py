"""One array into another, for compiled functions.

Numba takes a second to compile `target[:] = source`, most of it for the words of the error where shapes differ.
"""

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled


@compiled
def copy_into(target: Array, source: Array) -> None:
    """Sets the numbers of a target (n,) to those of a source, which has as many."""
    for n in range(target.size):
        target[n] = source[n]
