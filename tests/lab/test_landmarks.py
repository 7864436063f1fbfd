"""Errors at landmarks, where paths and errors are made by hand."""

import numpy as np
import pytest

from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import align
from fg_nav.frames import yaw_rotation
from fg_nav.lab.walked import error_reduction_percent, measure_landmarks
from tests.evaluation.walks import solution, winding_path

T = np.linspace(0.0, 40.0, 401)
NAMES = ("A", "B", "C") * 2
AT_S = np.array([2.0, 7.5, 13.0, 20.0, 26.51, 40.0])


def eastward():
    """A metre a second to the east; and where it is at the crossings."""
    path = np.column_stack([T, np.zeros((len(T), 2))])
    return path, np.column_stack([AT_S, np.zeros((len(AT_S), 2))])


def test_errors_are_over_the_ground():
    path, places = eastward()
    off = np.array(
        [[0.3, 0.4, 9.0], [0.0, 2.0, 0.0], [0.0, 0.0, 9.0], [-0.5, 0.0, 0.0], [0.0, 1.0, 0.0], [3.0, 4.0, 0.0]]
    )
    found = measure_landmarks(solution(T, path), NAMES, AT_S, places - off, align(path, path, "none"))
    np.testing.assert_allclose(found.error_m, [0.5, 2.0, 0.0, 0.5, 1.0, 5.0], atol=1e-12)
    assert found.landmark == NAMES


def test_the_alignment_of_the_footfalls_is_used_and_not_one_of_the_landmarks():
    path = winding_path(np.random.default_rng(3), len(T))
    places = np.column_stack([np.interp(AT_S, T, axis) for axis in path.T])
    turned = (path - path[0]) @ yaw_rotation(0.2).T + [1.0, 2.0, 3.0]
    found = solution(T, turned)
    assert measure_landmarks(found, NAMES, AT_S, places, align(turned, path, "yaw")).error_m.max() < 1e-9
    started = measure_landmarks(found, NAMES, AT_S, places, align(turned, path, "origin"))
    apart = np.linalg.norm((places - path[0])[:, :2], axis=1)
    np.testing.assert_allclose(started.error_m, 2 * np.sin(0.1) * apart)


def test_ma_s_figures():
    assert error_reduction_percent(1.5, 11.3) == pytest.approx(86.7, abs=0.05)  # printed: 85 %
    assert error_reduction_percent(2.0, 2.0) == 0.0
    assert error_reduction_percent(3.0, 2.0) == pytest.approx(-50.0)
    with pytest.raises(EvaluationError, match="take another"):
        error_reduction_percent(1.0, 0.0)


def test_a_crossing_outside_of_the_walk_is_named():
    path, places = eastward()
    alignment = align(path, path, "none")
    with pytest.raises(EvaluationError, match=r"landmark C is crossed at 40\.000 s.*0\.000 to 39\.900 s"):
        measure_landmarks(solution(T[:-1], path[:-1]), NAMES, AT_S, places, alignment)
    with pytest.raises(EvaluationError, match="crosses no landmark"):
        measure_landmarks(solution(T, path), (), AT_S[:0], places[:0], alignment)
