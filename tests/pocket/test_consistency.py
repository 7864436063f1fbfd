"""Monte Carlo: sensors drawn from the filter's own model, and whether its covariance holds.

The filter takes the noises of successive field differences for independent. For its own model they are: a field that
takes a step of that size each sample. A magnetometer's noise is in two differences with either sign, so that there the
filter claims too large a sigma of the bias.
"""

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from fg_nav.pocket.filter import (
    FilterInputs,
    PocketParameters,
    allocate_track,
    build_model,
    create_reference,
    initialize_state,
    run_filter,
)
from fg_nav.pocket.track import PocketStart
from tests.pocket.leg import MUNICH, walking

RUNS = 60
SURE = 0.999
PARAMETERS = PocketParameters(gyro_bias_sigma_deg_s=0.3, acc_sigma_m_s2=0.5, gravity_window_s=0.0)
BIAS_WALK = np.radians(200.0 / 3600.0) / np.sqrt(50.0)  # Of a poor sensor: 200 deg/h at 50 s.
MODEL = build_model(PARAMETERS)._replace(bias_density=BIAS_WALK**2)
SIGMA0 = np.array([0.02, 0.02, 0.05, *[np.radians(0.3)] * 3])


def errors(leg, rng):
    """Error (6,) and covariance at the end of one run with drawn noises."""
    R, h, n = leg.attitude, leg.h, len(leg.attitude) - 1
    step = (Rotation.from_matrix(R[:-1]).inv() * Rotation.from_matrix(R[1:])).as_matrix()
    bias = SIGMA0[3:] * rng.standard_normal(3) + np.cumsum(BIAS_WALK * np.sqrt(h) * rng.standard_normal((n, 3)), axis=0)
    rate = Rotation.from_matrix(step).as_rotvec() / h + bias
    rate += np.sqrt(MODEL.gyr_density / h) * rng.standard_normal((n, 3))
    force = 9.80665 * R[:-1, 2] + PARAMETERS.acc_sigma_m_s2 * rng.standard_normal((n, 3))
    noise = PARAMETERS.mag_sigma_uT * rng.standard_normal((n, 3))
    steps = np.cumsum(np.sqrt(2) * np.einsum("nij,nj->ni", R[:-1], noise), axis=0)
    field = np.einsum("nji,nj->ni", R[:-1], MUNICH + steps)
    always = np.ones(n, dtype=np.bool_)
    wrong = Rotation.from_rotvec(SIGMA0[:3] * rng.standard_normal(3)).as_matrix() @ R[0]
    state = initialize_state(PocketStart(wrong, SIGMA0[0], SIGMA0[2]), PARAMETERS)
    inputs = FilterInputs(np.full(n, h), rate, force, field, always, always, always)
    run_filter(inputs, state, create_reference(), MODEL, allocate_track(h * np.arange(n), n))
    attitude = Rotation.from_matrix(state.nav_R_body @ R[n - 1].T).as_rotvec()
    return np.concatenate([attitude, state.gyro_bias - bias[n - 1]]), state.P


def test_errors_are_what_the_filter_claims():
    leg, rng = walking(15.0, rate_hz=50.0), np.random.default_rng(7)
    runs = [errors(leg, rng) for _ in range(RUNS)]
    for part in (slice(0, 6), slice(0, 3), slice(3, 6)):  # all, attitude, bias
        nees = np.mean([x[part] @ np.linalg.solve(P[part, part], x[part]) for x, P in runs])
        low, high = chi2.ppf([(1 - SURE) / 2, (1 + SURE) / 2], RUNS * (part.stop - part.start)) / RUNS
        assert low < nees < high
