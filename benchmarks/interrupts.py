"""Ctrl-C that is not lost."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def remembered() -> Iterator[Callable[[], None]]:
    """Remember a Ctrl-C while the block runs; yield the function that raises KeyboardInterrupt once there was one.

    Python prints and drops an exception that is raised within a destructor or the callback of a weak reference; a
    KeyboardInterrupt that happens to come there would stop nothing.
    """
    came = False

    def remember(number: int, frame: FrameType | None) -> None:
        nonlocal came
        came = True
        signal.default_int_handler(number, frame)

    def require_none() -> None:
        if came:
            raise KeyboardInterrupt

    # Only the main thread is interrupted; and a signal that is ignored, or goes to somebody else, stays theirs.
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield require_none
        return
    signal.signal(signal.SIGINT, remember)
    try:
        yield require_none
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
