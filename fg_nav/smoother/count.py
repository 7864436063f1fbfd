"""How many factors of each kind a graph held, counted from the factors themselves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import gtsam
import numpy as np

from fg_nav.factors.residual import LETTER_SHIFT
from fg_nav.smoother.constraints import FixFactors
from fg_nav.smoother.field_factors import FieldFactors
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.known_places import KnownPlaceFactors
from fg_nav.smoother.own_factors import OwnFactors
from fg_nav.smoother.strides import INERTIAL_KEYS

KINDS = ("imu", "zero_velocity", "magnetic_heading", "differential_field", "field_potential", "gated_out")
"""As in `summary.json`; `gated_out` are the footfalls with a field whose compass a hard gate left out.

Factors of the caller's own stand with them as `own`, fixes as `position_fix`, places recognized as `same_place`,
those of an earlier walk as `known_place`, courses along the directions of a building as `direction`, heights by the
pressure of the air as `barometer`.
"""

POSITION_FIX, BAROMETER = "position_fix", "barometer"

_KIND_OF_KEYS = {
    "xvxvb": "imu",
    "xvs": "zero_velocity",
    "xm": "magnetic_heading",
    "xmm": "field_potential",
    "b": "differential_field",
    "xp": BAROMETER,
}
"""By the letters of the variables that a factor joins. No other factor joins the same, but priors a bias."""


def count_factors(problem: WalkProblem) -> Counter[str]:
    """Count the factors of a walk as it was solved."""
    counts = Counter(dict.fromkeys(KINDS, 0))
    counts["imu"] = sum(problem.graph.at(i).size() == INERTIAL_KEYS for i in range(problem.graph.size()))
    counts["zero_velocity"] += len(problem.velocities.keys)
    counts["differential_field"] += 0 if problem.differential is None else len(problem.differential)
    if problem.field is not None:
        counts["magnetic_heading"] += len(problem.field.heading.keys)
        counts["field_potential"] += len(problem.field.potential.keys)
        counts["gated_out"] += _count_gated_out(problem.field)
    if problem.places is not None:
        counts["same_place"] = len(problem.places)
    if problem.directions is not None:
        counts["direction"] = len(problem.directions)
    if problem.barometer is not None:
        counts[BAROMETER] = len(problem.barometer)
    fixes = sum(len(list(block.factors())) for block in problem.constraints if isinstance(block, FixFactors))
    if fixes:
        counts[POSITION_FIX] = fixes
    known = sum(len(list(block.factors())) for block in problem.constraints if isinstance(block, KnownPlaceFactors))
    if known:
        counts["known_place"] = known
    own = sum(len(block) for block in problem.constraints if isinstance(block, OwnFactors))
    if own:
        counts["own"] = own
    return counts


def _count_gated_out(field: FieldFactors) -> int:
    readings = field.readings
    seen = np.isfinite(readings.body_field).all(axis=1) & field.parameters.compass
    return int((seen & ~np.isfinite(readings.sigma_uT)).sum())


def count_graph(graph: gtsam.NonlinearFactorGraph) -> Counter[str]:
    """Count the factors of gtsam by kind: as `count_factors` does those of the motion and of the field."""
    kinds = (_find_kind(graph.at(i)) for i in range(graph.size()))
    return Counter(kind for kind in kinds if kind is not None)


def _find_kind(factor: gtsam.NonlinearFactor) -> str | None:
    word = _letters(factor.keys())
    if word == "b" and not isinstance(factor, gtsam.LinearContainerFactor):
        return None
    return _KIND_OF_KEYS.get(word)


def _letters(keys: Iterable[int]) -> str:
    return "".join(chr(key >> LETTER_SHIFT) for key in keys)
