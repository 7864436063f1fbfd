"""Seconds lost in mid-walk: sigmas are those of a person who walked unseen, and shrink where more is known again."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.magnetic import average_footfall_field
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.solution import StanceTable
from tests.online.walks import in_earth_field, walked
from tests.simulated import corridor

LOST_AT_S, LOST_S = 30.2, 5.0
"""In mid-swing, and round a corner of the corridor: the heading behind it is a right angle off."""


@cache
def cut() -> tuple[Recording, float]:
    """A minute round a corridor in a homogeneous field, seconds cut out; and its heading at the start."""
    simulated = corridor(seed=1, rate_hz=100.0)
    whole = in_earth_field(simulated.recording, simulated.motion.at(simulated.recording.t).nav_R_body)
    kept = (whole.t < LOST_AT_S) | (whole.t >= LOST_AT_S + LOST_S)
    lossy = replace(whole, t=whole.t[kept], acc=whole.acc[kept], gyr=whole.gyr[kept], mag=whole.mag[kept])
    return lossy, float(compute_heading(whole.truth.nav_R_body[0]))


@cache
def online(with_field: bool) -> OnlineNavigator:
    recording, heading = cut()
    options = OnlineOptions(heading_rad=heading, use_field=with_field)
    return walked(rows_of(recording), options, cuts=range(50, len(recording), 50))[0]


def solve(method: str, with_field: bool) -> StanceTable:
    if method == "online":
        return online(with_field).causal()
    recording, heading = cut()
    recording = recording if with_field else replace(recording, mag=None)
    stances = detect_stances(recording)
    field = average_footfall_field(recording, stances, heading) if with_field else None
    return smooth(recording, stances, heading=heading, field=field).stances


def errors_of(table: StanceTable) -> tuple[np.ndarray, np.ndarray]:
    """How far each footfall is off over the ground, m, and how far it is turned, rad."""
    truth = cut()[0].truth
    true = np.array([np.interp(table.t, truth.t, axis) for axis in truth.position.T]).T
    off = (table.position - table.position[0]) - (true - true[0])
    heading = compute_heading(truth.nav_R_body[np.searchsorted(truth.t, table.t).clip(0, len(truth.t) - 1)])
    return np.linalg.norm(off[:, :2], axis=1), wrap_angle(compute_heading(table.nav_R_body) - heading)


@pytest.mark.parametrize("method", ["online", "batch"])
@pytest.mark.parametrize("with_field", [False, True])
def test_behind_a_loss_of_seconds_the_sigmas_are_those_of_a_person_who_walked_on(method, with_field):
    """By the compass the right angle round a corner is found; what is walked behind it is as certain as before."""
    table = solve(method, with_field)
    k = int(np.searchsorted(table.t, LOST_AT_S + LOST_S))
    off, turned = errors_of(table)
    sigma = np.linalg.norm(table.position_sigma[:, :2], axis=1)
    assert (off[k:] < 3.0 * sigma[k:]).all()
    if with_field:
        assert np.degrees(table.heading_sigma[k + 10]) < 3.0
        assert (np.abs(turned[k + 3 :]) < 3.0 * table.heading_sigma[k + 3 :] + np.radians(1.0)).all()
        assert abs(sigma[-1] - sigma[k]) < 0.5
    else:
        assert off[k - 1] < 0.2
        assert 2.0 < sigma[k] < 15.0
        assert 1.0 < abs(turned[k]) < 3.0 * table.heading_sigma[k] < 6.0
        np.testing.assert_allclose(sigma[: k - 1].max(), sigma[k - 2], rtol=0.5)


def test_the_batch_of_a_stream_with_a_loss_is_that_of_its_samples():
    """Path and sigmas; and neither leaps but over the loss."""
    found, polished = online(False).finish(), online(False).polish()
    apart = np.linalg.norm((found.position - polished.position)[:, :2], axis=1)
    assert apart[found.t < LOST_AT_S].max() < 0.1
    assert apart.max() < 0.1 * np.linalg.norm(polished.stances.position_sigma[-1, :2])
    np.testing.assert_allclose(polished.stances.position_sigma[-1, :2], found.stances.position_sigma[-1, :2], rtol=0.1)
    step = np.linalg.norm(np.diff(polished.position, axis=0), axis=1)
    assert np.delete(step, np.argmax(np.diff(polished.t))).max() < 0.1
