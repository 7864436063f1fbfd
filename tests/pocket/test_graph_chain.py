"""The chain: its rows against differences, gtsam's factor and a dense solution."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, X
from scipy.spatial.transform import Rotation

from fg_nav.factors.rotation import rotation_exp
from fg_nav.pocket import PocketGraphParameters, PocketStart
from fg_nav.pocket.graph_chain import (
    BIAS,
    BODY,
    FIELD,
    PLACE,
    REGION,
    SCALE,
    SENSOR,
    SIZE,
    VELOCITY,
    Nodes,
    _between,
    field_rows,
    solve,
)
from fg_nav.pocket.graph_field import walk_of_strength
from fg_nav.pocket.graph_links import links_between, node_samples
from fg_nav.pocket.graph_motion import rests_of
from fg_nav.pocket.graph_solution import beliefs_of, factors_of, moved, predicted, prior_of, unweighed
from tests.pocket.leg import walking

P = PocketGraphParameters(latitude_deg=48.0, bias_returns_to_zero=True)
NOISE = (np.radians(0.1), 0.03, 0.5)
UNITS = np.repeat([1e-2, 1e-3, 1.0, 0.5], [3, 12, 6, 6])
"""Of x: rad, rad/s and parts, uT, m and m/s."""


class Problem:
    """A short walk, nodes that are off by a little, and all there is between them."""

    def __init__(self, seconds=4.0):
        leg = walking(seconds, still_s=0.2)
        recording = leg.recording(sigma=NOISE)
        node = node_samples(recording.t, P.node_s)
        r = recording
        self.bias0 = np.array([1e-3, -2e-3, 5e-4])
        self.links = links_between(node, r.t, r.acc, r.gyr, r.mag, self.bias0)
        self.beliefs = beliefs_of(P, self.bias0)
        self.prior = prior_of(PocketStart(leg.attitude[0], 0.01, 0.02), self.links, P)
        walk = walk_of_strength(self.links, P)
        rests = rests_of(self.links, P)
        rests.variance[3] = 1e-6  # one that is said to be
        rests.rate[3] = [2e-3, 0.0, -1e-3]
        self.factors = factors_of(self.links, P, unweighed(walk, self.links, P), rests)
        nodes = predicted(self.prior, self.links, self.beliefs)
        rng = np.random.default_rng(3)
        self.nodes = moved(nodes, UNITS * rng.standard_normal((len(nodes.b), SIZE)))


@pytest.fixture(scope="module")
def problem():
    return Problem()


def one(nodes, k, x):
    """Nodes with the k-th changed by x (27,)."""
    all_x = np.zeros((len(nodes.b), SIZE))
    all_x[k] = x
    return moved(nodes, all_x)


def differences(of, step=1e-6):
    return np.stack([(of(step * e) - of(-step * e)) / (2 * step) for e in np.eye(SIZE)], axis=-1)


def test_rows_of_a_field_are_its_derivatives(problem):
    q, H = problem, np.zeros((3, SIZE))
    rows = differences(lambda x: -field_rows(2, one(q.nodes, 2, x), q.factors, q.beliefs, np.zeros((3, SIZE))))
    field_rows(2, q.nodes, q.factors, q.beliefs, H)
    assert np.allclose(rows, H, atol=1e-5)
    assert np.abs(H[:, BIAS:SCALE]).max() > 5.0
    assert np.abs(H[:, SCALE:FIELD]).max() > 5.0


def test_the_step_from_node_to_node_is_its_derivative(problem):
    q, k = problem, 1

    def ahead(x):
        offset, _ = _between(k, one(q.nodes, k, x), q.factors, q.beliefs, np.zeros((SIZE, SIZE)))
        return offset

    F = np.zeros((SIZE, SIZE))
    _, noise = _between(k, q.nodes, q.factors, q.beliefs, F)
    # the offset of the attitude is a logarithm about 0.01 rad, whose derivative is the identity but for half of that
    assert np.allclose(differences(ahead), F, atol=0.02)
    # what the errors do to the attitude is in the way gone, to second order with the turn
    assert np.allclose(differences(ahead)[BIAS:], F[BIAS:], atol=1e-4)
    assert np.abs(F[VELOCITY:PLACE, :3]).max() > 4.0  # half a second of gravity
    constant = np.r_[SCALE:FIELD, REGION:VELOCITY]
    assert (np.delete(noise, constant) > 0).all()
    assert not noise[constant].any()


def test_the_step_of_the_attitude_is_gtsam_s_factor(problem):
    """AHRSFactor: the residual, up to its frame, and its derivative by the bias."""
    q, k, h = problem, 1, problem.links.h[1]
    parameters = gtsam.PreintegratedRotationParams()
    parameters.setGyroscopeCovariance(np.eye(3))
    measured = gtsam.PreintegratedAhrsMeasurements(
        parameters, q.bias0, h, gtsam.Rot3(q.links.turn[k]), q.links.per_sensor[k, :, :3], np.eye(3)
    )
    factor = gtsam.AHRSFactor(X(0), X(1), B(0), measured)
    values = gtsam.Values()
    values.insert(X(0), gtsam.Rot3(q.nodes.R[k]))
    values.insert(X(1), gtsam.Rot3(q.nodes.R[k + 1]))
    values.insert(B(0), q.nodes.b[k])
    F = np.zeros((SIZE, SIZE))
    still = q.beliefs._replace(earth_rate=np.zeros(3))
    y = q.nodes.y.copy()
    y[:, SCALE - 3 : FIELD - 3] = 0.0  # theirs knows no scale
    nodes = Nodes(q.nodes.R, y)
    offset, _ = _between(k, nodes, q.factors, still, F)
    # theirs is Log(R_1^T predicted) or its inverse, in the body; ours Log(R_1 predicted^T) in nav
    theirs = factor.unwhitenedError(values)
    ours = q.nodes.R[k + 1].T @ -offset[:3]
    assert min(np.abs(theirs - ours).max(), np.abs(theirs + ours).max()) < 1e-9
    by_bias = []
    for e in np.eye(3):
        values.update(B(0), q.nodes.b[k] + 1e-6 * e)
        more = factor.unwhitenedError(values)
        values.update(B(0), q.nodes.b[k] - 1e-6 * e)
        by_bias.append((more - factor.unwhitenedError(values)) / 2e-6)
    mine = q.nodes.R[k + 1].T @ F[:3, BIAS:SCALE]
    theirs = np.stack(by_bias, axis=1)
    assert min(np.abs(theirs - mine).max(), np.abs(theirs + mine).max()) < 0.02 * np.abs(mine).max()


def test_the_chain_is_the_dense_least_squares_solution(problem):
    """All rows in one matrix, whitened; variances of steps that are zero are 1e-12 of the prior's."""
    q = problem
    n = len(q.nodes.b)
    x0 = np.concatenate([np.zeros(3), q.prior.y - q.nodes.y[0]])
    solved = solve(q.nodes, q.factors, q.beliefs, x0, q.prior.P)
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
            offset, noise = _between(k, q.nodes, q.factors, q.beliefs, F)
            noise = np.maximum(noise, 1e-8 * UNITS**2)
            add(k + 1, np.eye(SIZE), offset, noise, k, -F)
        unit, y = np.eye(SIZE), q.nodes.y[k]
        add(k, unit[PLACE:BODY], -y[PLACE - 3 : BODY - 3], q.factors.swing[k])
        if np.isfinite(q.factors.rest[k]):
            rate = q.factors.rate[k] - q.nodes.R[k].T @ q.beliefs.earth_rate
            add(k, unit[BIAS:SCALE], rate - y[:3], q.factors.rest[k])
            add(k, unit[VELOCITY:PLACE], -y[VELOCITY - 3 : PLACE - 3], q.beliefs.rest_velocity)
        if q.factors.samples[k] > 0:
            z = field_rows(k, q.nodes, q.factors, q.beliefs, H)
            walked = q.factors.walk[min(k, n - 2)] / 3  # mean of a walk over its link, against its start
            add(k, H.copy(), z, q.beliefs.mag / q.factors.samples[k] + q.beliefs.mag_left + walked)
            tie = np.zeros((3, SIZE))
            tie[:, FIELD:REGION], tie[:, REGION:VELOCITY] = np.eye(3), -np.eye(3)
            add(k, tie, -tie[:, 3:] @ y, q.factors.deviation[k])
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
    mean = q.nodes.m[1] - q.nodes.m[0] + d @ x
    assert solved.step_square[0] == pytest.approx((mean**2).sum() + np.trace(d @ covariance @ d.T), rel=1e-3)


def test_nodes_without_any_error_want_no_change():
    leg = walking(4.0, still_s=0.2)
    recording = leg.recording(bias=np.zeros(3))
    node = node_samples(recording.t, P.node_s)
    p = PocketGraphParameters()
    links = links_between(node, recording.t, recording.acc, recording.gyr, recording.mag, np.zeros(3))
    beliefs, prior = beliefs_of(p, np.zeros(3)), prior_of(PocketStart(leg.attitude[0], 0.01), links, p)
    factors = factors_of(links, p, unweighed(walk_of_strength(links, p), links, p), rests_of(links, p))
    solved = solve(predicted(prior, links, beliefs), factors, beliefs, np.zeros(SIZE), prior.P)
    assert np.abs(solved.x[:, :3]).max() < 1e-4
    assert np.abs(solved.x[:, SENSOR]).max() < 1e-5
    assert Rotation.from_matrix(rotation_exp(solved.x[:, :3])).magnitude().max() < 1e-4
