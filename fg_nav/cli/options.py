"""Options of the command line that several verbs have: their types for typer, with their help; how answers are printed.

An answer is printed for people, as JSON for scripts (`--json`), or not at all (`--quiet`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from fg_nav.report import Plots

if TYPE_CHECKING:
    from fg_nav.commands import Answer

METHODS = ("smoother", "card", "inertial", "online", "iez", "qsf", "qsf-stance", "iqsf", "ma2018", "aiez", "matched")
POCKET_METHODS = ("pocket", "munoz-diaz2017", "online")
PRESETS = ("tuned", "physical", "as-printed")
PRINTED = ("qsf-printed", "iqsf-printed", "ma2018-printed", "aiez-printed")
DETECTORS = ("qsf", "iqsf", "ma2018", "aiez", "qsf-stance", *PRINTED)
GATES = (*DETECTORS, "none", *(f"{name}:hard" for name in DETECTORS))
SURVEYED = (*DETECTORS, "munoz-diaz", "all")  # For help and completion, without loading methods; tests compare them.


def _list_words(names: tuple[str, ...]) -> str:
    return f"{', '.join(names[:-1])} or {names[-1]}"


METHOD_NAMES = f"{_list_words(METHODS)}; all but the first four also smoothed, as `iez-rts`"
METHOD_WORDS = f"{METHOD_NAMES}. With --mount pocket: {_list_words(POCKET_METHODS)}."


def _complete(*names: str, keys_of: str = "") -> Callable[[str], list[str]]:
    """Return a completer of the last word in a comma list to `names`, or to the keys of the table `module.NAME`."""

    def complete(incomplete: str) -> list[str]:
        module, _, table = keys_of.rpartition(".")
        known = getattr(import_module(module), table) if table else names
        before, comma, last = incomplete.rpartition(",")
        return [before + comma + name for name in known if name.startswith(last)]

    return complete


_RTS = tuple(f"{name}-rts" for name in METHODS[4:])
complete_methods = _complete(*METHODS, *POCKET_METHODS[:-1], *_RTS)
complete_foot_methods = _complete(*METHODS, *_RTS)
complete_scenarios = _complete(keys_of="fg_nav.lab.simulation.scenarios.SCENARIOS")


def _complete_settings(incomplete: str) -> list[str]:
    owners = [f"{name}." for name in ("smoother", *METHODS[4:], "detector")]
    begun = [owner for owner in owners if owner.startswith(incomplete) or incomplete.startswith(owner)]
    if len(begun) != 1:
        return begun
    from fg_nav.commands.config import list_settings

    return [f"{name}=" for name in list_settings(begun[0][:-1]) if name.startswith(incomplete)]


def _take_config(context: typer.Context, path: Path | None) -> Path | None:
    """Make what a configuration says the defaults of the other options."""
    if path is not None and not context.resilient_parsing:
        from fg_nav.commands.config import list_defaults, read_config

        context.default_map = list_defaults(read_config(path))
    return path


ConfigPath = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        is_eager=True,
        callback=_take_config,
        help="Do as this config.json of a result says; other options still win.",
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        autocompletion=_complete_settings,
        help="A parameter as `config.json` shows it, such as smoother.magnetic.rounds=3 or detector.threshold=1e4; "
        "again for more.",
    ),
]
RecordingPaths = Annotated[
    list[Path], typer.Argument(metavar="RECORDING...", show_default=False, help="Files with a recording each.")
]
RecordingPath = Annotated[
    Path, typer.Argument(metavar="RECORDING", show_default=False, help="File with the recording.")
]
FormatName = Annotated[
    str | None,
    typer.Option(
        "--format",
        metavar="NAME",
        help="Its format. \\[default: recognised from the content]",
        autocompletion=_complete(keys_of="fg_nav.io.formats.FORMATS"),
    ),
]
PlotsChoice = Annotated[
    Plots,
    typer.Option("--plots", help="What is drawn: html, the page report.html; png, a picture of each part; all, both."),
]
NoMag = Annotated[
    bool,
    typer.Option("--no-mag", help="Ignore the magnetometer: no verdicts on the field, and no filter with a compass."),
]
MagAxesWords = Annotated[
    str | None,
    typer.Option(
        "--mag-axes",
        metavar="X,Y,Z",
        help="Axes of the magnetometer that are the gyroscope's x, y and z, such as --mag-axes=-y,x,z.",
    ),
]
CalibrationPath = Annotated[
    Path | None,
    typer.Option(
        "--calibration", metavar="FILE", help="Calibration to apply, from `fg-nav calibrate`; with --mount feet A,B."
    ),
]
GateName = Annotated[
    str | None,
    typer.Option(
        "--gate",
        metavar="NAME",
        help=f"Detector that weighs the field at a footfall: {', '.join(GATES[:5])} or none, which weighs all "
        "alike; with :hard behind it, ma2018:hard, it passes a footfall or not. `fg-nav detect` shows them. "
        "\\[default: ma2018]",
        autocompletion=_complete(*GATES),
    ),
]
MagneticFactors = Annotated[
    Literal["all", "card"],
    typer.Option(
        "--magnetic",
        help="Factors of the field in the graph: all, or card, those of the magnetic heading and of the differential "
        "field alone.",
    ),
]
Polish = Annotated[
    bool, typer.Option("--polish", help="Solve the walk in batch too at its end: trajectory_polished.tum.")
]
Preset = Annotated[
    str,
    typer.Option(
        "--preset",
        metavar="NAME",
        help=f"Parameters of the filters: {_list_words(PRESETS)}. The smoother has no presets.",
        autocompletion=_complete(*PRESETS),
    ),
]
PlaceWords = Annotated[
    str | None,
    typer.Option("--place", metavar="LAT,LON,YYYY-MM-DD", help="Where and when: the field of the Earth there."),
]
Heading = Annotated[
    float | None,
    typer.Option(
        "--heading",
        metavar="DEG",
        help="Heading at the start, degrees clockwise from north: of the sensor's x axis, or of the first strides with "
        "--mount pocket, or of the left sensor with --mount feet. "
        "\\[default: what the compass says, in a method that uses it; else 0]",
    ),
]
TruthPath = Annotated[
    Path | None,
    typer.Option(
        "--truth",
        metavar="FILE",
        help="True path or footprints; with --mount feet A,B. \\[default: what the recording carries]",
    ),
]
FixesPath = Annotated[
    Path | None,
    typer.Option(
        "--fixes",
        metavar="FILE",
        help="Known positions for the smoother: CSV time_s,x_m,y_m,z_m,sigma_m, m east, north and up of the start.",
    ),
]
GnssSource = Annotated[
    Path | None,
    typer.Option(
        "--gnss",
        metavar="own|FILE",
        help="Fixes of a receiver: `own` for the Location.csv in the recording; a folder or zip with one; or a CSV "
        "time_s,latitude,longitude,accuracy. For the smoother and --mount pocket.",
    ),
]
KnownPlaces = Annotated[
    Path | None,
    typer.Option(
        "--places",
        metavar="FILE",
        help="Places of an earlier walk in the same building: this one is located on them, by the smoother.",
    ),
]
PlacesToSave = Annotated[
    Path | None,
    typer.Option("--save-places", metavar="FILE", help="Save the places of this walk, for --places of later ones."),
]
AlignmentMode = Annotated[
    Literal["yaw", "none", "origin", "se3"],
    typer.Option("--alignment", help="How the solution is laid on the truth before errors are counted."),
]
MountPlaces = Annotated[
    Literal["foot", "feet", "pocket"],
    typer.Option(
        "--mount",
        help="Where the sensor was worn; a pocket is one of trousers. feet: a sensor on each foot, two recordings of "
        "one walk.",
    ),
]
FeetSides = Annotated[
    Literal["left,right", "right,left"] | None,
    typer.Option(
        "--sides",
        help="Feet of the two recordings of --mount feet, in their order. "
        "\\[default: as the steps show; else left,right]",
    ),
]
ClockOffset = Annotated[
    float | None,
    typer.Option(
        "--clock-offset",
        metavar="SECONDS",
        help="To add to the stamps of the second recording of --mount feet. \\[default: as the signals of both show]",
    ),
]
ColumnMapping = Annotated[
    str | None,
    typer.Option(
        "--columns",
        metavar="MAPPING",
        help="Which columns of a table are what, by name or number: "
        "time=ts\\[ms],acc=ax:ay:az\\[g],gyr=gx:gy:gz\\[deg/s],mag=mx:my:mz\\[G]. \\[default: by the header]",
    ),
]
FileRate = Annotated[
    str | None,
    typer.Option(
        "--rate",
        metavar="HZ[+-HZ]",
        help="Of a file without a clock: its samples are counted. With a sigma behind it, 200+-0.1. \\[default: 2 %]",
    ),
]
SensorName = Annotated[
    str | None, typer.Option("--sensor", metavar="NAME", help="Which of several sensors in the file.")
]
BarometerPath = Annotated[
    Path | None,
    typer.Option(
        "--barometer",
        metavar="FILE",
        help="Pressure of the air in a file of its own: time_s,pressure_pa (or _hpa), in the recording's clock.",
    ),
]
ColumnNames = Annotated[
    str | None,
    typer.Option(
        "--columns",
        metavar="MAPPING",
        help="Which fields of a row are what: time=1\\[ms],acc=2:3:4\\[g],gyr=5:6:7\\[deg/s], or all in order, of "
        "t,ax,ay,az,gx,gy,gz,mx,my,mz,p; - is passed over.",
    ),
]
UnitNames = Annotated[
    str | None,
    typer.Option(
        "--units", metavar="A,B", help="Of these columns, such as ms,g,deg/s,gauss. \\[default: s,m/s2,rad/s,uT]"
    ),
]
RowRate = Annotated[
    float | None, typer.Option("--rate", metavar="HZ", help="Of rows without t: their stamps are counted.")
]
ReplaySpeed = Annotated[
    str | None,
    typer.Option(
        "--speed",
        metavar="FACTOR",
        help="SOURCE is a whole recording: replay it so many times as fast as it was walked, or max.",
    ),
]
RecordPath = Annotated[
    Path | None, typer.Option("--record", metavar="FILE", help="Record the samples as they come, and the lines.")
]
StepConstant = Annotated[
    float | None,
    typer.Option("--step-constant", metavar="M", help="Of the person, with --mount pocket: a step over its opening."),
]
KnownDistance = Annotated[
    float | None,
    typer.Option(
        "--known-distance", metavar="M", help="Walked in this recording, with --mount pocket: finds the step constant."
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace an older result in the folder.")]
ForceAll = Annotated[
    bool, typer.Option("--force", help="Replace an older result in the folder, and the file of --save-places.")
]
Strict = Annotated[bool, typer.Option("--strict", help="Exit with 1 if the path is not to be used; it is written.")]
Seed = Annotated[int, typer.Option(min=0, help="Draws person, sensor, walk, field and noise.")]
OutDir = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Folder for the result. \\[default: a fresh one under results/]"),
]
GateNames = Annotated[
    str | None,
    typer.Option(
        "--gate",
        metavar="A,B",
        help="Detectors, with commas between, or `all`. \\[default: all but the printed]",
        autocompletion=_complete(*SURVEYED),
    ),
]
SourceName = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        show_default=False,
        help="- for standard input, a file that grows, a serial device, or tcp, tcp-listen or udp and ://host:port.",
    ),
]
SecondSource = Annotated[
    str | None,
    typer.Argument(
        metavar="[RIGHT]", show_default=False, help="With --mount feet, the right foot's; SOURCE is the left's."
    ),
]
StreamMount = Annotated[
    Literal["foot", "feet", "pocket"],
    typer.Option(
        "--mount", help="Where the sensor is worn; a pocket is one of trousers. feet: one on each foot, two sources."
    ),
]
StreamClockOffset = Annotated[
    float | None,
    typer.Option("--clock-offset", metavar="SECONDS", help="To add to the stamps of the right foot of --mount feet."),
]
ViewPage = Annotated[bool, typer.Option("--view", help="Show the walk on a page, for a browser on this machine.")]
ViewHost = Annotated[
    str,
    typer.Option(
        "--host",
        metavar="HOST",
        help="Address of this machine that shows the page; 0.0.0.0 lets all who reach it see it.",
    ),
]
ViewPort = Annotated[int, typer.Option("--port", metavar="PORT", help="Of the page; 0 for a free one.")]
Lag = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="Forget what is older. \\[default: keep the whole walk]")
]
ServedPort = Annotated[
    int | None, typer.Option(metavar="PORT", help="Serve the lines on this port of 127.0.0.1, and print none.")
]
Silence = Annotated[float | None, typer.Option(metavar="SECONDS", help="End the walk after so long without a row.")]
Speed = Annotated[float, typer.Option(metavar="FACTOR", help="Of the walk that is shown; 1 is its own.")]
EndDir = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Folder for the result at the end. \\[default: lines]")
]
FeetWord = Annotated[
    Literal["still", "moving"] | None, typer.Option(help="Whether the loaded foot moves on, as real ones do.")
]
Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON document, for scripts, and nothing else on standard output.")
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]


@contextmanager
def answering(as_json: bool, quiet: bool) -> Iterator[Callable[[Answer], None]]:
    """Keep quiet while a verb works, if that was asked for; yields what prints its answer: for people, or as JSON."""
    from fg_nav.report.terminal import hush

    def show(answer: Answer) -> None:
        if as_json:
            from fg_nav.text import to_json

            typer.echo(json.dumps(to_json(answer.content), indent=2, allow_nan=False))
        elif not quiet:
            answer.show()
        if answer.failure is not None:
            raise answer.failure

    with hush(quiet):
        yield show
