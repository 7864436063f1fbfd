"""The script that asks whether filters and their smoothers are as sure as they may be."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from fg_nav.ekf import IezParameters
from fg_nav.ekf.core import STANCE_CORRELATION_S
from fg_nav.ekf.presets import MATCHED, find_parameters
from tests.ekf.motion import Walk
from tests.scripts import load_script

consistency = load_script("filter_consistency")

WALKS = 25
SURE = 0.999  # Two-sided probability of the bounds: one seed is fixed, so this is how lucky the seed may be.


@pytest.fixture(scope="module")
def motion():
    """A curve of 15 strides in closed form, at the script's rate."""
    walk = Walk(strides=15, rest_s=1.0, roll=0.2, turn=0.15)
    t = np.arange(0.0, walk.duration_s, 1 / consistency.RATE_HZ)
    stands = walk.stands(t) & walk.stands(t + 1 / consistency.RATE_HZ)
    stands[0] = False
    rows = np.flatnonzero(np.diff(stands.astype(int)) == 1) + 3
    return consistency.Motion(t, walk.attitude(t), walk.velocity(t), stands, rows)


def bounds(number):
    return chi2.ppf([(1 - SURE) / 2, (1 + SURE) / 2], number) / number


def scores(motion, parameters, assumed=None, seed=7):
    """Scores of walks drawn from these parameters; `assumed` are those of the filter, where they are others."""
    return [consistency.scores_of(motion, parameters, np.random.default_rng([seed, k]), assumed) for k in range(WALKS)]


@pytest.mark.parametrize("method", ["iez", "ma2018", "aiez", "matched"])
def test_filter_and_smoother_are_as_sure_as_they_may_be(motion, method):
    found = scores(motion, consistency.drawable(find_parameters(method, "physical")))
    for name in found[0].nis:
        number = sum(score.nis[name][1] for score in found)
        low, high = bounds(number)
        assert low < sum(s.nis[name][0] * s.nis[name][1] for s in found) / number < high, name
    low, high = bounds(consistency.PARTS * WALKS)
    for name in found[0].nees:
        assert low < np.mean([score.nees[name] for score in found]) / consistency.PARTS < high, name


@pytest.mark.parametrize("claim", [{"acc_density": 0.005}, {"gyr_density_deg": 0.004}])
def test_a_smoother_that_claims_too_little_noise_is_found_out(motion, claim):
    drawn = IezParameters(gyr_relative_density=0.0, acc_relative_density=0.0)
    found = scores(motion, drawn, replace(drawn, **claim))
    assert np.mean([score.nees["smoother, middle"] for score in found]) / consistency.PARTS > 1.3


def test_the_drawn_foot_stands_as_the_filter_assumes(motion):
    """In stance the true velocity is rate x lever and noise of the filter's density; its samples lead there."""
    core = replace(MATCHED, unsteady_s=0.0, rolling_lever_m=(0.0, 0.0, 0.08))
    walk = consistency.drawn(motion, core, core, np.random.default_rng(3))
    k = len(walk.truth) // 2
    i = motion.rows[k]
    h = motion.t[i + 1] - motion.t[i]
    turned = Rotation.from_matrix(motion.nav_R_body[i].T @ motion.nav_R_body[i + 1]).as_rotvec()
    rate = turned / h
    rolling = motion.nav_R_body[i] @ np.cross(rate, [0.0, 0.0, 0.08])
    variance = (core.zero_velocity_density**2 + core.roll_sigma_m**2 * 2 * STANCE_CORRELATION_S * rate @ rate) / h
    assert np.abs(walk.truth[k].velocity - rolling).max() < 4 * np.sqrt(variance)
    np.testing.assert_allclose(walk.truth[k].nav_R_body, motion.nav_R_body[i], atol=1e-9)


def test_it_prints_a_row_for_each_figure(capsys):
    consistency.main(["--seeds", "2", "--methods", "iez", "aiez", "--scenario", "calibration-loop"])
    printed = capsys.readouterr().out
    for words in ("NIS of velocity", "NEES, smoother, middle"):
        assert sum(line.startswith(words) for line in printed.splitlines()) == 2
    assert "NIS of tilt" in printed
