"""Two feet in one graph: a simulated person with a sensor on each."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from scipy.linalg import cho_factor, cho_solve

from fg_nav.detection import detect_stances
from fg_nav.errors import EstimationError
from fg_nav.feet import SIDES
from fg_nav.feet.steps import average_cells
from fg_nav.frames import compute_heading, wrap_angle
from fg_nav.lab.consistency import compute_stance_nees
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother import feet as feet_module
from fg_nav.smoother.batch import WalkInput, fit_walk
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.sensitivity import FootfallCovariance
from fg_nav.smoother.solver import find_minimum
from fg_nav.smoother.square_root import DIMENSION
from tests.feet.walks import both, demo_feet, feet, truth_of


@cache
def solved() -> feet_module.SolvedFeet:
    return feet_module.solve_feet(*begin())


def begin() -> list[WalkProblem]:
    """Each foot by itself, the right one first."""
    walks = (fit_walk(feet()[side]) for side in ("right", "left"))
    return [replace(walk.problem, values=walk.solved.values) for walk in walks]


def test_both_feet_are_found_in_one_frame_though_the_right_ones_start_is_not_known() -> None:
    """In the frame of the left foot both are where they are, within the sigmas of the person."""
    origin = truth_of("left").position[0]
    for side in SIDES:
        table, truth = getattr(both(), side).stances, truth_of(side)
        error = table.position - (truth.position[table.sample] - origin)
        assert np.sqrt(np.mean(error[:, :2] ** 2)) < 0.15
        turned = wrap_angle(compute_heading(table.nav_R_body) - compute_heading(truth.nav_R_body[table.sample]))
        assert np.abs(turned).max() < np.radians(3.0)


def test_the_width_is_that_of_the_person_and_negative_where_the_feet_are_swapped() -> None:
    """The sensors sit up to some centimeters aside of the soles' middles."""
    right, swapped = both(), feet_module.smooth_feet(feet()["left"], feet()["right"])
    assert right.width_m == pytest.approx(demo_feet().step_width_m, abs=0.05)
    assert right.width_sigma_m < 0.05
    assert right.beyond_reach == 0
    assert swapped.width_m < -3.0 * swapped.width_sigma_m
    # The prior of the width is that of feet that are not swapped.
    assert swapped.width_m == pytest.approx(-right.width_m, abs=2.0 * right.width_sigma_m)


def test_a_foot_claims_less_beside_the_other_and_its_claim_is_true() -> None:
    foot, left = feet()["left"], both().left
    alone = smooth(foot.recording, foot.stances, heading=foot.heading)
    ends = [one.stances.position_sigma[-1, :2] for one in (alone, left)]
    assert (ends[1] < ends[0]).all()
    assert (ends[1] > 0.6 * ends[0]).all()  # two sensors, not more
    middle = len(alone.stances) // 2
    share = left.stances.heading_sigma[middle] / alone.stances.heading_sigma[middle]
    assert 0.65 < share < 0.95  # one over the root of two where the steps show the direction exactly
    assert 0.0 < compute_stance_nees(left.stances, truth_of("left")).mean_ratio < 3.0


def test_the_person_is_in_the_middle_and_as_uncertain_as_the_feet() -> None:
    person = both().person
    error = person.position - (demo_feet().person_at(person.t).position - truth_of("left").position[0])
    assert np.sqrt(np.mean(error[:, :2] ** 2)) < 0.15
    moves = np.linalg.norm(person.velocity[:, :2], axis=1) > 0.5
    direction = np.arctan2(person.velocity[:, 0], person.velocity[:, 1])
    assert np.median(np.abs(wrap_angle(compute_heading(person.nav_R_body) - direction))[moves]) < np.radians(15.0)
    # By half of what the feet differ, some centimeters, more uncertain than the left foot.
    sigma = np.sqrt(np.diagonal(person.stances.pose_cov, axis1=1, axis2=2))
    of_left = both().left.stances.position_sigma
    np.testing.assert_array_equal(person.stances.t, both().left.stances.t)
    assert (sigma[:, :3] >= of_left).all()
    # Who stands at the start has the feet near each other, and it is not known how.
    np.testing.assert_allclose(sigma[1:, :2], np.hypot(of_left[1:, :2], 0.03), atol=0.02)
    assert sigma[0, :2].max() < 0.1


def test_where_one_foot_was_not_recorded_the_person_goes_as_the_other_one() -> None:
    whole = both().person
    for side in SIDES:
        foot = feet()[side]
        cut = foot.recording.slice(0, len(foot.recording) * 2 // 3)
        given = {**feet(), side: WalkInput(cut, detect_stances(cut), foot.heading)}
        person = feet_module.smooth_feet(given["right"], given["left"]).person
        assert person.t[-1] == pytest.approx(whole.t[-1], abs=0.1)
        apart = np.stack([np.interp(whole.t, person.t, column) for column in person.position.T], axis=1)
        assert np.abs(apart - whole.position).max() < 0.8  # half a stride, and what one foot drifts
        assert (np.diff(person.t) > 0).all()
        assert person.stances.t[-1] > whole.t[-1] - 8.0


def find_dense_covariance(system, values, keys):
    """Joint covariances of some variables, in the order of elimination `keys`, by the whole information matrix."""
    size, order = np.array([DIMENSION[int(key) >> 56] for key in keys]), np.argsort(keys)
    begin = np.cumsum(size) - size
    information = np.zeros((size.sum(), size.sum()))
    for stack in system.stack(values):
        for row, at in zip(stack.rows, order[np.searchsorted(keys[order], stack.keys)], strict=True):
            columns = np.concatenate([np.arange(begin[k], begin[k] + size[k]) for k in at])
            information[np.ix_(columns, columns)] += row[:, :-1].T @ row[:, :-1]
    scale = np.sqrt(np.diag(information))
    factor = cho_factor(information / np.outer(scale, scale))

    def find(of) -> np.ndarray:
        which = [int(np.flatnonzero(keys == key)[0]) for key in of]
        at = np.concatenate([np.arange(begin[k], begin[k] + size[k]) for k in which])
        unit = np.zeros((len(scale), len(at)))
        unit[at, range(len(at))] = 1.0
        return cho_solve(factor, unit)[at] / np.outer(scale[at], scale[at])

    return find


def assert_like(found, dense) -> None:
    np.testing.assert_allclose(found, dense, rtol=1e-3, atol=1e-3 * np.abs(dense).max())


def test_where_no_steps_tie_the_feet_pairs_of_footfalls_hold_what_they_differ_by(monkeypatch) -> None:
    """They say nothing, and the tables and the differences of all pairs are those of the dense information."""
    monkeypatch.setattr("fg_nav.smoother.feet.WATCHED_S", 1.5)
    watched = feet_module.solve_feet(*begin())
    ties = watched.problem.ties
    assert len(ties) > ties.cells + 3
    assert ties.cells == solved().problem.ties.cells
    assert watched.minimum.error == pytest.approx(solved().minimum.error, rel=1e-9)
    keys = feet_module.order_variables(watched.problem)
    dense = find_dense_covariance(watched.problem.system, watched.minimum.linearized_at, keys)
    shared = np.zeros((watched.minimum.root.total, 0))
    tables, apart = feet_module._take_covariances(watched, shared)
    by_itself = feet_module._subtract_left(
        watched, watched.minimum.root.joint_covariances(feet_module._pair_keys(ties.pairs.right, ties.pairs.left))
    )
    np.testing.assert_allclose(apart, by_itself, rtol=1e-9, atol=1e-15)
    for k in (0, ties.cells - 1, ties.cells, len(ties) - 1):
        joint = dense(feet_module._pair_keys(ties.pairs.right, ties.pairs.left)[k])
        assert_like(tables[0][ties.right[k]], joint[:6, :6])
        assert_like(tables[1][ties.left[k]], joint[6:, 6:])
        assert_like(apart[k], feet_module._subtract_left(watched, np.tile(joint, (len(ties), 1, 1)))[k])
    free = np.setdiff1d(np.arange(len(tables[0]) - 1), ties.right)[5]
    key = np.uint64(X(int(watched.problem.right.nodes.result[free]))) + feet_module.RIGHT
    assert_like(tables[0][free], dense(np.array([key])))


def test_moves_of_each_foot_have_the_covariance_of_their_ends() -> None:
    """Where footfalls are tied to the other foot's, and so eliminated last, beside others, or with no node between."""
    both_feet = solved()
    shared = 1e-3 * np.random.default_rng(2).standard_normal((both_feet.minimum.root.total, 2))
    for one, problem in ((both_feet.right, both_feet.problem.right), (both_feet.left, both_feet.problem.left)):
        joint = FootfallCovariance.of(one, problem.nodes, shared)
        moves = joint.measure_moves(problem.nodes)
        for k in range(1, len(moves)):
            ends = np.zeros((len(moves), 4, 4))
            ends[k - 1], ends[k] = -np.eye(4), np.eye(4)
            expected = joint.combine(ends)[0]
            np.testing.assert_allclose(moves[k], expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())


def test_between_ties_that_are_far_apart_a_pair_is_watched_every_15_s(monkeypatch) -> None:
    problem = solved().problem
    monkeypatch.setattr(feet_module, "average_cells", lambda *feet: average_cells(*feet).take(np.array([0])))
    ties = feet_module.tie_feet(problem.right, problem.left, solved().minimum.values)
    t = [one.recording.t[one.nodes.sample[one.nodes.result]] for one in (problem.right, problem.left)]
    at = np.stack([t[0][ties.right], t[1][ties.left]], axis=1) - max(one[0] for one in t)
    # A standing and a cell at the start tie the feet; later moments are half a minute and more behind them.
    assert at[: ties.cells + 1].max() < 10.0
    np.testing.assert_allclose(at[ties.cells + 1 :].mean(axis=1), [30.0, 45.0], atol=2.0)
    assert np.abs(np.diff(at, axis=1)).max() < 1.5


def test_standing_feet_beyond_reach_are_found_and_pulled_together() -> None:
    """Feet that stand at one time cannot be two meters apart; where they are near nothing is asked."""
    problem, values = solved().problem, solved().minimum.values
    standing = feet_module.pair_standing_feet(problem.right, problem.left)
    assert (standing.evaluate(values, False)[0] == 0.0).all()
    away = replace(values, right=type(values.right)(values.right))
    for j in range(len(problem.right.nodes)):
        key = X(j)
        pose = away.right.atPose3(key)
        away.right.update(key, type(pose)(pose.rotation(), pose.translation() + np.array([2.0, 0.0, 0.0])))
    beyond = standing.take(standing.evaluate(away, False)[0][:, 0] > 0.0)
    assert len(beyond) > 20
    assert (standing.residuals.reach >= feet_module.REACH_M).all()
    assert beyond.error(away) > 10.0 * len(beyond)
    assert beyond.error(values) == 0.0
    # Asked for, they come back.
    again = replace(problem, values=away, reach=beyond)
    found = find_minimum(again.system, away, feet_module.order_variables(again)).values
    assert beyond.error(found) < 0.01


def test_two_walks_of_two_people_are_refused() -> None:
    """Their feet do not alternate, and nothing ties them."""
    right = feet()["right"]
    late = replace(right.recording, t=right.recording.t + 500.0, truth=None)
    with pytest.raises(EstimationError, match="hardly take steps in turn"):
        feet_module.smooth_feet(replace(right, recording=late), feet()["left"])


def test_each_foot_begins_with_the_bias_of_its_own_sensor() -> None:
    bias, right, usual = (0.4, -0.3, 0.6), feet()["right"], both()
    off = replace(right.recording, gyr=right.recording.gyr + np.radians(bias))
    known = replace(right, recording=off, parameters=SmootherParameters(gyro_bias_deg_s=bias))
    found = feet_module.smooth_feet(known, feet()["left"])
    np.testing.assert_allclose(found.person.position, usual.person.position, atol=5e-3)
    moved = np.degrees(found.right.stances.gyro_bias - usual.right.stances.gyro_bias)
    np.testing.assert_allclose(moved, np.tile(bias, (len(moved), 1)), atol=5e-3)
    np.testing.assert_allclose(found.left.stances.gyro_bias, usual.left.stances.gyro_bias, atol=np.radians(1e-3))
