"""`fg-nav compare` and `fg-nav demo`: several methods on the same walk, side by side."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from fg_nav.commands import Target, run_methods, simulate_walk
from fg_nav.commands.simulate import write_simulation
from fg_nav.estimators import find_estimator
from fg_nav.navigate import prepare_walk
from fg_nav.report.files import write_comparison
from fg_nav.report.folder import DEMO_FILES
from fg_nav.report.terminal import print_results
from fg_nav.walk import Options, Walk, read_walk

DEMO_METHODS = ("smoother", "iez")


def compare(recording: Path, methods: str, options: Options, format: str | None, out: Path | None, force: bool) -> None:
    """Run the methods of a list with commas on a recording, and print their summaries."""
    names = list(dict.fromkeys(name.strip() for name in methods.split(",")))
    for name in names:
        find_estimator(name)
    target = Target(out, force, f"{recording.stem}-compare")
    walk = prepare_walk(read_walk(recording, options, format))
    outcomes = run_methods(walk, names)
    with target.open() as folder:
        summaries = write_comparison(folder, walk, outcomes)
    print_results(summaries, target.place)


def demo(seed: int, out: Path | None, force: bool) -> None:
    """Simulate one minute of walking, and compare the methods on it."""
    target = Target(out, force, "demo", DEMO_FILES)
    simulated = simulate_walk("demo", seed)
    with target.open() as folder:
        # the recording as it will be read from the folder
        provenance = replace(simulated.recording.provenance, path=target.place / "recording.csv", format="canonical")
        walk = prepare_walk(Walk.of(replace(simulated.recording, provenance=provenance)))
        outcomes = run_methods(walk, DEMO_METHODS)
        write_simulation(folder, simulated)
        summaries = write_comparison(folder, walk, outcomes)
    print_results(summaries, target.place)
