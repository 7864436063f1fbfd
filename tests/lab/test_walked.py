"""Errors at the footfalls and at landmarks: walks whose errors are known because they were put in."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import align, compare_at_footfalls
from fg_nav.evaluation.metrics import measure_moment
from fg_nav.frames import yaw_rotation
from fg_nav.lab.simulation import Passing
from fg_nav.lab.walked import AS_STARTED, BEST_YAW, measure_landmarks, measure_walk
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from tests.evaluation.walks import solution, winding_path

SIDE = 25
SQUARE = np.array(
    [(k, 0, 0) for k in range(SIDE)]
    + [(SIDE, k, 0) for k in range(SIDE)]
    + [(SIDE - k, SIDE, 0) for k in range(SIDE)]
    + [(0, SIDE - k, 0) for k in range(SIDE + 1)],
    dtype=float,
)
"""Footfalls (101, 3) m round a square, one a metre, back to the start."""

LINE = np.column_stack([np.zeros(201), np.arange(201.0), np.zeros(201)])  # Footfalls north, ending far from the start.


def walked(estimate, truth, attitude=None, true_attitude=None):
    """Solution and truth, one sample a footfall."""
    t = np.arange(float(len(truth)))
    true_attitude = np.broadcast_to(np.eye(3), (len(truth), 3, 3)) if true_attitude is None else true_attitude
    found = solution(t, estimate, nav_R_body=attitude)
    if attitude is not None:
        object.__setattr__(found.stances, "nav_R_body", attitude)
    return found, TrajectoryTruth(t, truth, true_attitude)


def yawing(angle):
    return np.array([yaw_rotation(one) for one in angle])


def drifted(steps_of, rate):
    """Heading drifts counter-clockwise by `rate` rad a stride: each stride is turned by what has come together."""
    steps = np.diff(steps_of, axis=0)
    turned = np.einsum("kij,kj->ki", yawing(rate * np.arange(len(steps))), steps)
    return np.vstack([steps_of[0], steps_of[0] + np.cumsum(turned, axis=0)])


def best_scale(estimate, truth):
    """Scale, turn and shift in the plane by plain least squares: q = a p + b J p + c, scale hypot(a, b)."""
    x, y, one, zero = *estimate[:, :2].T, np.ones(len(truth)), np.zeros(len(truth))
    design = np.vstack([np.column_stack([x, -y, one, zero]), np.column_stack([y, x, zero, one])])
    a, b, *_ = np.linalg.lstsq(design, truth[:, :2].T.ravel(), rcond=None)[0]
    return np.hypot(a, b)


def test_end_error_of_a_closed_walk_is_its_closure_in_any_alignment():
    missed = SQUARE + np.linspace(0.0, 1.0, len(SQUARE))[:, None] * [0.3, -0.4, 1.2]
    for mode in (AS_STARTED, BEST_YAW):
        errors = measure_walk(*walked(missed @ yaw_rotation(0.4).T + 7.0, SQUARE), mode)
        assert errors.distance_m == pytest.approx(100.0)
        assert errors.end_m == pytest.approx(0.5)
        assert errors.end_percent == pytest.approx(0.5)
        assert errors.end_height_m == pytest.approx(1.2)
    off = np.zeros_like(LINE)
    off[1::2] = [3.0, -4.0, 50.0]
    errors = measure_walk(*walked(LINE + off, LINE))
    assert (errors.rmse_m, errors.mean_m) == pytest.approx((5.0 * np.sqrt(100 / 201), 5.0 * 100 / 201))


def test_the_moment_is_measured_in_the_map_of_the_end():
    """Half of the estimates were made when north was off by another angle: theirs is the error, and no fit hides it."""
    turn = 0.1
    final, truth = walked(SQUARE @ yaw_rotation(0.7).T, SQUARE)
    early = np.arange(len(SQUARE)) < 50
    then = np.where(early[:, None], final.position @ yaw_rotation(turn).T, final.position)
    end = compare_at_footfalls(final, truth, BEST_YAW).alignment
    errors = measure_moment(final, replace(final.stances, position=then), truth, end)
    apart = np.where(early, 2 * np.sin(turn / 2) * np.linalg.norm(SQUARE[:, :2], axis=1), 0.0)
    assert errors.rmse_m == pytest.approx(np.sqrt(np.mean(apart**2)))
    assert errors.max_m == pytest.approx(apart.max())
    assert errors.end_m == pytest.approx(0.0, abs=1e-9)
    fitted = measure_walk(replace(final, stances=replace(final.stances, position=then)), truth, BEST_YAW)
    assert fitted.rmse_m < errors.rmse_m


def test_start_is_laid_on_the_start_and_the_heading_is_left_as_it_was():
    turn = 0.1
    found, truth = walked((LINE - LINE[0]) @ yaw_rotation(turn).T + [5.0, -3.0, 2.0], LINE)
    started, best = (measure_walk(found, truth, mode) for mode in (AS_STARTED, BEST_YAW))
    chord = 2 * np.sin(turn / 2)
    assert started.end_m == pytest.approx(200.0 * chord)
    assert started.max_m == pytest.approx(200.0 * chord)
    assert started.mean_m == pytest.approx(100.0 * chord)
    assert (started.end_height_m, started.alignment) == (pytest.approx(0.0), "origin")
    assert max(best.end_m, best.max_m) < 1e-9


def test_heading_errors_are_of_the_change_clockwise_and_as_laid_with_the_error_at_the_start():
    turning = np.linspace(0.0, 3 * 2 * np.pi, len(SQUARE))
    drift = np.deg2rad(-14.0) * np.linspace(0.0, 1.0, len(SQUARE))  # clockwise
    found, truth = walked(SQUARE, SQUARE, yawing(turning + drift + 0.7), yawing(turning))
    for mode in (AS_STARTED, BEST_YAW):
        assert measure_walk(found, truth, mode).heading_deg == pytest.approx(14.0)
    most = np.deg2rad(190.0) * np.linspace(0.0, 1.0, len(SQUARE))
    assert measure_walk(*walked(SQUARE, SQUARE, yawing(most))).heading_deg == pytest.approx(170.0)
    step = np.deg2rad(np.concatenate([np.full(50, -3.0), np.full(51, 5.0)]))  # about up: clockwise is minus
    errors = measure_walk(*walked(SQUARE, SQUARE, yawing(turning + step), yawing(turning)))
    assert (errors.heading_deg, errors.heading_laid_deg) == pytest.approx((-8.0, -5.0))
    assert errors.heading_rmse_deg == pytest.approx(np.sqrt((50 * 9.0 + 51 * 25.0) / 101))
    bare = measure_walk(found, TrajectoryTruth(truth.t, truth.position), "yaw")
    assert (bare.heading_deg, bare.heading_laid_deg, bare.heading_rmse_deg) == (None, None, None)


def test_the_best_yaw_takes_a_wrong_heading_at_the_start_off():
    turned = yaw_rotation(0.3)
    found, truth = walked(LINE @ turned.T, LINE, np.broadcast_to(turned, (len(LINE), 3, 3)))
    assert measure_walk(found, truth, BEST_YAW).heading_rmse_deg == pytest.approx(0.0, abs=1e-9)
    started = measure_walk(found, truth)
    assert started.heading_rmse_deg == pytest.approx(np.rad2deg(0.3))
    assert started.heading_laid_deg == pytest.approx(-np.rad2deg(0.3))


def test_a_closed_loop_hides_scale_from_the_end_error_and_an_open_path_does_not():
    for path, end_m in ((SQUARE, 0.0), (LINE, 4.0)):
        errors = measure_walk(*walked(1.02 * path, path))
        assert errors.end_m == pytest.approx(end_m, abs=1e-9)
        assert errors.scale_percent == pytest.approx(2.0)
        assert errors.length_percent == pytest.approx(2.0)


def test_drift_of_heading_shortens_the_path_but_not_the_strides():
    errors = measure_walk(*walked(drifted(LINE, 0.005), LINE))
    assert errors.length_percent == pytest.approx(0.0, abs=1e-9)
    assert errors.scale_percent == pytest.approx(100.0 * (1.0 / best_scale(drifted(LINE, 0.005), LINE) - 1.0))
    assert errors.scale_percent < -0.5
    # Under a constant rate the end is off by the integral of the heading error.
    angle = np.arange(200) * 0.005
    expected = np.hypot(-np.sin(angle).sum(), np.cos(angle).sum() - 200.0)
    assert errors.end_m == pytest.approx(expected)


def test_footfalls_count_and_not_the_swings():
    t = np.linspace(0.0, 100.0, 1001)
    path = np.column_stack([np.interp(t, np.arange(101.0), axis) for axis in SQUARE.T])
    estimate = path.copy()
    stance = np.arange(0, 1001, 10)
    swing = np.setdiff1d(np.arange(1001), stance)
    estimate[swing] += 30.0
    errors = measure_walk(solution(t, estimate, stance), TrajectoryTruth(t, path))
    assert errors.max_m == pytest.approx(0.0, abs=1e-9)
    assert len(compare_at_footfalls(solution(t, estimate, stance), TrajectoryTruth(t, path), "yaw").row) == 101


def test_without_a_truth_there_is_the_closure():
    missed = SQUARE + np.linspace(0.0, 1.0, len(SQUARE))[:, None] * [0.6, 0.8, -0.5]
    errors = measure_walk(walked(missed, SQUARE)[0])
    assert (errors.alignment, errors.mean_m, errors.heading_deg) == ("closure", None, None)
    assert errors.end_m == pytest.approx(1.0)
    assert errors.end_height_m == pytest.approx(-0.5)
    assert errors.end_percent == pytest.approx(100.0 / errors.distance_m)


def test_surveyed_footprints_are_taken_with_the_best_yaw_only():
    surveyed = FootprintTruth(np.arange(0, 101, 5), SQUARE[::5, :2], 100)
    missed = SQUARE @ yaw_rotation(1.0).T
    found = walked(missed, SQUARE)[0]
    errors = measure_walk(found, surveyed, BEST_YAW)
    assert errors.max_m < 1e-9
    assert errors.distance_m == pytest.approx(100.0)
    assert (errors.end_height_m, errors.length_percent) == (None, None)
    with pytest.raises(EvaluationError, match="use 'yaw'"):
        measure_walk(found, surveyed, AS_STARTED)


def test_no_footfall_is_an_error_in_words():
    with pytest.raises(EvaluationError, match="no stance"):
        measure_walk(solution(np.arange(101.0), SQUARE, np.array([], dtype=int)))


# --- at landmarks ----------------------------------------------------------------------------------------------------

T = np.linspace(0.0, 40.0, 401)
AT_S = np.array([2.0, 7.5, 13.0, 20.0, 26.51, 40.0])


def passings(places):
    return [Passing(*one) for one in zip("ABCABC", AT_S, places, strict=True)]


def test_errors_at_landmarks_are_over_the_ground_in_the_alignment_of_the_footfalls():
    path = np.column_stack([T, np.zeros((len(T), 2))])
    off = np.zeros((6, 3))
    off[[0, 1, 3, 5], :2] = [[0.3, 0.4], [0.0, 2.0], [-0.5, 0.0], [3.0, 4.0]]
    off[[0, 2], 2] = 9.0
    places = np.column_stack([AT_S, np.zeros((6, 2))]) - off
    level, crossings = align(path, path, "none"), passings(places)
    found = measure_landmarks(solution(T, path), crossings, level)
    np.testing.assert_allclose(found, [0.5, 2.0, 0.0, 0.5, 0.0, 5.0], atol=1e-12)
    with pytest.raises(EvaluationError, match=r"landmark C is crossed at 40\.000 s.*0\.000 to 39\.900 s"):
        measure_landmarks(solution(T[:-1], path[:-1]), crossings, level)
    with pytest.raises(EvaluationError, match="crosses no landmark"):
        measure_landmarks(solution(T, path), (), level)
    path = winding_path(np.random.default_rng(3), len(T))
    places = np.column_stack([np.interp(AT_S, T, axis) for axis in path.T])
    turned = (path - path[0]) @ yaw_rotation(0.2).T + [1.0, 2.0, 3.0]
    best, started = (
        measure_landmarks(solution(T, turned), passings(places), align(turned, path, mode))
        for mode in ("yaw", "origin")
    )
    assert best.max() < 1e-9
    np.testing.assert_allclose(started, 2 * np.sin(0.1) * np.linalg.norm((places - path[0])[:, :2], axis=1))
