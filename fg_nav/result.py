"""What the main job returns: a solution, the walk that it was made of, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property

from fg_nav.evaluation.metrics import Metrics
from fg_nav.solution import Solution
from fg_nav.verdict import Verdict, judge_path
from fg_nav.walk import Outcome, Walk


@dataclass(frozen=True, repr=False)
class Result(Solution):
    """A `Solution` that knows its walk: what `fg_nav.navigate` returns.

    Attributes
    ----------
    walk : the recording as the method saw it, its stances, its field at the footfalls, its truth, the options.
    outcome : the comparison with the truth, and for an online method what came of its batch solution.

    Examples
    --------
    >>> result = fg_nav.navigate("walk.csv", "inertial")
    >>> result.position.shape == (len(result.t), 3)  # m, east, north, up from the first stance
    True
    >>> result.stances.position_sigma.shape == (len(result.stances), 3)  # m, one standard deviation
    True
    >>> result.walk.stances.n_footfalls == len(result.stances)
    True
    """

    walk: Walk = field(kw_only=True)
    outcome: Outcome = field(kw_only=True)

    @classmethod
    def of(cls, walk: Walk, outcome: Outcome) -> Result:
        """Join a walk with what a method made of it."""
        known = {item.name: getattr(outcome.solution, item.name) for item in fields(Solution)}
        return cls(**known, walk=walk, outcome=outcome)

    @property
    def metrics(self) -> Metrics:
        """Distance and closure in m, and where there is a truth the errors, in m and deg.

        Examples
        --------
        >>> result = fg_nav.navigate("walk.csv", "inertial", truth="truth.tum")
        >>> result.metrics.rmse_2d_m < 0.5
        True
        """
        return self.outcome.metrics

    @cached_property
    def verdict(self) -> Verdict:
        """Whether the path is to be trusted: a word, and the reasons against it.

        Examples
        --------
        >>> fg_nav.navigate("walk.csv", "inertial").verdict.word
        'trusted'
        """
        return judge_path(self.walk, self)
