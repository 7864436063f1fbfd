"""Verbs for a recorded walk: inspect, convert, run, export, compare, demo."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fg_nav.cli import options as given
from fg_nav.cli.options import answering
from fg_nav.report.export import EXPORTS

if TYPE_CHECKING:
    from fg_nav.changes import Changes
    from fg_nav.commands.config import Config

verbs = typer.Typer()


@verbs.command()
def inspect(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", show_default=False, help="Files with a recording each.")
    ],
    format: given.FormatName = None, columns: given.ColumnMapping = None, rate: given.FileRate = None,
    sensor: given.SensorName = None, barometer: given.BarometerPath = None,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Say what a file holds, and whether it can be navigated with; of several files in a table."""
    from fg_nav.commands import choose_reading
    from fg_nav.commands.inspect import inspect

    reading = choose_reading(format, columns, rate, sensor, barometer)
    with answering(json, quiet) as answer:
        answer(inspect(files, reading))


@verbs.command()
def convert(
    file: given.RecordingPath,
    out: Annotated[
        Path, typer.Argument(metavar="OUT", show_default=False, help="File to write: .csv, .csv.gz or .parquet.")
    ],
    format: given.FormatName = None, columns: given.ColumnMapping = None, rate: given.FileRate = None,
    sensor: given.SensorName = None, barometer: given.BarometerPath = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an older file.")] = False,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Write a recording's samples, in SI and as they are, as canonical CSV or Parquet."""
    from fg_nav.commands import choose_reading
    from fg_nav.commands.convert import convert

    reading = choose_reading(format, columns, rate, sensor, barometer)
    with answering(json, quiet) as answer:
        answer(convert(file, out, reading, force))


@verbs.command()
def run(
    recordings: given.RecordingPaths,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=f"{given.METHOD_WORDS} \\[default: smoother, or pocket]",
            autocompletion=given.complete_methods,
        ),
    ] = None,
    mount: given.MountPlaces = "foot", sides: given.FeetSides = None, clock_offset: given.ClockOffset = None,
    step_constant: given.StepConstant = None, known_distance: given.KnownDistance = None,
    no_mag: given.NoMag = False, heading: given.Heading = None, truth: given.TruthPath = None,
    calibration: given.CalibrationPath = None, mag_axes: given.MagAxesWords = None, gate: given.GateName = None,
    magnetic: given.MagneticFactors = "all", preset: given.Preset = "tuned", fixes: given.FixesPath = None,
    gnss: given.GnssSource = None, places: given.KnownPlaces = None, save_places: given.PlacesToSave = None,
    polish: given.Polish = False,
    format: given.FormatName = None, columns: given.ColumnMapping = None, rate: given.FileRate = None,
    sensor: given.SensorName = None, barometer: given.BarometerPath = None, alignment: given.AlignmentMode = "yaw",
    plots: given.PlotsChoice = "html",
    out: given.OutDir = None, force: given.ForceAll = False, strict: given.Strict = False,
    config: given.ConfigPath = None, settings: given.Settings = None,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Run one method on each recording and write trajectory, strides, summary and report.html; on two, of both feet."""
    from fg_nav.commands import choose_options, choose_reading
    from fg_nav.commands.run import RunRequest, check_feet_options, check_methods, run, set_mount
    from fg_nav.estimators import DEFAULT_METHOD

    both, worn = mount == "feet", "foot" if mount == "feet" else mount
    method = method or DEFAULT_METHOD[worn]
    check_feet_options(both, method, sides, clock_offset)
    check_methods([method], gate, polish, magnetic)
    known, changes = _read_parameters(config, settings, [method], worn, preset)
    files = (None, None) if both else (truth, calibration)
    options = choose_options(
        not no_mag, heading, alignment, files[0], gate, files[1], preset, fixes, mag_axes, polish, changes, places,
        magnetic, gnss,
    )  # fmt: skip
    options = set_mount(options, worn, (step_constant, known_distance), gate, preset)
    reading = choose_reading(format, columns, rate, sensor, barometer)
    request = RunRequest(method, options, reading, plots, out, force, strict, known, save_places)
    with answering(json, quiet) as answer:
        if both:
            from fg_nav.commands.run import FeetRequest, run_feet

            answer(run_feet(recordings, FeetRequest(request, sides, clock_offset, truth, calibration)))
        else:
            answer(run(recordings, request))


def _read_parameters(
    config: Path | None, settings: list[str] | None, methods: list[str], mount: str, preset: str
) -> tuple[Config | None, Changes]:
    """Return the configuration, and the parameters that it and `--set` give to the methods."""
    if config is None and not settings:
        return None, ()
    from fg_nav.commands.config import choose_changes, read_config

    known = None if config is None else read_config(config)
    return known, choose_changes(known, settings or (), methods, mount, preset)


@verbs.command()
def export(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", show_default=False, help="Of a result of `fg-nav run`.")],
    out: Annotated[
        list[Path],
        typer.Argument(
            metavar="OUT...",
            show_default=False,
            help=f"Files to write, by their endings: {', '.join(map(str, EXPORTS.values()))}.",
        ),
    ],
    origin: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON[,HEIGHT]", help="Where the foot first stood, for maps: degrees north and east, m."
        ),
    ] = None,
    turn: Annotated[
        float, typer.Option(metavar="DEG", help="Turn the path clockwise about the start, as by the declination.")
    ] = 0.0,
    start: Annotated[
        str | None,
        typer.Option(
            metavar="ISO",
            help="Instant of the first stamp, as 2026-05-04T09:30:00Z. \\[default: known where stamps are since 1970]",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace older files.")] = False,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Write the path of a result for other programs: maps, MATLAB, tables, ROS, Rerun."""
    from fg_nav.commands.convert import export

    with answering(json, quiet) as answer:
        answer(export(folder, out, origin, turn, start, force))


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
    no_mag: given.NoMag = False, heading: given.Heading = None, truth: given.TruthPath = None,
    calibration: given.CalibrationPath = None, mag_axes: given.MagAxesWords = None, gate: given.GateName = None,
    preset: given.Preset = "tuned",
    format: given.FormatName = None, columns: given.ColumnMapping = None, rate: given.FileRate = None,
    sensor: given.SensorName = None, barometer: given.BarometerPath = None, alignment: given.AlignmentMode = "yaw",
    plots: given.PlotsChoice = "html",
    out: given.OutDir = None, force: given.Force = False, config: given.ConfigPath = None,
    settings: given.Settings = None,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Run several methods on the same recording and the same stances, and lay them side by side in report.html."""
    from fg_nav.commands import choose_options, choose_reading
    from fg_nav.commands.run import check_methods, compare

    names = list(dict.fromkeys(name.strip() for name in methods.split(",")))
    check_methods(names, gate)
    known, changes = _read_parameters(config, settings, names, "foot", preset)
    options = choose_options(
        not no_mag, heading, alignment, truth, gate, calibration, preset, mag_axes=mag_axes, changes=changes
    )
    if known is not None:
        from fg_nav.commands.config import bind_to_recording

        options = bind_to_recording(options, known, recording)
    reading = choose_reading(format, columns, rate, sensor, barometer)
    with answering(json, quiet) as answer:
        answer(compare(recording, names, options, reading, plots, out, force))


@verbs.command()
def demo(
    seed: given.Seed = 1, view: given.ViewPage = False, speed: given.Speed = 1.0,
    host: given.ViewHost = "127.0.0.1", port: given.ViewPort = 8642, plots: given.PlotsChoice = "html",
    out: given.OutDir = None, force: given.Force = False,
    json: given.Json = False, quiet: given.Quiet = False,
) -> None:  # fmt: skip
    """Simulate four minutes of walking and compare the methods on them; with --view show them as they are walked."""
    with answering(json, quiet) as answer:
        if view:
            from fg_nav.commands.stream import view_demo

            view_demo(seed, speed, host, port)
        else:
            from fg_nav.commands.run import demo

            answer(demo(seed, plots, out, force))
