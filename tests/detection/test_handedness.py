"""Axes of the gyroscope against gravity, stride by stride."""

from functools import cache
from itertools import permutations, product

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


def test_all_signed_orders_of_three_axes_are_tried_and_the_given_one_first() -> None:
    assert len({one.tobytes() for one in AXES + 0.0}) == 48
    assert np.array_equal(AXES[0], np.eye(3))
    assert np.allclose(AXES @ AXES.transpose(0, 2, 1), np.eye(3))
    assert len(list(product(permutations(range(3)), product((1, -1), repeat=3)))) == len(AXES)


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


def test_any_right_handed_axes_that_both_sensors_share_are_taken() -> None:
    for shared in (SAME, SAME[[1, 2, 0]], X @ Z):
        for start_s in (4.0, 12.0, 20.0):
            assert measure_axes(*samples(turned(shared, shared, start_s, start_s + 6.0))).against < 1.0


def samples(recording: Recording) -> tuple[np.ndarray, ...]:
    return recording.t, recording.acc, recording.gyr


def test_the_odds_are_of_the_axes_that_were_taken_for_others() -> None:
    """What one exchange does, the inverse undoes: the best of the odds is it."""
    wrong = AXES[17]
    found = measure_axes(*samples(turned(SAME, wrong)))
    assert found.against > DECISIVE
    assert np.array_equal(found.best, wrong.T)


def test_one_stride_never_decides_and_rest_shows_nothing() -> None:
    assert measure_axes(*samples(turned(SAME, -SAME, 8.0, 9.6))).against < DECISIVE
    t = np.arange(0.0, 10.0, 0.005)
    rest = Recording(t, np.tile([0.0, 0.0, 9.81], (len(t), 1)), np.zeros((len(t), 3)))
    assert measure_axes(*samples(rest)).strides == 0
