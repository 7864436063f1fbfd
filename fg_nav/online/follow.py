"""Follow a source until it ends, or until somebody says stop: rows in, estimates out, checkpoints on the way.

Nothing that happens to the stream ends the walk but its end: bad rows are left out, a source that stalls is waited for,
and both are told. Checkpoints come every `checkpoint_s`, are written beside the walk, and less often once that takes
long: at most one part in twenty of the time goes into it.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.file import Calibration
from fg_nav.errors import EstimationError, FormatError, OutputError
from fg_nav.online import OnlineNavigator, load
from fg_nav.online.checkpoint import collect_content, write_content
from fg_nav.online.estimates import StanceEstimate
from fg_nav.online.lines import format_estimate
from fg_nav.online.smoother import OnlineOptions
from fg_nav.online.sources import RowReader, Source
from fg_nav.text import to_json

Tell = Callable[[str], None]

WAIT_S = 0.2
"""For bytes, before looking whether somebody said stop."""

SAVING_SHARE = 0.05
"""Of the time at most."""


@dataclass(frozen=True)
class StreamOptions:
    """How a source is followed.

    Attributes
    ----------
    online : options of the smoother.
    checkpoint : file to save the walk in, and to take it up from if it is there; None without.
    checkpoint_s : time between two saves, s.
    stalled_s : silence after which the source is said to stall, s.
    until_silent_s : silence after which the walk is taken to be over, s; None to wait for ever.
    calibration : to apply; None without.
    """

    online: OnlineOptions = field(default_factory=OnlineOptions)
    checkpoint: Path | None = None
    checkpoint_s: float = 10.0
    stalled_s: float = 5.0
    until_silent_s: float | None = None
    calibration: Calibration | None = None


class Stop(threading.Event):
    """Set when somebody said stop; made by `on_signals`."""


@contextmanager
def on_signals() -> Iterator[Stop]:
    """Yield an event that SIGINT or SIGTERM sets; a second one of them interrupts as usual."""
    stop = Stop()
    before: dict[int, Any] = {}

    def said(number: int, frame: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    if threading.current_thread() is threading.main_thread():
        before = {number: signal.signal(number, said) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def follow(
    source: Source, options: StreamOptions, tell: Tell, remark: Tell, stop: threading.Event | None = None
) -> OnlineNavigator:
    """Follow a source to its end.

    Parameters
    ----------
    source
        Of canonical rows.
    options
        How.
    tell
        Given one JSON line (`fg_nav.online.lines`) for each estimate.
    remark
        Given a sentence for people about what is odd.
    stop
        Ends the walk when it is set.

    Returns
    -------
    OnlineNavigator
        Closed: ask it for the whole walk.

    Raises
    ------
    FormatError, RecordingError, EstimationError
        Where the rows are of another format or unit, or a checkpoint cannot be taken up.
    """
    navigator = _begun(options, remark)
    walk = _Walk(navigator, options, tell, remark)
    reader = RowReader(source.name, remark, navigator.source.get("header"))
    silence = _Silence(source.name, options, remark)
    while not (stop is not None and stop.is_set()):
        piece = source.read(WAIT_S)
        if piece is None or silence.is_over(piece):
            break
        walk.take(reader.read(piece), reader.header)
    walk.take(reader.finish(), reader.header)
    if reader.header is None:
        raise FormatError(f"{source.name} ended before a header came: its first line must name the columns.")
    if reader.bad:
        remark(f"{reader.bad} rows were left out in all.")
    walk.end()
    return navigator


def _begun(options: StreamOptions, remark: Tell) -> OnlineNavigator:
    path = options.checkpoint
    if path is None or not path.exists():
        navigator = OnlineNavigator(options.online, remark)
        navigator.source["calibration"] = to_json(options.calibration)
        return navigator
    navigator = load(path, options.online, remark)
    if navigator.source.get("calibration") != to_json(options.calibration):
        raise EstimationError(f"{path.name} was made with another calibration: give the same, or name another.")
    remark(f"taken up from {path.name}: {len(navigator.footfalls)} stances, {navigator.buffer.stop} samples.")
    return navigator


class _Walk:
    """Samples to the navigator, estimates to whoever is told, and the walk into its checkpoint."""

    def __init__(self, navigator: OnlineNavigator, options: StreamOptions, tell: Tell, remark: Tell) -> None:
        self._navigator, self._options, self._tell = navigator, options, tell
        self._due = time.monotonic() + options.checkpoint_s
        self._remark, self._unsaved = remark, False
        self._saving: threading.Thread | None = None

    def take(self, rows: Floats, header: list[str] | None) -> None:
        if not len(rows):
            return
        self._navigator.source["header"] = header
        t, acc, gyr, mag = rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10]
        acc, mag = self._corrected(acc, mag)
        self._say(self._navigator.push(t, acc, gyr, mag if self._options.online.use_field else None))
        if self._options.checkpoint is not None and time.monotonic() >= self._due:
            self._save(self._options.checkpoint)

    def end(self) -> None:
        if self._options.checkpoint is not None:
            self._save(self._options.checkpoint)
            self._wait()
        self._say(self._navigator.close())

    def _say(self, estimates: list[StanceEstimate]) -> None:
        for estimate in estimates:
            continues = self._navigator.footfalls[estimate.number].continues
            self._tell(format_estimate(estimate, continues, self._navigator.judge.sensor_time))

    def _save(self, path: Path) -> None:
        """Save beside the walk: only the copy holds it up."""
        self._wait()
        content = collect_content(self._navigator)
        self._saving = threading.Thread(target=self._write, args=(content, path))
        self._due = np.inf
        self._saving.start()

    def _write(self, content: dict[str, Any], path: Path) -> None:
        began = time.monotonic()
        try:
            write_content(content, path)
            self._unsaved = False
        except OutputError as error:  # the walk goes on, disk full or not
            if not self._unsaved:
                self._remark(str(error))
            self._unsaved = True
        took = time.monotonic() - began
        self._due = time.monotonic() + max(self._options.checkpoint_s, took / SAVING_SHARE)

    def _wait(self) -> None:
        if self._saving is not None:
            self._saving.join()

    def _corrected(self, acc: Floats, mag: Floats) -> tuple[Floats, Floats]:
        """Apply the calibration as to a recording (`fg_nav.walk`)."""
        found = self._options.calibration
        if found is None:
            return acc, mag
        if found.magnetometer is not None:
            mag = np.asarray(found.magnetometer.correct(mag))
        if found.accelerometer is not None:
            acc = found.accelerometer.correct(acc)
        return acc, mag


class _Silence:
    """How long nothing has come."""

    def __init__(self, name: str, options: StreamOptions, remark: Tell) -> None:
        self._name, self._options, self._remark = name, options, remark
        self._since = time.monotonic()
        self._told = False

    def is_over(self, piece: bytes) -> bool:
        """Note what has come, or not; whether it has been silent for so long that the walk is over."""
        now = time.monotonic()
        silent = now - self._since
        if piece:
            if self._told:
                self._remark(f"{self._name} sends again after {silent:.0f} s.")
            self._since, self._told = now, False
            return False
        if silent >= self._options.stalled_s and not self._told:
            self._remark(f"nothing has come from {self._name} for {silent:.0f} s: waiting.")
            self._told = True
        end = self._options.until_silent_s
        return end is not None and silent >= end
