"""Alignment, scale and errors: against motions that are known, and against evo (GPLv3, a tool outside the package)."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.errors import EvaluationError
from fg_nav.evaluation import MODES, align, evaluate, fit_scale
from fg_nav.frames import yaw_rotation
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from tests.evaluation.walks import solution, winding_path

ALIGNED_RNG = np.random.default_rng(5)
ALIGNED = winding_path(ALIGNED_RNG)
NOISY = ALIGNED + 0.2 * ALIGNED_RNG.standard_normal(ALIGNED.shape)


@given(yaw=st.floats(-3.1, 3.1), shift=st.tuples(*[st.floats(-50, 50)] * 3))
@settings(max_examples=50, deadline=None)
def test_yaw_mode_undoes_the_gauge_exactly(yaw, shift):
    truth = ALIGNED @ yaw_rotation(yaw).T + np.array(shift)
    alignment = align(ALIGNED, truth)
    np.testing.assert_allclose(alignment.apply(ALIGNED), truth, atol=1e-9)
    np.testing.assert_allclose(alignment.truth_R_nav, yaw_rotation(yaw), atol=1e-12)


def test_se3_undoes_any_rotation_and_never_reflects_and_yaw_keeps_a_tilt():
    turn = Rotation.from_rotvec([0.4, -1.2, 2.0]).as_matrix()
    np.testing.assert_allclose(align(ALIGNED, ALIGNED @ turn.T + 3.0, "se3").truth_R_nav, turn, atol=1e-12)
    assert np.linalg.det(align(ALIGNED, ALIGNED * [1.0, -1.0, 1.0], "se3").truth_R_nav) == pytest.approx(1.0)
    assert np.abs(align(ALIGNED @ turn.T, ALIGNED, "yaw").apply(ALIGNED @ turn.T) - ALIGNED).max() > 0.1
    for mode in MODES:  # of one point, too
        assert np.linalg.det(align(ALIGNED[:1], NOISY[:1], mode).truth_R_nav) == pytest.approx(1.0)


@pytest.mark.parametrize("mode", ["yaw", "se3"])
def test_no_neighbouring_motion_fits_better(mode):
    alignment = align(ALIGNED, NOISY, mode)
    best = np.sum((alignment.apply(ALIGNED) - NOISY) ** 2)
    axes = np.eye(3) if mode == "se3" else np.eye(3)[2:]
    for rotvec in 1e-3 * np.vstack([axes, -axes]):
        p = ALIGNED @ (Rotation.from_rotvec(rotvec).as_matrix() @ alignment.truth_R_nav).T
        assert np.sum((p - p.mean(0) + NOISY.mean(0) - NOISY) ** 2) > best
    for shift in 1e-3 * np.vstack([np.eye(3), -np.eye(3)]):
        assert np.sum((alignment.apply(ALIGNED) + shift - NOISY) ** 2) > best


def test_none_and_origin():
    assert np.array_equal(align(ALIGNED, NOISY, "none").apply(ALIGNED), ALIGNED)
    moved = align(ALIGNED, NOISY, "origin").apply(ALIGNED)
    np.testing.assert_allclose(moved[0], NOISY[0])
    np.testing.assert_allclose(moved - ALIGNED, np.broadcast_to(NOISY[0] - ALIGNED[0], ALIGNED.shape), atol=1e-12)


def test_scale_is_above_one_for_a_short_estimate_and_blind_to_yaw_shift_and_height():
    truth = ALIGNED @ yaw_rotation(2.0).T + 7.0
    for axes in (2, 3):
        assert fit_scale(ALIGNED[:, :axes] / 1.02, truth[:, :axes]) == pytest.approx(1.02)
    assert np.isnan(fit_scale(np.zeros((5, 3)), ALIGNED[:5]))


def test_bad_input_is_named():
    broken = ALIGNED.copy()
    broken[17, 1] = np.nan
    for arguments, words in (
        ((ALIGNED, ALIGNED, "sim3"), "'sim3' is unknown"),
        ((ALIGNED, ALIGNED[1:]), "cannot be aligned"),
        ((broken, ALIGNED), "estimate is not finite at point 17"),
    ):
        with pytest.raises(EvaluationError, match=words):
            align(*arguments)


def test_errors_and_scale_are_those_of_evo():
    trajectory = pytest.importorskip("evo.core.trajectory", reason="evo is missing: pip install '.[checks]'")
    metrics = pytest.importorskip("evo.core.metrics")
    estimate, t = 0.97 * NOISY @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]).T, np.linspace(0.0, 20.0, len(ALIGNED))

    def theirs(axes, scaled=None):
        """Rmse, largest error and scale; not aligned if `scaled` is None."""
        upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
        moved, reference = (trajectory.PoseTrajectory3D(path * axes, upright, t) for path in (estimate, ALIGNED))
        scale = None if scaled is None else moved.align(reference, correct_scale=scaled)[2]
        ape = metrics.APE(metrics.PoseRelation.translation_part)
        ape.process_data((reference, moved))
        return *(ape.get_statistic(metrics.StatisticsType[name]) for name in ("rmse", "max")), scale

    ours = {mode: evaluate(solution(t, estimate), TrajectoryTruth(t, ALIGNED), mode) for mode in ("se3", "none", "yaw")}
    for mode, scaled in (("se3", False), ("none", None)):
        found = ours[mode].rmse_3d_m, ours[mode].max_error_m
        assert found == pytest.approx(theirs([1.0, 1.0, 1.0], scaled)[:2], rel=1e-9)
    flat = [1.0, 1.0, 0.0]
    assert ours["yaw"].rmse_2d_m == pytest.approx(theirs(flat, False)[0], rel=1e-9)
    assert fit_scale(estimate, ALIGNED) == pytest.approx(theirs(flat, True)[2], rel=1e-9)
    assert fit_scale(estimate, ALIGNED) > 1.01


RNG = np.random.default_rng(11)
PATH = winding_path(RNG)
T = np.linspace(0.0, 20.0, len(PATH))


def test_figures_of_known_errors_and_a_default_alignment_that_ignores_start_and_heading():
    error = 0.1 * RNG.standard_normal(PATH.shape)
    error[-1] = [0.3, 0.4, 1.2]
    metrics = evaluate(solution(T, PATH + error), TrajectoryTruth(T, PATH), "none")
    assert metrics.rmse_2d_m == pytest.approx(np.sqrt(np.mean(error[:, 0] ** 2 + error[:, 1] ** 2)))
    assert metrics.rmse_3d_m == pytest.approx(np.sqrt(np.mean(np.sum(error**2, axis=1))))
    assert metrics.end_error_m == pytest.approx(1.3)
    assert metrics.max_error_m == pytest.approx(1.3)
    assert metrics.points == len(T)
    moved = solution(T, PATH @ yaw_rotation(1.3).T + [4.0, -2.0, 1.0])
    metrics = evaluate(moved, TrajectoryTruth(T, PATH))
    assert metrics.alignment == "yaw"
    assert metrics.max_error_m < 1e-9
    assert evaluate(moved, TrajectoryTruth(T, PATH), "none").rmse_2d_m > 1.0


def test_truth_at_other_stamps_is_interpolated_only_where_it_was_seen():
    speed = np.array([1.0, 0.5, 0.1])
    truth_t = np.concatenate([np.arange(5.0, 8.0, 0.013), np.arange(9.0, 12.0, 0.013)])
    unseen = (T < 5.0) | (T > 12.0) | ((T > 8.01) & (T < 8.99))
    estimate = T[:, None] * speed + 100.0 * unseen[:, None]
    holed = PATH.copy()
    holed[50:120] = np.nan
    for path, truth, points in (
        (estimate, TrajectoryTruth(truth_t, truth_t[:, None] * speed), np.count_nonzero(~unseen)),
        (PATH, TrajectoryTruth(T, holed), len(T) - 70),
    ):
        metrics = evaluate(solution(T, path), truth, "none")
        assert metrics.max_error_m < 1e-9
        assert metrics.points == points
        assert len(truth.t) == len(T) or "the truth covers" in metrics.notes[0]
    coarse = np.arange(0.0, 20.5, 0.5)  # between such stamps all is seen: none is far from the usual
    metrics = evaluate(solution(T, T[:, None] * speed), TrajectoryTruth(coarse, coarse[:, None] * speed), "none")
    assert metrics.points == len(T)
    with pytest.raises(EvaluationError, match=r"100\.000 to 120\.000 s.*0\.000 to 20\.000 s.*clocks"):
        evaluate(solution(T, PATH), TrajectoryTruth(T + 100.0, PATH))


def test_heading_error_is_about_up_whatever_the_mounting():
    attitude = Rotation.random(len(T), rng=np.random.default_rng(1)).as_matrix()
    truth = TrajectoryTruth(T, PATH, attitude)
    off = evaluate(solution(T, PATH, nav_R_body=yaw_rotation(np.radians(3.0)) @ attitude), truth, "none")
    assert off.heading_rmse_deg == pytest.approx(3.0)
    turned = solution(T, PATH @ yaw_rotation(0.7).T, nav_R_body=yaw_rotation(0.7) @ attitude)
    assert evaluate(turned, truth).heading_rmse_deg == pytest.approx(0.0, abs=1e-6)
    assert evaluate(turned, TrajectoryTruth(T, PATH)).heading_rmse_deg is None


def test_distance_and_closure_go_from_stance_to_stance():
    corners = np.array([[0.0, 0, 0], [3.0, 0, 0], [3.0, 4.0, 0], [0.0, 4.0, 0], [0.0, 0.0, 1.0]])
    path = np.vstack([np.linspace(a, b, 10, endpoint=False) for a, b in pairwise(corners)])
    path = np.vstack([path, corners[-1:], [[9.0, 9.0, 9.0]]])
    metrics = evaluate(solution(np.arange(len(path), dtype=float), path, np.arange(0, 41, 10)))
    assert metrics.distance_m == pytest.approx(3 + 4 + 3 + np.sqrt(17))
    assert metrics.closure_m == pytest.approx(1.0)
    assert metrics.closure_percent == pytest.approx(100 / metrics.distance_m)
    assert metrics.strides_detected == 4


def test_only_what_is_known_goes_to_json():
    own = {"distance_m", "closure_m", "closure_percent", "strides_detected", "notes"}
    assert set(evaluate(solution(T, PATH)).as_dict()) == own
    text = json.dumps(evaluate(solution(T, PATH), TrajectoryTruth(T, PATH)).as_dict(), allow_nan=False)
    assert {"rmse_2d_m", "rmse_3d_m", "end_error_m", "max_error_m", "scale", "alignment"} <= set(json.loads(text))
    assert "closure_percent" not in evaluate(solution(T, PATH, np.array([0]))).as_dict()
    with pytest.raises(EvaluationError, match="no stance"):
        evaluate(solution(T, PATH, np.array([], dtype=int)))


# footprints: thirty, 1.35 m apart

STEPS = winding_path(RNG, 30)[:, :2] * 4.5
ALL = FootprintTruth(np.arange(30), STEPS, 29)


def walk_with_stances(xy):
    position = np.column_stack([xy @ yaw_rotation(0.8)[:2, :2].T + 5.0, 0.3 * RNG.standard_normal(len(xy))])
    return solution(np.arange(len(xy), dtype=float), position)


def test_footprints_are_fitted_by_rotation_and_shift_in_the_plane():
    metrics = evaluate(walk_with_stances(STEPS), ALL)
    assert metrics.rmse_2d_m < 1e-9
    assert metrics.rmse_3d_m is None
    assert (metrics.strides_detected, metrics.strides_true) == (29, 29)
    assert (metrics.points, metrics.footprints_surveyed, metrics.notes) == (30, 30, ())
    corners = np.array([0, 7, 15, 22, 29])
    metrics = evaluate(walk_with_stances(STEPS), FootprintTruth(corners, STEPS[corners] * 1.05, 29))
    off = 0.05 * np.sqrt(np.mean(np.sum((STEPS[corners] - STEPS[corners].mean(0)) ** 2, axis=1)))
    assert (metrics.scale, metrics.rmse_2d_m) == (pytest.approx(1.05), pytest.approx(off))


@pytest.mark.parametrize("missed", [0, 13, 29])
def test_a_missed_stance_costs_its_footprint_and_a_note(missed):
    metrics = evaluate(walk_with_stances(np.delete(STEPS, missed, 0)), ALL)
    assert metrics.rmse_2d_m < 1e-9
    assert (metrics.points, metrics.footprints_surveyed) == (29, 30)
    assert (metrics.strides_detected, metrics.strides_true) == (28, 29)
    assert any("fewer than the walk has" in note for note in metrics.notes)
    assert f"no stance for footprint {missed}: not scored" in metrics.notes


@pytest.mark.parametrize("extra", [[0], [29], [12, 20]])
def test_extra_stances_are_skipped_and_said_but_a_miscount_that_cancels_is_not_forgiven(extra):
    metrics = evaluate(walk_with_stances(np.insert(STEPS, extra, STEPS[extra] + 0.02, axis=0)), ALL)
    assert metrics.rmse_2d_m < 0.02
    assert metrics.points == 30
    assert any("more than the walk has" in note for note in metrics.notes)
    walked = np.insert(np.delete(STEPS, 8, 0), 20, STEPS[21], axis=0)
    assert evaluate(walk_with_stances(walked), ALL).rmse_2d_m > 0.5


def test_footprints_that_cannot_be_compared_are_errors_in_words():
    truth = FootprintTruth(np.array([0, 10, 29]), STEPS[[0, 10, 29]])
    with pytest.raises(EvaluationError, match="only 2 of 3 surveyed footprints have a stance"):
        evaluate(walk_with_stances(STEPS[:20]), truth)
    with pytest.raises(EvaluationError, match="footprints have none: use 'yaw'"):
        evaluate(walk_with_stances(STEPS), truth, "se3")


def test_footprints_with_times_are_compared_there_whatever_stances_were_found():
    t, when = np.linspace(0.0, 30.0, 3001), np.arange(30) + 0.3
    path = np.column_stack([*(np.interp(t, when, column) for column in STEPS.T), np.zeros(len(t))])
    found = solution(t, path, np.array([0, 400, 900]))
    truth = replace(ALL, xy=STEPS @ yaw_rotation(0.7)[:2, :2].T + [5.0, -3.0], t=when)
    metrics = evaluate(found, truth)
    assert metrics.max_error_m < 0.02  # between two samples
    assert (metrics.points, metrics.strides_detected, metrics.strides_true) == (30, 2, 29)
    assert metrics.rmse_3d_m is None
    assert evaluate(found, replace(truth, t=truth.t + 0.5)).max_error_m > 0.3
    # beyond the time of the solution they are named
    metrics = evaluate(found, replace(truth, t=truth.t + 1.0))
    assert (metrics.points, metrics.notes) == (29, ("no sample at footprint 29: not scored",))
    with pytest.raises(EvaluationError, match=r"only 0 of 30 surveyed footprints are within the time.*clocks"):
        evaluate(found, replace(truth, t=truth.t + 100.0))
