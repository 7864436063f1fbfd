"""Dead reckoning that stops at every node: near enough for Gauss-Newton."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.detection.stance import Stances
from fg_nav.frames import GRAVITY_M_S2, compute_heading, level_attitude
from fg_nav.recording import Recording
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


def test_behind_a_hole_the_foot_is_tilted_as_its_force_says() -> None:
    """It stands, is not seen for half a minute, and is put down 20 degrees from where it was."""
    late, tilt = np.arange(2000) >= 1000, Rotation.from_euler("x", 20.0, degrees=True).as_matrix()
    acc = GRAVITY_M_S2 * np.where(late[:, None], tilt[2], [0.0, 0.0, 1.0])
    recording = Recording(t=np.arange(2000) / 100.0 + 30.0 * late, acc=acc, gyr=np.zeros((2000, 3)))
    stances = Stances.from_mask(np.abs(np.arange(2000) - 1000) > 10)
    nodes = place_nodes(recording, stances, DEFAULT)
    values = initial_values(recording, stances, nodes, np.eye(3), np.zeros(3), GRAVITY_M_S2)
    attitude = node_arrays(nodes, values)[2]
    np.testing.assert_allclose(attitude[:, 2], acc[nodes.sample] / GRAVITY_M_S2, atol=0.01)
