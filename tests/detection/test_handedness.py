"""Axes of the gyroscope against gravity, stride by stride."""

from functools import cache

import numpy as np
import pytest

from fg_nav.detection.mount import AXES, DECISIVE, measure_axes, refuse_wrong_axes
from fg_nav.errors import RecordingError
from fg_nav.lab.simulation import simulate
from fg_nav.recording import Recording


@cache
def demo() -> Recording:
    return simulate("demo", 4).recording


def turned(acc: np.ndarray, gyr: np.ndarray, start_s: float = 8.0, stop_s: float = 16.0) -> Recording:
    """A piece of the walk, with these axes of either sensor."""
    part = (demo().t >= start_s) & (demo().t < stop_s)
    return Recording(demo().t[part], demo().acc[part] @ acc.T, demo().gyr[part] @ gyr.T)


SAME, X, Z = np.eye(3), np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, 1.0, -1.0])


@pytest.mark.parametrize(
    ("acc", "gyr", "words"),
    [
        (SAME, -SAME, "negate gyr"),
        (X, X, "left-handed"),
        (SAME, X, "the rate about x has the wrong sign"),
        (Z, SAME, "negate acc z, or gyr x and y"),
        (SAME, SAME[[1, 0, 2]], "those called y, x, z"),
    ],
)
def test_wrong_axes_are_refused_by_name_in_a_piece_of_eight_seconds(
    acc: np.ndarray, gyr: np.ndarray, words: str
) -> None:
    with pytest.raises(RecordingError, match=words):
        refuse_wrong_axes(turned(acc, gyr))


def measured(recording):
    return measure_axes(recording.t, recording.acc, recording.gyr)


def test_any_right_handed_axes_that_both_sensors_share_are_taken():
    for shared in (SAME, SAME[[1, 2, 0]], X @ Z):
        for start_s in (4.0, 12.0, 20.0):
            assert measured(turned(shared, shared, start_s, start_s + 6.0)).against < 1.0


def test_the_odds_are_of_the_axes_that_were_taken_for_others():
    """What one exchange does, the inverse undoes: the best of the odds of all 48 is it. One stride never decides."""
    assert len({one.tobytes() for one in AXES + 0.0}) == 48
    assert np.array_equal(AXES[0], np.eye(3))
    for wrong in AXES[[17, 30]]:
        found = measured(turned(SAME, wrong))
        assert found.against > DECISIVE
        assert np.array_equal(found.best, wrong.T)
    assert measured(turned(SAME, -SAME, 8.0, 9.6)).against < DECISIVE
    t = np.arange(0.0, 10.0, 0.005)
    assert measured(Recording(t, np.tile([0.0, 0.0, 9.81], (len(t), 1)), np.zeros((len(t), 3)))).strides == 0
