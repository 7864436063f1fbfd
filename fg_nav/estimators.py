"""The estimators by the names under which people ask for them.

Each takes the same recording and the same stances and returns a `Solution`, so that a comparison compares
estimators and nothing else. They are imported when first called: the graph library alone takes a second to
load.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from fg_nav.errors import EstimationError
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.stances import Stances

Progress: TypeAlias = Callable[[float], None]
"""Told from time to time what fraction of the work is done."""

Estimator: TypeAlias = Callable[[Recording, Stances, float, Progress | None], Solution]
"""Called with recording, stances, heading at the start in rad, and progress."""


def _smoother(recording: Recording, stances: Stances, heading: float, progress: Progress | None) -> Solution:
    from fg_nav.smoother import smooth

    return smooth(recording, stances, heading=heading, progress=progress)


def _iez(recording: Recording, stances: Stances, heading: float, progress: Progress | None) -> Solution:
    from fg_nav.ekf import run_iez

    return run_iez(recording, stances, heading=heading)


ESTIMATORS: dict[str, Estimator] = {"smoother": _smoother, "iez": _iez}


def estimator(name: str) -> Estimator:
    """Return the estimator of this name; raises `EstimationError` if there is none."""
    if name not in ESTIMATORS:
        raise EstimationError(f"there is no method '{name}': choose one of {', '.join(ESTIMATORS)}.")
    return ESTIMATORS[name]
