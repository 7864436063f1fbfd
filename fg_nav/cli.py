"""The command line: its verbs; what they do is in `fg_nav.commands`, options of several verbs in `cli_options`.

`main` is the one error boundary. Exit codes: 0 done; 1 the input or the output is to blame, said in one
line on standard error; 2 the command was not understood; 70 a bug, with its traceback; 130 interrupted.
"""

from __future__ import annotations

import io
import sys
import traceback
from pathlib import Path
from typing import Annotated, Literal, NoReturn

import typer

from fg_nav import cli_options as given
from fg_nav.errors import FgNavError

EXIT_USER, EXIT_BUG, EXIT_INTERRUPTED = 1, 70, 130

app = typer.Typer(
    name="fg-nav", add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False,
    help="Turn the recording of a foot-mounted inertial sensor into a trajectory with uncertainties.",
)  # fmt: skip


def main() -> NoReturn:
    """Run the command line and exit."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file name the terminal cannot show is no bug
    try:
        app()
    except FgNavError as error:
        _leave(_one_line(error), EXIT_USER)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        where = "" if error.filename is None else f" ({error.filename})"
        _leave(f"the system refused: {reason.lower()}{where}; check path, permissions and free space.", EXIT_USER)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)
    except Exception as error:
        traceback.print_exc()
        _leave(f"this is a bug ({type(error).__name__}): please report it with the lines above.", EXIT_BUG)
    sys.exit(0)


@app.callback(invoke_without_command=True)
def _program(version: Annotated[bool, typer.Option("--version", help="Show the version.")] = False) -> None:
    if version:
        from fg_nav.text import find_version

        typer.echo(f"fg-nav {find_version()}")
        raise typer.Exit


@app.command()
def inspect(
    file: Annotated[Path, typer.Argument(metavar="FILE", show_default=False, help="File with a recording.")],
    format: given.FormatName = None,
) -> None:
    """Say what a file holds, and whether it can be navigated with."""
    from fg_nav.commands.inspect import inspect

    inspect(file, format)


@app.command()
def run(
    recording: given.RecordingPath,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=f"{given.METHOD_NAMES}. With --mount pocket: {given.POCKET_METHOD_NAMES}. "
            "\\[default: smoother, or pocket]",
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
    alignment: given.AlignmentMode = "yaw",
    out: given.OutDir = None,
    force: given.Force = False,
    strict: given.Strict = False,
) -> None:
    """Run one method on a recording and write trajectory, strides, summary and pictures."""
    from fg_nav.commands import choose_options
    from fg_nav.commands.run import check_methods, check_mount, run

    lengths_m = (step_constant, known_distance)
    check_mount(mount, lengths_m, gate, preset)
    check_methods([method], gate, polish)
    options = choose_options(not no_mag, heading, alignment, truth, gate, calibration, preset, fixes, mag_axes, polish)
    run(recording, method, mount, options, lengths_m, format, out, force, strict)


@app.command()
def compare(
    recording: given.RecordingPath,
    methods: Annotated[
        str, typer.Option(metavar="A,B", help=f"Methods, with commas between: {given.METHOD_NAMES}.")
    ] = "smoother,iez",
    no_mag: given.NoMag = False,
    heading: given.Heading = None,
    truth: given.TruthPath = None,
    calibration: given.CalibrationPath = None,
    mag_axes: given.MagAxesWords = None,
    gate: given.GateName = None,
    preset: given.Preset = "tuned",
    format: given.FormatName = None,
    alignment: given.AlignmentMode = "yaw",
    out: given.OutDir = None,
    force: given.Force = False,
) -> None:
    """Run several methods on the same recording and the same stances, and lay them side by side."""
    from fg_nav.commands import choose_options
    from fg_nav.commands.run import check_methods, compare

    check_methods(methods.split(","), gate)
    options = choose_options(not no_mag, heading, alignment, truth, gate, calibration, preset, mag_axes=mag_axes)
    compare(recording, methods, options, format, out, force)


@app.command()
def demo(
    seed: given.Seed = 1,
    view: given.ViewPage = False,
    speed: given.Speed = 1.0,
    host: given.ViewHost = "127.0.0.1",
    port: given.ViewPort = 8642,
    out: given.OutDir = None,
    force: given.Force = False,
) -> None:
    """Simulate one minute of walking and compare the methods on it; with --view show it as it is walked."""
    from fg_nav.commands.run import demo
    from fg_nav.commands.view import view_demo

    if view:
        view_demo(seed, speed, host, port)
    else:
        demo(seed, out, force)


@app.command()
def calibrate(
    file: given.RecordingPath,
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
    force: Annotated[bool, typer.Option("--force", help="Replace an older calibration.")] = False,
) -> None:
    """Find the magnetometer's errors, and at rest those of gyroscope and accelerometer; write a calibration."""
    from fg_nav.commands.calibrate import calibrate

    calibrate(file, out, method, strength, place, mag_axes, format, force)


@app.command()
def detect(
    file: given.RecordingPath,
    gates: given.GateNames = None,
    calibration: given.CalibrationPath = None,
    mag_axes: given.MagAxesWords = None,
    heading: given.Heading = None,
    place: given.PlaceWords = None,
    truth: given.TruthPath = None,
    format: given.FormatName = None,
    alignment: given.AlignmentMode = "yaw",
    out: given.OutDir = None,
    force: given.Force = False,
) -> None:
    """Look at the magnetic field along a walk, and at what each detector makes of it: field.png, field_map.png.

    `--gate munoz-diaz` alone needs no footfalls: it judges the samples, of a sensor in a pocket too.
    """
    from fg_nav.commands import choose_options
    from fg_nav.commands.detect import detect

    options = choose_options(True, heading, alignment, truth, None, calibration, mag_axes=mag_axes)
    detect(file, gates, options, place, format, out, force)


@app.command()
def allan(
    file: given.RecordingPath,
    format: given.FormatName = None,
    out: given.OutDir = None,
    force: given.Force = False,
) -> None:
    """Say how noisy the sensor is, from a recording of it lying still: allan.json, allan.png."""
    from fg_nav.commands.allan import allan

    allan(file, format, out, force)


@app.command()
def stream(
    source: given.SourceName,
    checkpoint: given.CheckpointPath = None,
    every: Annotated[float, typer.Option(metavar="SECONDS", help="Between two saves.")] = 10.0,
    lag: given.Lag = None,
    heading: given.Heading = None,
    no_mag: given.NoMag = False,
    gate: given.GateName = None,
    fixes: given.FixesPath = None,
    calibration: given.CalibrationPath = None,
    mag_axes: given.MagAxesWords = None,
    mount: given.MountPlace = "foot",
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
    out: given.EndDir = None,
    polish: given.Polish = False,
    force: given.Force = False,
) -> None:
    """Follow a sensor while it is walked with: one JSON line a footfall or stride, and at the end the whole walk.

    Reads canonical CSV, the header line first, or rows of --columns. Ctrl-C ends the walk and writes its result.
    """
    from fg_nav.commands.stream import stream
    from fg_nav.online.follow import StreamRequest

    request = StreamRequest(
        source, checkpoint, every, lag, heading, not no_mag, gate, calibration, serve, baud, silence, mag_axes, polish,
        (host, port) if view else None, columns, units, rate, mount, fixes, step_constant,
        speed, record, force,
    )  # fmt: skip
    stream(request, out, force)


def _list_scenarios(wanted: bool) -> None:
    if wanted:
        from fg_nav.commands.simulate import print_scenarios

        print_scenarios()
        raise typer.Exit


@app.command()
def simulate(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", show_default=False, help="Its name, or a .toml file with one.")
    ],
    seed: given.Seed = 1,
    list_all: Annotated[
        bool, typer.Option("--list", help="Say what there is to choose from.", is_eager=True, callback=_list_scenarios)
    ] = False,
    sensor: Annotated[str | None, typer.Option(metavar="NAME", help="Another sensor.")] = None,
    field: Annotated[str | None, typer.Option(metavar="NAME", help="Another field.")] = None,
    site: Annotated[
        str | None, typer.Option(metavar="NAME", help="Another site, or latitude,longitude,YYYY-MM-DD.")
    ] = None,
    worn: Annotated[
        Literal["heel", "instep", "pocket", "table"] | None, typer.Option(help="Another place to wear it.")
    ] = None,
    rate: Annotated[float | None, typer.Option(metavar="HZ", help="Another rate of the recording.")] = None,
    turn: Annotated[float, typer.Option(metavar="DEG", help="Turn the whole course clockwise.")] = 0.0,
    calibrated: Annotated[
        bool, typer.Option("--calibrated", help="A perfectly calibrated magnetometer: only noise is left.")
    ] = False,
    rests: Annotated[
        Literal["still", "rocking", "none"] | None,
        typer.Option(help="What the foot does where the person stands; none: there is no standing."),
    ] = None,
    feet: given.FeetWord = None,
    out: given.OutDir = None,
    force: given.Force = False,
) -> None:
    """Simulate a walk with its truth: recording.csv, truth.tum, truth.json, landmarks.csv, map.png."""
    from fg_nav.commands.simulate import simulate
    from fg_nav.lab.simulation import Choices

    choices = Choices(sensor, site, field, worn, rate, turn, calibrated, rests=rests, feet=feet)
    simulate(scenario, seed, choices, out, force)


@app.command()
def campaign(
    plan: Annotated[Path, typer.Argument(metavar="FILE.toml", show_default=False, help="What is to be made.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder of the campaign. \\[default: results/ and the file's name]"),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Of a Dask cluster. \\[default: one of our own]")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Processes of our own. \\[default: one a core]")
    ] = None,
    renew: Annotated[bool, typer.Option("--renew", help="Make again what other code made.")] = False,
    retry: Annotated[bool, typer.Option("--retry", help="Make again what failed.")] = False,
) -> None:
    """Try methods on many walks, simulated and recorded; the same command goes on with what was stopped."""
    from fg_nav.commands import RESULTS
    from fg_nav.commands.campaign import campaign
    from fg_nav.lab.campaign.command import Request

    campaign(Request(plan, out or RESULTS / plan.stem, scheduler, workers, renew, retry))


@app.command()
def reproduce(
    paper: Annotated[
        Literal["ma2018", "aiez2017", "munoz-diaz2017"], typer.Argument(show_default=False, help="Its short name.")
    ],
    quick: Annotated[bool, typer.Option("--quick", help="3 seeds, and only what takes minutes.")] = False,
    seeds: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="How many walks of each kind. \\[default: 50, quick 3]")
    ] = None,
    first: Annotated[int, typer.Option(metavar="SEED", min=0, help="given.Seed of the first walk.")] = 101,
    workers: Annotated[int | None, typer.Option(metavar="N", min=1, help="Processes. \\[default: one a core]")] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder for the result. \\[default: results/reproduce-PAPER]"),
    ] = None,
    force: given.Force = False,
) -> None:
    """Lay the experiments of a paper beside ours, from simulated walks: report.html, results.json, pictures.

    A run that was ended goes on from there with the same command.
    """
    from fg_nav.commands import RESULTS
    from fg_nav.lab.reproduce.command import reproduce

    reproduce(paper, out or RESULTS / f"reproduce-{paper}", seeds, first, workers, quick, force)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _leave(words: str, code: int) -> NoReturn:
    print(f"fg-nav: {words}", file=sys.stderr)  # noqa: T201
    sys.exit(code)


if __name__ == "__main__":
    main()
