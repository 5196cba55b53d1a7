"""Many threads that allocate share a few arenas, told by the C library's own account of them."""

import os
import subprocess
import sys
from ctypes.util import find_library

import pytest

ALLOCATING = """
import ctypes, sys, threading
from msl_fem.computing.malloc import few_arenas
if sys.argv[1] == "few":
    assert few_arenas()
ready = threading.Barrier(17)
def allocate():
    kept = [bytearray(2000) for _ in range(100)]
    ready.wait()
    ready.wait()
    del kept
threads = [threading.Thread(target=allocate) for _ in range(16)]
for one in threads: one.start()
ready.wait()
ctypes.CDLL(None).malloc_stats()
ready.wait()
"""


def arenas(how: str) -> int:
    """How many arenas a process with sixteen threads that hold memory has."""
    environment = {name: value for name, value in os.environ.items() if name != "MALLOC_ARENA_MAX"}
    told = subprocess.run(
        [sys.executable, "-c", ALLOCATING, how], env=environment, check=True, capture_output=True, text=True
    )
    return told.stderr.count("Arena ")


@pytest.mark.skipif(
    not sys.platform.startswith("linux") or not find_library("c"), reason="malloc of the GNU C library alone has arenas"
)
def test_sixteen_threads_share_two_arenas() -> None:
    assert arenas("few") <= 2
    assert arenas("as it is") > 2


FREEING = """
import sys
from msl_fem.computing.malloc import give_back
def resident():
    with open("/proc/self/statm") as told: return int(told.read().split()[1]) * 4096 / 1e6
kept = [bytearray(100_000) for _ in range(2000)]
del kept[:-1]  # the last one holds the end of the heap
before = resident()
if sys.argv[1] == "given back":
    assert give_back()
print(before - resident())
"""


@pytest.mark.skipif(
    not sys.platform.startswith("linux") or not find_library("c"), reason="malloc of the GNU C library alone trims"
)
def test_what_is_free_is_given_back() -> None:
    """200 MB in pieces of 100 kB, which malloc keeps below the one that is not free."""
    given, kept = (
        float(subprocess.run([sys.executable, "-c", FREEING, how], check=True, capture_output=True, text=True).stdout)
        for how in ("given back", "as it is")
    )
    assert given > 150.0
    assert kept < 10.0
