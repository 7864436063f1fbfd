"""Where the lines of a stream and the remarks on it go: a printer or a port, and a page for people.

`emit` takes the lines of the moment, `emit_end` those of the whole walk at its end, which are not served: who listens
on a port follows a walk. The page takes all of them; where nobody takes those of the end, `emit_end` is None.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass

from fg_nav.online.status import Watcher
from fg_nav.view.line_server import LineServer
from fg_nav.view.loop import is_loopback
from fg_nav.view.page_server import PageServer

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
        outlets = Outlets(print_line, print_line, remark)
        if serve is not None:
            lines = opened.enter_context(closing(LineServer(serve)))
            remark(f"lines are served on 127.0.0.1:{lines.port}.")
            outlets = Outlets(lines.send, None, remark)
        if view is not None:
            page = opened.enter_context(closing(PageServer(*view)))
            remark(f"the walk is shown on {page.address} ({_who_sees_it(view[0])}).")
            emit_end = page.send if outlets.emit_end is None else _both(outlets.emit_end, page.send)
            outlets = Outlets(_both(outlets.emit, page.send), emit_end, _both(remark, page.send_remark), page)
        yield outlets


def _both(first: Say, second: Say) -> Say:
    def say(words: str) -> None:
        first(words)
        second(words)

    return say


def _who_sees_it(host: str) -> str:
    if is_loopback(host):
        return "for this machine alone"
    return "for all who reach this machine: there is no password, and no encryption"
