"""Ctrl-C that is not lost: where a library swallows it, it is raised again at the next step of the work."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_asked = threading.Event()


@contextmanager
def interruptible() -> Iterator[None]:
    """Remember an interruption while the block runs, besides raising KeyboardInterrupt as usual."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are the main thread's
        return
    _asked.clear()
    former = signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, former)


def _interrupt(_signal: int, _frame: FrameType | None) -> None:
    _asked.set()
    raise KeyboardInterrupt


def raise_if_interrupted() -> None:
    """Raise KeyboardInterrupt if one was raised before and swallowed, by a callback of a library for example."""
    if _asked.is_set():
        raise KeyboardInterrupt
