"""Where the lines of a stream and the remarks on it go: a printer or a port, and a page for people.

`emit` gets the lines of the moment, `emit_end` those of the whole walk at its end, which are not served: a client of
the port follows a walk. The page gets all of them; `emit_end` is None if nothing takes those of the end.

The page is shown the status between footfalls too; what is not known yet is null. Sigmas and the verdict on the field
are those of the newest line.

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
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from fg_nav.frames import compute_heading
from fg_nav.online.estimates import DIGITS
from fg_nav.online.pocket import Navigator
from fg_nav.solution import Return
from fg_nav.view.line_server import format_address, is_loopback, open_port
from fg_nav.view.process import ListenerProcess

HOST = "127.0.0.1"  # that serves lines
RATE_S = 2.0  # in which samples are counted for their rate
SILENT_S = 1.5  # without samples, after which a source is called silent

Say = Callable[[str], None]  # Called with a line, or a sentence for people.


@dataclass(frozen=True)
class Outlets:
    """Where lines, those of the end, and remarks go; and the process that is sent the status."""

    emit: Say
    emit_end: Say | None
    remark: Say
    watcher: ListenerProcess | None = None


@contextmanager
def open_outlets(serve: int | None, view: tuple[str, int] | None, print_line: Say, remark: Say) -> Iterator[Outlets]:
    """Open what was requested.

    Raises `StreamError` if a port cannot be served.

    Parameters
    ----------
    serve : port for the lines, which are then not printed; None without.
    view : host and port of the page; None without.
    print_line, remark : called with lines, and with sentences for people.
    """
    with ExitStack() as opened:
        lines = None if serve is None else opened.enter_context(open_port(HOST, serve, "--serve"))
        page = None if view is None else opened.enter_context(open_port(*view, "--port or --host"))
        if lines is not None:
            remark(f"lines are served on {HOST}:{lines.getsockname()[1]}.")
        if page is not None and view is not None:
            reach = "for all who reach this machine: there is no password, and no encryption"
            reach = "for this machine alone" if is_loopback(view[0]) else reach
            remark(f"the walk is shown on {format_address(view[0], page.getsockname()[1])} ({reach}).")
        if lines is None and page is None:
            yield Outlets(print_line, print_line, remark)
            return
        host = HOST if view is None else view[0]
        listeners = opened.enter_context(closing(ListenerProcess(lines, page, host, remark)))
        emit = listeners.send_line if lines is not None else _both(print_line, listeners.send)
        if page is None:
            yield Outlets(emit, None, remark)
            return
        emit_end = listeners.send if lines is not None else emit
        yield Outlets(emit, emit_end, _both(remark, listeners.send_remark), listeners)


def _both(first: Say, second: Say) -> Say:
    def say(words: str) -> None:
        first(words)
        second(words)

    return say


class StatusReporter:
    """Measures rate, latency and silence while a source is followed, and sends the status while somebody watches."""

    def __init__(self, watcher: ListenerProcess) -> None:
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

    def report(self, describe: Callable[[], dict[str, Any]], lost: Mapping[str, int], ended: bool = False) -> None:
        """Send the status if it is due and somebody watches; at the end always.

        `describe` returns what the samples so far show, in some milliseconds; `lost` is that of `LossCounter`.
        """
        now = time.monotonic()
        while self._counts and self._counts[0][0] < now - RATE_S:
            self._counts.popleft()
        if not (ended or (now >= self._due and self._watcher.viewers)):
            return
        self._due = now + self._watcher.status_s
        silent_s = 0.0 if self._silent_since is None else now - self._silent_since
        source = "ok" if silent_s < SILENT_S else f"silent {silent_s:.0f} s"
        flow = {
            "latency_ms": None if self._latency_ms is None else round(self._latency_ms, 1),
            "rate_hz": round(sum(count for _, count in self._counts) / RATE_S, 1),
            "lost_samples": lost["samples"],
            "lost_datagrams": lost["datagrams"],
            "source": "ended" if ended else source,
        }
        self._watcher.send_status({**describe(), **flow})


def describe_walk(navigator: Navigator) -> dict[str, Any]:
    """Return what the samples so far show of a walk; the pose costs some milliseconds."""
    stop, pose = navigator.buffer.stop, navigator.pose()
    heading_deg = None if pose is None else float(np.degrees(float(compute_heading(pose.nav_R_body[-1]))) % 360.0)
    return {
        "t": round(navigator.buffer.stamp(stop - 1), DIGITS) if stop else None,
        "standing": navigator.stands,
        "position_m": None if pose is None else np.round(pose.position[-1], DIGITS),
        "heading_deg": None if heading_deg is None else round(heading_deg, DIGITS),
        "floor": navigator.floor,
        "returns": [list_ends(one) for one in navigator.returns],
    }


def list_ends(one: Return) -> list[float]:
    """Begin and end of a return, and of the earlier pass, s."""
    return [round(float(t), DIGITS) for t in (one.t[0], one.t[-1], one.earlier_t.min(), one.earlier_t.max())]
