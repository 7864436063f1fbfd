"""Dead reckoning by steps: paths that are known, and a covariance that draws bear out."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.pocket.dead_reckoning import (
    MOUNTING_SIGMA_DEG,
    SLOPE_SIGMA,
    STEP_HEADING_SIGMA_DEG,
    STEP_SIGMA,
    StepLength,
    reckon_path,
)
from fg_nav.pocket.steps import Steps, ThighSwing
from fg_nav.pocket.track import PocketTrack

RATE_HZ = 20
STEP = 10  # Samples to a step.

LAW = StepLength(0.9, sigma=0.05)


def given(headings, twist_deg=0.0, sigma=None, mounting=(0.3, -0.8, 2.0)):
    """Track, swing and steps of a walk with these headings (S,) rad of its steps, and a twist in each stride."""
    headings = np.asarray(headings, dtype=float)
    n = STEP * (len(headings) + 4)
    body_R_thigh = Rotation.from_rotvec(mounting).as_matrix()
    yaw = np.pi / 2 - np.repeat(np.concatenate([[headings[0]] * 2, headings, [headings[-1]] * 2]), STEP)
    yaw += np.radians(twist_deg) * np.sin(2 * np.pi * np.arange(n) / (2 * STEP) + 0.7)
    R = Rotation.from_euler("z", yaw[:, None]).as_matrix().reshape(n, 3, 3) @ body_R_thigh.T
    sigmas = np.zeros((n, 6))
    sigmas[:, 2] = 0.0 if sigma is None else sigma
    nothing = np.full(n, np.nan)
    t = np.arange(n) / RATE_HZ
    track = PocketTrack(t, R, np.zeros((n, 3)), sigmas, np.zeros(1, int), np.zeros((1, 6, 6)), nothing, nothing)
    left, up = body_R_thigh @ [0, 1, 0], body_R_thigh @ [0, 0, 1]
    swing = ThighSwing(left, up, np.tile(up, (n, 1)), np.zeros(n), 0.5, 0.0)
    start = STEP * (2 + np.arange(len(headings)))
    opening = np.full(len(headings), np.radians(46.0))
    took = np.full(len(headings), STEP / RATE_HZ)
    steps = Steps(start, start + STEP, opening, took, np.arange(len(headings)) % 2 == 0, np.zeros(len(headings), int))
    return track, swing, steps


def test_a_path_north_and_then_east():
    track, swing, steps = given([0.0] * 30 + [np.pi / 2] * 20)
    path = reckon_path(track, swing, steps, LAW)
    length = LAW.predict(steps)[0]
    np.testing.assert_allclose(path.length, length)
    np.testing.assert_allclose(path.position[59], [0.0, 30 * length, 0.0], atol=0.5 * length)
    np.testing.assert_allclose(path.position[-1], [20 * length, 30 * length, 0.0], atol=length)
    np.testing.assert_allclose(path.heading[[0, 20, 40]], [0.0, 0.0, np.pi / 2], atol=1e-9)
    assert (path.sample[1::2] == steps.stop).all()
    assert np.sqrt(path.covariance[-1, 2, 2]) == pytest.approx(SLOPE_SIGMA * 50 * length)
    assert np.trace(path.covariance[0]) == 0.0


def test_the_twist_of_the_pelvis_leaves_nothing():
    plain = reckon_path(*given([0.4] * 40), LAW)
    twisted = reckon_path(*given([0.4] * 40, twist_deg=12.0), LAW)
    assert np.degrees(np.abs(twisted.heading - plain.heading)).max() < 0.5


def test_turned_about_up_it_is_the_same_path_turned():
    headings = np.linspace(0.0, 3.0, 40)
    one, other = reckon_path(*given(headings), LAW), reckon_path(*given(headings + 1.1), LAW)
    turn = Rotation.from_euler("z", -1.1).as_matrix()
    np.testing.assert_allclose(other.position, one.position @ turn.T, atol=1e-9)
    np.testing.assert_allclose(other.covariance, turn @ one.covariance @ turn.T, atol=1e-9)


@pytest.mark.parametrize("course", ["straight", "to and fro", "round"])
def test_the_covariance_is_that_of_the_draws(course):
    """Each source of error drawn as the model has it; heading loses more and more, from 3 to 8 deg."""
    count = 60
    true = {
        "straight": np.zeros(count),
        "to and fro": np.where(np.arange(count) < count // 2, 0.0, np.pi),
        "round": np.linspace(0.0, 2 * np.pi, count),
    }[course]
    sigma = np.radians(3.0 + 5.0 * np.arange(STEP * (count + 4)) / (STEP * (count + 4)))
    track, swing, steps = given(true, sigma=sigma)
    claimed = reckon_path(track, swing, steps, LAW)
    ends = draws(claimed, track.sigma[(steps.start + steps.stop) // 2, 2], 4000)
    found, said = np.cov(ends.T), claimed.covariance[-1, :2, :2]
    ratio = np.linalg.eigvals(np.linalg.solve(said, found)).real
    assert ratio.min() > 0.85
    assert ratio.max() < 1.15


def draws(path, sigma, number):
    """Ends (number, 2) of paths with errors of scale, heading, mounting and each step."""
    rng = np.random.default_rng(3)
    size = (number, len(path.length))
    growth = np.sqrt(np.diff(sigma**2, prepend=0.0))
    drift = np.cumsum(growth * rng.standard_normal(size), axis=1)
    drift += np.radians(MOUNTING_SIGMA_DEG) * rng.standard_normal((number, 1))
    drift += np.radians(STEP_HEADING_SIGMA_DEG) * rng.standard_normal(size)
    length = path.length * (1 + LAW.sigma * rng.standard_normal((number, 1)) + STEP_SIGMA * rng.standard_normal(size))
    forward = np.stack([np.sin(path.heading), np.cos(path.heading)], axis=1)
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    return np.einsum("ns,sj->nj", length, forward) + np.einsum("ns,sj->nj", path.length * drift, left)


def test_a_sigma_of_heading_that_falls_does_not_take_back_what_was_lost():
    track, swing, steps = given(np.zeros(40), sigma=np.radians(5.0))
    falling = track._replace(sigma=track.sigma * np.linspace(1.0, 0.1, len(track.t))[:, None])
    one, other = (reckon_path(given_track, swing, steps, LAW).covariance[-1] for given_track in (track, falling))
    np.testing.assert_allclose(other, one, rtol=0.3)
