"""What holds of a walk between its footfalls, for whoever watches: pose, stance, rate, latency, source.

==================== ============================================================================================
t                    s, of the last sample
standing             whether the foot stands
position_m           [east, north, up], by strapdown from the last footfall on
heading_deg          of the body's x axis, clockwise from north
floor                of the newest line: 0 where the walk began, +1 the next above; null where not known
returns              stretches recognized as walked before: s of begin and end of each, then of the earlier pass
latency_ms           from the arrival of the samples to the newest line
rate_hz              samples that come in a second
lost_samples         that the stamps show to be missing, of all so far
lost_datagrams       for which this machine had no room
source               "ok", "silent 7 s" or "ended"
==================== ============================================================================================

What is not known yet is null. Sigmas and the verdict on the field are those of the newest line.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

from fg_nav.frames import compute_heading
from fg_nav.online.estimates import DIGITS
from fg_nav.online.pocket import Navigator
from fg_nav.solution import Return

RATE_S = 2.0  # In which samples are counted for their rate.
SILENT_S = 1.5  # A source that has sent nothing for so long is called silent.


class Watcher(Protocol):
    """Who is shown the status: the server of a page."""

    @property
    def viewers(self) -> int:
        """How many watch."""
        ...

    @property
    def status_s(self) -> float:
        """How often they are shown it."""
        ...

    def send_status(self, status: dict[str, Any]) -> None:
        """Show it to all."""
        ...


class StatusReporter:
    """Measures while a source is followed, and reports to a watcher, where somebody watches."""

    def __init__(self, watcher: Watcher) -> None:
        self._watcher = watcher
        self._due = self._arrived = time.monotonic()
        self._silent_since: float | None = None
        self._counts: deque[tuple[float, int]] = deque()
        self._latency_ms: float | None = None

    def count_samples(self, count: int) -> None:
        """Note how many samples have come, at each read: one that finds none begins a silence."""
        now = time.monotonic()
        if count:
            self._arrived, self._silent_since = now, None
            self._counts.append((now, count))
        elif self._silent_since is None:
            self._silent_since = now

    def note_line(self) -> None:
        """Note that a line was just sent."""
        self._latency_ms = 1e3 * (time.monotonic() - self._arrived)

    def report(self, navigator: Navigator, lost: Mapping[str, int], ended: bool = False) -> None:
        """Send the status, where it is due and somebody watches; at the end always; `lost` as of `LossCounter`."""
        self._send(lambda: self._describe(navigator), lost, ended)

    def _send(self, describe: Callable[[], dict[str, Any]], lost: Mapping[str, int], ended: bool) -> None:
        now = time.monotonic()
        while self._counts and self._counts[0][0] < now - RATE_S:
            self._counts.popleft()
        if ended or (now >= self._due and self._watcher.viewers):
            self._due = now + self._watcher.status_s
            source = "ended" if ended else self._describe_source(now)
            counts = {"lost_samples": lost["samples"], "lost_datagrams": lost["datagrams"]}
            self._watcher.send_status({**describe(), **self._describe_flow(), **counts, "source": source})

    def _describe_source(self, now: float) -> str:
        silent_s = 0.0 if self._silent_since is None else now - self._silent_since
        return "ok" if silent_s < SILENT_S else f"silent {silent_s:.0f} s"

    def _describe(self, navigator: Navigator) -> dict[str, Any]:
        """Return what the samples so far show; the pose costs some milliseconds."""
        stop, pose = navigator.buffer.stop, navigator.pose()
        return {
            "t": round(navigator.buffer.stamp(stop - 1), DIGITS) if stop else None,
            "standing": navigator.stands,
            "position_m": None if pose is None else np.round(pose.position[-1], DIGITS),
            "heading_deg": None if pose is None else _to_degrees(float(compute_heading(pose.nav_R_body[-1]))),
            "floor": navigator.floor,
            "returns": [list_ends(one) for one in navigator.returns],
        }

    def _describe_flow(self) -> dict[str, Any]:
        """How fast lines come, and samples."""
        return {
            "latency_ms": None if self._latency_ms is None else round(self._latency_ms, 1),
            "rate_hz": round(sum(count for _, count in self._counts) / RATE_S, 1),
        }


def list_ends(one: Return) -> list[float]:
    """Begin and end of a return, and of the earlier pass, s."""
    return [round(float(t), DIGITS) for t in (one.t[0], one.t[-1], one.earlier_t.min(), one.earlier_t.max())]


def _to_degrees(heading: float) -> float:
    return round(float(np.degrees(heading) % 360.0), DIGITS)
