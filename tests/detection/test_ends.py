"""Levelling, and which rests are believed."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection.rest import find_start
from fg_nav.detection.stance import Stances
from fg_nav.frames import GRAVITY_M_S2, compute_heading
from fg_nav.recording import Recording

RATE = 200.0
BIAS = np.radians([0.3, -0.2, 0.4])

SWAY_HZ = np.array([0.25, 0.5, 1.0, 2.0, 4.0])
SWAY_DEG = 0.02 * np.sqrt(2.0) / SWAY_HZ / np.linalg.norm(1.0 / SWAY_HZ)
"""Amplitudes, 0.02 deg rms in all: a foot turns as fast at each frequency, as in a random walk. Of a slow sine alone
half a second would show a rate and no sway; real feet show it (`test_real_walks`)."""


def resting(seconds, seed=0, noise_deg_s=0.1, tilt=0.2):
    rng = np.random.default_rng(seed)
    count = int(seconds * RATE)
    t = np.arange(count) / RATE
    turn = 2 * np.pi * SWAY_HZ
    waves = np.cos(t[:, None, None] * turn[:, None] + rng.uniform(0.0, 2 * np.pi, (len(turn), 3)))
    sway = np.einsum("f,tfa->ta", turn * np.radians(SWAY_DEG), waves)
    gyr = BIAS + np.radians(noise_deg_s) * rng.standard_normal((count, 3)) + sway
    up = GRAVITY_M_S2 * np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    recording = Recording(t=t, acc=up + 0.02 * rng.standard_normal((count, 3)), gyr=gyr)
    return recording, Stances.from_mask(np.ones(count, dtype=bool))


def test_levelling_finds_up_and_keeps_the_heading():
    start = find_start(*resting(2.0), heading=0.7)
    assert compute_heading(start.nav_R_body) == pytest.approx(0.7)
    np.testing.assert_allclose(start.nav_R_body[2], [np.sin(0.2), 0.0, np.cos(0.2)], atol=1e-3)


@pytest.mark.parametrize("seconds", [0.6, 1.5, 10.0])
def test_a_rest_tells_the_bias_as_well_as_it_claims(seconds):
    errors = []
    for seed in range(60):
        start = find_start(*resting(seconds, seed))
        assert start.rest is not None
        errors.append((start.rest.rate - BIAS) / start.rest.sigma)
    assert 0.1 < np.sqrt(np.mean(np.square(errors))) < 1.5


def test_the_claim_falls_with_the_length_of_the_rest():
    short, long, longest = (
        np.degrees(np.mean([find_start(*resting(seconds, seed)).rest.sigma for seed in range(10)]))
        for seconds in (1.0, 10.0, 60.0)
    )
    assert short > 1.8 * long > 1.8 * 1.2 * longest
    assert 0.015 < longest < 0.017  # what sway leaves, and the floor


def test_a_rolling_foot_is_no_rest():
    recording, stances = resting(2.0)
    t = recording.t
    for rolling in (np.radians(2.0) * np.sin(2 * np.pi * t), np.radians(6.0) * np.linspace(-1, 1, len(t))):
        start = find_start(replace(recording, gyr=recording.gyr + rolling[:, None]), stances)
        assert start.rest is None


def test_the_lift_of_the_heel_is_left_out_of_the_rest():
    recording, stances = resting(3.0)
    gyr = recording.gyr.copy()
    gyr[500:] += np.linspace(0.0, 1.0, 100)[:, None]
    start = find_start(replace(recording, gyr=gyr), stances)
    assert start.rest.stop == 500
    assert (np.abs(start.rest.rate - BIAS) < 3 * start.rest.sigma).all()


def test_a_short_stance_is_no_rest():
    recording, _ = resting(3.0)
    mask = np.zeros(600, dtype=bool)
    mask[100:180] = True
    start = find_start(recording, Stances.from_mask(mask))
    assert (start.row, start.rest) == (100, None)


def test_the_rest_may_come_after_some_fidgeting_in_the_same_footfall():
    recording, _ = resting(4.0)
    gyr, mask = recording.gyr.copy(), np.ones(800, dtype=bool)
    gyr[150:250] += 1.0
    mask[140:260] = False
    fidgeting = replace(recording, gyr=gyr)
    stances = Stances.from_mask(mask)
    apart = find_start(fidgeting, stances)
    together = find_start(fidgeting, replace(stances, footfall=np.zeros(2, dtype=np.int64)))
    assert apart.rest.stop <= 150
    assert together.rest.start >= 250
    assert together.rest.stop - together.rest.start > 3 * (apart.rest.stop - apart.rest.start)
    np.testing.assert_allclose(together.nav_R_body, apart.nav_R_body)
