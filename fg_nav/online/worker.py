"""The worker process of `background`: it reads messages from its standard input, and answers requests.

It ends when its standard input does, so it never outlives the walk.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from fg_nav.detection.stance import StanceParameters
from fg_nav.online.anchor import AnchorState
from fg_nav.online.buffer import SampleBuffer
from fg_nav.online.options import OnlineOptions
from fg_nav.online.solving import WalkSolver
from fg_nav.system.processes import collect_seldom

if TYPE_CHECKING:
    from fg_nav.online.feet_solving import WalksAlone

NICENESS = 5  # The process that reports the walk comes first.


class Worker:
    """Samples and solver of one walk, driven by messages."""

    def __init__(
        self, make_solver: Callable[[OnlineOptions, StanceParameters, SampleBuffer], WalkSolver] = WalkSolver
    ) -> None:
        self._make_solver, self._buffer = make_solver, SampleBuffer()
        self._solver: WalkSolver

    def answer(self, kind: str, *content: Any) -> tuple[AnchorState | None] | None:
        """Process a message; return (anchor state or None,) for a request, None for other messages."""
        match kind:
            case "options":
                options, stance = content
                self._solver = self._make_solver(options, stance, self._buffer)
            case "samples":
                self._buffer.append(content[0])
            case "skip":
                self._buffer.skip_to(content[0])
            case "discard":
                self._buffer.discard(content[0])
            case "begin":
                self._solver.begin(content[0])
                self._solver.prepare()
            case "request":
                self._solver.request(content[0])
                return (self._solver.take(),)
        return None


def answer_messages() -> None:
    """Answer the messages of one foot, whose key is "", or of both, by side, until there are no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that reports the walk
    os.nice(NICENESS)
    collect_seldom()
    messages, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever prints must not print into the answers
    workers: dict[str, Worker] = {"": Worker()}
    walks: WalksAlone | None = None
    with suppress(EOFError, OSError, pickle.UnpicklingError):  # its owner has gone, maybe in the middle of a message
        while True:
            key, kind, *content = pickle.load(messages)
            if key and walks is None:
                from fg_nav.feet import SIDES
                from fg_nav.online import feet_solving

                walks = feet_solving.WalksAlone()
                workers |= {side: Worker(partial(feet_solving.FootSolver, side, walks)) for side in SIDES}
            if kind == "part" and walks is not None:
                walks.is_parted = True
                continue
            found = workers[key].answer(kind, *content)
            if found is not None:
                pickle.dump((key, *found), answers, protocol=pickle.HIGHEST_PROTOCOL)
                answers.flush()


if __name__ == "__main__":
    answer_messages()
