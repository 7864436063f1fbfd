"""Links and the chain: rotations, means and derivatives against differences; the rows; and a dense solution."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fg_nav.factors.rotation import rotation_exp
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
    REST_LINKS,
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
from tests.pocket.leg import BIAS as LEG_BIAS
from tests.pocket.leg import MUNICH, NOISE, resting, walking


@pytest.fixture(scope="module")
def leg():
    return walking(12.0)


@pytest.fixture(scope="module")
def exact(leg):
    return leg.recording(bias=np.zeros(3))


def links_of(recording, bias=np.zeros(3)):
    node = place_nodes(recording.t, NODE_S)
    return node, preintegrate_links(node, recording.t, recording.acc, recording.gyr - bias, recording.mag)


def test_nodes_are_where_they_should_be_and_the_last_sample_is_one():
    t = np.delete(np.arange(1234) * 0.01, slice(301, 330))
    node = place_nodes(t, 0.5)
    assert (node[0], node[-1]) == (0, len(t) - 1)
    at = t[node[:-1]]
    off = at - 0.5 * np.round(at / 0.5)
    assert np.abs(off[at != 3.3]).max() < 1e-9  # within the gap the first one after it


def test_turns_and_fields_without_errors_are_those_of_the_leg_and_rows_without_a_field_are_left_out(leg, exact):
    node, links = links_of(exact)
    R = leg.attitude[node]
    field = np.swapaxes(R[:-1], 1, 2) @ MUNICH
    assert np.allclose(np.swapaxes(R[:-1], 1, 2) @ R[1:], links.turn, atol=1e-12)
    assert np.allclose(links.h, np.diff(node) * leg.h)
    assert np.allclose(links.field, field, atol=1e-9)
    assert np.allclose(links.strength, np.linalg.norm(MUNICH))
    assert (links.n_fields == np.diff(node)).all()
    assert not links_of(replace(exact, mag=None))[1].n_fields.any()
    mag = exact.mag.copy()
    mag[::3] = mag[200:260] = np.nan
    mag[260:320] = 0.0
    links = links_of(replace(exact, mag=mag))[1]
    assert (links.n_fields[4:6] == 0).all()
    assert np.isnan(links.strength[4:6]).all()
    full = links.n_fields > 0
    assert np.allclose(links.field[full], field[full], atol=1e-9)


@pytest.mark.parametrize("error", range(12))
def test_errors_of_the_gyroscope_change_a_link_and_its_field_as_the_derivatives_say(exact, error):
    """Bias (3) and scale (9), by differences."""
    step = 1e-5 if error < 3 else 1e-4
    d = step * np.eye(12)[error]
    (_, links), (_, more), (_, less) = (
        links_of(replace(exact, gyr=exact.gyr @ (np.eye(3) - sign * d[3:].reshape(3, 3)).T), sign * d[:3])
        for sign in (0, 1, -1)
    )
    turned = np.swapaxes(less.turn, 1, 2) @ more.turn
    rate = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1) / (2 * step)
    assert np.allclose(rate, links.per_sensor[:, :, error], atol=1e-4)
    for name in ("delta_v", "delta_p"):
        change = (getattr(more, name) - getattr(less, name)) / (2 * step)
        assert np.allclose(change, getattr(links, f"{name}_per_sensor")[:, :, error], rtol=0.025, atol=0.02)
    if error < 3:  # z = dR y turns by K about itself: -[z]x K, as long as all of a link's y are alike
        change = (more.field - less.field) / (2 * step)
        assert np.allclose(change, -np.cross(links.field, links.lever[:, :, error]), atol=0.02)
        assert np.abs(change).max() > 1.0


def test_a_constant_rate_and_force_gain_what_they_should():
    """A force that is constant in nav, seen by a body that turns: its velocity comes out whole."""
    n, h, rate = 100, 0.01, np.array([0.3, -2.0, 1.0])
    R = rotation_exp(rate * ((np.arange(20 * n) + 0.5) * h / 20)[:, None])
    force = np.array([1.0, 2.0, 9.0])
    body = np.einsum("nji,j->ni", R, force).reshape(n, 20, 3).mean(axis=1)
    acc, gyr = np.concatenate([body, body[-1:]]), np.tile(rate, (n + 1, 1))
    links = preintegrate_links(np.array([0, n]), np.arange(n + 1) * h, acc, gyr, None)
    assert np.allclose(links.delta_v[0], force * n * h, atol=1e-3)
    assert np.allclose(links.delta_p[0], force * (n * h) ** 2 / 2, atol=1e-3)


def test_rest_is_seen_in_the_links_and_not_what_sways():
    """0.2 deg/s to and fro within some seconds, as a standing thigh does: quiet, but no rest."""
    recording = resting(60.0).recording(sigma=NOISE)
    _, links = links_of(recording)
    assert np.allclose(links.rate, LEG_BIAS, atol=NOISE[0] / np.sqrt(25) * 5)
    for spread, sigma in ((links.rate_spread, NOISE[0]), (links.force_spread, NOISE[1])):
        assert np.allclose(spread, sigma * np.sqrt(3), rtol=0.5)
    assert np.isfinite(detect_rests(links).variance).sum() == len(links.h) - REST_LINKS + 1
    sway = np.radians(0.2) * np.sin(2 * np.pi * recording.t / 3.0)
    _, links = links_of(replace(recording, gyr=recording.gyr + sway[:, None]))
    assert not np.isfinite(detect_rests(links).variance).any()


# the chain

P = PocketSmootherParameters(latitude_deg=48.0, bias_returns_to_zero=True)
UNITS = np.repeat([1e-2, 1e-3, 1.0, 0.5], [3, 12, 6, 6])  # Of x: rad, rad/s and parts, uT, m and m/s.


@pytest.fixture(scope="module")
def problem():
    """A short walk, nodes that are off by a little, and all there is between them."""
    leg = walking(4.0, still_s=0.2)
    _, links = links_of(leg.recording(sigma=NOISE), np.array([1e-3, -2e-3, 5e-4]))
    rests = detect_rests(links)
    rests.variance[3] = 1e-6  # one that is said to be
    rests.rate[3] = [2e-3, 0.0, -1e-3]
    prior = build_prior(PocketStart(leg.attitude[0], 0.01, 0.02), links, P)
    nodes, rng = predict_nodes(prior, links), np.random.default_rng(3)
    return SimpleNamespace(
        links=links,
        noise=build_noise(P),
        prior=prior,
        rests=rests,
        variances=initialize_variances(estimate_field_walk(links, P.mag_sigma_uT), links),
        nodes=inject_correction(nodes, UNITS * rng.standard_normal((len(nodes.b), SIZE))),
    )


def one(nodes, k, x):
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
