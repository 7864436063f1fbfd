"""`fg-nav run`: one method on a recording, into a folder with trajectory, strides, summary and pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from fg_nav.commands import TUNED, Target
from fg_nav.errors import EstimationError
from fg_nav.estimators import DEFAULT_METHOD, find_estimator
from fg_nav.navigate import navigate
from fg_nav.report.terminal import print_results, progress
from fg_nav.walk import Mount, Options


def run(
    recording: Path,
    method: str | None,
    mount: Mount,
    options: Options,
    lengths_m: tuple[float | None, float | None],
    format: str | None,
    out: Path | None,
    force: bool,
) -> None:
    """Navigate, and print the summary.

    `lengths_m` are the step constant and the known distance of one who walks with the sensor in a pocket.
    """
    method = method or DEFAULT_METHOD[mount]
    find_estimator(method, mount)
    target = Target(out, force, f"{recording.stem}-{method}")
    options = replace(options, mount=mount, step_constant_m=lengths_m[0], known_distance_m=lengths_m[1])
    with progress(method) as report:
        summary = navigate(recording, method, options, target.open(), format, report)
    print_results([summary], target.place)


def check_mount(mount: Mount, lengths_m: tuple[float | None, float | None], detector: str | None, preset: str) -> None:
    """Refuse options that are for a sensor worn elsewhere."""
    if mount == "foot" and lengths_m != (None, None):
        raise EstimationError(
            "--step-constant and --known-distance are for a sensor in a pocket: add --mount pocket, or leave them out."
        )
    if mount == "pocket" and (detector is not None or preset != TUNED):
        raise EstimationError("--detector and --preset are for a sensor on a foot: leave them out with --mount pocket.")
