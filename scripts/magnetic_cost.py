"""What the magnetic factors cost: the smoother with the field over the smoother without it, at three lengths.

    python scripts/magnetic_cost.py [--repeats N] [--fields LEVEL ...] [--scenario NAME] [--json FILE]

One walk of `mall` (35 minutes), cut after a quarter and a half. The calls follow each other within a repeat, so that
what else the machine does falls on all alike; ratios are taken within a repeat, and the median over the repeats counts.
Each runs in one thread of its own making, and is judged by the time of the processor, with the wall time beside it.

============= ====================================================================================================
with/without  `smooth(..., field=field)` over `smooth(...)`
field         `footfall_field`: finding the field at the footfalls, which `prepare` does once for all methods; as a
              share of the smoother without the field
doubling      cost with the field over that of half the walk; the same without it beside
============= ====================================================================================================

Asked: at most 1.4 with/without, and a doubling as without the field (2.3 at most, as in `benchmark`).
"""

from __future__ import annotations

import argparse
import gc
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import figures as fig
import numpy as np
from benchmark import DOUBLING_RATIO, Time, timed
from figures import Figure

from fg_nav.detection import detect_stances
from fg_nav.errors import SimulationError
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.magnetic import footfall_field
from fg_nav.recording import Recording
from fg_nav.smoother import smooth

SCENARIO, SEED, FIELDS = "mall", 1, ("smooth", "indoor")
PARTS = (0.25, 0.5, 1.0)
MOST_RATIO = 1.4


@dataclass(frozen=True)
class Cost:
    """Of one part of a walk, in one repeat."""

    without: Time
    with_field: Time
    finding: Time


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print, judge."""
    parser = argparse.ArgumentParser(description="What the magnetic factors cost.")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="how often all is run (3)")
    parser.add_argument("--fields", nargs="+", default=FIELDS, metavar="LEVEL")
    parser.add_argument("--scenario", default=SCENARIO, metavar="NAME", help=f"the walk ({SCENARIO})")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to this file")
    chosen = parser.parse_args(arguments)
    if chosen.repeats < 1:
        raise SimulationError(f"{chosen.repeats} repeats show nothing: ask for one or more.")
    figures: list[Figure] = []
    for level in chosen.fields:
        walk = simulate(chosen.scenario, SEED, Choices(field=level, calibrated=True)).recording
        parts = [walk.slice(0, round(share * len(walk))) for share in PARTS]
        costs(parts[0])  # compiled
        repeats = [[costs(part) for part in parts] for _ in range(chosen.repeats)]
        figures += print_costs(f"{chosen.scenario}, {level}", parts, repeats)
    fig.print_figures(figures)
    fig.print_verdict(figures)
    if chosen.json:
        fig.write_json(chosen.json, {"figures": [f.as_dict() for f in figures]})


def costs(part: Recording) -> Cost:
    """Time each call once."""
    stances = detect_stances(part)
    finding, field = timed(lambda: footfall_field(part, stances))
    gc.collect()
    without, _ = timed(lambda: smooth(part, stances))
    gc.collect()
    with_field, _ = timed(lambda: smooth(part, stances, field=field))
    return Cost(without, with_field, finding)


def print_costs(section: str, parts: Sequence[Recording], repeats: Sequence[Sequence[Cost]]) -> list[Figure]:
    """One row a length; returns the figures."""
    fig.print_heading(f"{section}: medians over {len(repeats)} repeats")
    rows, figures = [], []
    for k, part in enumerate(parts):
        some = [repeat[k] for repeat in repeats]
        cpu, wall = (_median([_ratio(one.with_field, one.without, of) for one in some]) for of in ("cpu", "wall"))
        finding = _median([_ratio(one.finding, one.without, "cpu") for one in some])
        us = 1e6 * _median([one.without.cpu for one in some]) / len(part)
        minutes = f"{(part.t[-1] - part.t[0]) / 60:.1f} min"
        rows.append((minutes, f"{us:.2f}", f"{cpu:.2f}", f"{wall:.2f}", f"{finding:.2f}"))
        figures.append(Figure(section, f"{section}, {minutes}: with/without", "smoother", cpu, high=MOST_RATIO))
    heads = ("walk", "without, us a sample", "with/without", "the same, wall", "field/without")
    fig.print_table(heads, rows)
    return figures + _doublings(section, repeats)


def _doublings(section: str, repeats: Sequence[Sequence[Cost]]) -> list[Figure]:
    figures = []
    for k, (half, whole) in enumerate(pairwise(range(len(PARTS)))):
        words = f"{section}, doubling {k + 1}"
        ours = _median([_ratio(one[whole].with_field, one[half].with_field, "cpu") for one in repeats])
        bare = _median([_ratio(one[whole].without, one[half].without, "cpu") for one in repeats])
        figures += [
            Figure(section, f"{words}: with the field", "smoother", ours, high=DOUBLING_RATIO),
            Figure(section, f"{words}: without", "inertial", bare),
        ]
    return figures


def _ratio(one: Time, other: Time, of: str) -> float:
    return float(getattr(one, of) / getattr(other, of))


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))


if __name__ == "__main__":
    fig.leave_with(main)
