"""The factors between two feet: what leaves no residual. Their derivatives are in `test_residual`."""

import numpy as np
import pytest

from fg_nav.factors.same_place import BesideEachOther, WithinReach
from fg_nav.frames import yaw_rotation


def test_feet_that_walk_beside_each_other_leave_no_residual_wherever_they_walk() -> None:
    """A person is turned about up and moved: the width stays."""
    width, forward = 0.17, 0.4
    left, right = np.eye(4), np.eye(4)
    right[:3, 3] = [forward, -width, 0.0]  # walking east, the right foot is to the south
    at_foot, ahead = np.zeros(3), np.array([forward, 0.0, 0.0])
    for angle in (0.0, 1.0, -2.5):
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = yaw_rotation(angle), [5.0, -3.0, 1.0]
        residual = BesideEachOther(at_foot, ahead, np.array([0.0, 1.0, 0.0]), np.eye(3))
        e = residual.evaluate([frame @ right, frame @ left, np.array([width])], False)[0]
        np.testing.assert_allclose(e, 0.0, atol=1e-12)
        # Swapped feet are beside each other by the opposite width.
        swapped = BesideEachOther(ahead, at_foot, np.array([0.0, 1.0, 0.0]), np.eye(3))
        e = swapped.evaluate([frame @ left, frame @ right, np.array([-width])], False)[0]
        np.testing.assert_allclose(e, 0.0, atol=1e-12)


@pytest.mark.parametrize(("apart", "sigmas"), [(0.3, 0.0), (1.5, 3.0)])
def test_standing_feet_are_pulled_together_from_beyond_reach_alone(apart: float, sigmas: float) -> None:
    one, other = np.eye(4), np.eye(4)
    other[:3, 3] = apart * np.array([0.6, 0.0, 0.8])
    assert WithinReach(np.array(1.2), np.array(0.1)).evaluate([one, other], False)[0] == pytest.approx(sigmas)
