"""Links: rotations, their derivative by the bias, means of fields and forces, against differences and by hand."""

import gtsam
import numpy as np
import pytest

from factors.rotation import rotation_exp
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.pocket.graph_links import links_between, node_samples
from fg_nav.pocket.graph_parameters import PocketGraphParameters
from fg_nav.pocket.gravity_force import gravity_of
from tests.pocket.leg import BIAS, MUNICH, walking

SIGMA = 0.5


@pytest.fixture(scope="module")
def leg():
    return walking(12.0)


def links_of(recording, bias=np.zeros(3), node_s=0.5):
    node = node_samples(recording.t, node_s)
    return node, links_between(node, recording.t, recording.acc, recording.gyr, recording.mag, SIGMA, bias)


def test_nodes_are_where_they_should_be_and_the_last_sample_is_one():
    t = np.delete(np.arange(1234) * 0.01, slice(301, 330))
    node = node_samples(t, 0.5)
    assert node[0] == 0
    assert node[-1] == len(t) - 1
    at = t[node[:-1]]
    off = at - 0.5 * np.round(at / 0.5)
    assert np.abs(off[at != 3.3]).max() < 1e-9  # within the gap the first one after it


def test_turns_without_errors_are_those_of_the_leg(leg):
    node, links = links_of(leg.recording(bias=np.zeros(3)))
    R = leg.attitude[node]
    assert np.allclose(np.swapaxes(R[:-1], 1, 2) @ R[1:], links.turn, atol=1e-12)
    assert np.allclose(links.h, np.diff(node) * leg.h)


def test_turn_and_its_noise_free_part_are_gtsam_s(leg):
    recording = leg.recording()
    node, links = links_of(recording, BIAS / 2)
    parameters = gtsam.PreintegratedRotationParams()
    parameters.setGyroscopeCovariance(np.eye(3))
    for k in (0, 5, len(links) - 1):
        theirs = gtsam.PreintegratedAhrsMeasurements(parameters, BIAS / 2)
        for i in range(node[k], node[k + 1]):
            theirs.integrateMeasurement(recording.gyr[i], leg.h)
        assert np.allclose(theirs.deltaRij().matrix(), links.turn[k], atol=1e-12)


@pytest.mark.parametrize("axis", range(3))
def test_a_bias_turns_a_link_and_its_field_as_the_derivatives_say(leg, axis):
    recording, step = leg.recording(), 1e-5
    d = step * np.eye(3)[axis]
    _, links = links_of(recording)
    (_, more), (_, less) = links_of(recording, d), links_of(recording, -d)
    turned = np.swapaxes(less.turn, 1, 2) @ more.turn
    rate = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1) / (2 * step)
    assert np.allclose(rate, links.per_bias[:, :, axis], atol=1e-6)
    # z = dR y turns by K about itself: -[z]x K, as long as all of a link's y are alike
    field_rate = (more.field - less.field) / (2 * step)
    assert np.allclose(field_rate, -np.cross(links.field, links.lever[:, :, axis]), atol=0.02)
    assert np.abs(field_rate).max() > 1.0


def test_a_known_field_is_its_mean_in_the_body_at_the_node(leg):
    node, links = links_of(leg.recording(bias=np.zeros(3)))
    assert np.allclose(links.field, leg.attitude[node[:-1]].transpose(0, 2, 1) @ MUNICH, atol=1e-9)
    assert np.allclose(links.strength, np.linalg.norm(MUNICH))
    assert (links.count == np.diff(node)).all()


def test_the_change_within_a_link_asks_for_the_bias(leg):
    _, links = links_of(leg.recording())
    A, r = links.swing[:, :, :3], links.swing[:, :, 3]
    information = np.einsum("kij,kil->jl", A, A)
    found = np.linalg.solve(information, np.einsum("kij,ki->j", A, r))
    assert np.allclose(found, BIAS, atol=0.02 * np.abs(BIAS).max())


def test_rows_without_a_field_are_left_out(leg):
    recording = leg.recording(bias=np.zeros(3))
    mag = recording.mag.copy()
    mag[::3] = np.nan
    mag[200:260] = np.nan
    mag[260:320] = 0.0
    node = node_samples(recording.t, 0.5)
    links = links_between(node, recording.t, recording.acc, recording.gyr, mag, SIGMA, np.zeros(3))
    assert (links.count[4:6] == 0).all()
    assert np.isnan(links.strength[4:6]).all()
    assert not links.swing[4:6].any()
    full = links.count > 0
    expected = leg.attitude[node[:-1]].transpose(0, 2, 1) @ MUNICH
    assert np.allclose(links.field[full], expected[full], atol=1e-9)


def test_no_magnetometer_is_no_field(leg):
    _, links = links_of(leg.recording(field=None))
    assert not links.count.any()
    assert not links.field.any()
    assert not links.swing.any()


def test_parts_of_links_are_links_of_parts(leg):
    recording = leg.recording()
    _, links = links_of(recording)
    joined = links.part(0, 7).then(links.part(7, len(links)))
    assert len(joined) == len(links)
    assert np.array_equal(joined.turn, links.turn)
    node = np.arange(350, 651, 50)
    there = links_between(node, recording.t, recording.acc, recording.gyr, recording.mag, SIGMA, np.zeros(3))
    assert np.allclose(there.field, links.field[7:13])
    assert np.allclose(there.push, links.push[7:13])


def test_the_mean_force_is_up_and_a_bias_tilts_it_as_the_derivative_says(leg):
    p = PocketGraphParameters()
    node, links = links_of(leg.recording(bias=np.zeros(3)))
    up = gravity_of(links, p)
    used = np.isfinite(up.variance)
    assert used.sum() == 11  # one a second, from the second on
    assert np.allclose(up.up[used], leg.attitude[node][used, 2], atol=2e-4)
    assert np.allclose(up.variance[used], (p.acc_sigma_m_s2 / GRAVITY_M_S2) ** 2, rtol=0.01)
    d = np.array([2e-3, -1e-3, 3e-3])
    _, other = links_of(leg.recording(bias=np.zeros(3)), d)
    moved = gravity_of(other, p)
    assert np.allclose(moved.up[used] - up.up[used], up.per_bias[used] @ d, atol=2e-5)
    assert np.abs(up.per_bias[used] @ d).max() > 1e-3


def test_a_force_that_is_not_gravity_s_is_not_up(leg):
    recording = leg.recording()
    faster = recording.acc.copy()
    faster[400:800] *= 1.1
    node = node_samples(recording.t, 0.5)
    links = links_between(node, recording.t, faster, recording.gyr, recording.mag, SIGMA, np.zeros(3))
    used = np.isfinite(gravity_of(links, PocketGraphParameters()).variance)
    at = recording.t[node]
    assert not used[(at > 5.5) & (at < 8.5)].any()
    assert used[(at > 10.0) & (at % 1.0 < 0.01)].all()


def test_a_constant_rate_and_force_gain_what_they_should():
    """A force that is constant in nav, seen by a body that turns: its velocity comes out whole."""
    n, h, rate = 100, 0.01, np.array([0.3, -2.0, 1.0])
    t = np.arange(n + 1) * h
    R = rotation_exp(rate * ((np.arange(20 * n) + 0.5) * h / 20)[:, None])
    force = np.array([1.0, 2.0, 9.0])
    body = np.einsum("nji,j->ni", R, force).reshape(n, 20, 3).mean(axis=1)
    acc = np.concatenate([body, body[-1:]])
    links = links_between(np.array([0, n]), t, acc, np.tile(rate, (n + 1, 1)), None, SIGMA, np.zeros(3))
    assert np.allclose(links.push[0], force * n * h, atol=1e-3)
