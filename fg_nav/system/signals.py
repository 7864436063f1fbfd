"""Signals that end a long job, as an event that its loop checks: an exception could rise in any line.

Python runs a signal handler between two lines of whatever the main thread does. An exception that rises inside a
callback of a weak reference or in `__del__`, of which Dask has many, is printed and forgotten.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


@contextmanager
def catch_signals(*numbers: signal.Signals) -> Iterator[threading.Event]:
    """Yield an event that the first of these signals sets; a second one interrupts as usual.

    Outside the main thread no signal is caught, and the event is never set.
    """
    stop = threading.Event()
    before: dict[int, Any] = {}

    def set_stop(number: int, frame: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    if threading.current_thread() is threading.main_thread():
        before = {number: signal.signal(number, set_stop) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
