"""`fg-nav run`, `compare` and `demo`: methods on a recording, into a folder of results.

`fg-nav run LEFT RIGHT --mount feet`: two recordings, of a sensor on each foot, as one walk.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from fg_nav.commands import TUNED, Answer, Target, answer_each, name_walk, run_methods, show_number, simulate_named
from fg_nav.errors import EstimationError, PlacesError, VerdictError
from fg_nav.estimators import Method, Use, check_use, find_method
from fg_nav.feet import refuse_for_two, split_pair
from fg_nav.io import Reading
from fg_nav.io.readers.table import refuse_sensor_tables
from fg_nav.pipeline import navigate, prepare_walk, require_mag, take_places
from fg_nav.report import Plots
from fg_nav.report.files import Summary, write_comparison, write_run
from fg_nav.report.folder import DEMO_FILES, check_file_free, result_file
from fg_nav.report.terminal import print_results, progress
from fg_nav.verdict import UNUSABLE
from fg_nav.walk import OWN_GNSS, Magnetic, Mount, Options, Walk, read_walk

if TYPE_CHECKING:
    from fg_nav.both_feet import Order
    from fg_nav.commands.config import Config
    from fg_nav.errors import FgNavError


@dataclass(frozen=True)
class RunRequest:
    """What to run on each of the recordings.

    Attributes
    ----------
    method, options : with what; the options know where the sensor was worn.
    reading : how the recordings are read.
    plots : what is drawn of the result.
    out, force : the folder of the result, and whether to replace one; of several recordings the folder of theirs.
    strict : a path that is not to be used is a failure.
    config : whose options of its own recording are taken too; None without.
    save_places : file for the places of the walk; None without.
    """

    method: str
    options: Options
    reading: Reading
    plots: Plots = "html"
    out: Path | None = None
    force: bool = False
    strict: bool = False
    config: Config | None = None
    save_places: Path | None = None


RESULT_COLUMNS = {
    "verdict": lambda content: str(content["verdict"]),
    "distance (m)": show_number("distance_m", "{:.2f}"),
    "strides": show_number("strides", "{:d}"),
    "start to end (m)": show_number("closure_m", "{:.3f}"),
    "end error (m)": show_number("end_error_m", "{:.3f}"),
    "files": lambda content: str(content["folder"]),
}
"""Of the table of several recordings."""


def run(recordings: Sequence[Path], request: RunRequest) -> Answer:
    """Navigate with one method, and return the summary of each recording.

    Raises
    ------
    EstimationError
        If there is no such method, or the options are of one recording and there are several.
    """
    options = request.options
    find_method(request.method, options.mount or "foot")
    _check_places(request)
    recordings = list(dict.fromkeys(recordings))
    if len(recordings) == 1:
        return _run_one(request, recordings[0])
    refuse_sensor_tables(recordings)
    own = {
        "--truth": options.truth_path,
        "--fixes": options.fixes_path,
        "--gnss": None if options.gnss_path == OWN_GNSS else options.gnss_path,
        "--known-distance": options.known_distance_m,
        "--save-places": request.save_places,
        "--barometer": request.reading.barometer,
    }
    for option, value in own.items():
        if value is not None:
            raise EstimationError(f"{option} is of one recording: run the {len(recordings)} one by one.")
    if request.out is None:
        return answer_each(recordings, partial(_run_one, request), RESULT_COLUMNS)
    # A folder for each recording; equal names get a number appended.
    places: dict[Path, Path] = {}
    known: Counter[str] = Counter()
    for recording in recordings:
        name = name_walk(recording)
        known[name] += 1
        name = name if known[name] == 1 else f"{name}-{known[name]}"
        places[recording] = request.out / f"{name}-{request.method}"
    return answer_each(recordings, lambda one: _run_one(replace(request, out=places[one]), one), RESULT_COLUMNS)


def _check_places(request: RunRequest) -> None:
    """Refuse known places that the method cannot use, and places that cannot be saved, before the solve."""
    options = request.options
    if options.places_path is None and request.save_places is None:
        return
    from fg_nav.places.saved import is_places

    if options.places_path is not None:
        check_use(find_method(request.method, options.mount or "foot"), "places")
    if not options.use_magnetometer or options.mount == "pocket":
        raise PlacesError(
            "places are known by the magnetic field along a foot's path: leave out --places and --save-places, or "
            "--no-mag and --mount pocket."
        )
    if request.save_places is not None:
        check_file_free(request.save_places, is_places, request.force)


def _run_one(request: RunRequest, recording: Path) -> Answer:
    method, strict, options = request.method, request.strict, request.options
    if request.config is not None:
        from fg_nav.commands.config import bind_to_recording

        options = bind_to_recording(options, request.config, recording)
    force = request.force and (request.out is not None or request.save_places is None)
    target = Target(request.out, force, f"{name_walk(recording)}-{method}")
    with target, progress(method) as report:
        walk = read_walk(recording, options, request.reading)
        if request.save_places is not None:
            require_mag(walk)  # before the work
        result = navigate(walk, method, progress=report)
        with target.open() as folder:
            summary = write_run(folder, result.walk, result.outcome, request.plots)
        failure: FgNavError | None = None
        if request.save_places is not None:
            # The result is already written: a walk without places to save is a failure, but loses nothing.
            from fg_nav.places.saved import is_places, write_places

            try:
                places = take_places(result.walk, result.outcome.solution)
                with result_file(request.save_places, is_places, request.force) as fresh:
                    write_places(fresh, places)
            except PlacesError as error:
                failure = error
    if failure is None and strict:
        failure = refuse_unusable(summary, target.place)
    content = {"recording": str(recording), "folder": str(target.place), **summary}
    return Answer(content, partial(print_results, [summary], target.place), failure)


def refuse_unusable(summary: Summary, folder: Path) -> VerdictError | None:
    """Return the failure of a path that is not to be used, where that was asked for by `--strict`; None of another."""
    if summary["verdict"] != UNUSABLE:
        return None
    return VerdictError(f"the path is not to be used: see its reasons in {folder / 'summary.json'}.")


@dataclass(frozen=True)
class FeetRequest:
    """What to run on two recordings.

    Attributes
    ----------
    run : as for one recording; its options are those of both, without truth and calibration.
    sides : feet of the recordings in their order; None where the steps are to show it.
    clock_offset_s : to add to the second recording's stamps; None where the signals are to show it.
    truths, calibrations : files with commas between, one a recording in their order; None without.
    """

    run: RunRequest
    sides: Order | None
    clock_offset_s: float | None
    truths: Path | None
    calibrations: Path | None


def run_feet(recordings: Sequence[Path], request: FeetRequest) -> Answer:
    """Navigate both feet as one walk, and return the summary.

    Raises
    ------
    EstimationError
        If there are not two recordings, the method does not solve both, or an option is of one recording.
    """
    from fg_nav.both_feet import MAX_GAP_S, navigate_feet
    from fg_nav.report.feet import write_feet

    run, readings = request.run, [request.run.reading] * len(recordings)
    # Two sensors of one file: the file counts twice.
    sensors = [word.strip() for word in (run.reading.sensor or "").split(",")]
    if len(recordings) == 1 and len(sensors) == 2 and all(sensors):
        recordings, readings = [recordings[0]] * 2, [replace(run.reading, sensor=sensor) for sensor in sensors]
    _check_feet(recordings, readings, run)
    truths = _split_files("--truth", request.truths)
    calibrations = _split_files("--calibration", request.calibrations)
    options = replace(run.options, heading_deg=None, mount="foot")
    name = "-".join([*dict.fromkeys(map(name_walk, recordings)), run.method])
    in_one = recordings[0] == recordings[1]  # on one clock
    words = "".join(str(one.sensor).lower() for one in readings)
    named: Order | None = "left,right" if "left" in words and words.find("left") < words.find("right") else None
    named = "right,left" if "right" in words and words.find("right") < words.find("left") else named
    target = Target(run.out, run.force, name)
    with target, progress(run.method) as report:
        walks = [
            read_walk(
                path,
                replace(options, truth_path=truth, calibration_path=calibration),
                replace(reading, longest_gap_s=MAX_GAP_S),
            )
            for path, reading, truth, calibration in zip(recordings, readings, truths, calibrations, strict=True)
        ]
        result = navigate_feet(
            walks[0],
            walks[1],
            run.method,
            heading_deg=run.options.heading_deg,
            clock_offset_s=0.0 if in_one and request.clock_offset_s is None else request.clock_offset_s,
            sides=request.sides or (named if in_one else None),
            progress=report,
        )
        with target.open() as folder:
            summary = write_feet(folder, result, run.plots)
    failure = refuse_unusable(summary, target.place) if run.strict else None
    content = {"recordings": [str(one) for one in recordings], "folder": str(target.place), **summary}
    return Answer(content, partial(print_results, [summary], target.place), failure)


def _check_feet(recordings: Sequence[Path], readings: Sequence[Reading], run: RunRequest) -> None:
    count = len(recordings)
    if count == 1:
        raise EstimationError(
            "--mount feet takes two recordings, one of each foot, or one of several sensors with two of them named by "
            "--sensor A,B."
        )
    if count != 2 or (recordings[0] == recordings[1] and readings[0] == readings[1]):
        given = "the same one twice" if count == 2 else f"{count} of them"
        raise EstimationError(f"--mount feet takes two recordings, one of each foot, and was given {given}.")
    options = run.options
    refused = {
        "--fixes": options.fixes_path,
        "--gnss": options.gnss_path,
        "--places": options.places_path,
        "--save-places": run.save_places,
        "--config": run.config,
        "--barometer": run.reading.barometer,
    }
    refuse_for_two(refused)


def _split_files(option: str, files: Path | None) -> tuple[Path | None, Path | None]:
    """Return the two files of `A,B`, one for each recording; (None, None) if `files` is None."""
    if files is None:
        return None, None
    pair = split_pair(files)
    if pair is None:
        raise EstimationError(
            f"{option} {files} is of one recording: with --mount feet give two files, one for each recording in their "
            f"order, as {option} A,B."
        )
    return pair


def check_methods(
    methods: Sequence[Method], gate: str | None, polish: bool = False, magnetic: Magnetic = "all"
) -> None:
    """Refuse --gate for methods with their own, --magnetic for methods without a graph, --polish for batch methods."""
    given: dict[Use, bool] = {"gate": gate is not None, "magnetic": magnetic != "all", "polish": polish}
    for use, is_given in given.items():
        if is_given and not any(use in one.uses for one in methods):
            check_use(methods[0], use)


def check_feet_options(both: bool, method: str, sides: str | None, clock_offset_s: float | None) -> None:
    """Refuse a method that does not solve both feet, and options of two feet where there is one."""
    if both:
        check_use(find_method(method), "feet")
    elif sides is not None or clock_offset_s is not None:
        raise EstimationError(
            "--sides and --clock-offset are for two recordings of one walk: name both, as --mount feet LEFT RIGHT."
        )


def set_mount(
    options: Options, mount: Mount, lengths_m: tuple[float | None, float | None], gate: str | None, preset: str
) -> Options:
    """Return the options for a sensor worn at `mount`; refuse those of the other mount.

    `lengths_m`: step constant and known distance (m), of a sensor in a pocket.
    """
    if mount == "foot" and lengths_m != (None, None):
        raise EstimationError(
            "--step-constant and --known-distance are for a sensor in a pocket: add --mount pocket, or leave them out."
        )
    if mount == "pocket" and (gate is not None or preset != TUNED or options.magnetic != "all"):
        raise EstimationError(
            "--gate, --magnetic and --preset are for a sensor on a foot: leave them out with --mount pocket."
        )
    return replace(options, mount=mount, step_constant_m=lengths_m[0], known_distance_m=lengths_m[1])


DEMO_SCENARIO = "building-loop"
DEMO_METHODS = ("smoother", "card", "inertial", "ma2018", "iez")


def compare(
    recording: Path,
    names: Sequence[str],
    options: Options,
    reading: Reading,
    plots: Plots,
    out: Path | None,
    force: bool,
) -> Answer:
    """Run several methods on a recording, and return their summaries."""
    for name in names:
        find_method(name)
    with Target(out, force, f"{name_walk(recording)}-compare") as target:
        walk = prepare_walk(read_walk(recording, options, reading))
        outcomes = run_methods(walk, names)
        with target.open() as folder:
            summaries = write_comparison(folder, walk, outcomes, plots)
    return answer_comparison(recording, summaries, target.place)


def answer_comparison(recording: Path, summaries: list[Summary], place: Path) -> Answer:
    """Return the summaries of several methods, which are in a folder."""
    content = {"recording": str(recording), "folder": str(place), "methods": summaries}
    return Answer(content, partial(print_results, summaries, place))


def demo(seed: int, plots: Plots, out: Path | None, force: bool) -> Answer:
    """Simulate four minutes of walking round a floor, and compare the methods on it."""
    from fg_nav.commands.simulate import write_simulation  # loads the simulator, which no other of these needs
    from fg_nav.lab.simulation import simulate

    with Target(out, force, "demo", DEMO_FILES) as target, target.open() as folder:
        simulated = simulate_named(simulate, DEMO_SCENARIO, seed)
        # the recording as it will be read from the folder
        provenance = replace(simulated.recording.provenance, path=target.place / "recording.csv", format="canonical")
        walk = prepare_walk(Walk.of(replace(simulated.recording, provenance=provenance)))
        outcomes = run_methods(walk, DEMO_METHODS)
        write_simulation(folder, simulated)
        summaries = write_comparison(folder, walk, outcomes, plots)
    return answer_comparison(target.place / "recording.csv", summaries, target.place)
