"""Wrong axes and signs of a sensor in a pocket are seen in the strides of the thigh, its own are taken."""

from functools import cache

import numpy as np
import pytest

from fg_nav.detection.mount import DECISIVE, MIN_THIGH_STRIDES, NO_SWINGS, SUSPECT, measure_swing_axes
from fg_nav.detection.source import AxesCheck
from fg_nav.errors import RecordingError
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online.buffer import rows_of
from fg_nav.verdict.limits import judge_axes

MIRRORS = {
    "gyroscope negated": (np.eye(3), -np.eye(3)),
    "x of both negated": (np.diag([-1.0, 1.0, 1.0]),) * 2,
    "z of both negated": (np.diag([1.0, 1.0, -1.0]),) * 2,
}


@cache
def walk(seed):
    return rows_of(simulate("demo", seed, Choices(worn="pocket", rate_hz=100.0)).recording)[:5000]


def change(rows, acc, gyr):
    return np.column_stack([rows[:, 0], rows[:, 1:4] @ acc.T, rows[:, 4:7] @ gyr.T, rows[:, 7:10]])


def measure(rows):
    return measure_swing_axes(rows[:, 0], rows[:, 1:4], rows[:, 4:7])


@pytest.mark.parametrize("seed", [104, 105])
def test_own_axes_are_taken_however_the_sensor_lies_in_the_pocket(seed):
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    found = measure(change(walk(seed), turn, turn))
    assert found.strides >= 15
    assert found.against < SUSPECT
    assert abs(np.median(found.gravity) - 9.81) < 0.15


def toy(scale=1.0, bias=(0.0, 0.0, 0.0), swing_rad=0.4, lost=0.0):
    """Thigh that swings about y, (N, 10), seen by an accelerometer that is off."""
    t = np.arange(0.0, 20.0, 0.01)
    phase = 2 * np.pi * t / 1.1
    angle, rate = swing_rad * np.sin(phase), swing_rad * 2 * np.pi / 1.1 * np.cos(phase)
    force = 9.80665 * np.column_stack([-np.sin(angle), np.zeros_like(t), np.cos(angle)])
    rows = np.zeros((len(t), 10))
    rows[:, 0], rows[:, 1:4], rows[:, 5] = t, scale * force + bias, rate
    return rows[np.random.default_rng(1).random(len(t)) >= lost]


@pytest.mark.parametrize("scale", [0.97, 1.0, 1.03])
def test_an_accelerometer_that_is_off_as_sensors_are_is_no_reason_to_refuse(scale):
    for bias in 0.3 * np.vstack([np.zeros(3), np.eye(3), -np.eye(3), np.ones(3), -np.ones(3)]):
        found = measure(toy(scale, bias))
        assert found.strides >= MIN_THIGH_STRIDES
        assert found.against < DECISIVE
        assert found.against < SUSPECT or scale != 1.0


@pytest.mark.parametrize("mirror", MIRRORS)
def test_a_mirror_is_seen_where_the_thigh_swings_far_and_no_axis_is_named(mirror):
    found = measure(change(toy(swing_rad=0.7), *MIRRORS[mirror]))
    assert found.against > DECISIVE
    assert "gravity turns against the gyroscope" in found.problem
    assert "negate" not in found.problem


def test_few_strides_are_no_evidence_many_are_no_more_than_one_and_a_gap_is_none():
    rows = change(toy(swing_rad=0.7), np.eye(3), -np.eye(3))
    few, many = measure(rows[:700]), measure(rows)
    assert 0 < few.strides < MIN_THIGH_STRIDES
    assert few.against == 0.0
    assert judge_axes(NO_SWINGS).weight < 0.0
    assert (many + many).against == pytest.approx(many.against)
    still = np.column_stack([0.01 * np.arange(3000), np.tile([0.0, 0.0, 9.81, 0.0, 0.0, 0.0], (3000, 1))])
    thinned = np.delete(walk(104), slice(None, None, 3), axis=0)
    thinned[:, 0] += np.cumsum(np.arange(len(thinned)) % 100 == 0)
    assert measure(still) is measure(thinned) is NO_SWINGS
    holed = toy()
    found = measure(holed[(holed[:, 0] < 6.0) | (holed[:, 0] > 8.5)])
    assert found.strides >= MIN_THIGH_STRIDES
    assert np.isfinite(found.gravity).all()


def test_a_stream_with_a_mirror_is_refused_in_its_first_minute_and_its_own_is_not():
    for rows, is_wrong in ((walk(104), False), (change(toy(swing_rad=0.7, lost=0.03), np.eye(3), -np.eye(3)), True)):
        looks = AxesCheck(print, mount="pocket")
        if is_wrong:
            with pytest.raises(RecordingError, match="gravity turns against"):
                looks.push(rows)
        else:
            looks.push(rows)
            assert looks.evidence.strides >= 15
