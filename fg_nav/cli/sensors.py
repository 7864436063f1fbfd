"""Verbs for the sensor itself: calibrate, detect, allan."""

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
    place: given.PlaceWords = None,
    mag_axes: given.MagAxesWords = None,
    format: given.FormatName = None,
    columns: given.ColumnMapping = None,
    rate: given.FileRate = None,
    sensor: given.SensorName = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an older calibration.")] = False,
    json: given.Json = False,
    quiet: given.Quiet = False,
) -> None:
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
    file: given.RecordingPath,
    gates: given.GateNames = None,
    calibration: given.CalibrationPath = None,
    mag_axes: given.MagAxesWords = None,
    heading: given.Heading = None,
    place: given.PlaceWords = None,
    truth: given.TruthPath = None,
    format: given.FormatName = None,
    columns: given.ColumnMapping = None,
    rate: given.FileRate = None,
    sensor: given.SensorName = None,
    alignment: given.AlignmentMode = "yaw",
    out: given.OutDir = None,
    force: given.Force = False,
    json: given.Json = False,
    quiet: given.Quiet = False,
) -> None:
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
    format: given.FormatName = None,
    columns: given.ColumnMapping = None,
    rate: given.FileRate = None,
    sensor: given.SensorName = None,
    out: given.OutDir = None,
    force: given.Force = False,
    json: given.Json = False,
    quiet: given.Quiet = False,
) -> None:
    """Say how noisy the sensor is, from a recording of it lying still: allan.json, allan.png."""
    from fg_nav.commands import choose_reading
    from fg_nav.commands.calibrate import allan

    reading = choose_reading(format, columns, rate, sensor)
    with answering(json, quiet) as answer:
        answer(allan(file, reading, out, force))
