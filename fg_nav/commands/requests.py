"""What each verb of the command line is asked: a dataclass a verb, whose fields are its options with their help.

A base class has the options that several verbs share. `fg_nav.cli` makes a command of each class, with the docstring as
its help, and calls the function that `verb` names with an instance of it. Nothing heavy is imported here, so that the
help is quick: names for help and completion stand here too, and tests compare them with the tables.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import MISSING, dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias

import typer

from fg_nav.estimators import METHODS, RTS, list_methods, name_owners
from fg_nav.report import Plots
from fg_nav.report.export import EXPORTS
from fg_nav.text import DETECTOR

Completer: TypeAlias = Callable[[str], list[str]]

GROUPS = INPUT, METHOD, WALK, OUTPUT = "Input", "Method", "Walk", "Output"  # Of options in the help, in this order.

PRESETS = ("tuned", "physical", "as-printed")
PRINTED = ("qsf-printed", "iqsf-printed", "ma2018-printed", "aiez-printed")
DETECTORS = ("qsf", "iqsf", "ma2018", "aiez", "qsf-stance", *PRINTED)
GATES = (*DETECTORS, "none", *(f"{name}:hard" for name in DETECTORS))


def _list_words(names: Iterable[str]) -> str:
    *others, last = names
    return f"{', '.join(others)} or {last}"


_FILTERS = [name for name in METHODS["foot"] if name + RTS in METHODS["foot"]]
_USUAL = [name for name in METHODS["foot"] if name not in _FILTERS and not name.endswith(RTS)]
METHOD_NAMES = f"{_list_words(_USUAL)}; or a filter: {_list_words(_FILTERS)}, each also smoothed, as `iez{RTS}`"
METHOD_WORDS = f"{METHOD_NAMES}. With --mount pocket: {_list_words(METHODS['pocket'])}."
USUAL_METHODS = "smoother; inertial, without the field; iez, a filter; with --mount pocket: pocket. More: --help-all."

ALL_WORDS: dict[str, str] = {}  # Of `--help-all`, by the help in whose place they are.


def complete_by(list_names: Callable[[], Iterable[str]]) -> Completer:
    """Return a completer of the last word in a comma list to these names, which are made when they are needed."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [before + comma + name for name in list_names() if name.startswith(last)]

    return complete


complete_methods = complete_by(lambda: list_methods("foot") | list_methods("pocket"))
complete_foot_methods = complete_by(lambda: list_methods("foot"))
complete_formats = complete_by(lambda: import_module("fg_nav.io.formats").list_formats())


def _complete_settings(incomplete: str) -> list[str]:
    owners = [f"{name}." for name in (*name_owners(), DETECTOR)]
    begun = [owner for owner in owners if owner.startswith(incomplete) or incomplete.startswith(owner)]
    if len(begun) != 1:
        return begun
    from fg_nav.commands.config import list_settings

    return [f"{name}=" for name in list_settings(begun[0][:-1]) if name.startswith(incomplete)]


def _read_config(path: str) -> Any:
    from fg_nav.commands.config import read_config

    return read_config(Path(path))


def _take_defaults(context: typer.Context, config: Any) -> Any:
    """Make what a configuration (`fg_nav.commands.config.Config`) says the defaults of the other options."""
    if config is not None and not context.resilient_parsing:
        context.default_map = config.list_defaults()
    return config


def argument(metavar: str | None, help: str, default: Any = ..., **others: Any) -> Any:
    """Return a field that is an argument, required if it has no default; `others` as of `typer.Argument`."""
    info = typer.Argument(default, metavar=metavar, help=help, show_default=False, **others)
    return field(default=MISSING if default is ... else default, metadata={"typer": info})


def option(
    panel: str, help: str, metavar: str | None = None, default: Any = None, name: str | None = None, **others: Any
) -> Any:
    """Return a field that is an option in a group of the help, named as the field; `others` as of `typer.Option`.

    One that is `hidden`, or has other words in `everything`, is in the help by `--help-all`.
    """
    ALL_WORDS[help] = others.pop("everything", help)
    names = () if name is None else name.split(",")
    info = typer.Option(default, *names, metavar=metavar, help=help, rich_help_panel=panel, **others)
    return field(default=MISSING if default is ... else default, metadata={"typer": info})


def flag(panel: str, help: str, name: str) -> Any:
    """Return a field that is a flag in a group of the help."""
    return option(panel, help, default=False, name=name)


@dataclass(kw_only=True, repr=False, eq=False)
class Request:
    """How the answer of any verb is printed."""

    verb: ClassVar[str]  # Module and function.

    json: bool = flag(OUTPUT, "Print one JSON document, for scripts, and nothing else on standard output.", "--json")
    quiet: bool = flag(OUTPUT, "Print nothing but errors.", "--quiet")
    verbose: int = option(OUTPUT, "Say remarks as they arise; -vv: steps.", None, 0, "--verbose,-v", count=True)
    log: Path | None = option(OUTPUT, "Log all that into a file, with times and levels; at its end.", "FILE")


@dataclass(kw_only=True, repr=False, eq=False)
class ReadingOptions:
    """How a file is read whose content leaves it open."""

    format: str | None = option(
        INPUT, "Its format. \\[default: recognized from the content]", "NAME", autocompletion=complete_formats
    )
    columns: str | None = option(
        INPUT,
        "Which columns of a table are what, by name or number: "
        "time=ts\\[ms],acc=ax:ay:az\\[g],gyr=gx:gy:gz\\[deg/s],mag=mx:my:mz\\[G]. \\[default: by the header]",
        "MAPPING",
    )
    rate: str | None = option(
        INPUT,
        "Of a file without a clock: its samples are counted. With a sigma behind it, 200+-0.1. \\[default: 2 %]",
        "HZ[+-HZ]",
    )
    sensor: str | None = option(INPUT, "Which of several sensors in the file, by a word of its name.", "NAME")


@dataclass(kw_only=True, repr=False, eq=False)
class BarometerOptions:
    """What belongs to a recording and is in a file of its own."""

    barometer: Path | None = option(
        INPUT,
        "Pressure of the air in a file of its own: time_s,pressure_pa (or _hpa), in the recording's clock.",
        "FILE",
    )


@dataclass(kw_only=True, repr=False, eq=False)
class AxesOptions:
    """How a magnetometer lies beside the gyroscope."""

    mag_axes: str | None = option(
        INPUT, "Axes of the magnetometer that are the gyroscope's x, y and z, such as --mag-axes=-y,x,z.", "X,Y,Z"
    )


@dataclass(kw_only=True, repr=False, eq=False)
class SensorOptions(AxesOptions):
    """How a sensor was worn, and what is known of it."""

    heading: float | None = option(
        WALK,
        "Heading at the start, degrees clockwise from north: of the sensor's x axis, or of the first strides "
        "with --mount pocket. "
        "\\[default: what the compass says, in a method that uses it; else 0]",
        "DEG",
    )
    calibration: Path | None = option(INPUT, "Calibration to apply, from `fg-nav calibrate`.", "FILE")


@dataclass(kw_only=True, repr=False, eq=False)
class FieldOptions:
    """What is made of the magnetic field."""

    no_mag: bool = flag(
        METHOD, "Ignore the magnetometer: no verdicts on the field, and no filter with a compass.", "--no-mag"
    )
    gate: str | None = option(
        METHOD,
        f"Detector that weighs the field at a footfall: {', '.join(GATES[:5])} or none, which weighs all "
        "alike; with :hard behind it, ma2018:hard, it passes a footfall or not. `fg-nav detect` shows them. "
        "\\[default: ma2018]",
        "NAME",
        autocompletion=complete_by(lambda: GATES),
    )


@dataclass(kw_only=True, repr=False, eq=False)
class TruthOptions:
    """What the path is compared with."""

    truth: Path | None = option(WALK, "True path or footprints. \\[default: what the recording carries]", "FILE")
    alignment: Literal["yaw", "none", "origin", "se3"] = option(
        WALK, "How the solution is laid on the truth before errors are counted.", default="yaw"
    )


@dataclass(kw_only=True, repr=False, eq=False)
class FolderOptions:
    """Where the result goes."""

    out: Path | None = option(OUTPUT, "Folder for the result. \\[default: a fresh one under results/]", "DIR")
    force: bool = flag(OUTPUT, "Replace an older result in the folder.", "--force")


@dataclass(kw_only=True, repr=False, eq=False)
class PlotOptions:
    """What is drawn."""

    plots: Plots = option(
        OUTPUT, "What is drawn: html, the page report.html; png, a picture of each part; all, both.", default="html"
    )


@dataclass(kw_only=True, repr=False, eq=False)
class PlaceOptions:
    """Where on the Earth a walk was."""

    place: str | None = option(WALK, "Where and when: the field of the Earth there.", "LAT,LON,YYYY-MM-DD")


@dataclass(kw_only=True, repr=False, eq=False)
class AidOptions:
    """What helps to solve a walk, recorded or in progress."""

    step_constant: float | None = option(WALK, "Of the person, with --mount pocket: a step over its opening.", "M")
    fixes: Path | None = option(
        WALK,
        "Known positions for the smoother: CSV time_s,x_m,y_m,z_m,sigma_m, m east, north and up of the start; or with "
        "latitude_deg,longitude_deg[,height_m] in place of these, wherever it starts.",
        "FILE",
    )
    polish: bool = flag(METHOD, "Solve the walk in batch too at its end: trajectory_polished.tum.", "--polish")


@dataclass(kw_only=True, repr=False, eq=False)
class PageOptions:
    """A page that shows walks in progress."""

    host: str = option(
        OUTPUT,
        "Address of this machine that shows the page; 0.0.0.0 lets all who reach it see it.",
        "HOST",
        default="127.0.0.1",
    )
    port: int = option(OUTPUT, "Of the page; 0 for a free one.", "PORT", default=8642)
    plan: Path | None = option(OUTPUT, "Picture under the path, with --plan-points.", "PICTURE")
    plan_points: str | None = option(
        OUTPUT, "Two of its pixels, and their places in m east and north: '120,80=0,0 940,80=41,0'.", "PX,PY=X,Y ..."
    )


@dataclass(kw_only=True, repr=False, eq=False)
class ViewOptions(PageOptions):
    """A page that is shown on request."""

    view: bool = flag(OUTPUT, "Show the walk on a page, for a browser on this machine.", "--view")


@dataclass(kw_only=True, repr=False, eq=False)
class WalkOptions(
    ReadingOptions,
    BarometerOptions,
    SensorOptions,
    FieldOptions,
    TruthOptions,
    PlotOptions,
    FolderOptions,
    Request,
):
    """How a recorded walk is solved, compared and drawn."""

    preset: str = option(
        METHOD,
        f"Parameters of the filters: {_list_words(PRESETS)}. The smoother has no presets.",
        "NAME",
        default=PRESETS[0],
        hidden=True,
        autocompletion=complete_by(lambda: PRESETS),
    )
    no_truth: bool = flag(
        WALK, "Leave out truth.tum or NAME.truth.tum beside the recording, which else is its truth.", "--no-truth"
    )
    config: Any = option(
        METHOD,
        "Do as this config.json of a result says; other options still win.",
        "FILE",
        is_eager=True,
        parser=_read_config,
        callback=_take_defaults,
    )
    settings: list[str] | None = option(
        METHOD,
        "A parameter as `config.json` shows it, such as smoother.magnetic.rounds=3 or detector.threshold=1e4; "
        "again for more.",
        "NAME=VALUE",
        name="--set",
        autocompletion=_complete_settings,
    )


@dataclass(kw_only=True, repr=False, eq=False)
class InspectRequest(ReadingOptions, BarometerOptions, Request):
    """Say what a file holds, and whether it can be navigated with; of several files in a table."""

    verb = "fg_nav.commands.inspect:inspect"

    files: list[Path] = argument("FILE...", "Files with a recording each.")
    mount: Literal["foot", "pocket"] | None = option(
        WALK, "Where the sensor was worn. \\[default: where it turns like it; else on a foot]"
    )


@dataclass(kw_only=True, repr=False, eq=False)
class ConvertRequest(ReadingOptions, BarometerOptions, Request):
    """Write a recording's samples, in SI and as they are, as canonical CSV or Parquet."""

    verb = "fg_nav.commands.convert:convert"

    recording: Path = argument("RECORDING", "File with the recording.")
    out: Path = argument("OUT", "File to write: .csv, .csv.gz or .parquet.")
    force: bool = flag(OUTPUT, "Replace an older file.", "--force")


@dataclass(kw_only=True, repr=False, eq=False)
class RunRequest(WalkOptions, AidOptions):
    """Run one method on each recording and write trajectory, strides, summary and report.html; on two, of both feet."""

    verb = "fg_nav.commands.run:run"

    recordings: list[Path] = argument("RECORDING...", "Files with a recording each.")
    method: str | None = option(
        METHOD,
        f"{USUAL_METHODS} \\[default: smoother, or pocket]",
        "NAME",
        everything=f"{METHOD_WORDS} \\[default: smoother, or pocket]",
        autocompletion=complete_methods,
    )
    magnetic: Literal["all", "card"] = option(
        METHOD,
        "Factors of the field in the graph: all, or card, those of the magnetic heading and of the "
        "differential field alone.",
        default="all",
    )
    mount: Literal["foot", "feet", "pocket"] = option(
        WALK,
        "Where the sensor was worn; a pocket is one of trousers. feet: a sensor on each foot, two recordings of one "
        "walk, with --truth and --calibration A,B and --heading of the left one; or one file and --sensor left,right.",
        default="foot",
    )
    sides: Literal["left,right", "right,left"] | None = option(
        WALK,
        "Feet of the two recordings of --mount feet, in their order. \\[default: as the steps show; else left,right]",
    )
    clock_offset: float | None = option(
        WALK,
        "To add to the stamps of the second recording of --mount feet. \\[default: as the signals of both show]",
        "SECONDS",
    )
    known_distance: float | None = option(
        WALK, "Walked in this recording, with --mount pocket: finds the step constant.", "M"
    )
    gnss: Path | None = option(
        WALK,
        "Fixes of a receiver: `own` for the Location.csv in the recording; a folder or zip with one; or a CSV "
        "time_s,latitude,longitude,accuracy. For the smoother and --mount pocket.",
        "own|FILE",
    )
    places: Path | None = option(
        WALK, "Places of an earlier walk in the same building: this one is located on them, by the smoother.", "FILE"
    )
    save_places: Path | None = option(OUTPUT, "Save the places of this walk, for --places of later ones.", "FILE")
    strict: bool = flag(OUTPUT, "Exit with 1 if the path is not to be used; it is written.", "--strict")
    force: bool = flag(OUTPUT, "Replace an older result in the folder, and the file of --save-places.", "--force")


@dataclass(kw_only=True, repr=False, eq=False)
class ExportRequest(Request):
    """Write the path of a result for other programs: maps, MATLAB, tables, ROS, Rerun."""

    verb = "fg_nav.commands.convert:export"

    folder: Path = argument("FOLDER", "Of a result of `fg-nav run`.")
    out: list[Path] = argument("OUT...", f"Files to write, by their endings: {', '.join(map(str, EXPORTS.values()))}.")
    origin: str | None = option(
        OUTPUT, "Where the foot first stood, for maps: degrees north and east, m.", "LAT,LON[,HEIGHT]"
    )
    turn: float = option(OUTPUT, "Turn the path clockwise about the start, as by the declination.", "DEG", default=0.0)
    start: str | None = option(
        OUTPUT,
        "Instant of the first stamp, as 2026-05-04T09:30:00Z. \\[default: known where stamps are since 1970]",
        "ISO",
    )
    force: bool = flag(OUTPUT, "Replace older files.", "--force")


@dataclass(kw_only=True, repr=False, eq=False)
class CompareRequest(WalkOptions):
    """Run several methods on the same recording and the same stances, and lay them side by side in report.html."""

    verb = "fg_nav.commands.run:compare"

    recording: Path = argument("RECORDING", "File with the recording.")
    methods: str | None = option(
        METHOD,
        f"With commas between: {USUAL_METHODS} \\[default: smoother,iez, or pocket,munoz-diaz2017]",
        "A,B",
        everything=f"With commas between: {METHOD_WORDS} \\[default: smoother,iez, or pocket,munoz-diaz2017]",
        autocompletion=complete_methods,
    )
    mount: Literal["foot", "pocket"] = option(
        WALK, "Where the sensor was worn; a pocket is one of trousers.", default="foot"
    )


@dataclass(kw_only=True, repr=False, eq=False)
class CalibrateRequest(ReadingOptions, AxesOptions, PlaceOptions, Request):
    """Find the magnetometer's errors, and at rest those of gyroscope and accelerometer; write a calibration.

    Of several recordings of one sensor the gyroscope's bias is the mean of all, and the rest by the first one.
    """

    verb = "fg_nav.commands.calibrate:calibrate"

    recordings: list[Path] = argument("RECORDING...", "Files with a recording each.")
    out: Path = option(OUTPUT, "Calibration to write.", "FILE", default=..., show_default=False)
    method: str | None = option(METHOD, "walk, levelled, ellipsoid or sphere. \\[default: by the recording]", "NAME")
    strength: float | None = option(METHOD, "Of the field, if known: for a sensor turned over.", "UT")
    force: bool = flag(OUTPUT, "Replace an older calibration.", "--force")


@dataclass(kw_only=True, repr=False, eq=False)
class StreamRequest(SensorOptions, FieldOptions, AidOptions, ViewOptions, PlotOptions, Request):
    """Follow a sensor while it is walked with: one JSON line a footfall or stride, and at the end the whole walk.

    Reads canonical CSV, the header line first, or rows of --columns. Ctrl-C ends the walk and writes its result.
    """

    verb = "fg_nav.commands.stream:stream"

    source: str = argument(
        "SOURCE",
        "- for standard input, a file that grows, a serial device, or tcp, tcp-listen or udp and ://host:port.",
    )
    right: str | None = argument("[RIGHT]", "With --mount feet, the right foot's; SOURCE is the left's.", default=None)
    columns: str | None = option(
        INPUT,
        "Which fields of a row are what: time=1\\[ms],acc=2:3:4\\[g],gyr=5:6:7\\[deg/s], or all in order, of "
        "t,ax,ay,az,gx,gy,gz,mx,my,mz,p; - is passed over.",
        "MAPPING",
    )
    units: str | None = option(INPUT, "Of these columns, such as ms,g,deg/s,gauss. \\[default: s,m/s2,rad/s,uT]", "A,B")
    rate: float | None = option(INPUT, "Of rows without t: their stamps are counted.", "HZ")
    speed: str | None = option(
        INPUT, "SOURCE is a whole recording: replay it so many times as fast as it was walked, or max.", "FACTOR"
    )
    baud: int = option(INPUT, "Of a serial device.", default=115200)
    silence: float | None = option(INPUT, "End the walk after so long without a row.", "SECONDS")
    lag: float | None = option(METHOD, "Forget what is older. \\[default: keep the whole walk]", "SECONDS")
    mount: Literal["foot", "feet", "pocket"] = option(
        WALK,
        "Where the sensor is worn; a pocket is one of trousers. feet: one on each foot, two sources, with "
        "--calibration A,B and --heading of the left one.",
        default="foot",
    )
    clock_offset: float | None = option(WALK, "To add to the stamps of the right foot of --mount feet.", "SECONDS")
    record: Path | None = option(OUTPUT, "Record the samples as they come, and the lines.", "FILE")
    resume: bool = flag(OUTPUT, "Go on with the walk of --record, if it is there.", "--resume")
    serve: int | None = option(OUTPUT, "Serve the lines on this port of 127.0.0.1, and print none.", "PORT")
    out: Path | None = option(OUTPUT, "Folder for the result at the end. \\[default: lines]", "DIR")
    force: bool = flag(OUTPUT, "Replace an older result in the folder, and an older record.", "--force")


@dataclass(kw_only=True, repr=False, eq=False)
class ViewRequest(PageOptions, Request):
    """Show several walks in progress on one page, each followed from the page of its own `fg-nav stream --view`."""

    verb = "fg_nav.commands.view:view"

    walkers: list[str] = argument(
        "NAME=HOST:PORT...",
        "Name and page of each, or its port here; behind @ where its walk began, m east and north: anna=8642@12,-3.",
    )


REQUESTS: tuple[type[Request], ...] = (
    InspectRequest,
    ConvertRequest,
    RunRequest,
    ExportRequest,
    CompareRequest,
    CalibrateRequest,
    StreamRequest,
    ViewRequest,
)
"""In the order of the help."""
