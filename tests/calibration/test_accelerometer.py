"""A large error of the accelerometer on a walk: taken off, as bias and scale, where it is there."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.calibration.inertial import average_out_error
from fg_nav.detection import detect_stances
from fg_nav.lab.simulation import simulate


@pytest.fixture(scope="module")
def walked():
    return replace(simulate("demo", 4).recording, mag=None)


def corrected(walk, bias=(0.0, 0.0, 0.0), scale=1.0):
    spoiled = replace(walk, acc=scale * walk.acc + np.asarray(bias))
    return spoiled, average_out_error(spoiled, detect_stances(spoiled))


def test_a_calibrated_accelerometer_is_left_as_it_is(walked):
    for bias, scale in (((0.0, 0.0, 0.0), 1.0), ((0.03, -0.02, 0.02), 1.002)):
        spoiled, found = corrected(walked, bias, scale)
        assert found is spoiled


@pytest.mark.parametrize("size", [0.7, -0.5])
def test_a_bias_is_taken_off_a_walk_and_said(walked, size):
    """Along the force; what a foot never turns to the vertical is neither seen nor of use."""
    up = walked.acc[:200].mean(axis=0) / np.linalg.norm(walked.acc[:200].mean(axis=0))
    _, found = corrected(walked, size * up)
    left = found.acc[:200].mean(axis=0) - walked.acc[:200].mean(axis=0)
    assert abs(left @ up) < 0.03
    assert np.linalg.norm(left) < 0.5 * abs(size)
    assert "an accelerometer bias of" in found.provenance.notes[-1]


def test_strides_show_the_bias_where_there_is_no_rest(walked):
    stances = detect_stances(walked)
    moving = walked.slice(int(stances.start[3]), int(stances.stop[-3]))
    spoiled, found = corrected(moving, [0.0, 0.0, 0.7])
    assert np.abs((spoiled.acc - moving.acc)[:, 2]).max() > 0.6
    assert np.abs((found.acc - moving.acc).mean(axis=0)[2]) < 0.2
