"""The rolling lever on feet whose lever is known: found, in any mounting, and not better known than it is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.detection import detect_stances
from fg_nav.detection import rest as lever_module
from fg_nav.detection.rest import estimate_lever
from fg_nav.detection.stance import Stances
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation.motion import Ramps
from fg_nav.lab.simulation.mount import INSTEP, Mount
from fg_nav.lab.simulation.person import Person
from fg_nav.recording import Recording
from tests.simulated import FIRM, PERSON, QUIET, RIGID, mounted, straight_walk, turning_foot

LEVER = np.array([-0.03, 0.02, 0.11])
STANCE_S, CYCLE_S = 0.4, 0.6
PRIOR = lever_module.PRIOR_SIGMA_M


def rolling(
    seed=0,
    stances=40,
    rise_deg=(3.0, 7.0, 3.0),
    noise=1.0,
    acc_bias=0.0,
    gyr_bias_deg_s=0.0,
    rate_hz=200.0,
    lever=LEVER,
):
    """A foot that turns about a fixed pivot in each stance, and in between goes back, by any mean angle.

    Every stance begins and ends at another attitude: all the tilt there is on a foot, and more.
    """
    rng = np.random.default_rng(seed)
    start = 0.1 + CYCLE_S * np.arange(stances)
    rise = np.radians(rise_deg) * (1 + 0.4 * rng.standard_normal((stances, 3)))
    begin = np.concatenate([start, start + STANCE_S])
    width = np.repeat([STANCE_S, CYCLE_S - STANCE_S], stances)
    motion = turning_foot(lever, [Ramps.of(begin, width, np.concatenate([angle, -angle])) for angle in rise.T])
    t = np.arange(round((0.3 + CYCLE_S * stances) * rate_hz)) / rate_hz
    gyr, acc = motion.sampled(t, 1 / rate_hz)
    acc = acc + acc_bias * rng.standard_normal(3) + noise * 0.03 * rng.standard_normal(acc.shape)
    gyr = gyr + np.radians(gyr_bias_deg_s) * rng.standard_normal(3)
    gyr = gyr + noise * np.radians(0.1) * rng.standard_normal(gyr.shape)
    since = (t - 0.1) % CYCLE_S
    stands = (t > 0.1) & (since < STANCE_S - 1 / rate_hz) & (t < start[-1] + CYCLE_S)
    return Recording(t=t, acc=acc, gyr=gyr), Stances.from_mask(stands)


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 800.0])
def test_without_noise_the_lever_is_exact(rate_hz):
    found = estimate_lever(*rolling(noise=0.0, acc_bias=0.05, rate_hz=rate_hz))
    np.testing.assert_allclose(found.lever, LEVER, atol=1e-3)
    assert found.stances_used == 40


@pytest.mark.parametrize("gyr_bias_deg_s", [0.0, 0.1])
def test_the_lever_is_known_to_within_its_sigma(gyr_bias_deg_s):
    errors = []
    for seed in range(25):
        found = estimate_lever(*rolling(seed, acc_bias=0.05, gyr_bias_deg_s=gyr_bias_deg_s))
        errors.append(np.linalg.solve(np.linalg.cholesky(found.covariance), found.lever - LEVER))
    assert np.sqrt(np.mean(np.square(errors))) < 1.0  # cautious: real feet share their model error
    assert np.abs(errors).max() < 2.5


def test_without_the_caution_the_scatter_of_stances_is_an_honest_sigma(monkeypatch):
    monkeypatch.setattr(lever_module, "ERROR_CORRELATION", 1.0)
    monkeypatch.setattr(lever_module, "PRIOR_SIGMA_M", 10.0)
    errors, levers = [], []
    for seed in range(60):
        found = estimate_lever(*rolling(seed, stances=60))
        errors.append((found.lever - LEVER) / np.sqrt(np.diag(found.covariance)))
        levers.append(found.lever)
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.6
    np.testing.assert_allclose(np.mean(levers, axis=0), LEVER, atol=0.004)


@pytest.mark.parametrize("rotvec", [(0.0, 0.0, np.pi), (np.pi, 0.0, 0.0), (1.0, -2.0, 0.4)])
def test_the_lever_turns_with_the_mounting(rotvec):
    turn = Rotation.from_rotvec(rotvec)
    recording, stances = rolling(seed=3)
    asis, turned = estimate_lever(recording, stances), estimate_lever(mounted(recording, turn), stances)
    np.testing.assert_allclose(turned.lever, turn.inv().apply(asis.lever), atol=1e-9)
    R = turn.as_matrix()
    np.testing.assert_allclose(turned.covariance, R.T @ asis.covariance @ R, atol=1e-12)


def test_more_stances_know_more():
    sigma = [np.sqrt(estimate_lever(*rolling(stances=n)).covariance[2, 2]) for n in (10, 40, 160)]
    assert sigma[0] > 1.4 * sigma[1] > 2 * sigma[2]


@pytest.mark.parametrize("count", [0, 1, 3])
def test_few_stances_leave_the_prior(count):
    recording, stances = rolling()
    few = replace(stances, start=stances.start[:count], stop=stances.stop[:count], footfall=stances.footfall[:count])
    found = estimate_lever(recording, few)
    np.testing.assert_array_equal(found.lever, 0.0)
    np.testing.assert_allclose(found.covariance, PRIOR**2 * np.eye(3))
    assert found.stances_used == count


def test_a_foot_that_does_not_roll_shows_nothing():
    """And the noise of the gyroscope is not taken for rolling that moves nothing, which would show a lever of zero."""
    found = estimate_lever(*rolling(rise_deg=(0.0, 0.0, 0.0)))
    np.testing.assert_array_equal(found.lever, 0.0)
    np.testing.assert_allclose(found.covariance, PRIOR**2 * np.eye(3))


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_along_the_only_axis_of_rolling_the_lever_stays_unknown(noise):
    """A wheel does not show how wide it is."""
    found = estimate_lever(*rolling(rise_deg=(0.0, 7.0, 0.0), noise=noise))
    np.testing.assert_allclose(found.lever, [-0.03, 0.0, 0.11], atol=0.01)
    sigma = np.sqrt(np.diag(found.covariance))
    assert sigma[1] == pytest.approx(PRIOR, rel=1e-3)
    assert max(sigma[0], sigma[2]) < 0.2 * PRIOR


def test_a_stance_at_the_very_end_of_the_recording():
    recording, stances = rolling(noise=0.0)
    end = int(stances.stop[-1])
    cut = recording.slice(0, end)
    stances = replace(stances, n_samples=end)
    np.testing.assert_allclose(estimate_lever(cut, stances).lever, LEVER, atol=1e-3)


def test_stances_of_two_samples_are_left_out():
    recording, stances = rolling()
    short = replace(stances, stop=np.where(np.arange(40) % 2 == 0, stances.start + 2, stances.stop))
    assert estimate_lever(recording, short).stances_used == 20


def test_uneven_stamps_and_fast_turning_are_no_obstacle():
    recording, stances = rolling(noise=0.0, rise_deg=(5.0, 12.0, 8.0), rate_hz=400.0)
    kept = np.ones(len(recording), dtype=bool)
    kept[5::7] = False  # these samples are merged into the ones before, so that no motion is lost
    t, merged = recording.t[kept], np.flatnonzero(~kept)
    acc, gyr = recording.acc.copy(), recording.gyr.copy()
    for samples in (acc, gyr):
        samples[merged - 1] = (samples[merged - 1] + samples[merged]) / 2
    uneven = Recording(t=t, acc=acc[kept], gyr=gyr[kept])
    found = estimate_lever(uneven, Stances.from_mask(stances.mask[kept]))
    np.testing.assert_allclose(found.lever, LEVER, atol=2e-3)


@pytest.mark.parametrize(
    ("person", "mount", "height_m"),
    [(RIGID, FIRM, 0.002), (QUIET, FIRM, 0.004), (PERSON, INSTEP, 0.02)],
    ids=["rigid", "quiet", "real"],
)
def test_a_walk_shows_the_height_of_the_sensor(person: Person, mount: Mount, height_m: float):
    """On a whole walk, with detected stances: the height rolling shows well; the rest is within its sigma.

    A sole that sinks while the foot rolls on looks like a lever that ends 1 cm farther back.
    """
    for seed in range(4):
        walk = straight_walk(person, strides=40, seed=seed, mount=mount)
        found = estimate_lever(walk.recording, detect_stances(walk.recording))
        foot_R_body = walk.motion.foot_R_body
        error = foot_R_body @ found.lever - walk.motion.lever_m
        assert abs(error[2]) < height_m
        assert np.all(np.abs(error) < 3 * np.sqrt(np.diag(foot_R_body @ found.covariance @ foot_R_body.T)))


def test_gravity_alone_is_no_lever():
    n = 2000
    acc = np.tile([0.0, 0.0, GRAVITY_M_S2], (n, 1))
    recording = Recording(t=np.arange(n) / 200, acc=acc, gyr=np.zeros((n, 3)))
    found = estimate_lever(recording, Stances.from_mask(np.arange(n) % 100 < 60))
    np.testing.assert_array_equal(found.lever, 0.0)
    np.testing.assert_allclose(found.covariance, PRIOR**2 * np.eye(3))
