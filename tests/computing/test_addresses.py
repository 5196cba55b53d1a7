"""Laws become machine code in whatever threads ask for it."""

import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from msl_fem.computing.laws import causes_of
from msl_fem.plant.effects import declared, expressions


@pytest.fixture
def _hasty_threads() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("_hasty_threads")
def test_threads_that_ask_at_once_all_get_it() -> None:
    """Fits in threads may be the first to need a law: numba's registries bear one thread at a time."""
    together = threading.Barrier(8)

    def address(_: int) -> float:
        together.wait()
        return expressions._machine_code(tuple(expressions.DECLARED.values()))[2][0]

    laws = ("own_drag: force = -a*v*abs(v); a: 0..1 N s2/m2", "own_drop: voltage = a*i; a: 0..1 ohm")
    with declared(*(one for text in laws for one in causes_of(text))), ThreadPoolExecutor(8) as pool:
        assert all(at > 0 for at in pool.map(address, range(8)))
