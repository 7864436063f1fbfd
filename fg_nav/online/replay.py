"""A recording as if it were being walked: each sample when its time has come, at its own speed or a faster one.

The samples are those of `fg_nav.io.read`: mended, as `fg-nav run` has them.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import StreamError
from fg_nav.online.buffer import COLUMNS, rows_of
from fg_nav.recording import Recording

AS_FAST_AS_POSSIBLE = "max"  # In place of a speed.
MAX_AT_ONCE = 1000  # Samples; between two blocks it is looked whether the walk shall end.


def parse_speed(words: str) -> float:
    """Return how many times as fast as it was walked; raises `StreamError` for what is no factor."""
    try:
        speed = np.inf if words == AS_FAST_AS_POSSIBLE else float(words)
    except ValueError:
        speed = np.nan
    if not speed > 0.0:
        raise StreamError(f"--speed {words} is no factor: give one above zero, or {AS_FAST_AS_POSSIBLE}.")
    return speed


class Replay:
    """A `SampleSource` that gives the samples of a recording, `speed` times as fast as they were taken."""

    lost = 0

    def __init__(self, recording: Recording, speed: float, name: str) -> None:
        self.name = name
        self._rows = rows_of(recording)
        self._due = (recording.t - recording.t[0]) / speed
        self._given = 0
        self._began: float | None = None

    @property
    def header(self) -> list[str] | None:
        """See `SampleSource`."""
        return None

    def resume(self, header: Sequence[str]) -> None:
        """See `SampleSource`."""

    def read(self, wait_s: float) -> Floats | None:
        """See `SampleSource`."""
        if self._given == len(self._rows):
            return None
        self._began = time.monotonic() if self._began is None else self._began
        due = float(self._due[self._given]) + self._began
        time.sleep(min(max(due - time.monotonic(), 0.0), wait_s))
        until = int(np.searchsorted(self._due, time.monotonic() - self._began, side="right"))
        first, self._given = self._given, min(max(until, self._given), self._given + MAX_AT_ONCE)
        return self._rows[first : self._given]

    def finish(self) -> Floats:
        """See `SampleSource`."""
        return np.empty((0, COLUMNS))

    def close(self) -> None:
        """Nothing is open."""
