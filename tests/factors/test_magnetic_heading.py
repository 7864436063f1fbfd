"""The heading factor: which way is north, what it says of tilt (nothing), and how surely."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from hypothesis import given, settings
from hypothesis import strategies as st

from fg_nav.factors.magnetic_heading import (
    heading_sigma,
    magnetic_heading_factor,
    magnetic_heading_jacobian,
    magnetic_heading_residual,
)
from fg_nav.frames import heading_of, wrap, yaw_rotation
from tests.factors.attitudes import attitude, pose, values_of, vectors
from tests.factors.derivatives import assert_jacobians_are_derivatives, jacobians, residual

UNIT = gtsam.noiseModel.Unit.Create(1)
MUNICH = np.array([0.0, 21.0, -43.0])
"""uT, east, north, up, at no declination."""
angles = st.floats(-3.1, 3.1)
nav_R_frd = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""A level sensor with axes forward, right, down that faces north."""


def declined(declination):
    """The field of Munich with its horizontal part so far east of north."""
    return yaw_rotation(-declination) @ MUNICH


@given(rotvec=vectors, declination=angles)
@settings(max_examples=40, deadline=None)
def test_the_true_attitude_has_no_residual_however_tilted(rotvec, declination):
    nav_R_body = attitude(rotvec)
    e = magnetic_heading_residual(nav_R_body, nav_R_body.T @ declined(declination), declination)
    assert wrap(e) == pytest.approx(0.0, abs=1e-12)


@given(rotvec=vectors, clockwise=angles, declination=angles)
@settings(max_examples=40, deadline=None)
def test_the_residual_is_how_far_clockwise_the_attitude_is_off(rotvec, clockwise, declination):
    truth = attitude(rotvec)
    off = yaw_rotation(-clockwise) @ truth
    assert wrap(heading_of(off) - heading_of(truth) - clockwise) == pytest.approx(0.0, abs=1e-9)
    e = magnetic_heading_residual(off, truth.T @ declined(declination), declination)
    assert wrap(e - clockwise) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("heading_deg", [-130.0, -40.0, 0.0, 25.0, 90.0, 170.0])
def test_a_printed_sign_doubles_the_heading_and_ours_cancels_it(heading_deg):
    heading = np.radians(heading_deg)
    nav_R_body = yaw_rotation(-heading) @ nav_R_frd
    x, y, _ = nav_R_body.T @ MUNICH
    assert np.arctan2(-y, x) == pytest.approx(heading)  # forward-right-down, levelled
    as_printed = np.arctan2(y, x)  # Ma 2018 Eq. 1, Zhang Eq. 25
    assert wrap(heading - as_printed) == pytest.approx(wrap(2 * heading), abs=1e-12)
    assert magnetic_heading_residual(nav_R_body, nav_R_body.T @ MUNICH, 0.0) == pytest.approx(0.0, abs=1e-12)


@given(rotvec=vectors, position=vectors, level=st.booleans())
@settings(max_examples=30, deadline=None)
def test_the_jacobian_is_the_derivative_by_turns_about_up(rotvec, position, level):
    nav_R_body = attitude(rotvec)
    body_field = nav_R_body.T @ yaw_rotation(0.4) @ MUNICH
    factor = magnetic_heading_factor(X(0), body_field, 0.1, UNIT, nav_R_body if level else None)
    h = 1e-5
    there, back = (
        residual(factor, values_of({X(0): pose(yaw_rotation(s * h) @ nav_R_body, position)})) for s in (1, -1)
    )
    row = jacobians(factor, values_of({X(0): pose(nav_R_body, position)}))[X(0)]
    up = nav_R_body.T @ [0.0, 0.0, 1.0]  # a turn about nav's up, in the body's tangent space
    assert row[:, :3] @ up == pytest.approx((there - back) / (2 * h), abs=1e-9)
    assert (there - back) / (2 * h) == pytest.approx(-1.0, abs=1e-8)
    np.testing.assert_array_equal(row[:, 3:], 0.0)


@given(rotvec=vectors)
@settings(max_examples=30, deadline=None)
def test_it_informs_of_the_rotation_about_up_and_of_nothing_else(rotvec):
    nav_R_body = attitude(rotvec)
    row = magnetic_heading_jacobian(nav_R_body)[None]
    about_nav_axes = nav_R_body @ (row.T @ row) @ nav_R_body.T
    np.testing.assert_allclose(about_nav_axes, np.diag([0.0, 0.0, 1.0]), atol=1e-12)


@given(rotvec=vectors)
@settings(max_examples=30, deadline=None)
def test_levelled_beforehand_the_jacobian_is_the_derivative_by_every_turn(rotvec):
    nav_R_body = attitude(rotvec)
    body_field = nav_R_body.T @ MUNICH
    factor = magnetic_heading_factor(X(0), body_field, 0.0, UNIT, nav_R_body)
    assert_jacobians_are_derivatives(factor, values_of({X(0): pose(nav_R_body)}))


def solved(tilt_sigma, body_field, start, noise=UNIT):
    """Attitude of the graph of one heading factor and a prior that holds the tilt of the start, not its heading."""
    graph, there = gtsam.NonlinearFactorGraph(), pose(start)
    covariance = np.eye(6) * 1e-6
    covariance[:3, :3] = start.T @ np.diag([tilt_sigma, tilt_sigma, 100.0]) ** 2 @ start
    graph.addPriorPose3(X(0), there, gtsam.noiseModel.Gaussian.Covariance(covariance))
    for _ in range(3):
        level = there.rotation().matrix()
        graph_now = gtsam.NonlinearFactorGraph(graph)
        graph_now.push_back(magnetic_heading_factor(X(0), body_field, 0.0, noise, level))
        there = there.retract(graph_now.linearize(values_of({X(0): there})).optimize().at(X(0)))
    return there.rotation().matrix()


@pytest.mark.parametrize("off", [-2.0, -0.3, 0.5, 3.0])
def test_a_solver_turns_the_heading_to_the_truth(off):
    truth = attitude([0.2, -0.3, 1.0])
    found = solved(0.01, truth.T @ MUNICH, yaw_rotation(off) @ truth, gtsam.noiseModel.Isotropic.Sigma(1, 0.05))
    np.testing.assert_allclose(found, truth, atol=1e-5)


def test_a_false_field_does_not_tilt():
    truth = attitude([0.2, -0.3, 1.0])
    lying = truth.T @ (MUNICH + np.array([15.0, -9.0, 30.0]))
    found = solved(0.2, lying, truth, gtsam.noiseModel.Isotropic.Sigma(1, 0.01))
    np.testing.assert_allclose(found[2], truth[2], atol=1e-9)  # up, seen from the body
    assert abs(wrap(heading_of(found) - heading_of(truth))) > 0.5


def test_the_strength_of_the_field_does_not_matter():
    nav_R_body, y = attitude([0.2, -0.3, 1.0]), np.array([10.0, 5.0, -20.0])
    e = magnetic_heading_residual(nav_R_body, y[None] * np.array([[1.0], [3.0]]), 0.0)
    assert e[0] == pytest.approx(e[1], abs=1e-14)


def test_sigma_is_the_scatter_of_the_heading():
    rng = np.random.default_rng(11)
    tilt = rng.normal(0.0, 0.01, (20000, 3)) * [1, 1, 0]
    noisy = np.einsum("tab,b->ta", attitude(tilt), MUNICH) + rng.normal(0.0, 0.6, (20000, 3))
    e = magnetic_heading_residual(np.eye(3), noisy, 0.0)
    assert np.std(e) == pytest.approx(heading_sigma(21.0, 0.6, 43.0, 0.01), rel=0.02)
    assert heading_sigma(0.0, 0.6) == np.inf


def test_many_stances_at_once_are_each_by_itself():
    rng = np.random.default_rng(3)
    nav_R_body, y, D = attitude(rng.normal(size=(5, 3))), rng.normal(size=(5, 3)), rng.normal(size=5)
    together = magnetic_heading_residual(nav_R_body, y, D)
    np.testing.assert_allclose(
        together, [magnetic_heading_residual(*each) for each in zip(nav_R_body, y, D, strict=True)]
    )
    level = attitude(rng.normal(size=(5, 3)))
    together = magnetic_heading_residual(nav_R_body, y, D, level)
    np.testing.assert_allclose(
        together, [magnetic_heading_residual(*one) for one in zip(nav_R_body, y, D, level, strict=True)]
    )
