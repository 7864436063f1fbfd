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
from fg_nav.lab.simulation.person import INSTEP, Mount, Person
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
    recording, stances = rolling(noise=0.0, acc_bias=0.05, rate_hz=rate_hz)
    found = estimate_lever(recording, stances)
    np.testing.assert_allclose(found.lever, LEVER, atol=1e-3)
    assert found.stances_used == 40
    end = int(stances.stop[-1])  # a stance at the very end of the recording
    found = estimate_lever(recording.slice(0, end), replace(stances, n_samples=end))
    np.testing.assert_allclose(found.lever, LEVER, atol=1e-3)


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


def test_few_stances_and_a_foot_that_does_not_roll_leave_the_prior():
    """The noise of the gyroscope is not taken for rolling that moves nothing, which would show a lever of zero."""
    recording, stances = rolling()
    nothing = replace(recording, acc=np.tile([0.0, 0.0, GRAVITY_M_S2], (len(recording), 1)), gyr=0.0 * recording.gyr)
    fews = [
        replace(stances, start=stances.start[:n], stop=stances.stop[:n], footfall=stances.footfall[:n])
        for n in (0, 1, 3)
    ]
    flat = rolling(rise_deg=(0.0, 0.0, 0.0))
    for one in (*((recording, few) for few in fews), flat, (nothing, stances)):
        found = estimate_lever(*one)
        np.testing.assert_array_equal(found.lever, 0.0)
        np.testing.assert_allclose(found.covariance, PRIOR**2 * np.eye(3))
    short = replace(stances, stop=np.where(np.arange(40) % 2 == 0, stances.start + 2, stances.stop))
    assert estimate_lever(recording, short).stances_used == 20  # two samples are no stance


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_along_the_only_axis_of_rolling_the_lever_stays_unknown(noise):
    """A wheel does not show how wide it is."""
    found = estimate_lever(*rolling(rise_deg=(0.0, 7.0, 0.0), noise=noise))
    np.testing.assert_allclose(found.lever, [-0.03, 0.0, 0.11], atol=0.01)
    sigma = np.sqrt(np.diag(found.covariance))
    assert sigma[1] == pytest.approx(PRIOR, rel=1e-3)
    assert max(sigma[0], sigma[2]) < 0.2 * PRIOR


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
