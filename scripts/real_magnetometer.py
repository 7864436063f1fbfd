"""Real walks with their magnetometer and without it: the set `magnetometer` of `real_walks.py`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import harness
import numpy as np
import walks
from harness import Figure
from walks import GDIN, OPENSHOE, REAL_WALKS

from fg_nav.errors import EstimationError, EvaluationError
from fg_nav.lab.campaign.walks import RAW, WALK, Recorded
from fg_nav.navigate import run_method
from fg_nav.walk import Walk as PreparedWalk

MAGNETIC_M, NO_WORSE, MAGNETIC_CLOSURE_PERCENT = 0.45, 1.10, 0.5
"""Mean footprint rmse, m; greatest ratio of any walk's to its own without the field; median closure, %."""

KNOWN_IRON: Mapping[str, str] = {RAW: "as recorded", WALK: "calibrated on the walk"}
MERITS = {GDIN: "footprint rmse (m)", OPENSHOE: "closure (%)"}


@dataclass(frozen=True)
class Pair:
    """A figure of merit of one walk without the field and with it, by what was known of the iron; infinite: failed."""

    group: str
    walk: str
    without: float
    with_field: Mapping[str, float]
    calibrated: bool

    def ratio(self, iron: str) -> float:
        """With the field over without it."""
        return self.with_field[iron] / self.without

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON."""
        known = {"without": self.without, **self.with_field}
        rounded = {name: harness.finite(float(f"{value:.5g}")) for name, value in known.items()}
        return {"group": self.group, "name": self.walk, **rounded, "calibrated": self.calibrated}


def measure_pairs(data: Path, names: Mapping[str, Sequence[str]] = REAL_WALKS) -> list[Pair]:
    """Measure each walk without the field and with it."""
    return [measure_pair(group, walk, data) for group in MERITS for walk in names[group]]


def measure_pair(group: str, walk: str, data: Path) -> Pair:
    """Measure one walk without the field and with it."""
    source = Recorded(walks.real_path(group, walk, data))
    prepared = {iron: source.prepare(iron) for iron in KNOWN_IRON}
    with_field = {iron: measure_merit(one, "smoother") for iron, one in prepared.items()}
    known = prepared[WALK].calibration is not None
    return Pair(group, walk, measure_merit(prepared[RAW], "inertial"), with_field, known)


def measure_merit(walk: PreparedWalk, method: str) -> float:
    """Footprint rmse in m where there is a truth, else closure in percent; infinite where the method fails."""
    try:
        metrics = run_method(walk, method).metrics
    except (EstimationError, EvaluationError):
        return float("inf")
    value = metrics.closure_percent if walk.truth is None else metrics.rmse_2d_m
    return float("inf") if value is None else value


def print_pairs(pairs: Sequence[Pair]) -> list[Figure]:
    """Print one row a walk, and return the figures of each group."""
    figures = []
    for group, merit in MERITS.items():
        some = [pair for pair in pairs if pair.group == group]
        if not some:
            continue
        harness.print_heading(f"{group}: {merit}, without the magnetometer and with it (ratio)")
        rows = []
        for one in some:
            cells = [f"{one.with_field[iron]:.3f} ({one.ratio(iron):.2f})" for iron in KNOWN_IRON]
            rows.append((f"{group} {one.walk}", f"{one.without:.3f}", *cells, "yes" if one.calibrated else "no"))
        harness.print_table(("walk", "without", *KNOWN_IRON.values(), "shows its iron"), rows)
        found = [figure for iron in KNOWN_IRON for figure in judge_pairs(group, some, iron)]
        harness.print_figures(found)
        figures += found
    return figures


def judge_pairs(group: str, pairs: Sequence[Pair], iron: str) -> list[Figure]:
    """What is asked with the magnetometer."""
    some = np.array([one.with_field[iron] for one in pairs])
    worst, words = max(one.ratio(iron) for one in pairs), KNOWN_IRON[iron]
    name, mean, middle = f"{words}: greatest ratio to without", float(some.mean()), float(np.median(some))
    if group == OPENSHOE:
        return [
            Figure(group, f"{words}: closure, median (%)", "smoother", middle, high=MAGNETIC_CLOSURE_PERCENT),
            Figure(group, name, "smoother", worst, pattern="{:.2f}"),
        ]
    return [
        Figure(group, f"{words}: rmse, mean (m)", "smoother", mean, high=MAGNETIC_M),
        Figure(group, name, "smoother", worst, high=NO_WORSE, pattern="{:.2f}"),
    ]
