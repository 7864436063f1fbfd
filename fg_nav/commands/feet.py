"""`fg-nav run LEFT RIGHT --mount feet`: two recordings, of a sensor on each foot, as one walk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from fg_nav.both_feet import MAX_GAP_S, Order, check_method, navigate_feet
from fg_nav.commands import Answer, Target, name_walk
from fg_nav.commands.run import RunRequest, refuse_unusable
from fg_nav.errors import EstimationError
from fg_nav.feet import refuse_for_two, split_pair
from fg_nav.io import Reading
from fg_nav.report.feet import write_feet
from fg_nav.report.terminal import print_results, progress
from fg_nav.walk import Options, read_walk


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
    run, (recordings, readings) = request.run, _name_sensors(recordings, request.run.reading)
    _check(recordings, readings, run)
    truths = _split("--truth", request.truths)
    calibrations = _split("--calibration", request.calibrations)
    name = "-".join([*dict.fromkeys(map(name_walk, recordings)), run.method])
    in_one = recordings[0] == recordings[1]  # on one clock
    words = "".join(str(one.sensor).lower() for one in readings)
    named: Order | None = "left,right" if "left" in words and words.find("left") < words.find("right") else None
    named = "right,left" if "right" in words and words.find("right") < words.find("left") else named
    target = Target(run.out, run.force, name)
    with target, progress(run.method) as report:
        walks = [
            read_walk(path, _choose_options(run.options, *files), replace(reading, longest_gap_s=MAX_GAP_S))
            for path, reading, *files in zip(recordings, readings, truths, calibrations, strict=True)
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


def _name_sensors(recordings: Sequence[Path], reading: Reading) -> tuple[Sequence[Path], list[Reading]]:
    """Return two recordings and how each is read: of one file with two of its sensors named, that file twice."""
    sensors = [word.strip() for word in (reading.sensor or "").split(",")]
    if len(recordings) == 1 and len(sensors) == 2 and all(sensors):
        return [recordings[0]] * 2, [replace(reading, sensor=sensor) for sensor in sensors]
    return recordings, [reading] * len(recordings)


def _check(recordings: Sequence[Path], readings: Sequence[Reading], run: RunRequest) -> None:
    check_method(run.method)
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


def _split(option: str, files: Path | None) -> tuple[Path | None, Path | None]:
    """Return a file for each recording, of two with a comma between."""
    if files is None:
        return None, None
    pair = split_pair(files)
    if pair is None:
        raise EstimationError(
            f"{option} {files} is of one recording: with --mount feet give two files, one for each recording in their "
            f"order, as {option} A,B."
        )
    return pair


def _choose_options(options: Options, truth: Path | None, calibration: Path | None) -> Options:
    return replace(options, truth_path=truth, calibration_path=calibration, heading_deg=None, mount="foot")
