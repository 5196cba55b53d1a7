"""The browser's pipe: its ends are descriptors 3 and 4 of the child, whichever were free before."""

import os

import pytest
from devtools import hand_over


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
@pytest.mark.parametrize("free", [True, False])
def test_the_ends_are_kept_as_descriptors_3_and_4(free: bool) -> None:
    read, write = os.pipe()
    child = os.fork()
    if not child:
        far = [os.dup(one) for one in (read, write)]  # above 4: the test has descriptors of its own
        while min(far) < 5:
            far = [os.dup(one) for one in far]
        for place in (3, 4):
            if free:
                os.closerange(place, place + 1)
        hand_over(*far)
        os._exit(0 if os.get_inheritable(3) and os.get_inheritable(4) and os.write(4, b"x") and os.read(3, 1) else 1)
    os.close(read)
    os.close(write)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
