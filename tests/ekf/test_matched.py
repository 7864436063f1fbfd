"""The fair opponent: the same beliefs as the factor graph, and a lever that the filter uses as it should."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.ekf.core import ACC_BIAS_SIGMA, ACC_BIAS_WALK, make_noise_models
from fg_nav.ekf.measurements import update_in_stance
from fg_nav.ekf.presets import FACTOR_SPACING_S, FORCE_SHARE, MATCHED
from fg_nav.mechanisation import NavState
from fg_nav.smoother import strides
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.strides import VELOCITY_SIGMA, place_nodes
from tests.ekf.motion import Walk

THERE = SmootherParameters()


def test_it_assumes_what_the_graph_assumes():
    same = (
        "acc_density",
        "gyr_relative_density",
        "saturated_share",
        "roll_sigma_m",
        "unsteady_s",
        "gyro_bias_sigma_deg_s",
        "gyro_bias_walk_deg_s",
        "tilt_sigma_deg",
        "gravity",
        "rest",
    )
    assert {name: getattr(MATCHED, name) for name in same} == {name: getattr(THERE, name) for name in same}
    assert MATCHED.gyr_density_deg == THERE.gyr_density_deg_s
    assert MATCHED.acc_relative_density == FORCE_SHARE * THERE.acc_relative_density
    assert MATCHED.tilt_sigma_rest_deg == THERE.tilt_sigma_deg
    assert (strides.ACC_BIAS_SIGMA, strides.ACC_BIAS_WALK) == (ACC_BIAS_SIGMA, ACC_BIAS_WALK)


def test_a_stance_carries_the_information_of_the_factors_of_the_graph():
    """Of a stance as long as those of the simulated walks: sum of 1 / sigma^2 over factors, and over samples."""
    recording, stances = Walk(strides=10, stance_s=0.24).recording(200.0)
    ties = place_nodes(recording, stances, THERE)
    walking = ties.interval > 0
    information = np.count_nonzero(walking) / VELOCITY_SIGMA**2
    _, noise = make_noise_models(MATCHED)
    samples = np.count_nonzero(stances.mask[stances.start[1] :])
    assert samples * recording.period_s / noise.floor == pytest.approx(information, rel=0.1)
    assert noise.rolling / noise.floor == pytest.approx((THERE.roll_sigma_m / VELOCITY_SIGMA) ** 2)
    assert noise.unsteady / noise.floor == pytest.approx((THERE.unsteady_s / VELOCITY_SIGMA) ** 2)
    assert FACTOR_SPACING_S == 0.08


def test_the_lever_gives_the_velocity_that_the_foot_has():
    """v = R (w x l) of a foot that is turned every way: no innovation is left, and with the sign turned much is."""
    rng = np.random.default_rng(3)
    R = Walk().attitude(np.array([2.3]))[0]
    w, lever = rng.standard_normal(3), np.array([0.02, -0.04, 0.09])
    state = NavState(np.zeros(3), R @ np.cross(w, lever), R, np.zeros(3), np.zeros(3))
    acc = np.array([0.0, 0.0, 9.80665])

    def nis(sign):
        _, noise = make_noise_models(replace(MATCHED, rolling_lever_m=tuple((sign * lever).tolist()), roll_sigma_m=0.0))
        P = 1e-8 * np.eye(15)
        return update_in_stance(state, P, np.zeros(15), acc, w, 0.005, noise, np.empty((3, 17)))

    assert nis(1) == pytest.approx(0.0, abs=1e-20)
    assert nis(-1) > 10.0


def test_a_foot_that_is_pushed_has_a_larger_sigma():
    state = NavState(np.zeros(3), np.array([0.02, 0.0, 0.0]), np.eye(3), np.zeros(3), np.zeros(3))
    _, noise = make_noise_models(replace(MATCHED, rolling_lever_m=(0.0, 0.0, 0.0)))

    def nis(force):
        P = 1e-8 * np.eye(15)
        return update_in_stance(
            state, P, np.zeros(15), np.array([0, 0, force]), np.zeros(3), 0.005, noise, np.empty((3, 17))
        )

    assert nis(9.80665 + 1.0) == pytest.approx(nis(9.80665) * noise.floor / (noise.floor + noise.unsteady), rel=0.02)
    assert nis(9.80665 - 1.0) == pytest.approx(nis(9.80665 + 1.0))
