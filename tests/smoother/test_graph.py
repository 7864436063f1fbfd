"""Dead reckoning that stops at every node: near enough for Gauss-Newton."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.detection.stance import Stances
from fg_nav.frames import GRAVITY_M_S2, compute_heading, level_attitude
from fg_nav.recording import Recording
from fg_nav.smoother.graph import dense_trajectory, initial_values
from fg_nav.smoother.solver import list_poses
from fg_nav.smoother.strides import place_nodes
from tests.simulated import RIGID
from tests.smoother.walks import DEFAULT, Walk, degrees_between, noise_free


def started(walk: Walk, tilt_deg: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Errors of position (M,) m and attitude (M,) deg at the nodes, the first attitude tilted."""
    nodes = place_nodes(walk.recording, walk.stances, DEFAULT)
    truth = walk.recording.truth
    first = truth.nav_R_body[nodes.sample[0]]
    tilt = Rotation.from_euler("y", tilt_deg, degrees=True).as_matrix()
    start = level_attitude(tilt @ first[2], compute_heading(first))
    values = initial_values(walk.recording, walk.stances, nodes, start, np.zeros(3), GRAVITY_M_S2)
    pose, true = list_poses(range(len(nodes)), values), truth.position[nodes.sample] - truth.position[nodes.sample[0]]
    off = degrees_between(pose[:, :3, :3], truth.nav_R_body[nodes.sample])
    return np.linalg.norm(pose[:, :3, 3] - true, axis=1), off


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
    attitude = list_poses(range(len(nodes)), values)[:, :3, :3]
    np.testing.assert_allclose(attitude[:, 2], acc[nodes.sample] / GRAVITY_M_S2, atol=0.01)


# --- the dense trajectory


RATE = 200.0
SAMPLE = np.array([130, 150, 151, 420, 700, 1000, 1013, 1700])


@pytest.fixture(scope="module")
def recording() -> Recording:
    return noise_free(RIGID).recording.slice(400, 2400)


@pytest.fixture(scope="module")
def truth(recording: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and attitude by integration of the samples from the truth at the first one."""
    here = np.searchsorted(recording.truth.t, recording.t[:1])
    zero = np.zeros((1, 3))
    start = recording.truth.position[here], zero, recording.truth.nav_R_body[here]
    return dense_trajectory(recording, np.array([0]), *start, zero, zero, GRAVITY_M_S2)


def moved(truth, seed: int):
    """States at the nodes, each 2 cm, 2 cm/s and half a degree off the integrated ones."""
    rng, (p, v, R) = np.random.default_rng(seed), (states[SAMPLE] for states in truth)
    turn = Rotation.from_rotvec(np.radians(0.5) * rng.standard_normal((len(SAMPLE), 3))).as_matrix()
    shift, kick = 0.02 * rng.standard_normal((2, len(SAMPLE), 3))
    return p + shift, v + kick, R @ turn


def dense(recording: Recording, states):
    return dense_trajectory(recording, SAMPLE, *states, *np.zeros((2, len(SAMPLE), 3)), GRAVITY_M_S2)


def test_it_passes_through_every_node_and_velocity_is_the_derivative_of_position(recording: Recording, truth) -> None:
    """Over each period the path moves by the mean velocity, but for the change of acceleration in a period."""
    states = moved(truth, 2)
    found = dense(recording, states)
    for state, dense_state in zip(states, found, strict=True):
        np.testing.assert_allclose(dense_state[SAMPLE], state, atol=1e-9)
    p, v, _ = found
    missing = np.diff(p, axis=0) * RATE - 0.5 * (v[1:] + v[:-1])
    missing[150] = 0.0  # two nodes a period apart, 2 cm from where they should be: nothing lies between
    assert np.linalg.norm(missing, axis=1).max() < 0.006
    assert np.linalg.norm(v, axis=1).max() > 4.0


def test_corrections_are_smooth(recording: Recording, truth) -> None:
    """The path less the integrated one begins with nothing and grows without a step; so do velocity and attitude."""
    states, between = moved(truth, 5), slice(SAMPLE[3], SAMPLE[4] + 1)
    p, v, R = (one[between] for one in dense(recording, states))
    from_node = [state[3:4] for state in states]
    own = dense_trajectory(recording, SAMPLE[3:4], *from_node, *np.zeros((2, 1, 3)), GRAVITY_M_S2)
    shift, kick, turn = p - own[0][between], v - own[1][between], degrees_between(own[2][between], R)
    for correction in (shift, kick, turn[:, None]):
        size = np.linalg.norm(correction, axis=1)
        assert size[0] == pytest.approx(0.0, abs=1e-9)
        assert np.linalg.norm(np.diff(correction, axis=0), axis=1).max() < 6.0 * size.max() / len(size)
    # the correction of velocity is the derivative of that of position
    np.testing.assert_allclose(np.gradient(shift, 1 / RATE, axis=0)[1:-1], kick[1:-1], atol=1e-4)
