"""Steps of a thigh: by hand-made flexions, and the axes of a simulated one, however it is mounted."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.errors import EstimationError
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.pocket import estimate_pocket
from fg_nav.pocket.steps import (
    SwingSums,
    estimate_swing,
    find_bounces,
    find_level_axis,
    find_steps,
    find_turning_points,
    measure_sway,
)
from fg_nav.recording import Recording

RATE_HZ = 50.0


def found(pieces):
    """Steps in pieces of flexion, deg, one after the other; up turns about one axis alone."""
    flexion = np.radians(np.concatenate(pieces))
    t = np.arange(len(flexion)) / RATE_HZ
    up = np.stack([np.sin(flexion), np.zeros(len(t)), np.cos(flexion)], axis=1)
    return t, find_steps(t, flexion, up)


def standing(seconds, at=0.0):
    """A thigh that stands at an angle, and sways by half a degree."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    return at + 0.5 * np.sin(2 * np.pi * t / 3.0)


def walking(strides, opening=50.0, stride_s=1.1, at=0.0):
    """Cycles from upright to upright: half a swing out of standing, and half a one into it, so one swing more."""
    t = np.arange(round(strides * stride_s * RATE_HZ)) / RATE_HZ
    return at + opening / 2 * np.sin(2 * np.pi * t / stride_s)


def moved(begin, end, seconds):
    """From one angle to another, smoothly."""
    t = np.linspace(0.0, 1.0, round(seconds * RATE_HZ))
    return begin + (end - begin) * (1 - np.cos(np.pi * t)) / 2


def test_every_swing_of_the_leg_is_a_stride_and_every_opening_a_step():
    t, steps = found([standing(3), walking(10), standing(3)])
    assert len(steps.strides) == 11
    assert len(steps) == 21  # 19 between the turning points, and half a step at either end
    assert steps.forward.tolist() == [k % 2 == 0 for k in range(21)]
    np.testing.assert_allclose(np.degrees(steps.opening[1:-1]), 50.0, atol=0.5)
    np.testing.assert_allclose(np.degrees(steps.opening[[0, -1]]), 25.0, atol=1.5)
    np.testing.assert_allclose(t[[steps.start[0], steps.stop[-1]]], [3.0, 14.0], atol=0.2)
    assert (steps.start[1:] == steps.stop[:-1]).all()


def test_a_pause_parts_two_walks_and_adds_no_stride():
    _, steps = found([standing(2), walking(6), standing(5), walking(4), standing(2)])
    assert len(steps.strides) == 7 + 5
    assert np.bincount(steps.bout).tolist() == [13, 9]


def test_where_the_other_leg_begins_its_step_goes_with_the_first_swing():
    _, steps = found([standing(2), -walking(6), standing(2)])
    assert not steps.forward[0]
    assert len(steps.strides) == 6
    assert steps.strides[0] == 0


@pytest.mark.parametrize(
    "pieces",
    [
        [standing(20)],
        [standing(3), moved(0, 75, 1.5), standing(10, 75), moved(75, 0, 1.5), standing(3)],
        [standing(3), moved(0, 75, 0.8), standing(3, 75), walking(8, 24.0, at=75.0), moved(75, 0, 0.8), standing(3)],
        [standing(3), walking(6, 14.0), standing(3)],
        [standing(3), moved(0, 40, 0.5), standing(0.3, 40), moved(40, 0, 0.5), standing(3)],
        [standing(2), walking(200, 3.0, 0.25), standing(2)],
        [walking(6, 50.0, 6.0)],
        [standing(3), walking(8, 100.0), standing(3)],
        [walking(8, 30.0, 0.16)],
    ],
    ids=[
        "stands",
        "sits down",
        "moves on a chair",
        "turns on the spot",
        "kicks",
        "trembles",
        "bows",
        "kicks high",
        "shakes",
    ],
)
def test_what_is_no_step(pieces):
    _, steps = found(pieces)
    assert len(steps) == 0
    assert len(steps.strides) == 0


def test_a_leg_that_gives_way_at_the_footfall_makes_one_step():
    wobble = np.concatenate([moved(-25, 20, 0.35), moved(20, 12, 0.1), moved(12, 18, 0.1), moved(18, -25, 0.5)])
    _, steps = found([np.tile(wobble, 8)])
    assert len(steps.strides) in (7, 8)  # at the very ends there is nothing to turn from
    np.testing.assert_allclose(np.degrees(steps.opening), 45.0, atol=1.0)


def test_no_sample_no_turn():
    assert find_turning_points(np.zeros(100), 0.1).size == 0
    assert find_turning_points(np.array([0.0, 1.0, 0.0, 2.0, 0.0]), 0.5).tolist() == [0, 1, 2, 3, 4]
    assert find_turning_points(np.array([0.0, 1.0, 0.7, 2.0, 0.0]), 0.5).tolist() == [0, 3, 4]


@pytest.fixture(scope="module")
def walk():
    return simulate("demo", 101, Choices(worn="pocket"))


def mounted(recording, turn):
    """The same walk with the sensor turned in the pocket."""
    samples = (turn.inv().apply(x) for x in (recording.acc, recording.gyr, recording.mag))
    return Recording(recording.t, *samples)


@pytest.mark.parametrize("rotvec", [(0, 0, 0), (1.2, 0.4, -2.0), (0, 3.1, 0), (-0.5, 1.6, 0.3)])
def test_axes_and_steps_do_not_hang_on_the_mounting(walk, rotvec):
    turn = Rotation.from_rotvec(rotvec)
    recording = mounted(walk.recording, turn)
    swing = estimate_swing(recording, estimate_pocket(recording))
    thigh_R_body = walk.recording.truth.nav_R_body  # true attitudes, of the sensor as it was
    left = np.einsum("nij,j->ni", thigh_R_body, turn.apply(swing.left))
    heading = np.arctan2(left[:, 1], -left[:, 0])  # of forward, clockwise from north
    assert swing.is_forward_known
    moving = np.flatnonzero(np.linalg.norm(np.gradient(walk.recording.truth.position, axis=0), axis=1) > 0.002)
    way = np.gradient(walk.recording.truth.position, axis=0)[moving]
    course = np.arctan2(way[:, 0], way[:, 1])
    off = np.angle(np.mean(np.exp(1j * (course + np.pi - np.unwrap(heading)[moving] - np.pi))))
    assert abs(np.degrees(off)) < 8.0
    steps = find_steps(recording.t, swing.flexion, swing.up_now)
    assert abs(len(steps.strides) - len(walk.strides)) <= 1


def test_a_sensor_that_lies_still_has_no_swing(walk):
    n = 3000
    rng = np.random.default_rng(0)
    still = Recording(np.arange(n) / 100, [0, 0, 9.8] + 0.01 * rng.standard_normal((n, 3)), np.zeros((n, 3)) + 1e-4)
    with pytest.raises(EstimationError, match="no walk in it"):
        estimate_swing(still, estimate_pocket(still))


def test_a_sensor_that_is_turned_every_way_has_no_axis():
    t = np.arange(3000) / 100
    gyr = 3.0 * np.stack([np.sin(3 * t), np.sin(4.1 * t + 1), np.sin(5.3 * t + 2)], axis=1)
    recording = Recording(t, np.tile([0, 0, 9.8], (3000, 1)), gyr)
    with pytest.raises(EstimationError, match="a level axis"):
        estimate_swing(recording, estimate_pocket(recording))


def test_a_swing_that_shows_no_axis_any_more_keeps_the_last_one() -> None:
    sums, up = SwingSums(), np.tile([0.0, 0.0, 1.0], (1000, 1))
    swing = np.sin(np.arange(1000) / 10.0)[:, None] * np.array([3.0, 0.1, 0.0])
    sums.add_swing(swing, up, 0.01)
    known = sums.axes
    assert known is not None
    for axis in np.eye(3):
        sums.add_swing(np.tile(30.0 * axis, (1000, 1)), up, 0.01)
    assert sums.axes is not None
    assert np.array_equal(sums.axes[0], known[0])


def test_a_body_that_bounces_steps_without_a_swing() -> None:
    t = np.arange(0, 40, 0.02)
    on = (t > 5) & (t < 30)
    vertical = 9.8 + on * 3.0 * np.sin(2 * np.pi * 1.9 * t) + 0.3 * np.random.default_rng(0).standard_normal(len(t))
    steps = find_bounces(t, vertical, on)
    assert abs(len(steps) - 25 * 1.9) <= 3
    assert np.isnan(steps.opening).all()
    np.testing.assert_allclose(steps.took, 1 / 1.9, atol=0.04)
    assert (np.diff(steps.bout) == 0).all()
    assert not len(find_bounces(t, np.where(t < 7, vertical, 9.8), on))  # three bounces are no walk


@pytest.mark.parametrize("course", [0.0, 2.0, -2.6])
def test_the_sway_points_forward(course) -> None:
    t = np.arange(0, 60, 0.02)
    w = 2 * np.pi * 1.9
    # an inverted pendulum: slowest where it is highest; and a sideways sway at half of that frequency
    ahead, side, vertical = 2.0 * np.sin(w * t), 1.5 * np.sin(w / 2 * t + 1.0), -2.5 * np.cos(w * t)
    acc = np.stack([ahead, side, 9.8 + vertical], axis=1) @ Rotation.from_euler("z", course).as_matrix().T
    sway, surely = measure_sway(acc * [1.0, 1.0, 0.0], acc[:, 2], np.ones(len(t), dtype=bool), 0.02)
    assert np.degrees(np.arctan2(sway[1], sway[0])) == pytest.approx(np.degrees(course), abs=3.0)
    assert surely > 0.8


def test_a_sensor_that_turns_about_up_keeps_the_axis_of_its_swing() -> None:
    t = np.arange(0, 60, 0.01)
    swing, about_up = 2.0 * np.cos(2 * np.pi * 0.95 * t), 4.0 * np.cos(2 * np.pi * 0.95 * t + 0.7)
    rate = np.stack([0.1 * about_up, swing, about_up], axis=1)
    share, axis = find_level_axis(rate.T @ rate, np.array([0.0, 0.0, 1.0]))
    assert share > 0.9
    assert abs(axis[1]) > 0.97
    assert axis[2] == pytest.approx(0.0, abs=1e-12)
