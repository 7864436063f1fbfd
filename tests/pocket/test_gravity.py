"""Specific forces at the stamps: single ones and means, against the attitude of a leg."""

import numpy as np

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.pocket.filter import average_force, interpolate_force, thin_flags
from tests.pocket.leg import Leg, walking

LEG = walking(10.0)
GRAVITY = GRAVITY_M_S2 * LEG.attitude[:-1, 2]


def test_a_sample_is_gravity_at_its_stamp():
    acc = LEG.recording().acc
    assert np.abs(interpolate_force(acc) - GRAVITY)[1:].max() < 0.02
    assert np.abs(acc - GRAVITY).max() > 0.15  # half a period late


def test_a_mean_is_gravity_in_the_body_at_its_end():
    force = average_force(LEG.recording(bias=np.zeros(3)), 100)
    assert np.isnan(force[:100]).all()
    assert np.abs(force - GRAVITY)[100:].max() < 0.005


def test_a_velocity_that_comes_back_to_itself_leaves_the_mean_alone():
    """Accelerations at the cadence, of 5 m/s^2, over a window of two strides."""
    recording = LEG.recording(bias=np.zeros(3))
    push = 5.0 * np.sin(2 * np.pi * recording.t)[:, None] * np.array([1.0, 0.5, 0.3])
    recording.acc[:] += np.einsum("nji,nj->ni", LEG.attitude[:-1], push)
    assert np.abs(average_force(recording, 200) - GRAVITY)[200:].max() < 0.1
    assert np.abs(interpolate_force(recording.acc) - GRAVITY).max() > 4.0


def test_a_bias_turns_the_mean_by_half_its_window():
    bias = np.array([0.02, -0.01, 0.02])
    pitched = Leg(np.tile(LEG.attitude[200], (1001, 1, 1)), 0.01)
    force, up = average_force(pitched.recording(bias=bias), 100)[-1], GRAVITY_M_S2 * LEG.attitude[200, 2]
    assert np.allclose(force, up - 0.5 * np.cross(bias, up), atol=2e-3)
    assert np.abs(force - up).max() > 0.01


def test_flags_are_thinned_to_a_period():
    t = np.arange(100) * 0.1
    flags = np.ones(100, dtype=bool)
    flags[15:17] = False
    assert np.array_equal(np.flatnonzero(thin_flags(t, flags, 0.5))[:5], [0, 5, 10, 17, 22])
    assert thin_flags(t, flags, 0.0).sum() == 98
