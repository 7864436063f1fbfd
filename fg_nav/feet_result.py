"""What comes of a walk with a sensor on each foot: the person's path, with each foot's own result.

The person is the middle of both sensors (`fg_nav.feet.person`). As a `Solution` it has one row a footfall of the left
foot, and its attitude is level, with x in the direction of walking. Where one foot's recording could not be used, the
person is where the other foot is, and where nothing ties the two that were solved as two walks, where the left one is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import compare, interpolate_truth
from fg_nav.evaluation.metrics import Metrics, evaluate
from fg_nav.feet import Side
from fg_nav.feet.person import PersonPath
from fg_nav.pipeline import Result
from fg_nav.solution import Solution, StanceTable
from fg_nav.truth import TrajectoryTruth
from fg_nav.verdict import UNUSABLE, Verdict, Word
from fg_nav.walk import Outcome

Known: TypeAlias = Literal["named", "shown", "assumed"]
"""How it is known which recording is of which foot: by the user, by the steps, or not."""

WORDS: tuple[Word, ...] = ("trusted", "doubtful", UNUSABLE)  # From the best to the worst.


@dataclass(frozen=True)
class Pairing:
    """How two recordings were put together."""

    order: tuple[Side, Side]  # feet of the first and of the second recording, and `sides` how that is known
    sides: Known
    # was added to the second recording's stamps; `clock_given` by the user, else by the signals
    clock_offset_s: float = 0.0
    clock_given: bool = False
    clock_drift: float = 0.0  # by how much more with each second since its start, s/s
    # between the sensors, across the way; None where one foot is missing, or nothing ties them
    width_m: float | None = None
    width_sigma_m: float | None = None
    cells: int = 0  # of steps that tie the feet
    beyond_reach: int = 0  # pairs of footfalls that were out of reach of each other before they were tied
    heading_deg: float | None = None  # of the left sensor at its start, as it was given; None where it was not
    doubts: tuple[str, ...] = ()  # sentences that make the result doubtful


@dataclass(frozen=True, repr=False)
class FeetResult(Solution):
    """The person's path as a `Solution`, and both feet: what `fg_nav.navigate_feet` returns.

    Attributes
    ----------
    feet : the `Result` of each foot that was navigated, by its side; stamps are of the first recording's clock.
    person : the path between the feet, with its covariance.
    pairing : how the recordings were put together: width, clocks, which is which foot.
    outcome : of the person, against the middle of both feet's truths where they have one.
    truth : of the person.

    Examples
    --------
    >>> result = fg_nav.navigate_feet("left.csv", "right.csv", "inertial")
    >>> sorted(result.feet), result.position.shape == (len(result.t), 3)  # m, between the feet
    (['left', 'right'], True)
    >>> result.stances.position_sigma.shape == (len(result.stances), 3)  # m, a row a footfall of the left foot
    True
    """

    feet: Mapping[str, Result] = field(kw_only=True)
    person: PersonPath = field(kw_only=True)
    pairing: Pairing = field(kw_only=True)
    outcome: Outcome = field(kw_only=True)
    truth: TrajectoryTruth | None = field(kw_only=True, default=None)

    @classmethod
    def of(
        cls, feet: Mapping[str, Result], person: PersonPath, pairing: Pairing, notes: tuple[str, ...] = ()
    ) -> FeetResult:
        """Join the results of the feet, and evaluate the person's path against the mean of both true paths."""
        first = next(iter(feet.values()))
        tied = pairing.width_m is not None
        truth, why_not = _find_truth(feet if tied else dict([next(iter(feet.items()))]))
        notes = (*pairing.doubts, *notes, *why_not)
        solution = make_person_solution(person, first, max(foot.runtime_s for foot in feet.values()), notes)
        solution = solution.widen(max(foot.walk.recording.provenance.rate_sigma for foot in feet.values()))
        outcome = Outcome(solution, evaluate(solution), None)
        if truth is not None:
            try:
                comparison = compare(solution, truth, first.walk.options.alignment)
                outcome = Outcome(solution, evaluate(solution, truth, comparison=comparison), comparison)
            except EvaluationError as error:
                metrics = outcome.metrics
                metrics = replace(metrics, notes=(*metrics.notes, f"the person's truth left out: {error}"))
                outcome = replace(outcome, metrics=metrics)
        known = {item.name: getattr(outcome.solution, item.name) for item in fields(Solution)}
        truth = None if outcome.comparison is None else truth
        return cls(**known, feet=feet, person=person, pairing=pairing, outcome=outcome, truth=truth)

    @property
    def left(self) -> Result | None:
        """The left foot; None where its recording could not be navigated."""
        return self.feet.get("left")

    @property
    def right(self) -> Result | None:
        """The right foot, likewise."""
        return self.feet.get("right")

    @property
    def width_m(self) -> float | None:
        """Between the sensors, across the way, m; None where one foot is missing, or nothing ties them.

        Examples
        --------
        >>> 0.0 < fg_nav.navigate_feet("left.csv", "right.csv", "inertial").width_m < 0.5
        True
        """
        return self.pairing.width_m

    @property
    def metrics(self) -> Metrics:
        """Distance and closure of the person, and errors where both feet have a true path; those of a foot are its own.

        Examples
        --------
        >>> result = fg_nav.navigate_feet("left.csv", "right.csv", "inertial", sides="left,right")
        >>> result.metrics.distance_m < result.left.metrics.distance_m + 1.0
        True
        """
        return self.outcome.metrics

    @cached_property
    def verdict(self) -> Verdict:
        """The worse of both feet's verdicts, with all reasons; doubtful at least where one foot is missing.

        Examples
        --------
        >>> fg_nav.navigate_feet("left.csv", "right.csv", "inertial").verdict.word
        'trusted'
        """
        found = {side: foot.verdict for side, foot in self.feet.items()}
        words: list[Word] = [one.word for one in found.values()]
        if self.pairing.doubts:
            words.append("doubtful")
        reasons = tuple(f"{side} foot: {reason}" for side, one in found.items() for reason in one.reasons)
        return Verdict(max(words, key=WORDS.index), (*self.pairing.doubts, *reasons))


def make_person_solution(person: PersonPath, foot: Solution, runtime_s: float, notes: tuple[str, ...] = ()) -> Solution:
    """Return the person's path as a `Solution` with method and parameters of a foot; no bias, no field."""
    # the sample of each footfall, once
    sample, first = np.unique(
        np.clip(np.searchsorted(person.t, person.footfall_t), 0, len(person.t) - 1), return_index=True
    )
    cov, count = person.pose_cov[first], len(sample)
    unknown = np.full((count, 3), np.nan)
    table = StanceTable(
        sample,
        person.t[sample],
        person.position[sample],
        person.nav_R_person[sample],
        gyro_bias=unknown,
        position_cov=cov[:, :3, :3],
        heading_sigma=np.sqrt(cov[:, 3, 3]),
        gyro_bias_sigma=unknown,
        field=("none",) * count,
        field_reason=("",) * count,
        pose_cov=cov,
    )
    path = person.t, person.position, person.velocity, person.nav_R_person
    return Solution(foot.method, *path, table, runtime_s, foot.parameters, notes)


def _find_truth(feet: Mapping[str, Result]) -> tuple[TrajectoryTruth | None, tuple[str, ...]]:
    """Return the mean of both feet's true paths (of one foot, its own) or None, and notes on why there is none."""
    truths = [foot.walk.truth for foot in feet.values() if foot.outcome.comparison is not None]
    paths = [truth for truth in truths if isinstance(truth, TrajectoryTruth)]
    if len(paths) < len(feet):
        return None, ()
    if len(paths) == 1:
        return replace(paths[0], nav_R_body=None), ()
    try:
        row, other = interpolate_truth(paths[1], paths[0].t)
    except EvaluationError as error:
        return None, (f"the person has no truth: {error}",)
    return TrajectoryTruth(paths[0].t[row], 0.5 * (paths[0].position[row] + other)), ()
