"""Walks in progress: a short one through the navigator, and the footfalls of a longer one through the smoother."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.detection.causal import Footfall
from fg_nav.online import OnlineNavigator, smoother
from fg_nav.online.buffer import OnlineOptions, SampleBuffer, rows_of
from fg_nav.online.estimates import Revision, StanceEstimate
from fg_nav.online.resolve import measure_online_field
from fg_nav.online.smoother import OnlineSmoother
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.solution import Solution, StanceTable
from tests.simulated import PERSON, corridor, straight_walk
from tests.smoother.walks import Walk, demo, part

NORTH = OnlineOptions(heading_rad=0.0)
FOOTFALLS = 40  # Of the longer walk, that are fed.

Found = list[StanceEstimate | Revision]


# --- through the navigator -------------------------------------------------------------------------------------------


@cache
def short_walk(strides: int = 12) -> Recording:
    """Some fifteen seconds straight to the north at 100 Hz, in a field that points there."""
    walk = straight_walk(PERSON, strides=strides, rate_hz=100.0)
    return replace(in_earth_field(walk.recording, walk.motion.at(walk.recording.t).nav_R_body), truth=None)


def in_earth_field(recording: Recording, nav_R_body: Floats) -> Recording:
    """A recording with the magnetometer of a homogeneous field to the north."""
    rng = np.random.default_rng(0)
    field = np.array([0.0, 20.0, -43.0]) + rng.normal(0.0, 0.3, (len(recording), 3))
    return replace(recording, mag=np.einsum("nji,nj->ni", nav_R_body, field))


def push(navigator: OnlineNavigator, rows: Floats, cuts: Iterable[int] = ()) -> Found:
    found = []
    for start, stop in pairwise([0, *cuts, len(rows)]):
        block = rows[start:stop]
        found += navigator.push(block[:, 0], block[:, 1:4], block[:, 4:7], block[:, 7:10])
    return found


def walked(
    rows: Floats,
    options: OnlineOptions = NORTH,
    remark: Callable[[str], None] = lambda words: None,
    cuts: Iterable[int] = (),
) -> tuple[OnlineNavigator, Found]:
    navigator = OnlineNavigator(options, remark)
    found = push(navigator, rows, cuts)
    return navigator, found + navigator.close()


@cache
def whole_walk() -> tuple[OnlineNavigator, list[StanceEstimate]]:
    navigator, found = walked(rows_of(short_walk()))
    return navigator, estimates_of(found)


def worst_difference(one: StanceTable, other: StanceTable) -> float:
    """Largest difference of any number in two tables; infinite if they have other rows."""
    names = ("t", "position", "nav_R_body", "gyro_bias", "position_cov", "heading_sigma", "gyro_bias_sigma")
    if not np.array_equal(one.sample, other.sample) or one.field != other.field:
        return np.inf
    return max(float(np.abs(getattr(one, name) - getattr(other, name)).max()) for name in names)


def estimates_of(found: Iterable[StanceEstimate | Revision]) -> list[StanceEstimate]:
    return [one for one in found if isinstance(one, StanceEstimate)]


def revisions_of(found: Iterable[StanceEstimate | Revision]) -> list[Revision]:
    return [one for one in found if isinstance(one, Revision)]


# --- through the smoother --------------------------------------------------------------------------------------------


@cache
def in_field() -> Walk:
    """The walk of `demo` with a magnetometer at 100 Hz in a field that has ripples a few metres long."""
    truth = corridor(seed=0).recording.truth
    ripple = 3.0 * np.sin(2.0 * truth.position[:, :2] + [0.0, 1.0])
    nav = np.array([1.0, 20.0, -43.0]) + np.column_stack([ripple, np.zeros(len(ripple))])
    mag = np.einsum("nji,nj->ni", truth.nav_R_body, nav)
    mag += 0.2 * np.random.default_rng(1).standard_normal(mag.shape)
    mag[1::2] = np.nan
    return Walk(replace(demo().recording, mag=mag), demo().stances)


def fed(walk: Walk, options: OnlineOptions = OnlineOptions(), footfalls: int = FOOTFALLS) -> OnlineSmoother:
    online = smoother_of(walk, options)
    for k in range(footfalls):
        add(online, walk, k)
    return online


@cache
def whole(with_field: bool) -> OnlineSmoother:
    return fed(in_field() if with_field else demo())


def smoother_of(walk: Walk, options: OnlineOptions = OnlineOptions()) -> OnlineSmoother:
    return OnlineSmoother(options, buffer_of(walk))


def buffer_of(walk: Walk) -> SampleBuffer:
    buffer = SampleBuffer()
    buffer.append(rows_of(walk.recording))
    return buffer


def add(online: OnlineSmoother, walk: Walk, k: int) -> Found:
    """Add a footfall of a walk with some samples beyond it; what is returned."""
    stances = walk.stances
    of = stances.footfall == k
    footfall = footfall_at(stances.start[of], stances.stop[of], int(stances.stillest(walk.recording.gyr)[k]))
    return online.add_footfall(footfall, known_until(walk, k))


def known_until(walk: Walk, k: int) -> int:
    return int(walk.stances.stop[walk.stances.footfall == k][-1]) + 5


def footfall_at(start: Floats, stop: Floats, stillest: int, continues: bool = False) -> Footfall:
    return Footfall(start, stop, np.ones(len(start)), stillest, continues)


def polished(walk: Walk, options: OnlineOptions = OnlineOptions()) -> Solution:
    """The batch on the same footfalls, without the gyroscope scale, which a walk in progress has not."""
    cut = part(walk, FOOTFALLS)
    seen = measure_online_field(cut.recording, cut.stances, options)
    p = replace(options.parameters, gyro_scale=False)
    return smooth(seen.recording, cut.stances, p, options.heading_rad, None, seen.field)


def farthest(table: StanceTable, other: StanceTable) -> float:
    return float(np.linalg.norm(table.position - other.position, axis=1).max())


# --- what is made to happen ------------------------------------------------------------------------------------------


def solve_only_at(monkeypatch: pytest.MonkeyPatch, *footfalls: int) -> None:
    """Let a walk be solved again at these footfalls and at its end: what is begun behind them is never due."""
    monkeypatch.setattr(smoother, "AT_ONCE", footfalls)
    monkeypatch.setattr(smoother, "choose_delay", lambda n, has_lag: 10**9)


def solve_in_windows(monkeypatch: pytest.MonkeyPatch, behind: int, window: int = 16) -> None:
    """Let a walk be solved as a whole up to a footfall, and behind it window by window."""
    at_once = tuple(n for n in (1, 2, 3, 4, 6, 8, 10) if n <= behind)
    for name, value in (("AT_ONCE", at_once), ("WHOLE_UNTIL", behind), ("WHOLE_WITH_LAG", behind), ("WINDOW", window)):
        monkeypatch.setattr(smoother, name, value)


def spoil(
    monkeypatch: pytest.MonkeyPatch,
    owner: object,
    name: str,
    fails: Callable[..., bool] = lambda number, *given: False,
    error: Exception = RuntimeError("Indeterminate linear system detected"),
) -> list[object]:
    """Let calls of a function fail that `fails` chooses by number, from one on, and arguments; return all calls."""
    called, calls = getattr(owner, name), list[object]()

    def spoiled(*given: object) -> object:
        calls.append(given)
        if fails(len(calls), *given):
            raise error
        return called(*given)

    monkeypatch.setattr(owner, name, spoiled)
    return calls
