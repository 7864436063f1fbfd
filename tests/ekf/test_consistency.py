"""Monte Carlo: walks drawn from the filter's own beliefs, and whether NEES and NIS are what they should be.

Truth and estimate start apart by a draw from P, the biases walk, the samples have the densities of the filter
and the velocity in stance is measured with its noise. Then the errors are chi-square with as many degrees of
freedom as components, within the bounds of the number of runs (Bar-Shalom et al. 2001, 5.4).
"""

import numpy as np
from numba import njit
from scipy.stats import chi2

from fg_nav.ekf.covariance import VELOCITY, Densities, propagate_covariance
from fg_nav.ekf.update import inject_error, update_component
from fg_nav.mechanisation import NavState, strapdown
from tests.ekf.errors import error_of, with_error
from tests.ekf.motion import Walk

RUNS = 200
RATE = 100.0
DENSITY = Densities(0.02**2, np.radians(0.05) ** 2, np.radians(0.01) ** 2, 0.003**2)
STANCE_VARIANCE = 0.01**2
PRIOR = np.repeat([1e-3, 0.02, 0.01, np.radians(0.2), 0.03], 3)
SURE = 0.999  # Two-sided probability of the bounds: one seed is fixed, so this is how lucky the seed may be.


@njit
def navigate(truth, estimate, P, acc, gyr, stands, h, noise, density, variance):
    """Move truth and estimate over the same walk; returns the NIS of each correction."""
    x, turn, push = np.zeros(15), np.empty((3, 3)), np.empty(3)
    nis = np.full(len(acc), np.nan)
    for i in range(len(acc)):
        if stands[i]:
            nis[i] = 0.0
            for k in range(3):
                measured = truth.velocity[k] + np.sqrt(variance) * noise[i, k]
                nis[i] += update_component(P, x, VELOCITY + k, estimate.velocity[k] - measured, variance) ** 2
            inject_error(estimate, x)
        # the sensor reads what moves the truth, its biases, and white noise
        force = acc[i] + truth.acc_bias + np.sqrt(density.acc / h) * noise[i, 3:6]
        rate = gyr[i] + truth.gyro_bias + np.sqrt(density.gyr / h) * noise[i, 6:9]
        strapdown(truth, acc[i] + truth.acc_bias, gyr[i] + truth.gyro_bias, h, 9.80665, turn, push)
        strapdown(estimate, force, rate, h, 9.80665, turn, push)
        propagate_covariance(P, turn, push, h, density)
        truth.gyro_bias[:] += np.sqrt(density.gyro_bias * h) * noise[i, 9:12]
        truth.acc_bias[:] += np.sqrt(density.acc_bias * h) * noise[i, 12:15]
    return nis


def monte_carlo():
    """NEES (runs, 5 parts and all) at the end, mean NIS of each run, and the number of corrections."""
    walk = Walk(strides=8, rest_s=1.0)
    recording, stances = walk.recording(RATE)
    rng = np.random.default_rng(11)
    nees, nis = [], []
    for _ in range(RUNS):
        estimate = NavState(np.zeros(3), np.zeros(3), walk.attitude(np.zeros(1))[0].copy(), *np.zeros((2, 3)))
        truth = with_error(estimate, -PRIOR * rng.standard_normal(15))
        P = np.diag(PRIOR**2)
        noise = rng.standard_normal((len(recording), 15))
        samples = recording.acc, recording.gyr, stances.mask
        scores = navigate(truth, estimate, P, *samples, 1 / RATE, noise, DENSITY, STANCE_VARIANCE)
        nis.append(np.nanmean(scores))
        e = error_of(estimate, truth)
        parts = [slice(k, k + 3) for k in range(0, 15, 3)] + [slice(0, 15)]
        nees.append([e[p] @ np.linalg.solve(P[p, p], e[p]) for p in parts])
    return np.array(nees), np.array(nis), int(np.count_nonzero(stances.mask))


def bounds(dof, draws):
    """Of the mean of `draws` independent chi-square numbers."""
    return chi2.ppf([(1 - SURE) / 2, (1 + SURE) / 2], dof * draws) / draws


def test_errors_are_as_large_as_the_filter_claims():
    nees, nis, corrections = monte_carlo()
    for part, dof in zip(nees.mean(axis=0), [3, 3, 3, 3, 3, 15], strict=True):
        low, high = bounds(dof, RUNS)
        assert low < part < high
    low, high = bounds(3, RUNS * corrections)
    assert low < nis.mean() < high
