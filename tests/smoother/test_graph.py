"""Dead reckoning that stops at every node: near enough for Gauss-Newton."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.frames import GRAVITY_M_S2, compute_heading, level_attitude
from fg_nav.smoother.graph import initial_values
from fg_nav.smoother.strides import place_nodes
from tests.simulated import RIGID
from tests.smoother.walks import DEFAULT, Walk, degrees_between, node_arrays, noise_free


def started(walk: Walk, tilt_deg: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Errors of position (M,) m and attitude (M,) deg at the nodes, the first attitude tilted."""
    nodes = place_nodes(walk.recording, walk.stances, DEFAULT)
    truth = walk.recording.truth
    first = truth.nav_R_body[nodes.sample[0]]
    tilt = Rotation.from_euler("y", tilt_deg, degrees=True).as_matrix()
    start = level_attitude(tilt @ first[2], compute_heading(first))
    values = initial_values(walk.recording, walk.stances, nodes, start, np.zeros(3), GRAVITY_M_S2)
    position, velocity, attitude, gyro_bias, acc_bias = node_arrays(nodes, values)
    assert not velocity.any()
    assert not gyro_bias.any()
    assert not acc_bias.any()
    true_position = truth.position[nodes.sample] - truth.position[nodes.sample[0]]
    return np.linalg.norm(position - true_position, axis=1), degrees_between(attitude, truth.nav_R_body[nodes.sample])


@pytest.mark.parametrize(("rate_hz", "off_deg"), [(50.0, 8.0), (200.0, 5.0), (400.0, 5.0)])
def test_it_starts_within_degrees_and_per_cents(rate_hz: float, off_deg: float) -> None:
    """At 50 Hz a swinging foot turns by 10 degrees in a sample, and the coning within it adds up to degrees."""
    metres, degrees = started(noise_free(RIGID, rate_hz=rate_hz))
    assert metres.max() < 3.0
    assert degrees.max() < off_deg


@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_tilt_is_taken_off_while_the_foot_stands(rate_hz: float) -> None:
    """Three seconds of standing are twelve time constants, at any rate."""
    walk = noise_free(RIGID, rate_hz=rate_hz)
    (_, degrees), (_, level) = started(walk, tilt_deg=5.0), started(walk)
    assert degrees[0] == pytest.approx(5.0, abs=0.01)
    second = place_nodes(walk.recording, walk.stances, DEFAULT).first[1]
    assert degrees[second] == pytest.approx(level[second], abs=0.05)
