"""`fg-nav view`: several walks in progress on one page, each from the page of its own `fg-nav stream --view`."""

from __future__ import annotations

import asyncio
import signal
import socket
from collections.abc import Sequence
from contextlib import suppress

from fg_nav.commands.requests import ViewRequest
from fg_nav.commands.shared import Answer
from fg_nav.errors import StreamError
from fg_nav.report import terminal
from fg_nav.text import format_count
from fg_nav.view.board import BoardServer, Walker
from fg_nav.view.outlets import describe_page, open_port
from fg_nav.view.plan import Plan


def view(request: ViewRequest) -> Answer:
    """Show several walks until Ctrl-C."""
    walkers = [Walker.parse(words) for words in request.walkers]
    if len({one.name for one in walkers}) < len(walkers):
        raise StreamError("two walkers have one name: give each its own.")
    board, plan = BoardServer(request.host, walkers), Plan.read(request.plan, request.plan_points)
    if plan is not None:
        board.show_plan([plan.path, plan.type, plan.describe()])
    door = open_port(request.host, request.port, "--port or --host")
    shown = f"{format_count(len(walkers), 'walk')} shown on {describe_page(request.host, door)}; Ctrl-C ends it."
    terminal.remark(f"fg-nav: {shown}")
    asyncio.run(_serve(board, walkers, door))
    return Answer({"walkers": [one.name for one in walkers]}, lambda: None)


async def _serve(board: BoardServer, walkers: Sequence[Walker], door: socket.socket) -> None:
    """Follow the walks, and serve the page, until a signal."""
    loop, follows = asyncio.get_running_loop(), asyncio.gather(*map(board.follow, walkers))
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, follows.cancel)
    await board.open(door)
    with suppress(asyncio.CancelledError):
        await follows
    await board.close()
