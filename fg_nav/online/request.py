"""What a user asks of `fg-nav stream`: which source, followed how; and what is left of the walk when it has ended.

StreamRequest  -> source, lag, heading, calibration, checkpoint, lines printed or served
run_stream     -> the source is opened, and followed to its end (`follow`)
StreamedWalk   -> the closed navigator, to be solved as a whole
"""

from __future__ import annotations

import signal
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fg_nav.calibration.of_recording import Calibration, read_calibration
from fg_nav.detection.mount import Wearing
from fg_nav.errors import EstimationError, StreamError
from fg_nav.io import read_fixes
from fg_nav.magnetic.axes import MagAxes
from fg_nav.magnetic.quasi_static import choose_gate
from fg_nav.online.follow import StreamOptions, follow_source
from fg_nav.online.options import OnlineOptions
from fg_nav.online.outlets import Outlets, Say
from fg_nav.online.pocket import Navigator, PocketOptions
from fg_nav.online.record import open_recorded
from fg_nav.online.rows import Columns, parse_columns
from fg_nav.online.sources import SampleSource, open_samples
from fg_nav.smoother.parameters import FieldParameters, SmootherParameters
from fg_nav.system.signals import catch_signals

ENDING = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))
"""Signals that end the walk: Ctrl-C, a service that is stopped, a terminal or connection that is gone."""

MIN_LAG_S = 10.0  # A shorter lag holds fewer strides than the smoother needs to estimate sensor and foot.


@dataclass(frozen=True)
class StreamRequest:
    """What a user asks for; see `fg-nav stream --help`."""

    source: str
    checkpoint: Path | None = None
    checkpoint_s: float = 10.0
    lag_s: float | None = None
    heading_deg: float | None = None
    use_magnetometer: bool = True
    gate: str | None = None
    calibration_path: Path | None = None
    serve: int | None = None
    baud: int = 115200
    silence_s: float | None = None
    mag_axes: str | None = None
    polish: bool = False
    view: tuple[str, int] | None = None
    columns: str | None = None
    units: str | None = None
    rate_hz: float | None = None
    mount: Wearing = "foot"
    fixes_path: Path | None = None
    step_constant_m: float | None = None
    speed: str | None = None
    record: Path | None = None
    force: bool = False


@dataclass(frozen=True)
class StreamedWalk:
    """A walk that has ended: its navigator, the name of its source, and the calibration and axes that were applied.

    `polish` asks for its batch solution as well.
    """

    navigator: Navigator
    name: str
    calibration: Calibration | None
    mag_axes: MagAxes | None = None
    polish: bool = False


def run_stream(request: StreamRequest, outlets: Outlets) -> StreamedWalk:
    """Follow a source until it ends or a signal says stop, as a user asks; lines and remarks go to the outlets.

    Raises
    ------
    FgNavError
        Where something that was asked for cannot be: the source, the checkpoint, the rows.
    """
    options = read_stream_options(request)
    with (
        catch_signals(*ENDING) as stop,
        closing(open_source_of(request, options.columns, outlets.remark)) as source,
    ):
        navigator = follow_source(source, options, outlets.emit, outlets.remark, stop, outlets.watcher)
    return StreamedWalk(navigator, source.name, options.calibration, options.mag_axes, request.polish)


def read_stream_options(request: StreamRequest) -> StreamOptions:
    """Return how a source is followed, with the files that are named read; raises `FgNavError` for what cannot be."""
    calibration = None if request.calibration_path is None else read_calibration(request.calibration_path)
    axes = None if request.mag_axes is None else MagAxes.parse(request.mag_axes)
    return StreamOptions(
        online=_online_options(request, calibration),
        checkpoint=request.checkpoint,
        checkpoint_s=_check_positive(request.checkpoint_s, "--every") or 0.0,
        until_silent_s=_check_positive(request.silence_s, "--silence"),
        calibration=calibration,
        mag_axes=axes,
        columns=parse_columns(request.columns, request.units, request.rate_hz),
        beside=True,
    )


def open_source_of(request: StreamRequest, columns: Columns | None, remark: Say) -> SampleSource:
    """Open the source of a request, and the file that its rows are written to."""
    given = (request.source, columns, request.baud, request.speed, remark)
    if request.record is None:
        return open_samples(*given)
    goes_on = request.checkpoint is not None and request.checkpoint.exists()
    return open_recorded(request.record, goes_on, request.force, *given)


def _online_options(request: StreamRequest, calibration: Calibration | None) -> OnlineOptions | PocketOptions:
    heading = request.heading_deg
    if heading is not None and not np.isfinite(heading):
        raise EstimationError(f"a heading of {heading} deg is no direction: give a number.")
    heading_rad = None if heading is None else float(np.radians(heading))
    if request.mount == "pocket":
        for name, given in (("--lag", request.lag_s), ("--gate", request.gate), ("--fixes", request.fixes_path)):
            if given is not None:
                raise EstimationError(f"{name} is for a sensor on a foot: leave it out with --mount pocket.")
        axes_given = request.mag_axes is not None
        return PocketOptions(heading_rad, request.use_magnetometer, request.step_constant_m, axes_given)
    if request.step_constant_m is not None:
        raise EstimationError("--step-constant is for a sensor in a pocket: add --mount pocket, or leave it out.")
    lag_s = _check_positive(request.lag_s, "--lag")
    if lag_s is not None and lag_s < MIN_LAG_S:
        raise EstimationError(f"a lag of {lag_s:g} s is too short: give {MIN_LAG_S:g} or more.")
    if lag_s is not None and request.polish:
        raise EstimationError("with --lag the samples are discarded, so there is no --polish: give one of the two.")
    magnetic = FieldParameters(gate=choose_gate(request.gate, request.use_magnetometer))
    parameters, known = SmootherParameters(magnetic=magnetic), None if calibration is None else calibration.gyroscope
    return OnlineOptions(
        heading_rad=heading_rad,
        use_field=request.use_magnetometer,
        lag_s=lag_s,
        parameters=parameters if known is None else replace(parameters, **known.prior),
        axes_given=request.mag_axes is not None,
        fixes=() if request.fixes_path is None else read_fixes(request.fixes_path),
        calibration=None if calibration is None else calibration.magnetometer,
    )


def _check_positive(value: float | None, name: str) -> float | None:
    if value is not None and not 0 < value < np.inf:
        raise StreamError(f"{name} {value:g} is no time: give seconds above zero.")
    return value
