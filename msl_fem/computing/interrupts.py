"""Ctrl-C and SIGTERM at moments at which a lock is held."""

import contextlib
import signal
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def interrupts_held_back() -> Iterator[None]:
    """Ctrl-C and SIGTERM act after the block, which may hold locks; processes started in it never hear them.

    The parent alone answers them, and ends its processes.
    """
    with _answered_later(signal.SIGINT), _answered_later(signal.SIGTERM):
        if not hasattr(signal, "pthread_sigmask"):  # Windows
            yield
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _answered_later(number: signal.Signals) -> Iterator[None]:
    """A mask is its thread's alone: any other thread may take the signal, which Python answers in the main one."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = signal.signal(number, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        signal.signal(number, before or signal.SIG_DFL)
        if came:
            signal.raise_signal(number)
