"""Verbs for a recorded walk: inspect, convert, run, compare, demo."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fg_nav.cli import options as given
from fg_nav.cli.output import answering

verbs = typer.Typer()


@verbs.command()
def inspect(
    file: Annotated[Path, typer.Argument(metavar="FILE", show_default=False, help="File with a recording.")],
    format: given.FormatName = None,
    columns: given.ColumnMapping = None,
    rate: given.FileRate = None,
    sensor: given.SensorName = None,
    json: given.Json = False,
    quiet: given.Quiet = False,
) -> None:
    """Say what a file holds, and whether it can be navigated with."""
    from fg_nav.commands import choose_reading
    from fg_nav.commands.inspect import inspect

    reading = choose_reading(format, columns, rate, sensor)
    with answering(json, quiet) as answer:
        answer(inspect(file, reading))


@verbs.command()
def convert(
    file: given.RecordingPath,
    out: Annotated[
        Path, typer.Argument(metavar="OUT", show_default=False, help="File to write: .csv, .csv.gz or .parquet.")
    ],
    format: given.FormatName = None,
    columns: given.ColumnMapping = None,
    rate: given.FileRate = None,
    sensor: given.SensorName = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an older file.")] = False,
    json: given.Json = False,
    quiet: given.Quiet = False,
) -> None:
    """Write a recording's samples, in SI and as they are, as canonical CSV or Parquet."""
    from fg_nav.commands import choose_reading
    from fg_nav.commands.convert import convert

    reading = choose_reading(format, columns, rate, sensor)
    with answering(json, quiet) as answer:
        answer(convert(file, out, reading, force))


@verbs.command()
def run(
    recording: given.RecordingPath,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=f"{given.METHOD_WORDS} \\[default: smoother, or pocket]",
            autocompletion=given.complete_methods,
        ),
    ] = None,
    mount: given.MountPlace = "foot",
    step_constant: given.StepConstant = None,
    known_distance: given.KnownDistance = None,
    no_mag: given.NoMag = False,
    heading: given.Heading = None,
    truth: given.TruthPath = None,
    calibration: given.CalibrationPath = None,
    mag_axes: given.MagAxesWords = None,
    gate: given.GateName = None,
    preset: given.Preset = "tuned",
    fixes: given.FixesPath = None,
    polish: given.Polish = False,
    format: given.FormatName = None,
    columns: given.ColumnMapping = None,
    rate: given.FileRate = None,
    sensor: given.SensorName = None,
    alignment: given.AlignmentMode = "yaw",
    out: given.OutDir = None,
    force: given.Force = False,
    strict: given.Strict = False,
    json: given.Json = False,
    quiet: given.Quiet = False,
) -> None:
    """Run one method on a recording and write trajectory, strides, summary and pictures."""
    from fg_nav.commands import choose_options, choose_reading
    from fg_nav.commands.run import check_methods, check_mount, run

    lengths_m = (step_constant, known_distance)
    check_mount(mount, lengths_m, gate, preset)
    check_methods([method], gate, polish)
    options = choose_options(not no_mag, heading, alignment, truth, gate, calibration, preset, fixes, mag_axes, polish)
    reading = choose_reading(format, columns, rate, sensor)
    with answering(json, quiet) as answer:
        answer(run(recording, method, mount, options, lengths_m, reading, out, force, strict))


@verbs.command()
def compare(
    recording: given.RecordingPath,
    methods: Annotated[
        str,
        typer.Option(
            metavar="A,B",
            help=f"Methods, with commas between: {given.METHOD_NAMES}.",
            autocompletion=given.complete_foot_methods,
        ),
    ] = "smoother,iez",
    no_mag: given.NoMag = False,
    heading: given.Heading = None,
    truth: given.TruthPath = None,
    calibration: given.CalibrationPath = None,
    mag_axes: given.MagAxesWords = None,
    gate: given.GateName = None,
    preset: given.Preset = "tuned",
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
    """Run several methods on the same recording and the same stances, and lay them side by side."""
    from fg_nav.commands import choose_options, choose_reading
    from fg_nav.commands.run import check_methods, compare

    check_methods(methods.split(","), gate)
    options = choose_options(not no_mag, heading, alignment, truth, gate, calibration, preset, mag_axes=mag_axes)
    reading = choose_reading(format, columns, rate, sensor)
    with answering(json, quiet) as answer:
        answer(compare(recording, methods, options, reading, out, force))


@verbs.command()
def demo(
    seed: given.Seed = 1,
    view: given.ViewPage = False,
    speed: given.Speed = 1.0,
    host: given.ViewHost = "127.0.0.1",
    port: given.ViewPort = 8642,
    out: given.OutDir = None,
    force: given.Force = False,
    json: given.Json = False,
    quiet: given.Quiet = False,
) -> None:
    """Simulate one minute of walking and compare the methods on it; with --view show it as it is walked."""
    from fg_nav.commands.run import demo
    from fg_nav.commands.view import view_demo

    with answering(json, quiet) as answer:
        if view:
            view_demo(seed, speed, host, port)
        else:
            answer(demo(seed, out, force))
