"""`fg-nav demo --view`: the simulated walk on the page while it is walked, without a sensor.

Its samples come as a sensor's would: canonical rows, each when its time has come, through `follow_source`.
When the walk is over the page stays until Ctrl-C.
"""

from __future__ import annotations

import signal
import time
from bisect import bisect_right
from pathlib import Path
from tempfile import TemporaryDirectory

from fg_nav.commands import simulate_walk
from fg_nav.commands.stream import emit_solution, remark
from fg_nav.errors import StreamError
from fg_nav.io import write_canonical
from fg_nav.online.follow import StreamOptions, follow_source
from fg_nav.online.outlets import open_outlets
from fg_nav.recording import Recording
from fg_nav.signals import catch_signals

SCENARIO = "demo"


class PlayedRecording:
    """A source that sends the rows of a recording each when its time has come, `speed` times as fast."""

    def __init__(self, recording: Recording, speed: float) -> None:
        self.name = "the simulated walk"
        with TemporaryDirectory() as folder:
            path = Path(folder) / "walk.csv"
            write_canonical(recording, path)
            self._header, *self._rows = path.read_bytes().splitlines(keepends=True)
        self._due = ((recording.t - recording.t[0]) / speed).tolist()
        self._began = time.monotonic()
        self._sent = 0

    def read(self, wait_s: float) -> bytes | None:
        """See `Source`."""
        if self._sent == len(self._rows):
            return None
        elapsed = time.monotonic() - self._began
        time.sleep(min(max(self._due[self._sent] - elapsed, 0.0), wait_s))
        until = bisect_right(self._due, time.monotonic() - self._began)
        piece = b"".join([self._header, *self._rows[self._sent : until]])
        self._sent = max(until, self._sent)
        return piece

    def close(self) -> None:
        """Nothing is open."""


def view_demo(seed: int, speed: float, host: str, port: int) -> None:
    """Show the walk until Ctrl-C."""
    if not 0.0 < speed < float("inf"):
        raise StreamError(f"--speed {speed:g} is no factor: give one above zero.")
    with (
        open_outlets(None, (host, port), lambda line: None, remark) as outlets,
        catch_signals(signal.SIGINT, signal.SIGTERM) as stop,
    ):
        simulated = simulate_walk(SCENARIO, seed).recording
        remark(f"a walk of {simulated.t[-1] - simulated.t[0]:.0f} s; Ctrl-C ends it.")
        source = PlayedRecording(simulated, speed)
        navigator = follow_source(source, StreamOptions(), outlets.emit, outlets.remark, stop, outlets.watcher)
        if not stop.is_set() and outlets.emit_end is not None:
            emit_solution(navigator.finish(), navigator.judge.sensor_time, outlets.emit_end)
            remark("the walk is over, and stays on the page until Ctrl-C.")
            stop.wait()
