"""The demonstration as it is recorded: a minute, once round a corridor, by a foot and a sensor that are real."""

import numpy as np
import pytest

from fg_nav.frames import GRAVITY_M_S2, compute_heading
from fg_nav.lab.simulation import SimulatedWalk, simulate
from fg_nav.truth import TrajectoryTruth

SEED = 7


@pytest.fixture(scope="module")
def demo() -> SimulatedWalk:
    return simulate("demo", SEED)


def test_it_is_a_minute_once_round_a_corridor(demo: SimulatedWalk) -> None:
    truth = demo.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    assert 60 < demo.recording.duration_s < 75
    assert 70 < np.linalg.norm(np.diff(truth.position[:, :2], axis=0), axis=1).sum() < 85
    heading_deg = np.rad2deg(np.unwrap(compute_heading(truth.nav_R_body)))
    assert heading_deg[-1] - heading_deg[0] == pytest.approx(360.0, abs=0.5)
    assert np.ptp(truth.position[:, 2]) < 0.25


def test_standing_it_shows_gravity_its_bias_and_a_noise_of_its_own(demo: SimulatedWalk) -> None:
    recording, prior = demo.recording, demo.scenario.prior
    still = slice(0, int(4.0 * prior.rate_hz))
    acc, gyr = recording.acc[still], recording.gyr[still]
    assert np.linalg.norm(acc.mean(axis=0)) == pytest.approx(GRAVITY_M_S2, abs=0.1)
    bias = np.rad2deg(gyr.mean(axis=0) - demo.biases.gyr[0])
    assert np.abs(bias).max() < 0.1
    for samples, triad in ((acc, prior.acc), (gyr, prior.gyr)):
        noise = np.diff(samples, axis=0).std(axis=0) / np.sqrt(2)
        np.testing.assert_allclose(noise, triad.noise_density * np.sqrt(prior.rate_hz), rtol=0.15)
