"""A paper's experiments on the terminal: each figure with the paper's beside ours, and why those differ that do."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import figures as fig

from fg_nav.errors import OutputError
from fg_nav.report.terminal import console, progress
from fg_nav.reproduce.results import EXPLAINED, NOT_REPRODUCED, Experiment, Reproduction, Row, Spread

FIRST_SEED, SEEDS = 101, 20


def reproduced(make: Callable[..., Reproduction], arguments: Sequence[str] | None) -> None:
    """Make the experiments as asked for, and print them."""
    parser = argparse.ArgumentParser(description="The experiments of a paper beside ours.")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of walks and pictures")
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help=f"walks, from seed 101 on ({SEEDS})")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (2)")
    parser.add_argument("--quick", action="store_true", help="three seeds, and less of each")
    chosen = parser.parse_args(arguments)
    if not chosen.out.is_dir():
        raise OutputError(f"there is no folder {chosen.out}: make it, or name another with --out.")
    with progress("experiments") as report:
        seeds = range(FIRST_SEED, FIRST_SEED + chosen.seeds)
        found = make(chosen.out, seeds, chosen.jobs, report, chosen.quick)
    for experiment in found.experiments:
        print_experiment(experiment)


def print_experiment(experiment: Experiment) -> None:
    """One row a figure; below, why some are off."""
    fig.print_heading(f"{experiment.name}: {experiment.title}")
    fig.print_table(
        ("figure", "paper", *experiment.columns, ""),
        [
            (
                f"{row.quantity} ({row.unit})" if row.unit else row.quantity,
                row.printed or "-",
                *(_told(row, row.ours.get(column)) for column in experiment.columns),
                row.verdict,
            )
            for row in experiment.rows
        ],
    )
    for row in experiment.rows:
        if row.verdict in (EXPLAINED, NOT_REPRODUCED):
            console().print(f"{row.verdict}: {row.quantity}. {row.why}")


def _told(row: Row, spread: Spread | None) -> str:
    if spread is None or not spread.n:
        return "-"
    middle, low, high = (row.pattern.format(value) for value in (spread.median, spread.low, spread.high))
    return middle if spread.n == 1 else f"{middle} ({low} to {high})"
