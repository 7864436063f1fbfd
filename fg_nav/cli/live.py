"""The verb for a walk in progress: stream."""

from __future__ import annotations

from typing import Annotated

import typer

from fg_nav.cli import options as given
from fg_nav.cli.options import answering

verbs = typer.Typer()


@verbs.command()
def stream(
    source: given.SourceName,
    second: given.SecondSource = None,
    checkpoint: given.CheckpointPath = None,
    every: Annotated[float, typer.Option(metavar="SECONDS", help="Between two saves.")] = 10.0,
    lag: given.Lag = None,
    heading: given.Heading = None,
    no_mag: given.NoMag = False,
    gate: given.GateName = None,
    fixes: given.FixesPath = None,
    calibration: given.CalibrationPath = None,
    mag_axes: given.MagAxesWords = None,
    mount: given.StreamMount = "foot",
    clock_offset: given.StreamClockOffset = None,
    step_constant: given.StepConstant = None,
    serve: given.ServedPort = None,
    view: given.ViewPage = False,
    host: given.ViewHost = "127.0.0.1",
    port: given.ViewPort = 8642,
    baud: Annotated[int, typer.Option(help="Of a serial device.")] = 115200,
    columns: given.ColumnNames = None,
    units: given.UnitNames = None,
    rate: given.RowRate = None,
    speed: given.ReplaySpeed = None,
    record: given.RecordPath = None,
    silence: given.Silence = None,
    plots: given.PlotsChoice = "html",
    out: given.EndDir = None,
    polish: given.Polish = False,
    force: given.Force = False,
    json: given.Json = False,
    quiet: given.Quiet = False,
) -> None:
    """Follow a sensor while it is walked with: one JSON line a footfall or stride, and at the end the whole walk.

    Reads canonical CSV, the header line first, or rows of --columns. Ctrl-C ends the walk and writes its result.
    """
    from fg_nav.commands.stream import check_sources, stream
    from fg_nav.commands.stream_feet import stream_feet
    from fg_nav.detection.mount import Wearing
    from fg_nav.online.feet_follow import FeetStreamRequest
    from fg_nav.online.follow import StreamRequest

    right = check_sources(second, clock_offset, mount)
    worn: Wearing = "foot" if mount == "feet" else mount
    request = StreamRequest(
        source, checkpoint, every, lag, heading, not no_mag, gate, calibration, serve, baud, silence, mag_axes, polish,
        (host, port) if view else None, columns, units, rate, worn, fixes, step_constant,
        speed, record, force,
    )  # fmt: skip
    with answering(json, quiet) as answer:
        if right is not None:
            feet = FeetStreamRequest(request, right, clock_offset or 0.0)
            answer(stream_feet(feet, out, force, lines=not (json or quiet)))
            return
        answer(stream(request, plots, out, force, lines=not (json or quiet)))
