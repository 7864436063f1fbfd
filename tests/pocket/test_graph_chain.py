"""The chain: its rows against differences, gtsam's factor and a dense solution."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, X
from scipy.spatial.transform import Rotation

from factors.rotation import rotation_exp
from fg_nav.pocket import PocketGraphParameters, PocketStart
from fg_nav.pocket.graph_chain import BIAS, FIELD, REGION, SIZE, _between, field_rows, gravity_rows, solve
from fg_nav.pocket.graph_field import walk_of_strength
from fg_nav.pocket.graph_links import links_between, node_samples
from fg_nav.pocket.graph_solution import beliefs_of, factors_of, moved, predicted, prior_of, unweighed
from fg_nav.pocket.gravity_force import gravity_of
from tests.pocket.leg import walking

P = PocketGraphParameters(latitude_deg=48.0, bias_returns_to_zero=True)
NOISE = (np.radians(0.1), 0.03, 0.5)


class Problem:
    """A short walk, nodes that are off by a little, and all there is between them."""

    def __init__(self, seconds=4.0):
        leg = walking(seconds, still_s=0.2)
        recording = leg.recording(sigma=NOISE)
        node = node_samples(recording.t, P.node_s)
        r = recording
        self.bias0 = np.array([1e-3, -2e-3, 5e-4])
        self.links = links_between(node, r.t, r.acc, r.gyr, r.mag, P.mag_sigma_uT, self.bias0)
        self.beliefs = beliefs_of(P, self.bias0)
        self.prior = prior_of(PocketStart(leg.attitude[0], 0.01, 0.02), self.links, P)
        walk = walk_of_strength(self.links, P)
        self.factors = factors_of(self.links, P, unweighed(walk, self.links, P), gravity_of(self.links, P))
        nodes = predicted(self.prior, self.links, self.beliefs)
        rng = np.random.default_rng(3)
        scale = np.repeat([0.01, 1e-3, 1.0, 1.0], 3)
        self.nodes = moved(nodes, scale * rng.standard_normal((len(nodes.b), SIZE)))


@pytest.fixture(scope="module")
def problem():
    return Problem()


def one(nodes, k, x):
    """Nodes with the k-th changed by x (12,)."""
    all_x = np.zeros((len(nodes.b), SIZE))
    all_x[k] = x
    return moved(nodes, all_x)


def differences(of, step=1e-6):
    return np.stack([(of(step * e) - of(-step * e)) / (2 * step) for e in np.eye(SIZE)], axis=-1)


def test_rows_of_a_field_are_its_derivatives(problem):
    q, H = problem, np.zeros((3, SIZE))
    rows = differences(lambda x: -field_rows(2, one(q.nodes, 2, x), q.factors, q.beliefs, np.zeros((3, SIZE))))
    field_rows(2, q.nodes, q.factors, q.beliefs, H)
    # z hardly hangs on the bias to second order, [z]x K
    assert np.allclose(rows[:, FIELD:], H[:, FIELD:], atol=1e-6)
    assert np.allclose(rows[:, :BIAS], H[:, :BIAS], atol=1e-4)
    assert np.allclose(rows[:, BIAS:FIELD], H[:, BIAS:FIELD], atol=1e-4)
    assert np.abs(H[:, BIAS:FIELD]).max() > 5.0


def test_rows_of_gravity_are_its_derivatives(problem):
    q, H = problem, np.zeros((3, SIZE))
    k = int(np.flatnonzero(np.isfinite(q.factors.force_variance))[0])
    rows = differences(lambda x: -gravity_rows(k, one(q.nodes, k, x), q.factors, q.beliefs, np.zeros((3, SIZE))))
    gravity_rows(k, q.nodes, q.factors, q.beliefs, H)
    assert np.allclose(rows, H, atol=1e-6)


def test_the_step_from_node_to_node_is_its_derivative(problem):
    q, k = problem, 1

    def ahead(x):
        offset, _ = _between(k, one(q.nodes, k, x), q.factors, q.beliefs, np.zeros((SIZE, SIZE)))
        return offset

    F = np.zeros((SIZE, SIZE))
    _, noise = _between(k, q.nodes, q.factors, q.beliefs, F)
    # the offset of the attitude is a logarithm about 0.01 rad, whose derivative is the identity but for half of that
    assert np.allclose(differences(ahead), F, atol=0.02)
    assert np.allclose(differences(ahead)[BIAS:], F[BIAS:], atol=1e-8)
    assert (noise[:REGION] > 0).all()
    assert not noise[REGION:].any()


def test_the_step_of_the_attitude_is_gtsam_s_factor(problem):
    """AHRSFactor: the residual, up to its frame, and its derivative by the bias."""
    q, k, h = problem, 1, problem.links.h[1]
    parameters = gtsam.PreintegratedRotationParams()
    parameters.setGyroscopeCovariance(np.eye(3))
    measured = gtsam.PreintegratedAhrsMeasurements(
        parameters, q.bias0, h, gtsam.Rot3(q.links.turn[k]), q.links.per_bias[k], np.eye(3)
    )
    factor = gtsam.AHRSFactor(X(0), X(1), B(0), measured)
    values = gtsam.Values()
    values.insert(X(0), gtsam.Rot3(q.nodes.R[k]))
    values.insert(X(1), gtsam.Rot3(q.nodes.R[k + 1]))
    values.insert(B(0), q.nodes.b[k])
    F = np.zeros((SIZE, SIZE))
    still = q.beliefs._replace(earth_rate=np.zeros(3))
    offset, _ = _between(k, q.nodes, q.factors, still, F)
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
    mine = q.nodes.R[k + 1].T @ F[:3, BIAS:FIELD]
    theirs = np.stack(by_bias, axis=1)
    assert min(np.abs(theirs - mine).max(), np.abs(theirs + mine).max()) < 0.02 * np.abs(mine).max()


def test_the_chain_is_the_dense_least_squares_solution(problem):
    """All rows in one matrix, whitened; variances of steps that are zero are 1e-12 of the prior's."""
    q = problem
    n = len(q.nodes.b)
    x0 = np.concatenate([np.zeros(3), q.prior.b - q.nodes.b[0], q.prior.m - q.nodes.m[0], q.prior.E - q.nodes.E[0]])
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
            noise[REGION:] = 1e-8
            add(k + 1, np.eye(SIZE), offset, noise, k, -F)
        if np.isfinite(q.factors.force_variance[k]):
            z = gravity_rows(k, q.nodes, q.factors, q.beliefs, H)
            add(k, H[:2], z[:2], q.factors.force_variance[k])
        if q.factors.samples[k] > 0:
            z = field_rows(k, q.nodes, q.factors, q.beliefs, H)
            walked = q.factors.walk[min(k, n - 2)] / 3  # mean of a walk over its link, against its start
            add(k, H.copy(), z, q.beliefs.mag / q.factors.samples[k] + walked)
            tie = np.zeros((3, SIZE))
            tie[:, FIELD:REGION], tie[:, REGION:] = np.eye(3), -np.eye(3)
            add(k, tie, q.nodes.E[k] - q.nodes.m[k], q.factors.deviation[k])
            swing = np.zeros((3, SIZE))
            swing[:, BIAS:FIELD] = q.factors.swing[k, :, :3]
            off = q.nodes.b[k] - q.bias0
            add(k, swing, q.factors.swing[k, :, 3] - swing[:, BIAS:FIELD] @ off, 1.0 / q.factors.still[min(k, n - 2)])
    A, b = np.concatenate(rows), np.concatenate(right)
    unit = np.tile(np.repeat([1e-2, 1e-3, 1.0, 1.0], 3), n)
    R = np.linalg.qr(A * unit, mode="r")
    x = unit * np.linalg.lstsq(A * unit, b, rcond=None)[0]
    inverse = np.linalg.solve(R, np.eye(n * SIZE))
    covariance = unit[:, None] * (inverse @ inverse.T) * unit
    sigma = np.sqrt(np.diag(covariance)).reshape(n, SIZE)
    assert np.abs((solved.x - x.reshape(n, SIZE)) / sigma).max() < 1e-3
    blocks = np.stack([covariance[i : i + SIZE, i : i + SIZE] for i in range(0, n * SIZE, SIZE)])
    scale = sigma[:, :, None] * sigma[:, None, :]
    assert np.abs((solved.P - blocks) / scale).max() < 1e-3
    # the expected square of a step: mean and variance of m_1 - m_0 there
    d = np.zeros((3, n * SIZE))
    d[:, FIELD:REGION], d[:, SIZE + FIELD : SIZE + REGION] = -np.eye(3), np.eye(3)
    mean = q.nodes.m[1] - q.nodes.m[0] + d @ x
    assert solved.step_square[0] == pytest.approx((mean**2).sum() + np.trace(d @ covariance @ d.T), rel=1e-3)


def test_nodes_without_any_error_want_no_change():
    leg = walking(4.0, still_s=0.2)
    recording = leg.recording(bias=np.zeros(3))
    node = node_samples(recording.t, P.node_s)
    p = PocketGraphParameters()
    links = links_between(node, recording.t, recording.acc, recording.gyr, recording.mag, 0.5, np.zeros(3))
    beliefs, prior = beliefs_of(p, np.zeros(3)), prior_of(PocketStart(leg.attitude[0], 0.01), links, p)
    factors = factors_of(links, p, unweighed(walk_of_strength(links, p), links, p), gravity_of(links, p))
    solved = solve(predicted(prior, links, beliefs), factors, beliefs, np.zeros(SIZE), prior.P)
    assert np.abs(solved.x[:, :3]).max() < 1e-4
    assert np.abs(solved.x[:, BIAS:FIELD]).max() < 1e-5
    assert Rotation.from_matrix(rotation_exp(solved.x[:, :3])).magnitude().max() < 1e-4
