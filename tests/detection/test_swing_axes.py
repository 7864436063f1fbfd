"""Wrong axes and signs of a sensor in a pocket are seen in the strides of the thigh, its own are taken."""

from functools import cache

import numpy as np
import pytest

from fg_nav.detection.handedness import DECISIVE, NO_EVIDENCE, SUSPECT
from fg_nav.detection.swing_axes import measure_swing_axes
from fg_nav.errors import RecordingError
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.online.axes_check import AxesCheck
from fg_nav.online.buffer import SampleBuffer, rows_of

MIRRORS = {
    "gyroscope negated": (np.eye(3), -np.eye(3)),
    "x of both negated": (np.diag([-1.0, 1.0, 1.0]),) * 2,
    "z of both negated": (np.diag([1.0, 1.0, -1.0]),) * 2,
}


@cache
def walk(seed):
    return rows_of(simulate("demo", seed, Choices(worn="pocket", rate_hz=100.0)).recording)[:5000]


def change(rows, acc, gyr):
    return np.column_stack([rows[:, 0], rows[:, 1:4] @ acc.T, rows[:, 4:7] @ gyr.T, rows[:, 7:]])


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


@pytest.mark.parametrize("mirror", MIRRORS)
@pytest.mark.parametrize("seed", [104, 105])
def test_a_mirror_is_seen_and_what_to_do_is_said(mirror, seed):
    found = measure(change(walk(seed), *MIRRORS[mirror]))
    assert found.against > DECISIVE
    assert "gravity turns against the gyroscope" in found.problem


def test_a_sensor_that_lies_has_no_strides_and_a_gap_is_none():
    still = np.column_stack([0.01 * np.arange(3000), np.tile([0.0, 0.0, 9.81, 0.0, 0.0, 0.0], (3000, 1))])
    rows = np.delete(walk(104), slice(None, None, 3), axis=0)
    rows[:, 0] += np.cumsum(np.arange(len(rows)) % 100 == 0)
    assert measure(still) is measure(rows) is NO_EVIDENCE


def test_a_stream_with_a_mirror_is_refused_in_its_first_minute_and_its_own_is_not():
    for rows, is_wrong in ((walk(104), False), (change(walk(104), *MIRRORS["gyroscope negated"]), True)):
        buffer, looks = SampleBuffer(), AxesCheck(print, mount="pocket")
        buffer.append(rows)
        if is_wrong:
            with pytest.raises(RecordingError, match="gravity turns against"):
                looks.look_at(buffer)
        else:
            looks.look_at(buffer)
            assert looks.evidence.strides >= 15
