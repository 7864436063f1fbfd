"""Verbs for the sensor itself: calibrate, detect, allan; and for a walk in progress: stream."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fg_nav.cli import options as given
from fg_nav.cli.options import answering

verbs = typer.Typer()


@verbs.command()
def calibrate(
    recordings: given.RecordingPaths,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", show_default=False, help="Calibration to write.")],
    method: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="walk, levelled, ellipsoid or sphere. \\[default: by the recording]"),
    ] = None,
    strength: Annotated[
        float | None, typer.Option(metavar="UT", help="Of the field, if known: for a sensor turned over.")
    ] = None,
    place: given.PlaceWords = None, mag_axes: given.MagAxesWords = None,
    format: given.FormatName = None, columns: given.ColumnMapping = None, rate: given.FileRate = None,
    sensor: given.SensorName = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an older calibration.")] = False,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Find the magnetometer's errors, and at rest those of gyroscope and accelerometer; write a calibration.

    Of several recordings of one sensor the gyroscope's bias is the mean of all, and the rest by the first one.
    """
    from fg_nav.commands import choose_reading
    from fg_nav.commands.calibrate import calibrate

    reading = choose_reading(format, columns, rate, sensor)
    with answering(json, quiet) as answer:
        answer(calibrate(recordings, out, method, strength, place, mag_axes, reading, force))


@verbs.command()
def detect(
    file: given.RecordingPath, gates: given.GateNames = None, calibration: given.CalibrationPath = None,
    mag_axes: given.MagAxesWords = None, heading: given.Heading = None, place: given.PlaceWords = None,
    truth: given.TruthPath = None,
    format: given.FormatName = None, columns: given.ColumnMapping = None, rate: given.FileRate = None,
    sensor: given.SensorName = None, alignment: given.AlignmentMode = "yaw",
    out: given.OutDir = None, force: given.Force = False,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Look at the magnetic field along a walk, and at what each detector makes of it: field.png, field_map.png.

    `--gate munoz-diaz` alone needs no footfalls: it judges the samples, of a sensor in a pocket too.
    """
    from fg_nav.commands import choose_options, choose_reading
    from fg_nav.commands.detect import detect

    options = choose_options(True, heading, alignment, truth, None, calibration, mag_axes=mag_axes)
    reading = choose_reading(format, columns, rate, sensor)
    with answering(json, quiet) as answer:
        answer(detect(file, gates, options, place, reading, out, force))


@verbs.command()
def allan(
    file: given.RecordingPath,
    format: given.FormatName = None, columns: given.ColumnMapping = None, rate: given.FileRate = None,
    sensor: given.SensorName = None,
    out: given.OutDir = None, force: given.Force = False,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Say how noisy the sensor is, from a recording of it lying still: allan.json, allan.png."""
    from fg_nav.commands import choose_reading
    from fg_nav.commands.calibrate import allan

    reading = choose_reading(format, columns, rate, sensor)
    with answering(json, quiet) as answer:
        answer(allan(file, reading, out, force))


@verbs.command()
def stream(
    source: given.SourceName, second: given.SecondSource = None,
    lag: given.Lag = None, heading: given.Heading = None, no_mag: given.NoMag = False, gate: given.GateName = None,
    fixes: given.FixesPath = None, calibration: given.CalibrationPath = None, mag_axes: given.MagAxesWords = None,
    mount: given.StreamMount = "foot", clock_offset: given.StreamClockOffset = None,
    step_constant: given.StepConstant = None, serve: given.ServedPort = None, view: given.ViewPage = False,
    host: given.ViewHost = "127.0.0.1", port: given.ViewPort = 8642,
    baud: Annotated[int, typer.Option(help="Of a serial device.")] = 115200,
    columns: given.ColumnNames = None, units: given.UnitNames = None, rate: given.RowRate = None,
    speed: given.ReplaySpeed = None, record: given.RecordPath = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the walk of --record, if it is there.")] = False,
    silence: given.Silence = None,
    plots: given.PlotsChoice = "html",
    out: given.EndDir = None, polish: given.Polish = False, force: given.Force = False,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Follow a sensor while it is walked with: one JSON line a footfall or stride, and at the end the whole walk.

    Reads canonical CSV, the header line first, or rows of --columns. Ctrl-C ends the walk and writes its result.
    """
    from fg_nav.commands.stream import check_sources, stream, stream_feet
    from fg_nav.detection.mount import Wearing
    from fg_nav.online.feet_follow import FeetStreamRequest
    from fg_nav.online.follow import StreamRequest

    right = check_sources(second, clock_offset, mount)
    worn: Wearing = "foot" if mount == "feet" else mount
    request = StreamRequest(
        source, lag, heading, not no_mag, gate, calibration, serve, baud, silence, mag_axes, polish,
        (host, port) if view else None, columns, units, rate, worn, fixes, step_constant,
        speed, record, resume, force,
    )  # fmt: skip
    with answering(json, quiet) as answer:
        if right is not None:
            feet = FeetStreamRequest(request, right, clock_offset or 0.0)
            answer(stream_feet(feet, out, force, lines=not (json or quiet)))
            return
        answer(stream(request, plots, out, force, lines=not (json or quiet)))
