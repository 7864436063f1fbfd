"""What a user asks of `fg-nav stream LEFT RIGHT --mount feet`: as of one sensor (`request`), for two.

Calibrations are two files with a comma between; what is of one sensor alone is refused.
"""

from __future__ import annotations

from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path

from fg_nav.errors import EstimationError, StreamError
from fg_nav.feet import SIDES, Side, refuse_for_two, split_pair
from fg_nav.online.feet import FeetNavigator
from fg_nav.online.feet_follow import follow_feet
from fg_nav.online.options import OnlineOptions
from fg_nav.online.outlets import Outlets
from fg_nav.online.request import ENDING, StreamedWalk, StreamRequest, open_source_of, read_stream_options
from fg_nav.system.signals import catch_signals


@dataclass(frozen=True)
class FeetStreamRequest:
    """What is asked for of both feet, whose `source` is the left one's; the right one's, and its clock's offset, s."""

    both: StreamRequest
    right: str
    clock_offset_s: float = 0.0

    @property
    def sources(self) -> dict[Side, str]:
        """By side."""
        return {"left": self.both.source, "right": self.right}


@dataclass(frozen=True)
class StreamedFeet:
    """Two feet whose walk has ended: their navigator, and the walk of each as of one foot."""

    navigator: FeetNavigator
    walks: dict[Side, StreamedWalk]


def run_feet_stream(request: FeetStreamRequest, outlets: Outlets) -> StreamedFeet:
    """Follow both sources until they end or a signal says stop; lines and remarks go to the outlets.

    Raises
    ------
    FgNavError
        Where something that was asked for cannot be.
    """
    _check(request)
    both = request.both
    files = _split_calibrations(both.calibration_path)
    options = {side: read_stream_options(replace(both, calibration_path=files[side])) for side in SIDES}
    left, right = (options[side].online for side in SIDES)
    assert isinstance(left, OnlineOptions)
    assert isinstance(right, OnlineOptions)
    offset_s = request.clock_offset_s
    navigator = FeetNavigator(left, outlets.remark, clock_offset_s=offset_s, beside=True, right=right)
    with catch_signals(*ENDING) as stop, ExitStack() as opened:
        opened.callback(navigator.abandon)
        sources = {
            side: opened.enter_context(
                closing(open_source_of(replace(both, source=word), options[side].columns, outlets.remark))
            )
            for side, word in request.sources.items()
        }
        follow_feet(sources, options, navigator, outlets, stop)
    walks = {
        side: StreamedWalk(navigator.navigators[side], one.name, options[side].calibration, options[side].mag_axes)
        for side, one in sources.items()
    }
    return StreamedFeet(navigator, walks)


def _check(request: FeetStreamRequest) -> None:
    both = request.both
    if request.right == both.source:
        raise StreamError(f"{request.right} is named twice: --mount feet takes two sources, the left foot's first.")
    refused = {
        "--checkpoint": both.checkpoint,
        "--lag": both.lag_s,
        "--fixes": both.fixes_path,
        "--record": both.record,
        "--step-constant": both.step_constant_m,
        "--polish": both.polish or None,
    }
    refuse_for_two(refused)


def _split_calibrations(files: Path | None) -> dict[Side, Path | None]:
    if files is None:
        return {"left": None, "right": None}
    pair = split_pair(files)
    if pair is None:
        raise EstimationError(
            f"--calibration {files} is of one sensor: with --mount feet give two files, the left foot's first, as "
            "--calibration LEFT,RIGHT."
        )
    return dict(zip(SIDES, pair, strict=True))
