"""Inertial measurements between nodes: the same strapdown as everywhere, with the noise that the motion calls for."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest

from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.recording import Recording
from fg_nav.samples.readings import find_saturated, rebuild_peaks
from fg_nav.smoother import strides as preintegration
from fg_nav.smoother.strides import compound_samples, preintegrate
from tests.smoother.walks import DEFAULT, demo

NO_BIAS = gtsam.imuBias.ConstantBias()
QUIET = replace(DEFAULT, acc_relative_density=0.0, gyr_relative_density=0.0)


@pytest.fixture(autouse=True)
def exact_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """No noise but that of the samples."""
    monkeypatch.setattr(preintegration, "POSITION_DENSITY", 1e-9)


def measurements(recording: Recording, sample: list[int], p=DEFAULT, bias=NO_BIAS) -> list:
    return list(preintegrate(recording, np.array(sample), bias, p))


@pytest.fixture(scope="module")
def recording() -> Recording:
    return demo().recording


@pytest.mark.parametrize("bias", [np.zeros(6), np.array([0.1, -0.2, 0.05, 0.01, 0.02, -0.03])], ids=["none", "some"])
def test_measurement_is_strapdown_over_the_same_samples(recording: Recording, bias: np.ndarray) -> None:
    sample = [600, 640, 641, 790, 1200]
    found = measurements(recording, sample, bias=gtsam.imuBias.ConstantBias(bias[:3], bias[3:]))
    assert len(found) == len(sample) - 1
    rng, (force, rate) = np.random.default_rng(0), recording.integrable
    for measurement, i, j in zip(found, sample[:-1], sample[1:], strict=True):
        attitude = gtsam.Rot3.RzRyRx(*rng.standard_normal(3))
        position, velocity = rng.standard_normal(3), rng.standard_normal(3)
        start = gtsam.NavState(attitude, position, velocity)
        predicted = measurement.predict(start, gtsam.imuBias.ConstantBias(bias[:3], bias[3:]))
        state = NavState(position.copy(), velocity.copy(), attitude.matrix().copy(), bias[3:], bias[:3])
        turn, push = np.empty((3, 3)), np.empty(3)
        for k in range(i, j):
            h = recording.t[k + 1] - recording.t[k]
            strapdown(state, force[k], rate[k], h, GRAVITY_M_S2, turn, push)
        np.testing.assert_allclose(predicted.position(), state.position, atol=1e-11)
        np.testing.assert_allclose(predicted.velocity(), state.velocity, atol=1e-11)
        np.testing.assert_allclose(predicted.attitude().matrix(), state.nav_R_body, atol=1e-12)
        assert measurement.deltaTij() == pytest.approx(recording.t[j] - recording.t[i], abs=1e-12)


def variances(measurement) -> np.ndarray:
    """Of rotation, position and velocity (3, 3), each along the body axes at the end."""
    return np.diagonal(measurement.preintMeasCov()).reshape(3, 3)


def still(n: int = 401, rate_hz: float = 200.0) -> Recording:
    """A sensor that stands level and reads no noise."""
    return Recording(t=np.arange(n) / rate_hz, acc=np.tile([0.0, 0.0, GRAVITY_M_S2], (n, 1)), gyr=np.zeros((n, 3)))


@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_covariance_is_that_of_integrated_white_noise(rate_hz: float) -> None:
    T, acc, gyr = 2.0, QUIET.acc_density, np.radians(QUIET.gyr_density_deg_s)
    n = round(T * rate_hz)
    rotation, position, velocity = variances(measurements(still(n + 1, rate_hz), [0, n], QUIET)[0])
    np.testing.assert_allclose(rotation, gyr**2 * T, rtol=1e-2)
    assert velocity[2] == pytest.approx(acc**2 * T, rel=1e-2)
    assert position[2] == pytest.approx(acc**2 * T**3 / 3, rel=2e-2)
    tilted = GRAVITY_M_S2 * gyr  # a tilt that walks turns gravity into the level plane
    np.testing.assert_allclose(velocity[:2], acc**2 * T + tilted**2 * T**3 / 3, rtol=2e-2)
    np.testing.assert_allclose(position[:2], acc**2 * T**3 / 3 + tilted**2 * T**5 / 20, rtol=2e-2)


def test_noise_of_an_interval_is_the_mean_over_its_samples(recording: Recording) -> None:
    """Of a level, straight push: the velocity's variance is the sum of the samples' s^2 h."""
    base, n = still(), 400
    push = np.zeros((n + 1, 3))
    push[100:130, 2] = np.linspace(1.0, 60.0, 30)
    h, gravity = 1 / 200, GRAVITY_M_S2
    shaken = replace(base, acc=base.acc + push)
    p = replace(QUIET, acc_relative_density=0.02, gyr_density_deg_s=1e-9)
    (found,) = measurements(shaken, [0, n], p)
    off = np.linalg.norm(shaken.acc[:n], axis=1) - gravity
    expected = np.sum(p.acc_density**2 + (0.02 * off) ** 2) * h
    np.testing.assert_allclose(variances(found)[2], expected, rtol=1e-6)


def clipped(axis: int) -> Recording:
    """A still sensor but for one swing, whose rate about an axis is cut at the end of the range."""
    base = still()
    swing = np.zeros(401)
    swing[100:200] = 12.0 * np.sin(np.linspace(0.0, np.pi, 100))
    gyr = np.zeros((401, 3))
    gyr[:, axis] = np.minimum(swing, 8.7)
    return replace(base, gyr=gyr)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_saturated_axis_is_doubted_and_no_other(axis: int) -> None:
    recording = clipped(axis)
    flags = find_saturated(recording.gyr)
    assert 20 < flags[:, axis].sum() < 80
    assert flags.sum() == flags[:, axis].sum()
    believing = replace(QUIET, saturated_share=0.0)
    # body axes at the end are those at the start but for a turn about `axis`: it is an eigenvector of the turn
    doubt, without = (measurements(recording, [0, 400], p)[0].preintMeasCov()[:3, :3] for p in (QUIET, believing))
    added = doubt - without
    cut = recording.gyr[flags[:, axis], axis]
    one_error = np.sum(QUIET.saturated_share * cut) ** 2 / 200**2
    hidden = one_error + np.sum(rebuild_peaks(recording.gyr, 1 / 200).sigma ** 2) / 200**2
    assert added[axis, axis] == pytest.approx(hidden, rel=1e-6)
    others = [k for k in range(3) if k != axis]
    np.testing.assert_allclose(added[np.ix_(others, others)], 0.0, atol=1e-8 * hidden)


def pushed(when: slice, size: float) -> Recording:
    """A still sensor but for two pushes forward, the one at `when` beyond the end of the range at 40 m/s^2."""
    base = still()
    acc = base.acc.copy()
    for some in (slice(40, 60), slice(340, 360)):
        acc[some, 0] = (size if some == when else 30.0) * np.sin(np.linspace(0.0, np.pi, 20))
    return replace(base, acc=np.minimum(acc, 40.0))


def test_a_force_hidden_early_moves_the_end_of_the_interval_and_one_hidden_late_does_not() -> None:
    """The position's variance is the velocity's times the square of the time left."""
    believing = replace(QUIET, saturated_share=0.0)
    for when, middle in ((slice(40, 60), 50), (slice(340, 360), 350)):
        recording = pushed(when, 60.0)
        doubt, without = (variances(measurements(recording, [0, 400], p)[0]) for p in (QUIET, believing))
        added = (doubt - without)[:, 0]
        left = (400 - middle) / 200
        assert added[2] > 0.001
        assert np.sqrt(added[1] / added[2]) == pytest.approx(left, rel=0.02)


def test_the_end_of_a_push_that_was_cut_is_within_its_sigma() -> None:
    """Drawn heights of the push, cut, rebuilt and integrated: the velocity at the end, over its sigma."""
    rng, over = np.random.default_rng(7), []
    for size in rng.uniform(45.0, 90.0, 30):
        recording = pushed(slice(40, 60), size)
        hidden = np.maximum(size * np.sin(np.linspace(0.0, np.pi, 20)) - 40.0, 0.0).sum() / 200
        (found,) = measurements(recording, [0, 400])
        velocity = np.sum((recording.integrable[0] - recording.acc)[:, 0]) / 200
        over.append((velocity - hidden) / np.sqrt(variances(found)[2, 0]))
    assert 0.1 < np.sqrt(np.mean(np.square(over))) < 1.5


def test_an_interval_with_a_gap_is_doubted_and_no_other() -> None:
    base = clipped(1)
    gap = np.arange(401) > 300
    holed = replace(base, t=base.t + 0.05 * gap)
    before, with_gap, after = measurements(holed, [0, 290, 310, 400], replace(QUIET, saturated_share=0.0))
    usual = measurements(base, [0, 290, 310, 400], replace(QUIET, saturated_share=0.0))
    assert variances(with_gap)[0, 1] > 100 * variances(usual[1])[0, 1]
    for found, expected in ((before, usual[0]), (after, usual[2])):
        np.testing.assert_allclose(variances(found)[0], variances(expected)[0], rtol=1e-6)


def test_few_samples_stand_for_many(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preintegration, "POSITION_DENSITY", 1e-3)
    sample, bias = [600, 790, 800, 1200], np.array([[0.1, -0.2, 0.05], [0.01, 0.02, -0.03]])
    h, samples = np.diff(recording.t), recording.integrable
    few = compound_samples(*samples, h, np.array(sample), *bias)
    assert few.first[-1] == len(few.h) < 0.35 * (sample[-1] - sample[0])
    # Their motion the first test compares; what is left is how it changes with the bias, and its covariance.
    compounded = measurements(recording, sample, bias=gtsam.imuBias.ConstantBias(*bias))
    other = gtsam.imuBias.ConstantBias(bias[0] + 0.02, bias[1] + 0.002)
    monkeypatch.setattr(preintegration, "compound_samples", compound_samples.py_func)
    monkeypatch.setattr(preintegration, "_end_block", lambda rate, h, first, last, bias: first + 1)
    one_by_one = measurements(recording, sample, bias=gtsam.imuBias.ConstantBias(*bias))
    for one, exact in zip(compounded, one_by_one, strict=True):
        L = np.linalg.inv(np.linalg.cholesky(exact.preintMeasCov()))
        np.testing.assert_allclose(L @ one.preintMeasCov() @ L.T, np.eye(9), atol=0.01)
        moved, expected = (m.predict(gtsam.NavState(), other) for m in (one, exact))
        np.testing.assert_allclose(L @ expected.localCoordinates(moved), 0.0, atol=0.01)
