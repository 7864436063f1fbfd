"""The chain: its rows against differences, gtsam's factor and a dense solution."""

import numpy as np
import pytest

from fg_nav.pocket import PocketSmootherParameters, PocketStart
from fg_nav.pocket.iterated_smoother import (
    build_noise,
    build_prior,
    estimate_field_walk,
    initialize_variances,
    inject_correction,
    predict_nodes,
)
from fg_nav.pocket.kalman_smoother import (
    BIAS,
    BODY,
    FIELD,
    NODE_S,
    REGION,
    SCALE,
    SIZE,
    SWING,
    VELOCITY,
    detect_rests,
    linearize_field,
    linearize_transition,
    place_nodes,
    preintegrate_links,
    smooth_nodes,
)
from tests.pocket.leg import walking

P = PocketSmootherParameters(latitude_deg=48.0, bias_returns_to_zero=True)
NOISE = (np.radians(0.1), 0.03, 0.5)
UNITS = np.repeat([1e-2, 1e-3, 1.0, 0.5], [3, 12, 6, 6])  # Of x: rad, rad/s and parts, uT, m and m/s.


class Problem:
    """A short walk, nodes that are off by a little, and all there is between them."""

    def __init__(self, seconds=4.0):
        leg = walking(seconds, still_s=0.2)
        recording = leg.recording(sigma=NOISE)
        node = place_nodes(recording.t, NODE_S)
        r = recording
        self.bias0 = np.array([1e-3, -2e-3, 5e-4])
        self.links = preintegrate_links(node, r.t, r.acc, r.gyr - self.bias0, r.mag)
        self.noise = build_noise(P)
        self.prior = build_prior(PocketStart(leg.attitude[0], 0.01, 0.02), self.links, P)
        walk = estimate_field_walk(self.links, P.mag_sigma_uT)
        self.rests = detect_rests(self.links)
        self.rests.variance[3] = 1e-6  # one that is said to be
        self.rests.rate[3] = [2e-3, 0.0, -1e-3]
        self.variances = initialize_variances(walk, self.links)
        nodes = predict_nodes(self.prior, self.links)
        rng = np.random.default_rng(3)
        self.nodes = inject_correction(nodes, UNITS * rng.standard_normal((len(nodes.b), SIZE)))


@pytest.fixture(scope="module")
def problem():
    return Problem()


def one(nodes, k, x):
    """Nodes with the k-th changed by x (27,)."""
    all_x = np.zeros((len(nodes.b), SIZE))
    all_x[k] = x
    return inject_correction(nodes, all_x)


def differences(of, step=1e-6):
    return np.stack([(of(step * e) - of(-step * e)) / (2 * step) for e in np.eye(SIZE)], axis=-1)


def test_rows_of_a_field_are_its_derivatives(problem):
    q, H = problem, np.zeros((3, SIZE))
    rows = differences(lambda x: -linearize_field(2, one(q.nodes, 2, x), q.links, np.zeros((3, SIZE))))
    linearize_field(2, q.nodes, q.links, H)
    assert np.allclose(rows, H, atol=1e-5)
    assert np.abs(H[:, BIAS:SCALE]).max() > 5.0
    assert np.abs(H[:, SCALE:FIELD]).max() > 5.0


def test_the_step_from_node_to_node_is_its_derivative(problem):
    q, k = problem, 1

    def ahead(x):
        offset, _ = linearize_transition(k, one(q.nodes, k, x), q.links, q.variances, q.noise, np.zeros((SIZE, SIZE)))
        return offset

    F = np.zeros((SIZE, SIZE))
    _, variance = linearize_transition(k, q.nodes, q.links, q.variances, q.noise, F)
    # the offset of the attitude is a logarithm about 0.01 rad, whose derivative is the identity but for half of that
    assert np.allclose(differences(ahead), F, atol=0.02)
    # what the errors do to the attitude is in the way gone, to second order with the turn
    assert np.allclose(differences(ahead)[BIAS:], F[BIAS:], atol=1e-4)
    assert np.abs(F[VELOCITY:SWING, :3]).max() > 4.0  # half a second of gravity
    constant = np.r_[SCALE:FIELD, REGION:VELOCITY]
    assert (np.delete(variance, constant) > 0).all()
    assert not variance[constant].any()
    half = q.links._replace(h=q.links.h / 2)  # noises are densities: of rate and force, and of the place they move
    _, less = linearize_transition(k, q.nodes, half, q.variances, q.noise, np.zeros((SIZE, SIZE)))
    grown = [0, BIAS, VELOCITY, SWING]
    assert np.allclose(variance[grown] / less[grown], [2.0, 2.0, 2.0, 8.0])


def test_the_chain_is_the_dense_least_squares_solution(problem):
    """All rows in one matrix, whitened; variances of steps that are zero are 1e-12 of the prior's."""
    q = problem
    n = len(q.nodes.b)
    x0 = np.concatenate([np.zeros(3), q.prior.y - q.nodes.y[0]])
    solved = smooth_nodes(q.nodes, q.links, q.variances, q.rests, q.noise, x0, q.prior.P)
    rows, right = [], []

    def add(k, H, z, variance, k2=None, H2=None):
        whole = np.zeros((len(z), n * SIZE))
        whole[:, k * SIZE : (k + 1) * SIZE] = H
        if k2 is not None:
            whole[:, k2 * SIZE : (k2 + 1) * SIZE] = H2
        scale = 1.0 / np.sqrt(np.broadcast_to(variance, len(z)))
        rows.append(whole * scale[:, None])
        right.append(z * scale)

    add(0, np.eye(SIZE), x0, np.diag(q.prior.P))
    H = np.zeros((3, SIZE))
    for k in range(n):
        if k < n - 1:
            F = np.zeros((SIZE, SIZE))
            offset, variance = linearize_transition(k, q.nodes, q.links, q.variances, q.noise, F)
            variance = np.maximum(variance, 1e-8 * UNITS**2)
            add(k + 1, np.eye(SIZE), offset, variance, k, -F)
        unit, y = np.eye(SIZE), q.nodes.y[k]
        add(k, unit[SWING:BODY], -y[SWING - 3 : BODY - 3], q.variances.swing[k])
        if np.isfinite(q.rests.variance[k]):
            rate = q.rests.rate[k] - q.nodes.R[k].T @ q.noise.earth_rate
            add(k, unit[BIAS:SCALE], rate - y[:3], q.rests.variance[k])
            add(k, unit[VELOCITY:SWING], -y[VELOCITY - 3 : SWING - 3], q.noise.rest_velocity)
        if k < n - 1 and q.links.n_fields[k] > 0:
            z = linearize_field(k, q.nodes, q.links, H)
            walked = q.variances.step[k] / 3  # mean of a walk over its link, against its start
            add(k, H.copy(), z, q.noise.mag / q.links.n_fields[k] + q.noise.mag_left + walked)
            tie = np.zeros((3, SIZE))
            tie[:, FIELD:REGION], tie[:, REGION:VELOCITY] = np.eye(3), -np.eye(3)
            add(k, tie, -tie[:, 3:] @ y, q.variances.deviation[k])
    A, b = np.concatenate(rows), np.concatenate(right)
    unit = np.tile(UNITS, n)
    R = np.linalg.qr(A * unit, mode="r")
    x = unit * np.linalg.lstsq(A * unit, b, rcond=None)[0]
    inverse = np.linalg.solve(R, np.eye(n * SIZE))
    covariance = unit[:, None] * (inverse @ inverse.T) * unit
    sigma = np.sqrt(np.diag(covariance)).reshape(n, SIZE)
    assert np.abs((solved.x - x.reshape(n, SIZE)) / sigma).max() < 1e-3
    blocks = np.stack([covariance[i : i + SIZE, i : i + SIZE] for i in range(0, n * SIZE, SIZE)])
    scale = sigma[:, :, None] * sigma[:, None, :]
    assert np.abs((solved.P - blocks) / scale).max() < 1e-3
    # the expected squares: of a step, mean and variance of m_1 - m_0 there
    d = np.zeros((3, n * SIZE))
    d[:, FIELD:REGION], d[:, SIZE + FIELD : SIZE + REGION] = -np.eye(3), np.eye(3)
    mean = np.diff(q.nodes.y[:2, FIELD - 3 : REGION - 3], axis=0)[0] + d @ x
    assert solved.square.step[0] == pytest.approx((mean**2).sum() + np.trace(d @ covariance @ d.T), rel=1e-3)
