"""Figures of one method on one walk, by the names that the papers have for them (`fg_nav.evaluation.walked`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from fg_nav.evaluation.walked import AS_STARTED, error_reduction_percent
from fg_nav.lab.campaign import kept
from fg_nav.lab.campaign.kept import Result
from fg_nav.lab.reproduce.results import Spread, spread_of

Figure = Callable[[Result], float | None]
"""A figure of a walk; None where it has none."""


def walk_error(result: Result, name: str, mode: str = AS_STARTED) -> float | None:
    """Size of an error of `WalkErrors`, laid on the truth in this way; None where there is none."""
    errors = result.errors.get(mode)
    value = None if errors is None else getattr(errors, name)
    return None if value is None else float(abs(value))


def at_landmarks(result: Result, of: Callable[[Sequence[float]], float], mode: str = AS_STARTED) -> float | None:
    """Mean or largest error over the crossings of landmarks; None where there is none."""
    errors = result.landmark_m.get(mode)
    return None if not errors else float(of(errors))


def mean(values: Sequence[float]) -> float:
    """Arithmetic mean, the same in whatever order the sum is made."""
    return math.fsum(values) / len(values)


def used_percent(result: Result) -> float | None:
    """Share of the footfalls at which the method took in the field."""
    return 100.0 * result.used.count(kept.USED) / len(result.used) if result.used else None


def end_m(result: Result) -> float | None:
    """Final position error, over the ground."""
    return walk_error(result, "end_m")


def end_percent(result: Result) -> float | None:
    """The same in percent of the way, TTD."""
    return walk_error(result, "end_percent")


def heading_deg(result: Result) -> float | None:
    """Error of the change of heading from first to last footfall."""
    return walk_error(result, "heading_deg")


def mean_m(result: Result) -> float | None:
    """Mean error at the footfalls."""
    return walk_error(result, "mean_m")


def max_m(result: Result) -> float | None:
    """Largest error at a footfall."""
    return walk_error(result, "max_m")


def landmark_mean_m(result: Result) -> float | None:
    """Mean error over the crossings of landmarks."""
    return at_landmarks(result, mean)


def landmark_max_m(result: Result) -> float | None:
    """Largest error at a crossing of a landmark."""
    return at_landmarks(result, max)


def spread_over(results: Sequence[Result], figure: Figure) -> Spread:
    """Median and spread over walks; a failed walk is infinitely wrong."""
    values = [math.inf if result.failed else figure(result) for result in results]
    return spread_of([value for value in values if value is not None])


def reduction_over(results: Sequence[Result], reference: Sequence[Result], figure: Figure) -> Spread:
    """Median and spread, over walks, of the reduction of a figure against that of another method on the same walk."""
    theirs: Mapping[str, Result] = {result.key.walk: result for result in reference}
    found = []
    for result in results:
        other = theirs.get(result.key.walk)
        pair = (figure(result), None if other is None else figure(other))
        if pair[0] is not None and pair[1]:
            found.append(error_reduction_percent(pair[0], pair[1]))
        elif result.failed:
            found.append(-math.inf)
    return spread_of(found)
