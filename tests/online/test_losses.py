"""Seconds lost in mid-walk: sigmas are those of a person who walked unseen, and shrink where more is known again."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.frames import compute_heading
from fg_nav.magnetic import average_footfall_field
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.solution import Solution, StanceTable
from fg_nav.truth import TrajectoryTruth
from tests.simulated import corridor

LOST_AT_S, LOST_S = 30.2, 5.0
"""In mid-swing, and round a corner of the corridor: the heading behind it is a right angle off."""


@cache
def walk() -> Recording:
    """A minute round a corridor, in a homogeneous field."""
    simulated = corridor(seed=1, rate_hz=100.0)
    attitude = simulated.motion.at(simulated.recording.t).nav_R_body
    field = np.array([0.0, 20.0, -43.0]) + np.random.default_rng(0).normal(0.0, 0.3, (len(attitude), 3))
    return replace(simulated.recording, mag=np.einsum("nji,nj->ni", attitude, field))


@cache
def cut() -> Recording:
    """The same with seconds cut out."""
    whole = walk()
    kept = (whole.t < LOST_AT_S) | (whole.t >= LOST_AT_S + LOST_S)
    assert whole.mag is not None
    return replace(whole, t=whole.t[kept], acc=whole.acc[kept], gyr=whole.gyr[kept], mag=whole.mag[kept])


def start_heading() -> float:
    truth = walk().truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    return float(compute_heading(truth.nav_R_body[0]))


@cache
def online(with_field: bool) -> OnlineNavigator:
    recording = cut()
    assert recording.mag is not None
    navigator = OnlineNavigator(OnlineOptions(heading_rad=start_heading(), use_field=with_field))
    for i in range(0, len(recording), 50):
        part = slice(i, i + 50)
        navigator.push(recording.t[part], recording.acc[part], recording.gyr[part], recording.mag[part])
    navigator.close()
    return navigator


@cache
def batch(with_field: bool) -> Solution:
    recording = cut() if with_field else replace(cut(), mag=None)
    stances = detect_stances(recording)
    field = average_footfall_field(recording, stances, start_heading()) if with_field else None
    return smooth(recording, stances, heading=start_heading(), field=field)


def errors_of(table: StanceTable) -> tuple[np.ndarray, np.ndarray]:
    """How far each footfall is off over the ground, m, and how far it is turned, rad."""
    truth = walk().truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    true = np.array([np.interp(table.t, truth.t, axis) for axis in truth.position.T]).T
    off = (table.position - table.position[0]) - (true - true[0])
    heading = compute_heading(truth.nav_R_body[np.searchsorted(truth.t, table.t).clip(0, len(truth.t) - 1)])
    turned = (compute_heading(table.nav_R_body) - heading + np.pi) % (2 * np.pi) - np.pi
    return np.linalg.norm(off[:, :2], axis=1), turned


def first_behind(table: StanceTable) -> int:
    return int(np.searchsorted(table.t, LOST_AT_S + LOST_S))


both_ways = pytest.mark.parametrize(
    "estimate", [lambda field: online(field).causal(), lambda field: batch(field).stances], ids=["online", "batch"]
)


@both_ways
def test_behind_a_loss_of_seconds_the_sigmas_are_those_of_a_person_who_walked_on(estimate):
    table = estimate(False)
    k = first_behind(table)
    off, turned = errors_of(table)
    sigma = np.linalg.norm(table.position_sigma[:, :2], axis=1)
    assert off[k - 1] < 0.2
    assert 2.0 < sigma[k] < 15.0
    assert (off[k:] < 3.0 * sigma[k:]).all()
    assert 1.0 < abs(turned[k]) < 3.0 * table.heading_sigma[k] < 6.0
    np.testing.assert_allclose(sigma[: k - 1].max(), sigma[k - 2], rtol=0.5)


@both_ways
def test_with_the_compass_the_heading_is_known_again(estimate):
    """A right angle round a corner is found, and what is walked behind it is as certain as before."""
    table = estimate(True)
    k = first_behind(table)
    off, turned = errors_of(table)
    sigma = np.linalg.norm(table.position_sigma[:, :2], axis=1)
    assert np.degrees(table.heading_sigma[k + 10]) < 3.0
    assert (np.abs(turned[k + 3 :]) < 3.0 * table.heading_sigma[k + 3 :] + np.radians(1.0)).all()
    assert (off[k:] < 3.0 * sigma[k:]).all()
    assert abs(sigma[-1] - sigma[k]) < 0.5


def test_the_batch_of_a_stream_with_a_loss_is_that_of_its_samples():
    """Path and sigmas; and neither leaps but over the loss."""
    navigator = online(False)
    found, polished = navigator.finish(), navigator.polish()
    apart = np.linalg.norm((found.position - polished.position)[:, :2], axis=1)
    assert apart[found.t < LOST_AT_S].max() < 0.1
    assert apart.max() < 0.1 * np.linalg.norm(polished.stances.position_sigma[-1, :2])
    np.testing.assert_allclose(polished.stances.position_sigma[-1, :2], found.stances.position_sigma[-1, :2], rtol=0.1)
    step = np.linalg.norm(np.diff(polished.position, axis=0), axis=1)
    assert np.delete(step, np.argmax(np.diff(polished.t))).max() < 0.1
