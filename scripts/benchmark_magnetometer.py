"""What the magnetometer costs: processor time of the smoother with it over that without, on the same simulated walks.

    python scripts/benchmark_magnetometer.py [--repeats N] [--seed N] [--rate HZ] [--json FILE]

Timed is what `fg-nav run` does between reading and writing: correction, stances, field and smoother, compiled before;
no heading is given. Each repeat runs both modes on all walks, one after the other, so that what else the machine does
affects all alike; the ratio is taken within a repeat, and the median over the repeats counts. All times are those of
the processor.

The walks: the scenario `teaching-building` in an indoor field and in a smooth one, and the scenario `demo`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TypeAlias

import harness
import numpy as np
from harness import Figure, measure_time, option, spread

from fg_nav.arrays import Floats
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.walk import Options, Walk

RATIO = 1.5  # What is asked: with the magnetometer at most half as much time again.

RATE_HZ = 200.0

WITHOUT, WITH = "without", "with"
MODES = {WITHOUT: Options(use_magnetometer=False), WITH: Options()}

Repeat: TypeAlias = Mapping[str, Mapping[str, float]]
"""Walk -> mode -> processor time, s, of one repeat."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, and write what was asked for."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        rate=option(RATE_HZ, "of the samples", metavar="HZ"),
        seed=harness.FIRST_SEED,
        repeats=3,
        json=None,
    )
    walks = simulate_walks(chosen.seed, chosen.rate)
    repeats = measure_repeats(walks, chosen.repeats)
    figures = print_costs(walks, repeats)
    harness.print_verdict(figures, chosen.json, processor_s=repeats)


def simulate_walks(seed: int, rate_hz: float) -> dict[str, Recording]:
    """Return the walks by name."""
    levels = {
        f"building, {field}": Choices(rate_hz=rate_hz, field=field, calibrated=True) for field in ("indoor", "smooth")
    }
    walks = {name: simulate("teaching-building", seed, choices) for name, choices in levels.items()}
    walks["demo"] = simulate("demo", seed, Choices(rate_hz=rate_hz))
    return {name: walk.recording for name, walk in walks.items()}


def measure_repeats(walks: Mapping[str, Recording], repeats: int) -> Sequence[Repeat]:
    """Time both modes on all walks, that many times, after a run of the last walk that compiles."""
    measure_modes(list(walks.values())[-1])
    return harness.repeat_measurement(measure_modes, walks, repeats)


def measure_modes(recording: Recording) -> dict[str, float]:
    """Time each mode once, on one walk."""
    return {mode: measure_time(partial(smooth, recording, options))[0].cpu for mode, options in MODES.items()}


def smooth(recording: Recording, options: Options) -> None:
    """Run the smoother on a recording, from the samples on."""
    run_method(prepare_walk(Walk.of(recording, options)), "smoother")


def print_costs(walks: Mapping[str, Recording], repeats: Sequence[Repeat]) -> list[Figure]:
    """Print the seconds of each mode and their ratio, and return the ratios."""
    rows, figures = [], []
    for name, recording in walks.items():
        without, with_it = (list_seconds(repeats, name, mode) for mode in (WITHOUT, WITH))
        ratio, words = with_it / without, f"{WITH} over {WITHOUT}, {name}"
        seconds = [f"{np.median(times):.2f}" for times in (without, with_it)]
        rows.append([name, str(len(recording)), *seconds, spread(ratio, ends=(0, 100))])
        figures.append(Figure("magnetometer", words, "smoother", float(np.median(ratio)), high=RATIO, pattern="{:.2f}"))
    harness.print_heading(f"Processor time, s, and its ratio: medians over {len(repeats)} repeats (least to greatest)")
    harness.print_table(("walk", "samples", WITHOUT, WITH, "ratio"), rows)
    harness.print_figures(figures)
    return figures


def list_seconds(repeats: Sequence[Repeat], walk: str, mode: str) -> Floats:
    """Processor time (R,) of a mode on a walk in each repeat."""
    return np.array([repeat[walk][mode] for repeat in repeats])


if __name__ == "__main__":
    harness.run(main)
