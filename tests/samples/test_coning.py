"""Coning and sculling against motions whose end is known: a cone, a rocking sledge, and gaps in them."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.recording import Recording
from fg_nav.samples.gaps import compensate_coning

TURNS_RAD_S = 2 * np.pi * 2.0  # Two cones a second.
HALF_ANGLE = 0.3
SWAY_M = 0.2
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(12)
UP = np.array([0.0, 0.0, 1.0])


def cone(t: Floats) -> Rotation:
    """The body's z axis goes about a cone, and the body does not turn about it: the classical coning motion."""
    phase = TURNS_RAD_S * t
    return Rotation.from_rotvec(HALF_ANGLE * np.stack([np.cos(phase), np.sin(phase), 0 * phase], axis=1))


def cone_rate(t: Floats) -> Floats:
    phase, sine = TURNS_RAD_S * t, np.sin(HALF_ANGLE)
    about = np.full_like(t, np.cos(HALF_ANGLE) - 1.0)
    return TURNS_RAD_S * np.stack([-sine * np.sin(phase), sine * np.cos(phase), about], axis=1)


def swayed(t: Floats) -> Floats:
    """Specific force in the coning body that sways along east, in step with its tilt."""
    acc = -SWAY_M * TURNS_RAD_S**2 * np.sin(TURNS_RAD_S * t)
    nav = np.stack([acc, 0 * t, np.full_like(t, GRAVITY_M_S2)], axis=1)
    return cone(t).inv().apply(nav)


def mean_over(of: Callable[[Floats], Floats], t: Floats, h: Floats) -> Floats:
    """Mean (N, 3) over each period by Gauss's rule."""
    return sum(w / 2 * of(t + h * (1 + x) / 2) for x, w in zip(POINTS, WEIGHTS, strict=True))


def samples(t: Floats, h: Floats) -> tuple[Floats, Floats]:
    return mean_over(swayed, t, h), mean_over(cone_rate, t, h)


def left_over(acc: Floats, gyr: Floats, t: Floats, h: Floats) -> tuple[float, float]:
    """What integration misses by the end: of the turn about up, rad, and of the velocity, m/s."""
    velocity = SWAY_M * TURNS_RAD_S * np.array([np.cos(TURNS_RAD_S * t[0]), 0.0, 0.0])
    state = NavState(np.zeros(3), velocity, cone(t[:1]).as_matrix()[0], np.zeros(3), np.zeros(3))
    turn, push = np.empty((3, 3)), np.empty(3)
    for f, w, period in zip(acc, gyr, h, strict=True):
        strapdown(state, f, w, period, GRAVITY_M_S2, turn, push)
    end = t[-1:] + h[-1]
    truth = SWAY_M * TURNS_RAD_S * np.array([np.cos(TURNS_RAD_S * end[0]), 0.0, 0.0])
    missed = Rotation.from_matrix(state.nav_R_body) * cone(end).inv()
    return float(missed.as_rotvec()[0] @ UP), float(np.linalg.norm(state.velocity - truth))


def even(rate_hz: float, duration_s: float = 5.0) -> tuple[Floats, Floats]:
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    return t, np.full(len(t), 1 / rate_hz)


def test_what_is_left_falls_with_the_fourth_power_of_the_period() -> None:
    plain, better = [], []
    for rate_hz in (50.0, 100.0, 200.0):
        t, h = even(rate_hz)
        acc, gyr = samples(t, h)
        plain.append(np.abs(left_over(acc, gyr, t, h)))
        better.append(np.abs(left_over(*compensate_coning(acc, gyr, h), t, h)))
    plain_ratio, ratio = (np.array(errors[:-1]) / np.array(errors[1:]) for errors in (plain, better))
    np.testing.assert_allclose(plain_ratio, 4.0, rtol=0.1)
    assert (ratio[:, 0] > 12.0).all()
    assert (better[1] < plain[1] / 40).all()
    assert (better[2] < plain[2] / 100).all()


@pytest.mark.parametrize("uneven", [False, True])
def test_a_change_at_one_rate_is_seen_whole_at_every_sample_from_the_first_to_the_last(uneven: bool) -> None:
    """Rate and force linear in time: the terms are h^2/12 w x w' and h^2/12 (w x f' - w' x f) exactly."""
    rng = np.random.default_rng(2)
    h = 0.01 * (rng.uniform(0.7, 3.0, 12) if uneven else np.ones(12))
    middle = (np.cumsum(h) - h / 2)[:, None]
    (w0, w1), (f0, f1) = rng.standard_normal((2, 2, 3)) * [[[5.0], [80.0]], [[20.0], [300.0]]]
    gyr, acc = w0 + w1 * middle, f0 + f1 * middle
    found_acc, found_gyr = compensate_coning(acc, gyr, h)
    share = h[:, None] ** 2 / 12
    np.testing.assert_allclose(found_gyr - gyr, share * np.cross(gyr, w1), atol=1e-9)
    np.testing.assert_allclose(found_acc - acc, share * (np.cross(gyr, f1) - np.cross(w1, acc)), atol=1e-8)


@pytest.mark.parametrize("lost", [1, 2, 4])
def test_lost_samples_are_made_good(lost: int) -> None:
    """Of a cone at 100 Hz every 37th sample is lost, and so many after it: the sample before it is held for all.

    It integrates nearly to what was moved: with coning, with sculling.
    """
    t, h = even(100.0, 20.0)
    acc, gyr = samples(t, h)
    kept = (np.arange(len(t)) < 100) | (np.arange(len(t)) % 37 >= lost)
    kept[-8:] = True
    recording = Recording(t=t[kept], acc=acc[kept], gyr=gyr[kept])
    h = np.append(np.diff(recording.t), 0.01)
    held = np.abs(left_over(recording.acc, recording.gyr, recording.t, h))
    bridged = np.abs(left_over(*recording.integrable, recording.t, h))
    assert (bridged < held / 20).all()
