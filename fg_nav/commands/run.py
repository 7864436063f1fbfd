"""`fg-nav run` and `compare`: methods on a recording, into a folder of results.

`fg-nav run LEFT RIGHT --mount feet`: two recordings, of a sensor on each foot, as one walk.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

from fg_nav.commands.requests import CompareRequest, RunRequest
from fg_nav.commands.shared import (
    Answer,
    Target,
    answer_each,
    choose_options,
    choose_reading,
    find_truth,
    name_truth,
    name_walk,
    refuse_misfits,
    run_methods,
    show_number,
    split_files,
)
from fg_nav.errors import EstimationError, FormatError, PlacesError, VerdictError
from fg_nav.estimators import METHODS, Method, check_use, find_method
from fg_nav.feet import SIDES, Side
from fg_nav.io.readers.table import refuse_sensor_tables
from fg_nav.pipeline import navigate, prepare_walk, require_mag, take_places
from fg_nav.report.files import Summary, write_comparison, write_feet, write_run
from fg_nav.report.folder import check_file_free, result_file
from fg_nav.report.terminal import print_results, progress
from fg_nav.verdict import UNUSABLE
from fg_nav.walk import Options, read_walk

if TYPE_CHECKING:
    from fg_nav.both_feet import Order
    from fg_nav.errors import FgNavError
    from fg_nav.text import Changes
    from fg_nav.walk import Mount


RESULT_COLUMNS = {
    "verdict": lambda content: str(content["verdict"]),
    "distance (m)": show_number("distance_m", "{:.2f}"),
    "strides": show_number("strides", "{:d}"),
    "start to end (m)": show_number("closure_m", "{:.3f}"),
    "end error (m)": show_number("end_error_m", "{:.3f}"),
    "files": lambda content: str(content["folder"]),
}
"""Of the table of several recordings."""

COMPARED: Mapping[Mount, str] = {"foot": "smoother,iez", "pocket": "pocket,munoz-diaz2017"}
"""Methods that are compared where none were named."""

ONE_FILE = (
    "--mount feet takes two recordings, one of each foot: add the other one; or one file with both sensors, which "
    "--sensor A,B names"
)


def run(request: RunRequest) -> Answer:
    """Navigate with one method, and return the summary of each recording; of two feet, as one walk."""
    mount: Mount = "pocket" if request.mount == "pocket" else "foot"
    method = find_method(request.method or next(iter(METHODS[mount])), mount)
    recordings = list(dict.fromkeys(request.recordings))
    # What does not fit together.
    refuse_misfits(request, [method], len(recordings))
    if request.mount == "feet":
        check_use(method, "feet")
    # Options, and how the recordings are read.
    options = replace(
        choose_options(request),
        mount=mount,
        changes=_choose_changes(request, [method], mount),
        magnetic=request.magnetic,
        polish=request.polish,
        fixes_path=request.fixes,
        gnss_path=request.gnss,
        places_path=request.places,
        step_constant_m=request.step_constant,
        known_distance_m=request.known_distance,
    )
    if request.mount == "feet":
        return run_feet(request, method, options)
    if request.save_places is not None:
        from fg_nav.places.saved import is_places

        check_file_free(request.save_places, is_places, request.force)
    if len(recordings) == 1:
        return _run_one(request, method, options, recordings[0], request.out)
    refuse_sensor_tables(recordings)
    # A folder for each recording; equal names get a number appended.
    places: dict[Path, Path | None] = {}
    known: Counter[str] = Counter()
    for recording in recordings:
        name = name_walk(recording)
        known[name] += 1
        name = name if known[name] == 1 else f"{name}-{known[name]}"
        places[recording] = None if request.out is None else request.out / f"{name}-{method.name}"
    return answer_each(recordings, lambda one: _run_one(request, method, options, one, places[one]), RESULT_COLUMNS)


def _choose_changes(request: RunRequest | CompareRequest, methods: Sequence[Method], mount: Mount) -> Changes:
    """Return the parameters that `--config` and `--set` give to the methods."""
    if request.config is None and not request.settings:
        return ()
    from fg_nav.commands.config import choose_changes

    return choose_changes(request.config, request.settings or (), methods, mount, request.preset)


def _wants_truth(request: RunRequest | CompareRequest, recording: Path) -> bool:
    """Whether a truth beside a recording is to be looked for: not again where a configuration is of it."""
    if request.no_truth and request.truth is not None:
        raise EstimationError("--truth and --no-truth contradict each other: give one of them.")
    return not request.no_truth and not (request.config is not None and request.config.is_of(recording))


def _run_one(request: RunRequest, method: Method, options: Options, recording: Path, out: Path | None) -> Answer:
    """Navigate with one recording, and return the summary."""
    force = request.force and (out is not None or request.save_places is None)
    target = Target(out, force, f"{name_walk(recording)}-{method.name}")
    if request.config is not None:
        options = request.config.bind(options, recording)
    with target, progress(method.name) as report:
        walk = read_walk(recording, options, choose_reading(request))
        if _wants_truth(request, recording):
            walk = find_truth(walk, recording)
        if request.save_places is not None:
            require_mag(walk)  # before the work
        result = navigate(walk, method.name, progress=report)
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
    return _answer(request, {"recording": str(recording)}, summary, target.place, failure)


def _answer(
    request: RunRequest, known: dict[str, object], summary: Summary, folder: Path, failure: FgNavError | None = None
) -> Answer:
    """Return the summary, a failure where the path is not to be used and `--strict` was asked for."""
    if failure is None and request.strict and summary["verdict"] == UNUSABLE:
        failure = VerdictError(f"the path is not to be used: see its reasons in {folder / 'summary.json'}.")
    content = {**known, "folder": str(folder), **summary}
    return Answer(content, partial(print_results, [summary], folder), failure)


def run_feet(request: RunRequest, method: Method, options: Options) -> Answer:
    """Navigate both feet as one walk, and return the summary.

    Raises `EstimationError` if there are not two recordings, or a file is of one recording.
    """
    from fg_nav.both_feet import MAX_GAP_S, navigate_feet

    reading = replace(choose_reading(request), longest_gap_s=MAX_GAP_S)
    recordings, readings = request.recordings, [reading] * len(request.recordings)
    # Two sensors of one file, by default those called left and right: the file counts twice.
    sensors = [word.strip() for word in (request.sensor or ("left,right" if len(recordings) == 1 else "")).split(",")]
    if len(recordings) == 1 and len(sensors) == 2 and all(sensors):
        recordings, readings = [recordings[0]] * 2, [replace(reading, sensor=sensor) for sensor in sensors]
    if len(recordings) == 1:
        raise EstimationError(f"{ONE_FILE}, as --sensor left,right.")
    in_one = len(recordings) == 2 and recordings[0] == recordings[1]  # on one clock
    if len(recordings) != 2 or (in_one and readings[0] == readings[1]):
        given = "the same one twice" if in_one else f"{len(recordings)} of them"
        raise EstimationError(f"--mount feet takes two recordings, one of each foot, and was given {given}.")
    truths, wants_truth = split_files("--truth", request.truth), _wants_truth(request, recordings[0]) and not in_one
    calibrations = split_files("--calibration", request.calibration)
    # Sides by the names of the sensors, where they say them.
    sides = {(side, other): f"{side},{other}" for side, other in (SIDES, SIDES[::-1])}
    named = next((order for pair, order in sides.items() if all(map(_names_side, sensors, pair))), None)
    target = Target(request.out, request.force, "-".join([*dict.fromkeys(map(name_walk, recordings)), method.name]))
    with target, progress(method.name) as report:
        walks = []
        for path, one, truth, calibration in zip(recordings, readings, truths, calibrations, strict=True):
            own = replace(options, heading_deg=None, truth_path=truth, calibration_path=calibration)
            try:
                walks.append(read_walk(path, own, one))
            except FormatError as error:
                if request.sensor or not in_one:
                    raise
                reason = str(error).removesuffix(": leave --sensor out.")
                raise EstimationError(f"{ONE_FILE}, but {reason.removesuffix('.')}.") from None
        if wants_truth and all(name_truth(one).is_file() for one in recordings):
            walks = list(map(find_truth, walks, recordings))
        result = navigate_feet(
            walks[0],
            walks[1],
            method.name,
            heading_deg=request.heading,
            clock_offset_s=0.0 if in_one and request.clock_offset is None else request.clock_offset,
            sides=request.sides or (cast("Order | None", named) if in_one else None),
            progress=report,
        )
        with target.open() as folder:
            summary = write_feet(folder, result, request.plots)
    return _answer(request, {"recordings": [str(one) for one in recordings]}, summary, target.place)


def _names_side(sensor: str, side: Side) -> bool:
    """Whether the name of a sensor says its foot: left, or l, lf."""
    return side in sensor.lower() or sensor.lower() in (side[0], f"{side[0]}f")


def compare(request: CompareRequest) -> Answer:
    """Run several methods on a recording, and return their summaries."""
    words = COMPARED[request.mount] if request.methods is None else request.methods
    methods = [find_method(name, request.mount) for name in dict.fromkeys(word.strip() for word in words.split(","))]
    refuse_misfits(request, methods)
    changes = _choose_changes(request, methods, request.mount)
    options = replace(choose_options(request), mount=request.mount, changes=changes)
    wants_truth = _wants_truth(request, request.recording)
    if request.config is not None:
        options = request.config.bind(options, request.recording)
    with Target(request.out, request.force, f"{name_walk(request.recording)}-compare") as target:
        walk = read_walk(request.recording, options, choose_reading(request))
        walk = prepare_walk(find_truth(walk, request.recording) if wants_truth else walk)
        outcomes = run_methods(walk, [one.name for one in methods])
        with target.open() as folder:
            summaries = write_comparison(folder, walk, outcomes, request.plots)
    return answer_comparison(request.recording, summaries, target.place)


def answer_comparison(recording: Path, summaries: list[Summary], place: Path) -> Answer:
    """Return the summaries of several methods, which are in a folder."""
    content = {"recording": str(recording), "folder": str(place), "methods": summaries}
    return Answer(content, partial(print_results, summaries, place))
