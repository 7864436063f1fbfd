"""What walks are held by: stances, rests, floors, fixes, places, the other foot, a building, and walks unseen.

Derivatives of all of them are in `test_residual`.
"""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import A, B, S, V, X, Z
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from fg_nav.factors import BuildingDirection, StanceVelocity, factor_of, heading_factor, zero_rate_factor
from fg_nav.factors.same_place import BesideEachOther, SamePlace, WithinReach, weigh_place
from fg_nav.factors.walk_constraints import (
    QUARTER,
    FloorHeight,
    UnseenWalk,
    direction_loss,
    direction_probability,
    odds_of_elsewhere,
)
from fg_nav.factors.zero_velocity import REST_TAIL_SIGMAS
from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.lab.simulation.motion import Ramps
from tests.factors.variables import pose, residual, values_of, vectors
from tests.simulated import turning_foot

angles = st.floats(-3.0, 3.0)
UNIT = gtsam.noiseModel.Unit.Create(3)


def standing(rotvec, position=(0.0, 0.0, 0.0)) -> gtsam.Pose3:
    return pose(Rotation.from_rotvec(rotvec).as_matrix(), position)


# --- the velocity of a stance: its zero by the physics of a rolling body


def stance(body_velocity, settling, sigma=np.ones(3), sinks_per_m=0.0):
    velocity = StanceVelocity(body_velocity, settling, sigma, np.array(sinks_per_m))
    return factor_of(velocity, [X(0), V(0), S(0)])


def test_a_softer_sole_sinks_faster():
    """One that settles 3 mm more in 0.3 s sinks by 10 mm/s more, in any attitude."""
    u, settling, rotvec = np.random.default_rng(4).standard_normal((3, 3))
    velocity = Rotation.from_rotvec(rotvec).apply(u) + settling - np.array([0.0, 0.0, 0.010])
    values = values_of({X(0): standing(rotvec), V(0): velocity, S(0): np.array([0.003])})
    np.testing.assert_allclose(residual(stance(u, settling, sinks_per_m=1 / 0.3), values), 0.0, atol=1e-12)


def rolling_foot(lever, sinking=0.0):
    """A foot that turns about a pivot, which sinks by so many metres meanwhile."""
    begin, width = np.array([0.0]), np.array([0.4])
    turns = [Ramps(begin, width, np.array([rise])) for rise in (0.1, 0.5, -0.2)]
    return turning_foot(lever, turns, up=Ramps(begin, width, np.array([-sinking])))


LEVER = np.array([-0.03, 0.02, 0.11])


@pytest.mark.parametrize("sinking", [0.0, 0.003])
def test_a_body_that_rolls_about_a_settling_pivot_has_no_residual(sinking):
    t = np.linspace(0.02, 0.38, 7)
    now = rolling_foot(LEVER, sinking).at(t)
    settling = rolling_foot(np.zeros(3), sinking).at(t).velocity  # of the pivot
    assert np.linalg.norm(now.velocity, axis=1).max() > 0.1
    for k in range(len(t)):
        at = {X(0): pose(now.nav_R_body[k], now.position[k]), V(0): now.velocity[k], S(0): np.zeros(1)}
        found = residual(stance(np.cross(now.rate[k], LEVER), settling[k]), values_of(at))
        np.testing.assert_allclose(found, 0.0, atol=1e-12)


@given(rotvec=vectors, position=vectors, velocity=vectors)
@settings(max_examples=10, deadline=None)
def test_without_a_lever_it_is_the_plain_zero_velocity_update(rotvec, position, velocity):
    values = values_of({X(0): standing(rotvec, position), V(0): velocity, S(0): np.zeros(1)})
    plain = gtsam.PriorFactorVector(V(0), np.zeros(3), gtsam.noiseModel.Isotropic.Sigma(3, 0.01))
    found = stance(np.zeros(3), np.zeros(3), np.full(3, 0.01)).error(values)
    assert found == pytest.approx(plain.error(values), rel=1e-12)


# --- headings


@given(rotvec=vectors, axis=vectors)
@settings(max_examples=20, deadline=None)
def test_a_heading_is_that_of_the_frames_whatever_the_axis(rotvec, axis):
    """The x axis by `compute_heading`; another one as if it were the x axis of another body."""
    assume(np.linalg.norm(axis) > 0.1)
    R = Rotation.from_rotvec(rotvec)
    turned = R * Rotation.align_vectors([axis / np.linalg.norm(axis)], [[1.0, 0.0, 0.0]])[0]
    assume(np.hypot(*turned.as_matrix()[:2, 0]) > 0.05)
    values = values_of({X(0): standing(rotvec)})
    for by, heading in (((1.0, 0.0, 0.0), R.as_matrix()), (axis, turned.as_matrix())):
        off = compute_heading(heading) - 0.4
        found = residual(heading_factor(X(0), 0.4, 0.1, by), values)
        np.testing.assert_allclose(found, np.arctan2(np.sin(off), np.cos(off)) / 0.1, atol=1e-8)


def test_optimizers_of_gtsam_turn_a_pose_to_its_heading_by_the_weights():
    """A level pose and a prior, on both sides of south: the mean by the information; iSAM2 has the same."""
    prior = gtsam.Pose3(gtsam.Rot3.Rz(np.pi / 2 - np.radians(178.0)), [1.0, 2.0, 3.0])
    noise = gtsam.noiseModel.Diagonal.Sigmas([1e-3, 1e-3, np.radians(2.0), 1.0, 1.0, 1.0])
    graph, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.addPriorPose3(X(0), prior, noise)
    graph.push_back(heading_factor(X(0), np.radians(-176.0), np.radians(1.0)))
    start.insert(X(0), prior)
    isam = gtsam.ISAM2()
    isam.update(graph, start)
    expected = 178.0 + 6.0 * 4.0 / (4.0 + 1.0)  # of 178 deg at 2, and 184 at 1
    for found in (gtsam.LevenbergMarquardtOptimizer(graph, start).optimize(), isam.calculateBestEstimate()):
        pose = found.atPose3(X(0))
        assert np.degrees(compute_heading(pose.rotation().matrix())) % 360.0 == pytest.approx(expected, abs=1e-4)
        np.testing.assert_allclose(pose.translation(), [1.0, 2.0, 3.0], atol=1e-9)
        sigma = gtsam.Marginals(graph, found).marginalCovariance(X(0))[2, 2] ** 0.5
        assert np.degrees(sigma) == pytest.approx((1.0 + 0.25) ** -0.5, rel=1e-6)
    with pytest.raises(ValueError, match="a sigma above zero"):
        heading_factor(X(0), 0.0, 0.0)


# --- rests


def bias_values(acc, gyro):
    return values_of({B(0): gtsam.imuBias.ConstantBias(acc, gyro)})


@given(acc=vectors, gyro=vectors, rate=vectors, log_sigma=vectors)
@settings(max_examples=20, deadline=None)
def test_a_rest_is_a_prior_on_the_gyroscope_alone_with_cauchys_loss(acc, gyro, rate, log_sigma):
    axes = Rotation.from_rotvec(acc).as_matrix()
    covariance, inverse = (axes @ np.diag(100.0 ** (sign * log_sigma)) @ axes.T for sign in (1, -1))
    factor = zero_rate_factor(B(0), rate, covariance)
    chi_square = (gyro - rate) @ inverse @ (gyro - rate)
    loss = REST_TAIL_SIGMAS**2 * np.log1p(chi_square / REST_TAIL_SIGMAS**2)
    assert 2.0 * factor.error(bias_values(acc, gyro)) == pytest.approx(loss, rel=1e-6, abs=1e-9)
    expected = block_diag(np.zeros((3, 3)), inverse / (1.0 + chi_square / REST_TAIL_SIGMAS**2))
    found = factor.linearize(bias_values(acc, gyro)).information()
    np.testing.assert_allclose(found, expected, atol=1e-6 * expected.max())


# --- floors


@given(rotvec=vectors, position=vectors, floor=st.floats(-50, 50), across=vectors, up=st.floats(-50, 50))
@settings(max_examples=20, deadline=None)
def test_only_the_height_above_the_floor_counts(rotvec, position, floor, across, up):
    factor = factor_of(FloorHeight(1.0), [X(0), Z(0)])
    here = residual(factor, values_of({X(0): standing(rotvec, position), Z(0): np.array([floor])}))
    elsewhere = position + np.array([across[0], across[1], up])
    moved = values_of({X(0): standing(-rotvec, elsewhere), Z(0): np.array([floor + up])})
    assert here == pytest.approx([position[2] - floor])
    assert residual(factor, moved) == pytest.approx(here, abs=1e-9)


# --- one place, two feet


def same_place(later, earlier, heading):
    (weight,) = weigh_place(np.array([heading]), 0.3, 0.6, 0.2)
    return factor_of(SamePlace(later, earlier, weight), [X(1), X(0)])


@given(rotvec=vectors, other=vectors, position=vectors, later=vectors, earlier=vectors, turn=angles)
@settings(max_examples=20, deadline=None)
def test_a_walk_that_is_turned_about_up_closes_as_well(rotvec, other, position, later, earlier, turn):
    one, two, about_up = standing(rotvec, position), standing(other, -position), standing([0.0, 0.0, turn])
    here = residual(same_place(later, earlier, 0.3), values_of({X(1): one, X(0): two}))
    both = values_of({X(1): about_up * one, X(0): about_up * two})
    np.testing.assert_allclose(residual(same_place(later, earlier, 0.3 + turn), both), here, atol=1e-9)


def test_a_tie_is_metres_over_the_sigmas_along_across_and_up_and_nothing_at_one_place():
    """A walk north: east is to its right, and north ahead. A metre ahead of the one footfall is behind the other."""
    seen, ahead = same_place(np.zeros(3), np.zeros(3), np.pi / 2), np.array([1.0, 0.0, 0.0])
    off = values_of({X(1): standing(np.zeros(3), [0.6, 0.3, 0.2]), X(0): standing(np.zeros(3))})
    assert residual(seen, off) == pytest.approx([1.0, -1.0, 1.0])
    opposite = values_of({X(1): standing(np.zeros(3)), X(0): standing([0.0, 0.0, np.pi], [2.0, 0.0, 0.0])})
    assert residual(same_place(ahead, ahead, 0.0), opposite) == pytest.approx(np.zeros(3), abs=1e-12)


def test_feet_that_walk_beside_each_other_leave_no_residual_wherever_they_walk():
    """A person is turned about up and moved: the width stays. Swapped feet are beside each other by the opposite."""
    width, forward, left_of = 0.17, 0.4, np.array([0.0, 1.0, 0.0])
    left, right = np.eye(4), np.eye(4)
    right[:3, 3] = [forward, -width, 0.0]  # walking east, the right foot is to the south
    at_foot, ahead = np.zeros(3), np.array([forward, 0.0, 0.0])
    for angle in (0.0, 1.0, -2.5):
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = yaw_rotation(angle), [5.0, -3.0, 1.0]
        for first, second, points, apart in (
            (right, left, (at_foot, ahead), width),
            (left, right, (ahead, at_foot), -width),
        ):
            factor = BesideEachOther(*points, left_of, np.eye(3))
            e = factor.evaluate([frame @ first, frame @ second, np.array([apart])], False)[0]
            np.testing.assert_allclose(e, 0.0, atol=1e-12)


@pytest.mark.parametrize(("apart", "sigmas"), [(0.3, 0.0), (1.5, 3.0)])
def test_standing_feet_are_pulled_together_from_beyond_reach_alone(apart, sigmas):
    one, other = np.eye(4), np.eye(4)
    other[:3, 3] = apart * np.array([0.6, 0.0, 0.8])
    assert WithinReach(np.array(1.2), np.array(0.1)).evaluate([one, other], False)[0] == pytest.approx(sigmas)


# --- a walk that was not seen


@given(tilts=vectors, yaw=angles, move=vectors, turn=angles)
@example(tilts=np.ones(3), yaw=3.0, move=np.ones(3), turn=-3.0)
@settings(max_examples=30, deadline=None)
def test_an_unseen_walk_counts_how_far_a_person_came_and_turned_and_how_the_foot_was_put_down(tilts, yaw, move, turn):
    """From an attitude to one turned about up, of the same tilt; the displacement is that in the world."""
    walk = UnseenWalk(np.array([2.0, 2.0, 0.5]), np.array(turn), np.array(0.7), np.array(0.3))
    first, factor = Rotation.from_rotvec(tilts), factor_of(walk, [X(0), X(1)])

    def error(second, move):
        at = {X(0): pose(first.as_matrix(), np.ones(3)), X(1): pose(second.as_matrix(), np.ones(3) + move)}
        return residual(factor, values_of(at))

    e = error(Rotation.from_rotvec([0.0, 0.0, yaw]) * first, move)
    assert e[:3] == pytest.approx(move / [2.0, 2.0, 0.5], abs=1e-9)
    off = (yaw - turn + np.pi) % (2 * np.pi) - np.pi
    assert abs(e[3]) == pytest.approx(abs(off) / 0.7, abs=1e-9)
    if 1e-6 < abs(off) < 3.0:
        assert np.sign(e[3]) == np.sign(off)
    assert e[4:] == pytest.approx(np.zeros(3), abs=1e-9)
    tipped = error(first * Rotation.from_rotvec([0.03, 0.0, 0.0]), np.zeros(3))
    of_tilt = np.linalg.norm(np.cross(first.as_matrix()[2], [1, 0, 0]))
    assert np.linalg.norm(tipped[4:]) == pytest.approx(0.03 * of_tilt / 0.3, rel=0.02)


# --- directions of a building: the mixture's loss and weight, and that it is silent elsewhere


SIGMA = np.radians(2.0)


@given(course=angles, off=st.floats(-0.7, 0.7), quarter=st.integers(-4, 4), start=vectors, climb=st.floats(-0.5, 0.5))
@settings(max_examples=50, deadline=None)
def test_the_loss_is_of_what_a_course_is_off_the_nearest_direction(course, off, quarter, start, climb):
    """Of a displacement of 7 m between two attitudes that are anything."""
    factor = factor_of(BuildingDirection(SIGMA, 0.1, np.array(0.6)), [X(0), X(1), A(0)])
    place = [start, start + 7.0 * np.array([np.cos(course), np.sin(course), climb])]
    ends = {X(k): pose(R, place[k]) for k, R in enumerate(Rotation.random(2, rng=np.random.default_rng(0)).as_matrix())}
    values = values_of({**ends, A(0): np.array([course - off + quarter * QUARTER])})
    assert factor.error(values) == pytest.approx(0.6 * direction_loss(off / SIGMA, 0.1), abs=1e-9)


@given(off=st.floats(-np.pi / 4, np.pi / 4), sigma_deg=st.floats(0.5, 10), share=st.floats(0.05, 0.95))
@settings(max_examples=50, deadline=None)
def test_the_weight_is_the_posterior_and_the_slope_of_the_loss_which_is_the_likelihood(off, sigma_deg, share):
    sigma, h = np.radians(sigma_deg), 1e-5
    c, x = odds_of_elsewhere(sigma, share), off / sigma
    followed, elsewhere = share * norm.pdf(off, scale=sigma), (1 - share) * 2 / np.pi
    at_zero = share * norm.pdf(0.0, scale=sigma) + elsewhere
    assert direction_probability(x, c) == pytest.approx(followed / (followed + elsewhere), abs=1e-12)
    assert direction_loss(x, c) == pytest.approx(np.log(at_zero / (followed + elsewhere)), abs=1e-9)
    slope = (direction_loss(x + h, c) - direction_loss(x - h, c)) / (2 * h)
    assert slope == pytest.approx(direction_probability(x, c) * x, abs=1e-6)
