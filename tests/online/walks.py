"""A short walk with a magnetometer, and what a navigator makes of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.online import OnlineNavigator, smoother
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.estimates import Revision, StanceEstimate
from fg_nav.recording import Recording
from fg_nav.solution import StanceTable
from tests.simulated import PERSON, straight_walk

NORTH = OnlineOptions(heading_rad=0.0)


@cache
def short_walk(strides: int = 12) -> Recording:
    """Some fifteen seconds straight to the north at 100 Hz, in a field that points there."""
    walk = straight_walk(PERSON, strides=strides, rate_hz=100.0)
    recording = walk.recording
    attitude = walk.motion.at(recording.t).nav_R_body
    rng = np.random.default_rng(0)
    field = np.array([0.0, 20.0, -43.0]) + rng.normal(0.0, 0.3, (len(recording), 3))
    return replace(recording, mag=np.einsum("nji,nj->ni", attitude, field), truth=None)


def push(navigator: OnlineNavigator, rows: Floats, cuts: Iterable[int] = ()) -> list[StanceEstimate | Revision]:
    """Push rows (n, 10) in blocks between `cuts`."""
    found = []
    for start, stop in pairwise([0, *cuts, len(rows)]):
        block = rows[start:stop]
        found += navigator.push(block[:, 0], block[:, 1:4], block[:, 4:7], block[:, 7:10])
    return found


def worst_difference(one: StanceTable, other: StanceTable) -> float:
    """Largest difference of any number in two tables; infinite if they have other rows."""
    names = ("t", "position", "nav_R_body", "gyro_bias", "position_cov", "heading_sigma", "gyro_bias_sigma")
    if not np.array_equal(one.sample, other.sample) or one.field != other.field:
        return np.inf
    return max(float(np.abs(getattr(one, name) - getattr(other, name)).max()) for name in names)


def estimates_of(found: Iterable[StanceEstimate | Revision]) -> list[StanceEstimate]:
    """The estimates among what a navigator returned."""
    return [one for one in found if isinstance(one, StanceEstimate)]


def revisions_of(found: Iterable[StanceEstimate | Revision]) -> list[Revision]:
    """The revisions among it."""
    return [one for one in found if isinstance(one, Revision)]


def solve_only_at(monkeypatch: pytest.MonkeyPatch, *footfalls: int) -> None:
    """Let a walk be solved again at these footfalls and at its end: what is begun behind them is never due."""
    monkeypatch.setattr(smoother, "AT_ONCE", footfalls)
    monkeypatch.setattr(smoother, "choose_delay", lambda n, has_lag: 10**9)


def solve_in_windows(monkeypatch: pytest.MonkeyPatch, behind: int, window: int = 16) -> None:
    """Let a walk be solved as a whole up to a footfall, and behind it window by window."""
    at_once = tuple(n for n in (1, 2, 3, 4, 6, 8, 10) if n <= behind)
    for name, value in (("AT_ONCE", at_once), ("WHOLE_UNTIL", behind), ("WHOLE_WITH_LAG", behind), ("WINDOW", window)):
        monkeypatch.setattr(smoother, name, value)
