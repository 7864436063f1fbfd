"""The scale of the gyroscope: its effect on an interval by finite differences, and found on a walk with a field."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fg_nav.arrays import Floats
from fg_nav.magnetic import average_footfall_field
from fg_nav.mechanisation import NavState, rotation_vector, strapdown
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.smoother.gyro_scale import ALIKE_SIGMA, SCALE_SIGMA, GyroScale, compare_models, sense_scale
from fg_nav.solution import Solution
from tests.simulated import corridor
from tests.smoother.test_field import earth, heading_error_deg, in_field
from tests.smoother.walks import DEFAULT, demo

SCALE = np.array([0.02, -0.02, 0.02])


def integrate(t: Floats, force: Floats, rate: Floats) -> NavState:
    """Free motion from rest."""
    state = NavState(np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))
    turn, push = np.empty((3, 3)), np.empty(3)
    for i in range(len(t) - 1):
        strapdown(state, force[i], rate[i], t[i + 1] - t[i], 0.0, turn, push)
    return state


@pytest.mark.parametrize("axis", range(3))
def test_sensitivity_is_that_of_integrated_samples(axis: int) -> None:
    """A swing of 0.4 s at up to 8 rad/s and 25 m/s^2, 400 Hz."""
    t = np.arange(161) / 400.0
    phase = np.pi * t[:, None] / t[-1]
    rate = np.sin(phase * [1.0, 2.0, 1.5]) * [3.0, -8.0, 4.0]
    force = np.cos(phase * [2.0, 1.0, 3.0]) * [25.0, 10.0, 20.0] + [0.0, 0.0, 9.8]
    bias, d = np.array([0.01, -0.02, 0.03]), 1e-4
    s = d * np.eye(3)[axis]
    low, high = (integrate(t, force, (rate - bias) / (1.0 + sign * s)) for sign in (-1.0, 1.0))
    end_R_start = integrate(t, force, rate - bias).nav_R_body.T
    expected = [
        rotation_vector(low.nav_R_body.T @ high.nav_R_body),
        end_R_start @ (high.position - low.position),
        end_R_start @ (high.velocity - low.velocity),
    ]
    found = sense_scale(t, force, rate, np.array([0, len(t) - 1]), bias[None])[0]
    for rows, e in zip(np.split(found[:, axis], 3), expected, strict=True):
        np.testing.assert_allclose(rows, e / (2 * d), atol=2e-3 * np.linalg.norm(e) / (2 * d))


def scaled(scale: Floats) -> Recording:
    recording = in_field(earth())
    return replace(recording, gyr=recording.gyr * (1.0 + scale))


@cache
def smoothed(wrong: bool, corrected: bool = True, with_field: bool = True) -> Solution:
    recording, stances = scaled(SCALE * wrong), demo().stances
    field = average_footfall_field(recording, stances) if with_field else None
    return smooth(recording, stances, replace(DEFAULT, gyro_scale=corrected), 0.0, field=field)


def is_noted(solution: Solution) -> bool:
    return any("scale errors" in note for note in solution.notes)


def test_a_wrong_scale_is_taken_off_where_the_field_shows_it() -> None:
    assert is_noted(smoothed(True))
    with_it, without = (np.sqrt((heading_error_deg(smoothed(True, on)) ** 2).mean()) for on in (False, True))
    assert without < 0.6 * with_it


def test_a_right_scale_is_left_as_it_is() -> None:
    found, expected = smoothed(False), smoothed(False, corrected=False)
    assert not is_noted(found)
    np.testing.assert_array_equal(found.position, expected.position)


def test_sigmas_hold_a_scale_that_the_walk_does_not_refute() -> None:
    """Nothing is taken off, and a scale of a per cent is still possible: the gyro bias is less certain for it."""
    counted, ignored = smoothed(False).stances, smoothed(False, corrected=False).stances
    assert np.all(counted.gyro_bias_sigma > ignored.gyro_bias_sigma)
    assert counted.heading_sigma[-1] > ignored.heading_sigma[-1]


@pytest.mark.parametrize("nats", [-2.0, 0.0, 2.0, 8.0])
def test_second_moment_is_that_of_both_models_drawn(nats: float) -> None:
    """With probability w the errors are N(s, P), else they are smaller."""
    rng = np.random.default_rng(1)
    root = np.array([[2.0, 0.0, 0.0], [1.0, 3.0, 0.0], [0.0, -1.0, 1.0]]) * 1e-3
    with_errors = (rng.random(200_000) < np.exp(nats) / (1.0 + np.exp(nats)))[:, None]
    normal = rng.standard_normal((200_000, 3))
    drawn = np.where(with_errors, SCALE / 4 + normal @ root.T, 2e-4 * normal)
    found = GyroScale(SCALE / 4, root @ root.T, nats, 4e-8 * np.eye(3)).second_moment
    np.testing.assert_allclose(found, drawn.T @ drawn / len(drawn), atol=0.02 * np.trace(found) + 1e-9)


def test_nats_are_those_of_the_densities_of_the_estimate() -> None:
    """What the walk says is one estimate of the scale with a covariance; it is drawn about zero by either model."""
    root = np.array([[2.0, 0.0, 0.0], [1.0, 3.0, 0.0], [0.0, -1.0, 1.0]]) * 1e-3
    covariance = root @ root.T
    information = np.linalg.inv(covariance)
    found = compare_models(information, information @ SCALE)
    densities = [
        multivariate_normal(cov=covariance + variance * np.eye(3)).logpdf(SCALE)
        for variance in (SCALE_SIGMA**2 + ALIKE_SIGMA**2, ALIKE_SIGMA**2)
    ]
    assert found.nats == pytest.approx(densities[0] - densities[1], rel=1e-9)


def test_a_small_error_is_no_scale_however_long_the_walk() -> None:
    """Axes out of square look like a few tenths of a percent in any walk; two percent are a scale in a short one."""
    small, large = 0.003 * np.array([1.0, -1.0, 1.0]), 0.02 * np.array([0.0, 1.0, 0.0])
    assert not compare_models(np.eye(3) / 1e-8, small / 1e-8).is_shown
    assert compare_models(np.eye(3) / 1e-5, large / 1e-5).is_shown


def test_without_a_field_the_scale_is_left_as_it_is() -> None:
    assert not is_noted(smoothed(True, with_field=False))


def test_corrected_samples_are_those_without_the_errors() -> None:
    found = GyroScale(SCALE, np.eye(3) * 1e-6, 10.0, np.zeros((3, 3))).remove_from(scaled(SCALE))
    np.testing.assert_allclose(found.gyr, in_field(earth()).gyr, atol=1e-12)


def test_sigmas_hold_what_is_left_of_a_scale_that_was_taken_off() -> None:
    """1 % on each axis, three seeds: squares of heading and bias errors over their variances are of order 1."""
    headings, biases = [], []
    for seed in range(3):
        recording, stances = in_field(earth(), seed), demo(seed).stances
        wrong = replace(recording, gyr=recording.gyr * 1.01)
        found = smooth(wrong, stances, DEFAULT, 0.0, field=average_footfall_field(wrong, stances))
        headings.append(np.mean(np.radians(heading_error_deg(found, seed)) ** 2 / found.stances.heading_sigma**2))
        error = found.stances.gyro_bias[:, 2] - corridor(seed=seed).gyro_bias[2]
        biases.append(np.mean((error / found.stances.gyro_bias_sigma[:, 2]) ** 2))
    assert np.mean(headings) < 3.0
    assert np.mean(biases) < 3.0
