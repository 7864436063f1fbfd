"""The command line: parse, call, print.

`main` is the one error boundary. Exit codes: 0 done; 1 the input or the output is to blame, said in one
line on standard error; 2 the command was not understood; 70 a bug, with its traceback; 130 interrupted.
"""

from __future__ import annotations

import io
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NoReturn

import typer

from fg_nav.errors import CalibrationError, EstimationError, FgNavError, MagneticError, OutputError, SimulationError

if TYPE_CHECKING:
    from fg_nav.earth import EarthField
    from fg_nav.lab.simulation import Choices, SimulatedWalk
    from fg_nav.recording import Recording
    from fg_nav.session import Options, Outcome, Session

EXIT_USER, EXIT_BUG, EXIT_INTERRUPTED = 1, 70, 130

RESULTS = Path("results")
"""Where results go for which no folder was named."""

PATH_METHOD = "iez"
"""Draws the way on which the field is looked at: quick, and good enough for a map."""

DEMO_METHODS = ("smoother", "iez")

METHOD_NAMES = (
    "smoother, inertial, online, iez, qsf, qsf-stance, iqsf, ma2018, aiez or matched; "
    "all but the first three also smoothed, as `iez-rts`"
)
POCKET_METHOD_NAMES = "pocket or munoz-diaz2017"
PRESET_NAMES = "tuned, physical or as-printed"
"""In words for the help, which must not load the methods; a test holds both to those that there are."""

app = typer.Typer(
    name="fg-nav", add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False,
    help="Turn the recording of a foot-mounted inertial sensor into a trajectory with uncertainties.",
)  # fmt: skip

Target = Callable[[], AbstractContextManager[tuple[Path, Path]]]
"""Makes the folder of a result: where it will be, and where to write until it is complete."""

RecordingPath = Annotated[
    Path, typer.Argument(metavar="RECORDING", show_default=False, help="File with the recording.")
]
FormatName = Annotated[
    str | None,
    typer.Option("--format", metavar="NAME", help="Its format. \\[default: recognised from the content]"),
]
NoMag = Annotated[
    bool,
    typer.Option("--no-mag", help="Ignore the magnetometer: no verdicts on the field, and no filter with a compass."),
]
CalibrationPath = Annotated[
    Path | None,
    typer.Option("--calibration", metavar="FILE", help="Calibration to apply, from `fg-nav calibrate`."),
]
Detector = Annotated[
    str | None,
    typer.Option("--detector", metavar="NAME", help="What judges the magnetic field. \\[default: ma2018]"),
]
Preset = Annotated[
    str,
    typer.Option(
        "--preset",
        metavar="NAME",
        help=f"Parameters of the filters: {PRESET_NAMES}. The smoother has no presets.",
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
        "--mount pocket. "
        "\\[default: what the compass says, in a method that uses it; else 0]",
    ),
]
TruthPath = Annotated[
    Path | None,
    typer.Option("--truth", metavar="FILE", help="True path or footprints. \\[default: what the recording carries]"),
]
FixesPath = Annotated[
    Path | None,
    typer.Option(
        "--fixes",
        metavar="FILE",
        help="Known positions for the smoother: CSV time_s,x_m,y_m,z_m,sigma_m, m east, north and up of the start.",
    ),
]
AlignmentMode = Annotated[
    Literal["yaw", "none", "origin", "se3"],
    typer.Option("--alignment", help="How the solution is laid on the truth before errors are counted."),
]
MountPlace = Annotated[
    Literal["foot", "pocket"], typer.Option("--mount", help="Where the sensor was worn; a pocket is one of trousers.")
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
Seed = Annotated[int, typer.Option(min=0, help="Draws person, sensor, walk, field and noise.")]
OutDir = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Folder for the result. \\[default: a fresh one under results/]"),
]


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
        from fg_nav.version import version as installed

        typer.echo(f"fg-nav {installed()}")
        raise typer.Exit


@app.command()
def inspect(
    file: Annotated[Path, typer.Argument(metavar="FILE", show_default=False, help="File with a recording.")],
    format: FormatName = None,
) -> None:
    """Say what a file holds, and whether it can be navigated with."""
    from fg_nav.inspection import inspect as judged
    from fg_nav.io import read_raw
    from fg_nav.report.inspection import print_inspection

    print_inspection(judged(read_raw(file, format)))


@app.command()
def run(
    recording: RecordingPath,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=f"{METHOD_NAMES}. With --mount pocket: {POCKET_METHOD_NAMES}. \\[default: smoother, or pocket]",
        ),
    ] = None,
    mount: MountPlace = "foot",
    step_constant: StepConstant = None,
    known_distance: KnownDistance = None,
    no_mag: NoMag = False,
    heading: Heading = None,
    truth: TruthPath = None,
    calibration: CalibrationPath = None,
    detector: Detector = None,
    preset: Preset = "tuned",
    fixes: FixesPath = None,
    format: FormatName = None,
    alignment: AlignmentMode = "yaw",
    out: OutDir = None,
    force: Force = False,
) -> None:
    """Run one method on a recording and write trajectory, strides, summary and pictures."""
    from fg_nav.estimators import DEFAULT_METHOD

    method = method or DEFAULT_METHOD[mount]
    _methods_exist([method], mount)
    _check_mount(mount, step_constant, known_distance, detector, preset)
    _check_free(out, force)
    from fg_nav.report.writing import write_run_folder
    from fg_nav.session import load

    options = replace(
        _options(no_mag, heading, alignment, truth, detector, calibration, preset, fixes),
        mount=mount,
        step_constant_m=step_constant,
        known_distance_m=known_distance,
    )
    session = load(recording, format, options)
    outcomes = _solved(session, [method])
    with _folder(out, force, f"{recording.stem}-{method}") as (place, folder):
        write_run_folder(folder, session, outcomes[method])
    _show(session, outcomes, place)


@app.command()
def compare(
    recording: RecordingPath,
    methods: Annotated[
        str, typer.Option(metavar="A,B", help=f"Methods, with commas between: {METHOD_NAMES}.")
    ] = "smoother,iez",
    no_mag: NoMag = False,
    heading: Heading = None,
    truth: TruthPath = None,
    calibration: CalibrationPath = None,
    detector: Detector = None,
    preset: Preset = "tuned",
    format: FormatName = None,
    alignment: AlignmentMode = "yaw",
    out: OutDir = None,
    force: Force = False,
) -> None:
    """Run several methods on the same recording and the same stances, and lay them side by side."""
    names = list(dict.fromkeys(name.strip() for name in methods.split(",")))
    _methods_exist(names)
    _check_free(out, force)
    from fg_nav.report.writing import write_comparison_folder
    from fg_nav.session import load

    session = load(recording, format, _options(no_mag, heading, alignment, truth, detector, calibration, preset))
    outcomes = _solved(session, names)
    with _folder(out, force, f"{recording.stem}-compare") as (place, folder):
        write_comparison_folder(folder, session, outcomes)
    _show(session, outcomes, place)


@app.command()
def demo(
    seed: Seed = 1,
    out: OutDir = None,
    force: Force = False,
) -> None:
    """Simulate one minute of walking and compare the methods on it."""
    from fg_nav.report.folder import DEMO_FILES

    _check_free(out, force, DEMO_FILES)
    from fg_nav.report.writing import write_comparison_folder, write_simulation_folder
    from fg_nav.session import prepare

    walk = _simulated("demo", seed)
    with _folder(out, force, "demo", DEMO_FILES) as (place, folder):
        session = prepare(_as_if_read(walk.recording, place / "recording.csv"))
        outcomes = _solved(session, DEMO_METHODS)
        write_simulation_folder(folder, walk)
        write_comparison_folder(folder, session, outcomes)
    _show(session, outcomes, place)


@app.command()
def calibrate(
    file: RecordingPath,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", show_default=False, help="Calibration to write.")],
    method: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="walk, levelled, ellipsoid or sphere. \\[default: by the recording]"),
    ] = None,
    strength: Annotated[
        float | None, typer.Option(metavar="UT", help="Of the field, if known: for a sensor turned over.")
    ] = None,
    place: PlaceWords = None,
    format: FormatName = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an older calibration.")] = False,
) -> None:
    """Find the magnetometer's errors, and at rest those of gyroscope and accelerometer; write a calibration."""
    from fg_nav.calibration.file import is_calibration, write_calibration
    from fg_nav.calibration.of_recording import calibrate as calibrated
    from fg_nav.calibration.of_recording import check_method
    from fg_nav.io import read
    from fg_nav.report.calibration import print_calibration
    from fg_nav.report.one_file import check_file_free, result_file

    if method is not None:
        check_method(method)
    check_file_free(out, is_calibration, force)
    found = calibrated(read(file, format), method, _strength(strength, place))
    with result_file(out, is_calibration, force) as fresh:
        write_calibration(fresh, found.calibration)
    print_calibration(found, out)


@app.command()
def detect(
    file: RecordingPath,
    detectors: Annotated[
        str | None,
        typer.Option(
            "--detector",
            metavar="A,B",
            help="Detectors, with commas between, or `all`. \\[default: all but the printed]",
        ),
    ] = None,
    calibration: CalibrationPath = None,
    heading: Heading = None,
    place: PlaceWords = None,
    truth: TruthPath = None,
    format: FormatName = None,
    alignment: AlignmentMode = "yaw",
    out: OutDir = None,
    force: Force = False,
) -> None:
    """Look at the magnetic field along a walk, and at what each detector makes of it: field.png, field_map.png.

    `--detector munoz-diaz` alone needs no footfalls: it judges the samples, of a sensor in a pocket too.
    """
    from fg_nav.report.field_survey import SAMPLEWISE, detectors_named
    from fg_nav.report.folder import DETECT_FILES

    names = detectors_named(detectors)
    _check_free(out, force, DETECT_FILES)
    earth = _earth(place)
    options = _options(False, heading, alignment, truth, None, calibration)
    target = partial(_folder, out, force, f"{file.stem}-detect", DETECT_FILES)
    if names == [SAMPLEWISE]:
        if place is not None or truth is not None:
            raise MagneticError(f"{SAMPLEWISE} alone draws no map and no headings: leave --place and --truth out.")
        _detect_in_samples(file, format, options, target)
    else:
        _detect_at_footfalls(file, format, options, names, earth, target)


def _detect_at_footfalls(
    file: Path, format: str | None, options: Options, names: list[str], earth: EarthField | None, target: Target
) -> None:
    from fg_nav.report.field_results import print_survey
    from fg_nav.report.field_survey import surveyed
    from fg_nav.report.writing import write_survey_folder
    from fg_nav.session import load

    session = load(file, format, options)
    field = session.known_field()
    outcome = _solved(session, [PATH_METHOD])[PATH_METHOD]
    survey = surveyed(session.recording, field, names, outcome.solution, earth)
    with target() as (place, folder):
        write_survey_folder(folder, session, survey, outcome)
    print_survey(session, survey, place)


def _detect_in_samples(file: Path, format: str | None, options: Options, target: Target) -> None:
    from fg_nav.report.field_samples import print_samples, sampled, write_samples
    from fg_nav.session import opened

    session = opened(file, format, options)
    survey = sampled(session.recording)
    with target() as (place, folder):
        write_samples(folder, session, survey)
    print_samples(session, survey, place)


@app.command()
def allan(
    file: RecordingPath,
    format: FormatName = None,
    out: OutDir = None,
    force: Force = False,
) -> None:
    """Say how noisy the sensor is, from a recording of it lying still: allan.json, allan.png."""
    from fg_nav.report.folder import ALLAN_FILES

    _check_free(out, force, ALLAN_FILES)
    from fg_nav.calibration.at_rest import measure_recording_noise
    from fg_nav.io import read
    from fg_nav.report.allan import print_allan, write_allan

    noise = measure_recording_noise(read(file, format))
    with _folder(out, force, f"{file.stem}-allan", ALLAN_FILES) as (place, folder):
        write_allan(folder, noise, file)
    print_allan(noise, place)


@app.command()
def stream(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            show_default=False,
            help="- for standard input, a file that grows, a serial device, tcp://host:port or udp://host:port.",
        ),
    ],
    checkpoint: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save the walk here, and take it up from here if it is there.")
    ] = None,
    every: Annotated[float, typer.Option(metavar="SECONDS", help="Between two saves.")] = 10.0,
    lag: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Forget what is older. \\[default: keep the whole walk]")
    ] = None,
    heading: Heading = None,
    no_mag: NoMag = False,
    calibration: CalibrationPath = None,
    serve: Annotated[
        int | None, typer.Option(metavar="PORT", help="Serve the lines on this port of 127.0.0.1, and print none.")
    ] = None,
    baud: Annotated[int, typer.Option(help="Of a serial device.")] = 115200,
    silence: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="End the walk after so long without a row.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder for the result at the end. \\[default: lines]")
    ] = None,
    force: Force = False,
) -> None:
    """Follow a sensor while it is walked with: one JSON line a footfall, and at the end the whole walk.

    Reads rows of canonical CSV, the header line first. Ctrl-C ends the walk and writes its result.
    """
    _check_free(out, force)
    from fg_nav.online.command import Wanted, streamed
    from fg_nav.report.in_progress import printed, remark, show_end, write_end

    wanted = Wanted(source, checkpoint, every, lag, heading, not no_mag, calibration, serve, baud, silence)
    walk = streamed(wanted, printed(), remark)
    if out is None:
        show_end(walk, serve is not None)
        return
    with _folder(out, force, "stream") as (place, folder):
        write_end(folder, walk)
    remark(f"files: {place}")


def _list_scenarios(wanted: bool) -> None:
    if wanted:
        from fg_nav.report.simulated import print_scenarios

        print_scenarios()
        raise typer.Exit


@app.command()
def simulate(
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", show_default=False, help="Its name, or a .toml file with one.")
    ],
    seed: Seed = 1,
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
    out: OutDir = None,
    force: Force = False,
) -> None:
    """Simulate a walk with its truth: recording.csv, truth.tum, truth.json, landmarks.csv, map.png."""
    from fg_nav.report.folder import SIMULATION_FILES

    _check_free(out, force, SIMULATION_FILES)
    from fg_nav.lab.simulation import Choices
    from fg_nav.report.simulated import print_simulation
    from fg_nav.report.writing import write_simulation_folder

    walk = _simulated(scenario, seed, Choices(sensor, site, field, worn, rate, turn, calibrated))
    with _folder(out, force, walk.scenario.name, SIMULATION_FILES) as (place, folder):
        write_simulation_folder(folder, walk)
    print_simulation(walk, place)


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
    from fg_nav.lab.campaign.command import Request, run_campaign
    from fg_nav.report.campaign import print_campaign, print_note, show_progress

    place = RESULTS / plan.stem if out is None else out
    with show_progress() as show:
        done = run_campaign(Request(plan, place, scheduler, workers, renew, retry), show, print_note)
    print_campaign(done, place)


@app.command()
def reproduce(
    paper: Annotated[
        Literal["ma2018", "aiez2017", "munoz-diaz2017"], typer.Argument(show_default=False, help="Its short name.")
    ],
    quick: Annotated[bool, typer.Option("--quick", help="3 seeds, and only what takes minutes.")] = False,
    seeds: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="How many walks of each kind. \\[default: 50, quick 3]")
    ] = None,
    first: Annotated[int, typer.Option(metavar="SEED", min=0, help="Seed of the first walk.")] = 101,
    workers: Annotated[int | None, typer.Option(metavar="N", min=1, help="Processes. \\[default: one a core]")] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder for the result. \\[default: results/reproduce-PAPER]"),
    ] = None,
    force: Force = False,
) -> None:
    """Lay the experiments of a paper beside ours, from simulated walks: report.html, results.json, pictures.

    A run that was ended goes on from there with the same command.
    """
    from fg_nav.lab.reproduce.command import reproduce as reproduced

    reproduced(paper, out or RESULTS / f"reproduce-{paper}", seeds, first, workers, quick, force)


def _options(
    no_mag: bool,
    heading: float | None,
    alignment: str,
    truth: Path | None,
    detector: str | None,
    calibration: Path | None,
    preset: str = "tuned",
    fixes: Path | None = None,
) -> Options:
    """What was asked for; refuses a preset or a detector that there is not, or that would have nothing to judge."""
    from fg_nav.ekf.presets import check_preset
    from fg_nav.magnetic.quasi_static import DEFAULT, find_detector
    from fg_nav.session import Options

    find_detector(detector or DEFAULT)
    check_preset(preset)
    if no_mag and detector is not None:
        raise MagneticError("--no-mag leaves --detector nothing to judge: give one of them.")
    return Options(not no_mag, heading, alignment, truth, detector or DEFAULT, calibration, preset, fixes)


def _earth(place: str | None) -> EarthField | None:
    from fg_nav.earth import Place, compute_field

    return None if place is None else compute_field(Place.parse(place))


def _strength(strength_uT: float | None, place: str | None) -> float | None:
    """Strength of the field as told, or that of a place."""
    if strength_uT is not None and place is not None:
        raise CalibrationError("--strength and --place both tell the strength of the field: give one of them.")
    if strength_uT is not None and not 5.0 <= strength_uT <= 200.0:
        raise CalibrationError(f"a field of {strength_uT:g} uT is none on Earth (25 to 65): give its strength in uT.")
    earth = _earth(place)
    return strength_uT if earth is None else earth.strength_uT


def _methods_exist(names: Sequence[str], mount: Literal["foot", "pocket"] = "foot") -> None:
    from fg_nav.estimators import estimator

    for name in names:
        estimator(name, mount)


def _check_mount(
    mount: str, step_constant: float | None, known_distance: float | None, detector: str | None, preset: str
) -> None:
    """Refuse options that are for a sensor worn elsewhere."""
    if mount == "foot" and (step_constant is not None or known_distance is not None):
        raise EstimationError(
            "--step-constant and --known-distance are for a sensor in a pocket: add --mount pocket, or leave them out."
        )
    if mount == "pocket" and (detector is not None or preset != "tuned"):
        raise EstimationError("--detector and --preset are for a sensor on a foot: leave them out with --mount pocket.")


def _check_free(out: Path | None, force: bool, ours: frozenset[str] | None = None) -> None:
    """Refuse before the work rather than after it."""
    from fg_nav.report.folder import RESULT_FILES, check_free

    if out is not None:
        check_free(out, force, ours or RESULT_FILES)
    elif force:
        raise OutputError("--force replaces the result in a folder: name the folder with --out.")


@contextmanager
def _folder(
    out: Path | None, force: bool, name: str, ours: frozenset[str] | None = None
) -> Iterator[tuple[Path, Path]]:
    """Yield the place of the result, and the folder to write into until it is complete."""
    from fg_nav.report.folder import RESULT_FILES, claim_folder, result_folder

    place = claim_folder(RESULTS, name) if out is None else out
    with result_folder(place, force, ours or RESULT_FILES, claimed=out is None) as folder:
        yield place, folder


def _solved(session: Session, names: Sequence[str]) -> dict[str, Outcome]:
    from fg_nav.report.terminal import progress
    from fg_nav.session import solve

    outcomes = {}
    for name in names:
        with progress(name) as report:
            outcomes[name] = solve(session, name, report)
    return outcomes


def _simulated(name: str, seed: int, choices: Choices | None = None) -> SimulatedWalk:
    from fg_nav.lab.simulation import Choices, scenario, simulate
    from fg_nav.lab.simulation.scenario_file import SUFFIX, read_scenario
    from fg_nav.report.terminal import progress

    own = name.endswith(SUFFIX)
    chosen = read_scenario(Path(name)) if own else scenario(name)
    try:
        with progress(chosen.name) as report:
            return simulate(chosen, seed, choices or Choices(), progress=report)
    except SimulationError as error:
        raise SimulationError(f"{Path(name).name}: {error}" if own else str(error)) from None


def _as_if_read(recording: Recording, path: Path) -> Recording:
    """Return a recording with the file named that it will be found in."""
    return replace(recording, provenance=replace(recording.provenance, path=path, format="canonical"))


def _show(session: Session, outcomes: Mapping[str, Outcome], place: Path) -> None:
    from fg_nav.report.results import summary
    from fg_nav.report.terminal import print_results

    print_results([summary(session, outcome) for outcome in outcomes.values()], place)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _leave(words: str, code: int) -> NoReturn:
    print(f"fg-nav: {words}", file=sys.stderr)  # noqa: T201
    sys.exit(code)


if __name__ == "__main__":
    main()
