"""What `fg-nav stream` does up to the end of the walk: open the source, serve or print the lines, follow."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fg_nav.calibration.file import Calibration, read_calibration
from fg_nav.errors import EstimationError, StreamError
from fg_nav.online import OnlineNavigator
from fg_nav.online.follow import StreamOptions, Tell, follow, on_signals
from fg_nav.online.lines import LineServer
from fg_nav.online.smoother import OnlineOptions
from fg_nav.online.sources import open_source

SHORTEST_LAG_S = 10.0
"""A lag below holds fewer strides than the smoother needs to know sensor and foot."""


@dataclass(frozen=True)
class Wanted:
    """What a user asked for; see `fg-nav stream --help`."""

    source: str
    checkpoint: Path | None = None
    checkpoint_s: float = 10.0
    lag_s: float | None = None
    heading_deg: float | None = None
    use_magnetometer: bool = True
    calibration_path: Path | None = None
    serve: int | None = None
    baud: int = 115200
    silence_s: float | None = None


@dataclass(frozen=True)
class Followed:
    """A walk that has ended: its navigator, the name of its source, and the calibration that was applied."""

    navigator: OnlineNavigator
    name: str
    calibration: Calibration | None


def streamed(wanted: Wanted, tell: Tell, remark: Tell) -> Followed:
    """Follow a source until it ends or a signal says stop.

    Parameters
    ----------
    wanted
        What was asked for.
    tell
        Given each line, unless they are served.
    remark
        Given sentences for people.

    Raises
    ------
    FgNavError
        Where something that was asked for cannot be: the source, the checkpoint, the port, the rows.
    """
    calibration = None if wanted.calibration_path is None else read_calibration(wanted.calibration_path)
    options = StreamOptions(
        online=_online(wanted),
        checkpoint=wanted.checkpoint,
        checkpoint_s=_positive(wanted.checkpoint_s, "--every") or 0.0,
        until_silent_s=_positive(wanted.silence_s, "--silence"),
        calibration=calibration,
    )
    with on_signals() as stop, closing(open_source(wanted.source, wanted.baud)) as source:
        if wanted.serve is None:
            return Followed(follow(source, options, tell, remark, stop), source.name, calibration)
        with closing(LineServer(wanted.serve)) as server:
            remark(f"lines are served on 127.0.0.1:{server.port}.")
            return Followed(follow(source, options, server.send, remark, stop), source.name, calibration)


def _online(wanted: Wanted) -> OnlineOptions:
    lag_s = _positive(wanted.lag_s, "--lag")
    if lag_s is not None and wanted.checkpoint is not None:
        raise EstimationError("with --lag the walk is forgotten, and there is no --checkpoint of it: give one of them.")
    if lag_s is not None and lag_s < SHORTEST_LAG_S:
        raise EstimationError(f"a lag of {lag_s:g} s is too short: give {SHORTEST_LAG_S:g} or more.")
    heading = wanted.heading_deg
    if heading is not None and not np.isfinite(heading):
        raise EstimationError(f"a heading of {heading} deg is no direction: give a number.")
    return OnlineOptions(
        heading_rad=None if heading is None else float(np.radians(heading)),
        use_field=wanted.use_magnetometer,
        lag_s=lag_s,
    )


def _positive(value: float | None, name: str) -> float | None:
    if value is not None and not 0 < value < np.inf:
        raise StreamError(f"{name} {value:g} is no time: give seconds above zero.")
    return value
