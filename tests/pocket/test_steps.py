"""Steps of a thigh: by hand-made flexions, and the axes of a simulated one, however it is mounted."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.errors import EstimationError
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.pocket import estimate_pocket
from fg_nav.pocket.steps import estimate_swing, find_bounces, find_steps, measure_sway
from fg_nav.recording import Recording

RATE_HZ = 50.0


def found(*pieces):
    """Steps in pieces of flexion, deg, one after the other; up turns about one axis alone."""
    flexion = np.radians(np.concatenate(pieces))
    t = np.arange(len(flexion)) / RATE_HZ
    return t, find_steps(t, flexion, np.stack([np.sin(flexion), 0 * t, np.cos(flexion)], axis=1))


def swinging(cycles, opening=50.0, cycle_s=1.1, at=0.0):
    """Cycles from upright to upright: half a swing out of standing, and half a one into it, so one swing more."""
    t = np.arange(round(cycles * cycle_s * RATE_HZ)) / RATE_HZ
    return at + opening / 2 * np.sin(2 * np.pi * t / cycle_s)


def standing(seconds, at=0.0):
    """A thigh that stands at an angle, and sways by half a degree."""
    return swinging(seconds / 3.0, 1.0, 3.0, at)


def moved(begin, end, seconds):
    t = np.linspace(0.0, 1.0, round(seconds * RATE_HZ))
    return begin + (end - begin) * (1 - np.cos(np.pi * t)) / 2


def test_every_swing_of_the_leg_is_a_stride_and_every_opening_a_step_and_a_pause_adds_none():
    t, steps = found(standing(3), swinging(10), standing(3))
    assert len(steps.strides) == 11
    assert steps.forward.tolist() == [k % 2 == 0 for k in range(21)]  # 19 between, and half a step at either end
    np.testing.assert_allclose(np.degrees(steps.opening[1:-1]), 50.0, atol=0.5)
    np.testing.assert_allclose(np.degrees(steps.opening[[0, -1]]), 25.0, atol=1.5)
    np.testing.assert_allclose(t[[steps.start[0], steps.stop[-1]]], [3.0, 14.0], atol=0.2)
    assert (steps.start[1:] == steps.stop[:-1]).all()
    _, steps = found(standing(2), -swinging(6), standing(2))  # the other leg begins: its step goes with the first
    assert not steps.forward[0]
    assert len(steps.strides) == 6
    assert steps.strides[0] == 0
    _, steps = found(standing(2), swinging(6), standing(5), swinging(4), standing(2))
    assert len(steps.strides) == 7 + 5
    assert np.bincount(steps.bout).tolist() == [13, 9]
    _, steps = found(standing(2, 30), swinging(6, at=30.0), standing(2, 30))  # up a slope, thigh forward
    assert len(steps.strides) == 7


@pytest.mark.parametrize(
    "pieces",
    {
        "stands": [standing(20)],
        "sits down": [standing(3), moved(0, 75, 1.5), standing(10, 75), moved(75, 0, 1.5), standing(3)],
        "on a chair": [standing(3), moved(0, 75, 0.8), swinging(8, 24.0, at=75.0), moved(75, 0, 0.8), standing(3)],
        "turns on the spot": [standing(3), swinging(6, 14.0), standing(3)],
        "kicks": [standing(3), moved(0, 40, 0.5), standing(0.3, 40), moved(40, 0, 0.5), standing(3)],
        "trembles": [standing(2), swinging(200, 3.0, 0.25), standing(2)],
        "bows": [swinging(6, 50.0, 6.0)],
        "kicks high": [standing(3), swinging(8, 100.0), standing(3)],
        "shakes": [swinging(8, 30.0, 0.16)],
    }.values(),
)
def test_what_is_no_step(pieces):
    _, steps = found(*pieces)
    assert len(steps) == len(steps.strides) == 0


def test_a_leg_that_gives_way_at_the_footfall_makes_one_step():
    wobble = [moved(-25, 20, 0.35), moved(20, 12, 0.1), moved(12, 18, 0.1), moved(18, -25, 0.5)]
    _, steps = found(*(8 * wobble))
    assert len(steps.strides) in (7, 8)  # at the very ends there is nothing to turn from
    np.testing.assert_allclose(np.degrees(steps.opening), 45.0, atol=1.0)


@pytest.mark.parametrize("rotvec", [(0, 0, 0), (1.2, 0.4, -2.0), (0, 3.1, 0), (-0.5, 1.6, 0.3)])
def test_axes_and_steps_do_not_hang_on_the_mounting(rotvec):
    walk, turn = simulate("demo", 101, Choices(worn="pocket")), Rotation.from_rotvec(rotvec)
    r, truth = walk.recording, walk.recording.truth
    recording = Recording(r.t, *(turn.inv().apply(x) for x in (r.acc, r.gyr, r.mag)))
    swing = estimate_swing(recording, estimate_pocket(recording))
    assert swing.is_forward_known
    left = np.einsum("nij,j->ni", truth.nav_R_body, turn.apply(swing.left))  # true attitudes, of the sensor as it was
    heading = np.arctan2(left[:, 1], -left[:, 0])  # of forward, clockwise from north
    way = np.gradient(truth.position, axis=0)
    moving = np.linalg.norm(way, axis=1) > 0.002
    course = np.arctan2(way[:, 0], way[:, 1])
    off = np.angle(np.mean(np.exp(1j * (course - heading)[moving])))
    assert abs(np.degrees(off)) < 8.0
    steps = find_steps(recording.t, swing.flexion, swing.up_now)
    assert abs(len(steps.strides) - len(walk.strides)) <= 1


def test_a_sensor_that_lies_still_or_is_turned_every_way_has_no_swing():
    t, noise = np.arange(3000) / 100, np.random.default_rng(0).standard_normal((3000, 3))
    tumbling = 3.0 * np.stack([np.sin(3 * t), np.sin(4.1 * t + 1), np.sin(5.3 * t + 2)], axis=1)
    for gyr, words in ((np.full((3000, 3), 1e-4), "no walk in it"), (tumbling, "a level axis")):
        recording = Recording(t, [0, 0, 9.8] + 0.01 * noise, gyr)
        with pytest.raises(EstimationError, match=words):
            estimate_swing(recording, estimate_pocket(recording))


def test_a_body_that_bounces_steps_without_a_swing():
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
def test_the_sway_points_forward(course):
    t = np.arange(0, 60, 0.02)
    w = 2 * np.pi * 1.9
    # an inverted pendulum: slowest where it is highest; and a sideways sway at half of that frequency
    ahead, side, vertical = 2.0 * np.sin(w * t), 1.5 * np.sin(w / 2 * t + 1.0), -2.5 * np.cos(w * t)
    acc = np.stack([ahead, side, 9.8 + vertical], axis=1) @ Rotation.from_euler("z", course).as_matrix().T
    sway, surely = measure_sway(acc * [1.0, 1.0, 0.0], acc[:, 2], np.ones(len(t), dtype=bool), 0.02)
    assert np.degrees(np.arctan2(sway[1], sway[0])) == pytest.approx(np.degrees(course), abs=3.0)
    assert surely > 0.8
