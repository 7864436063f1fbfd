"""`fg-nav run`, `compare` and `demo`: methods on a recording, into a folder of results.

`fg-nav run`: one method, with trajectory, strides, summary and pictures.
`fg-nav compare` and `fg-nav demo`: several methods on the same walk, side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from fg_nav.commands import TUNED, Answer, Target, name_walk, run_methods, simulate_walk
from fg_nav.errors import EstimationError, VerdictError
from fg_nav.estimators import DEFAULT_METHOD, ONLINE, WITH_OWN_DETECTOR, find_estimator
from fg_nav.io import Reading
from fg_nav.pipeline import navigate, prepare_walk
from fg_nav.report.files import Summary, write_comparison
from fg_nav.report.folder import DEMO_FILES
from fg_nav.report.terminal import print_results, progress
from fg_nav.verdict import UNUSABLE
from fg_nav.walk import Mount, Options, Walk, read_walk


def run(
    recording: Path,
    method: str | None,
    mount: Mount,
    options: Options,
    lengths_m: tuple[float | None, float | None],
    reading: Reading,
    out: Path | None,
    force: bool,
    strict: bool = False,
) -> Answer:
    """Navigate, and return the summary.

    `lengths_m` are the step constant and the known distance of one who walks with the sensor in a pocket.

    With `strict` a path that is not to be used is a failure.
    """
    method = method or DEFAULT_METHOD[mount]
    find_estimator(method, mount)
    target = Target(out, force, f"{name_walk(recording)}-{method}")
    options = replace(options, mount=mount, step_constant_m=lengths_m[0], known_distance_m=lengths_m[1])
    with progress(method) as report:
        summary = navigate(recording, method, options, target.open(), reading, report)
    failure = None
    if strict and summary["verdict"] == UNUSABLE:
        failure = VerdictError(f"the path is not to be used: see its reasons in {target.place / 'summary.json'}.")
    content = {"recording": str(recording), "folder": str(target.place), **summary}
    return Answer(content, partial(print_results, [summary], target.place), failure)


def check_methods(methods: Sequence[str | None], gate: str | None, polish: bool = False) -> None:
    """Refuse a gate where each of the methods has its own, and a batch solution next to one."""
    names = [(name or DEFAULT_METHOD["foot"]).strip() for name in methods]
    if gate is not None and set(names) <= set(WITH_OWN_DETECTOR):
        raise EstimationError(f"{names[0]} judges the field by its own detector: leave --gate out.")
    if polish and names != [ONLINE]:
        raise EstimationError(
            f"--polish is for --method {ONLINE}: leave it out, {names[0]} solves the walk as a whole."
        )


def check_mount(mount: Mount, lengths_m: tuple[float | None, float | None], gate: str | None, preset: str) -> None:
    """Refuse options that are for a sensor worn elsewhere."""
    if mount == "foot" and lengths_m != (None, None):
        raise EstimationError(
            "--step-constant and --known-distance are for a sensor in a pocket: add --mount pocket, or leave them out."
        )
    if mount == "pocket" and (gate is not None or preset != TUNED):
        raise EstimationError("--gate and --preset are for a sensor on a foot: leave them out with --mount pocket.")


DEMO_METHODS = ("smoother", "iez")


def compare(recording: Path, methods: str, options: Options, reading: Reading, out: Path | None, force: bool) -> Answer:
    """Run the methods of a list with commas on a recording, and return their summaries."""
    names = list(dict.fromkeys(name.strip() for name in methods.split(",")))
    for name in names:
        find_estimator(name)
    target = Target(out, force, f"{name_walk(recording)}-compare")
    walk = prepare_walk(read_walk(recording, options, reading))
    outcomes = run_methods(walk, names)
    with target.open() as folder:
        summaries = write_comparison(folder, walk, outcomes)
    return answer_comparison(recording, summaries, target.place)


def answer_comparison(recording: Path, summaries: list[Summary], place: Path) -> Answer:
    """Return the summaries of several methods, which are in a folder."""
    content = {"recording": str(recording), "folder": str(place), "methods": summaries}
    return Answer(content, partial(print_results, summaries, place))


def demo(seed: int, out: Path | None, force: bool) -> Answer:
    """Simulate one minute of walking, and compare the methods on it."""
    from fg_nav.commands.simulate import write_simulation  # loads the simulator, which no other of these needs

    target = Target(out, force, "demo", DEMO_FILES)
    simulated = simulate_walk("demo", seed)
    with target.open() as folder:
        # the recording as it will be read from the folder
        provenance = replace(simulated.recording.provenance, path=target.place / "recording.csv", format="canonical")
        walk = prepare_walk(Walk.of(replace(simulated.recording, provenance=provenance)))
        outcomes = run_methods(walk, DEMO_METHODS)
        write_simulation(folder, simulated)
        summaries = write_comparison(folder, walk, outcomes)
    return answer_comparison(target.place / "recording.csv", summaries, target.place)
