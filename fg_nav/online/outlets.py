"""Where the lines of a stream and the remarks on it go: a printer or a port, and a page for people.

`emit` takes the lines of the moment, `emit_end` those of the whole walk at its end, which are not served: who listens
on a port follows a walk. The page takes all of them; where nobody takes those of the end, `emit_end` is None.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass

from fg_nav.online.status import Watcher
from fg_nav.view.loop import format_address, is_loopback, open_port
from fg_nav.view.process import ListenerProcess

HOST = "127.0.0.1"  # That serves lines.

Say = Callable[[str], None]
"""Takes a line, or a sentence for people."""


@dataclass(frozen=True)
class Outlets:
    """Where lines, those of the end, and remarks go; and who is shown the status."""

    emit: Say
    emit_end: Say | None
    remark: Say
    watcher: Watcher | None = None


@contextmanager
def open_outlets(serve: int | None, view: tuple[str, int] | None, print_line: Say, remark: Say) -> Iterator[Outlets]:
    """Open what was asked for.

    Parameters
    ----------
    serve
        Port for the lines, which are then not printed; None without.
    view
        Host and port of the page; None without.
    print_line, remark
        Given lines, and sentences for people.

    Raises
    ------
    StreamError
        If a port cannot be served.
    """
    with ExitStack() as opened:
        lines = None if serve is None else opened.enter_context(open_port(HOST, serve, "--serve"))
        page = None if view is None else opened.enter_context(open_port(*view, "--port or --host"))
        if lines is not None:
            remark(f"lines are served on {HOST}:{_port_of(lines)}.")
        if page is not None and view is not None:
            remark(f"the walk is shown on {format_address(view[0], _port_of(page))} ({_who_sees_it(view[0])}).")
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


def _port_of(door: socket.socket) -> int:
    return int(door.getsockname()[1])


def _both(first: Say, second: Say) -> Say:
    def say(words: str) -> None:
        first(words)
        second(words)

    return say


def _who_sees_it(host: str) -> str:
    if is_loopback(host):
        return "for this machine alone"
    return "for all who reach this machine: there is no password, and no encryption"
