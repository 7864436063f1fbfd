"""Nodes where the foot stands, their ties, and dead reckoning between them, near enough for Gauss-Newton."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.detection.stance import Stances
from fg_nav.factors.zero_velocity import StanceVelocity
from fg_nav.frames import GRAVITY_M_S2, UNKNOWN_RAD, compute_heading, level_attitude
from fg_nav.recording import Recording
from fg_nav.smoother import SmootherParameters, strides
from fg_nav.smoother.graph import dense_trajectory, initial_values
from fg_nav.smoother.solver import list_poses
from fg_nav.smoother.strides import place_nodes
from tests.simulated import LEVER, RIGID
from tests.smoother.walks import DEFAULT, Walk, degrees_between, demo, noise_free

RATE = 200.0


def walk_with(lengths: list[tuple[int, int]], seed: int, one_footfall: bool = False) -> tuple[Recording, Stances]:
    """Stances of some samples, each after a swing of some samples, in a recording that is nothing but noise."""
    gaps, stands = np.array(lengths).T
    start = np.cumsum(gaps) + np.concatenate([[0], np.cumsum(stands)[:-1]])
    stop = start + stands
    n = int(stop[-1]) + 20
    rng = np.random.default_rng(seed)
    recording = Recording(t=np.arange(n) / RATE, acc=np.tile([0.0, 0.0, 9.8], (n, 1)), gyr=rng.standard_normal((n, 3)))
    footfall = np.zeros(len(start), dtype=np.int64) if one_footfall else np.arange(len(start))
    return recording, Stances(start, stop, footfall, n)


some_stances = st.lists(st.tuples(st.integers(1, 80), st.integers(1, 500)), min_size=1, max_size=6)


@settings(max_examples=60, deadline=None)
@given(lengths=some_stances, seed=st.integers(0, 99), one=st.booleans(), node_s=st.sampled_from([0.05, 0.1, 0.4]))
def test_nodes_stand_in_order_in_their_stances_neither_close_nor_far_and_on_the_stillest_sample_of_each_footfall(
    lengths: list[tuple[int, int]], seed: int, one: bool, node_s: float
) -> None:
    recording, stances = walk_with(lengths, seed, one)
    nodes = strides.place_nodes(recording, stances, replace(DEFAULT, node_spacing_s=node_s))
    assert np.all(np.diff(nodes.sample) > 0)
    assert np.all((stances.start[nodes.interval] <= nodes.sample) & (nodes.sample < stances.stop[nodes.interval]))
    assert set(nodes.interval) == set(range(len(stances)))
    np.testing.assert_array_equal(nodes.footfall, stances.footfall[nodes.interval])
    np.testing.assert_array_equal(nodes.footfall[nodes.first[:-1]], np.arange(stances.n_footfalls))
    assert nodes.first[-1] == len(nodes)
    np.testing.assert_array_equal(nodes.sample[nodes.result], stances.stillest(recording.gyr))
    for k in range(len(stances)) if not one else ():
        step = np.diff(recording.t[nodes.sample[nodes.interval == k]])
        duration = recording.t[stances.stop[k] - 1] - recording.t[stances.start[k]]
        spacing = node_s if duration <= strides.LONG_STANCE_S else strides.REST_SPACING_S
        assert np.all(step >= DEFAULT.shortest_interval_s - 1e-9)
        assert np.all(step <= 1.5 * spacing + 2 / RATE)  # the node on the stillest sample was moved by half a step


SOFT = replace(DEFAULT, settling_m=0.0015)  # On a sole that is expected to give way by 1.5 mm.


def ties_of(walk: Walk, p: SmootherParameters = SOFT) -> tuple[strides.Nodes, StanceVelocity]:
    """Nodes of a walk without a gyro bias, and what is expected of their velocities."""
    nodes = strides.place_nodes(walk.recording, walk.stances, p)
    return nodes, strides.measure_velocities(walk.recording, walk.stances, nodes, np.zeros(3), np.array(LEVER), p)


def roll(walk: Walk, nodes: strides.Nodes, ties: StanceVelocity) -> tuple[Floats, Floats, Floats]:
    """Nodes (K,) inside a stance of the walk, their expected velocity by rolling, and the true one (K, 3) m/s, nav."""
    same, truth = np.diff(nodes.interval) == 0, walk.recording.truth
    inside = np.append(same, False) & np.insert(same, 0, False)
    inner = np.flatnonzero(inside & (nodes.interval > 0) & (nodes.interval < nodes.interval[-1]))
    sample = nodes.sample[inner]
    velocity = np.gradient(truth.position, truth.t, axis=0, edge_order=2)[sample]
    return inner, np.einsum("nij,nj->ni", truth.nav_R_body[sample], ties.body_velocity[inner]), velocity


def test_lever_says_how_a_rolling_foot_moves() -> None:
    walk = noise_free(RIGID)
    inner, rolling, velocity = roll(walk, *ties_of(walk, replace(DEFAULT, node_spacing_s=0.05)))
    assert len(inner) > 50
    assert np.linalg.norm(rolling, axis=1).max() > 0.03
    # a node's rate is the mean about it, and changes in a landing and a lifting foot
    np.testing.assert_allclose(rolling, velocity, atol=1.5e-3)
    assert np.sqrt(np.mean((rolling - velocity) ** 2)) < 4e-4


def test_sole_sinks_in_a_stance_of_the_walk_and_not_in_a_rest() -> None:
    walk = noise_free()
    nodes, ties = ties_of(walk)
    inner, rolling, velocity = roll(walk, nodes, ties)
    rest = np.isin(nodes.interval, [0, nodes.interval[-1]])
    assert np.all(ties.settling[~rest, 2] < 0)
    assert not ties.settling[rest].any()
    assert not ties.settling[:, :2].any()
    assert 0.5 < ties.settling[inner, 2].mean() / (velocity - rolling)[:, 2].mean() < 2.0


def test_a_sole_settles_once_in_a_footfall_though_its_stance_is_in_pieces() -> None:
    walk = demo()
    s = walk.stances
    k = int(np.argmax((s.stop - s.start > 60) & (s.footfall > 0)))  # a stance of the walk, torn in its middle
    middle = int(s.start[k] + s.stop[k]) // 2
    torn = replace(
        s,
        start=np.insert(s.start, k + 1, middle + 10),
        stop=np.insert(s.stop, k, middle - 10),
        footfall=np.insert(s.footfall, k, s.footfall[k]),
    )
    (nodes, whole), (more, pieces) = (ties_of(Walk(walk.recording, stances)) for stances in (s, torn))
    footfall = s.footfall[k]
    per_m = whole.sinks_per_m[nodes.footfall == footfall][0]
    np.testing.assert_allclose(pieces.sinks_per_m[more.footfall == footfall], per_m)
    np.testing.assert_allclose(pieces.settling[more.footfall == footfall, 2], -SOFT.settling_m * per_m)


def test_velocities_are_firm_where_the_foot_is_still() -> None:
    """Three stances between swings: still, turning at 0.5 rad/s, pushed at 0.5 m/s^2 off gravity."""
    n, stances = 500, Stances.from_mask(np.isin(np.arange(500) // 100, [0, 2, 4]))
    acc, gyr = np.tile([0.0, 0.0, GRAVITY_M_S2], (n, 1)), np.zeros((n, 3))
    gyr[100:200, 1] = gyr[300:400, 1] = 4.0
    gyr[200:300, 1] = 0.5
    acc[400:, 2] += 0.5
    recording = Recording(t=np.arange(n) / 200.0, acc=acc, gyr=gyr)
    nodes, ties = ties_of(Walk(recording, stances), DEFAULT)
    sigma, p = ties.sigma, DEFAULT
    expected = np.hypot(strides.VELOCITY_SIGMA, np.array([0.0, 0.5 * p.roll_sigma_m, 0.5 * p.unsteady_s]))
    np.testing.assert_allclose(sigma[:, :2], np.repeat(expected[nodes.interval][:, None], 2, axis=1), rtol=1e-9)
    sinking = p.settling_sigma_m / (99 / 200)  # how deep a sole sinks is not known
    np.testing.assert_allclose(sigma[:, 2], np.hypot(sigma[:, 0], sinking), rtol=1e-6)


def test_over_a_hole_a_person_goes_on_and_the_field_shows_part_of_the_turn() -> None:
    """A level sensor is put down tilted and turned by 50 degrees; what was read next to each node counts."""
    tilt, turn = Rotation.from_euler("x", 12.0, degrees=True), Rotation.from_euler("z", 50.0, degrees=True)
    behind, field = (turn * tilt).as_matrix(), np.array([0.0, 20.0, -43.0])
    for hole_s in (0.6, 20.0):
        late = np.arange(400) >= 200
        t = np.arange(400) / 200.0 + hole_s * late
        acc, mag = (np.where(late[:, None], behind.T @ v, v) for v in (np.array([0.0, 0.0, GRAVITY_M_S2]), field))
        recording = Recording(t=t, acc=acc, gyr=np.zeros((400, 3)), mag=mag)
        found = strides.find_unseen_walks(recording, np.array([10, 150, 199, 200, 390]))
        np.testing.assert_array_equal(found.unseen, [False, False, True, False])
        np.testing.assert_allclose(found.body_up[2], acc[200], atol=1e-9)
        elapsed = hole_s + 0.005
        sigma = min(strides.TURNING_RAD * np.sqrt(elapsed), UNKNOWN_RAD)
        share = sigma**2 / (sigma**2 + strides.FIELD_SIGMA_RAD**2)
        assert found.walk.turn[2] == pytest.approx(share * np.radians(50.0), rel=1e-6)
        assert found.walk.turn_sigma[2] == pytest.approx(sigma)
        np.testing.assert_allclose(
            found.walk.move_sigma[2] / strides.walk_for(elapsed), [1.0, 1.0, strides.CLIMBING_M_S]
        )
        assert not strides.find_unseen_walks(recording, np.array([199, 200]), with_compass=False).walk.turn.any()
    assert strides.walk_for(np.array(1e-3)) == pytest.approx(1e-3, rel=1e-4)  # straight on at first,
    assert strides.walk_for(np.array(1e5)) == pytest.approx(
        np.sqrt(2.0 * strides.STRAIGHT_S * 1e5), rel=1e-2
    )  # a random walk later


# --- dead reckoning that stops at every node


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


def dense(recording: Recording, states, *biases: np.ndarray):
    biases = np.repeat(biases or np.zeros((2, 3)), len(SAMPLE), axis=0).reshape(2, -1, 3)
    return dense_trajectory(recording, SAMPLE, *states, *biases, GRAVITY_M_S2)


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


def test_biases_are_taken_off(recording: Recording, truth) -> None:
    """But for the hundredths of a millimetre by which a bias changes coning and sculling."""
    gyro, acc = np.array([0.01, -0.02, 0.03]), np.array([0.1, 0.2, -0.3])
    biased = replace(recording, acc=recording.acc + acc, gyr=recording.gyr + gyro)
    found = dense(biased, [states[SAMPLE] for states in truth], gyro, acc)
    for integrated, dense_states in zip(truth, found, strict=True):
        np.testing.assert_allclose(dense_states, integrated, atol=5e-5)


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
