"""`fg-nav demo --view`: the simulated walk on the page while it is walked, without a sensor.

Its samples come as a sensor's would, each when its time has come, through `follow_source`.
When the walk is over the page stays until Ctrl-C.
"""

from __future__ import annotations

import signal

from fg_nav.commands import simulate_walk
from fg_nav.commands.run import DEMO_SCENARIO
from fg_nav.commands.stream import emit_solution, remark
from fg_nav.errors import StreamError
from fg_nav.online.follow import StreamOptions, follow_source
from fg_nav.online.outlets import open_outlets
from fg_nav.online.sources import Replay
from fg_nav.system.signals import catch_signals
from fg_nav.verdict import judge_footfalls


def view_demo(seed: int, speed: float, host: str, port: int) -> None:
    """Show the walk until Ctrl-C."""
    if not 0.0 < speed < float("inf"):
        raise StreamError(f"--speed {speed:g} is no factor: give one above zero.")
    with (
        open_outlets(None, (host, port), lambda line: None, remark) as outlets,
        catch_signals(signal.SIGINT, signal.SIGTERM) as stop,
    ):
        simulated = simulate_walk(DEMO_SCENARIO, seed).recording
        remark(f"a walk of {simulated.t[-1] - simulated.t[0]:.0f} s; Ctrl-C ends it.")
        source = Replay(simulated, speed, "the simulated walk")
        navigator = follow_source(
            source, StreamOptions(beside=True), outlets.emit, outlets.remark, stop, outlets.watcher
        )
        if not stop.is_set() and outlets.emit_end is not None:
            solution = navigator.finish()
            verdicts = [judge_footfalls(solution.stances)]
            emit_solution(solution, navigator.judge.sensor_time, outlets.emit_end, verdicts)
            remark("the walk is over, and stays on the page until Ctrl-C.")
            stop.wait()
