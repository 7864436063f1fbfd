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
from fg_nav.smoother import smooth, smooth_graph
from fg_nav.smoother.sensitivity import (
    ALIKE_SIGMA,
    MIN_OWN,
    SCALE_SIGMA,
    GyroScale,
    average_models,
    sense_rate_error,
    spread_clipped_peaks,
)
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
    found = sense_rate_error(t, force, rate, np.array([0, len(t) - 1]), bias[None], rate - bias)[0]
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


def test_a_scale_in_one_half_alone_is_left_as_it_is() -> None:
    """It is no scale, and stays in the sigmas."""
    recording, stances = in_field(earth()), demo().stances
    late = np.arange(len(recording))[:, None] >= len(recording) // 2
    wrong = replace(recording, gyr=recording.gyr * (1.0 + SCALE * late))
    found = smooth(wrong, stances, DEFAULT, 0.0, field=average_footfall_field(wrong, stances))
    assert not is_noted(found)
    assert found.stances.heading_sigma[-1] > 1.15 * smoothed(False).stances.heading_sigma[-1]


def priors() -> list[Floats]:
    """Covariances of the errors of both halves: nothing but what is alike, one scale, one in each half."""
    same, own = np.kron(np.ones((2, 2)), np.eye(3)), np.eye(6)
    alike = ALIKE_SIGMA**2 * (same + MIN_OWN * own)
    return [alike, alike + SCALE_SIGMA**2 * same, alike + SCALE_SIGMA**2 * own]


NOISE = np.kron([[1.0, 0.2], [0.2, 2.0]], [[4.0, 1.0, 0.0], [1.0, 9.0, -1.0], [0.0, -1.0, 2.0]]) * 1e-6
"""Covariance (6, 6) of what a walk shows of the errors of its halves."""


def average_shown(shown: Floats, noise: Floats = NOISE) -> GyroScale:
    """Average over the models, by errors (6,) that a walk shows with this noise."""
    information = np.linalg.inv(noise)
    return average_models(information, information @ shown)


@pytest.mark.parametrize("seed", range(5))
def test_evidence_of_the_three_models_is_that_of_multivariate_normals(seed: int) -> None:
    """So are the mean and the second moment, by the gains of normal variables."""
    rng = np.random.default_rng(seed)
    shown = rng.multivariate_normal(np.zeros(6), priors()[seed % 3] + NOISE)
    weight = np.array([multivariate_normal(cov=prior + NOISE).pdf(shown) for prior in priors()])
    weight /= weight.sum()
    half = np.kron([[0.5, 0.5]], np.eye(3))
    gains = [prior @ np.linalg.inv(prior + NOISE) for prior in priors()]
    means = np.array([half @ gain @ shown for gain in gains])
    left = [half @ (prior - gain @ prior) @ half.T for gain, prior in zip(gains, priors(), strict=True)]
    found = average_shown(shown)
    assert found.probability == pytest.approx(weight[1], rel=1e-6)
    np.testing.assert_allclose(found.scale, weight[1] * means[1], atol=1e-9)
    np.testing.assert_allclose(found.sigma, np.sqrt(np.diag(left[1])), rtol=1e-6)
    off = means - found.scale * found.matters
    expected = sum(w * (P + np.outer(m, m)) for w, P, m in zip(weight, left, off, strict=True))
    np.testing.assert_allclose(found.second_moment, expected, atol=1e-11)


@pytest.mark.parametrize("seed", [0, 3])
def test_what_rebuilt_peaks_have_in_common_is_in_the_heading_sigma(seed: int) -> None:
    """The pitch rate of a foot, cut at 60 % and rebuilt: two sides of one axis, and their error in the sigma."""
    walk = demo(seed)
    axis = int(np.abs(walk.recording.gyr).max(axis=0).argmax())
    level = 0.6 * np.abs(walk.recording.gyr[:, axis]).max()
    clipped = replace(walk.recording, gyr=np.clip(walk.recording.gyr, -level, level))
    assert clipped.peaks[1].run[:, axis].any()
    found = smooth_graph(clipped, walk.stances)
    spread = spread_clipped_peaks(found.walk.problem, found.walk.solved)
    assert 1 <= spread.shape[1] <= 4
    without = spread_clipped_peaks(*((one := smooth_graph(walk.recording, walk.stances).walk).problem, one.solved))
    assert without.shape[1] == 0
    error = np.abs(heading_error_deg(found.solution, seed)[-1])
    assert error < 3.0 * np.degrees(found.solution.stances.heading_sigma[-1])


def test_a_unit_of_the_common_error_moves_the_walk_as_samples_with_it_do() -> None:
    """Columns of the peaks against two solutions, with rates that are raised and lowered by a hundredth of a sigma."""
    walk, step = demo(0), 0.05
    level = 0.6 * np.abs(walk.recording.gyr).max()
    clipped = replace(walk.recording, gyr=np.clip(walk.recording.gyr, -level, level))
    peaks = clipped.peaks[1]
    alike = np.where(clipped.gyr > 0.0, peaks.sigma / np.sqrt(np.maximum(peaks.run, 1.0)), 0.0)
    axis = int(alike.sum(axis=0).argmax())
    t, (force, rate), ends = clipped.t, clipped.integrable, np.array([0, len(clipped) // 8])
    some = slice(0, ends[1] + 1)
    error = np.zeros_like(rate)
    error[:, axis] = alike[:, axis]
    moved = sense_rate_error(t, force, rate, ends, np.zeros((1, 3)), alike)[0][:, axis]
    low, high = (integrate(t[some], force[some], (rate - s * error)[some]) for s in (-step, step))
    turn = rotation_vector(low.nav_R_body.T @ high.nav_R_body) / (2 * step)
    np.testing.assert_allclose(moved[:3], turn, atol=0.02 * np.linalg.norm(turn) + 1e-6)


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
