"""Links: rotations, their derivative by the bias, means of fields and forces, against differences and by hand."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest

from fg_nav.factors.rotation import rotation_exp
from fg_nav.pocket.kalman_smoother import REST_LINKS, detect_rests, place_nodes, preintegrate_links
from tests.pocket.leg import BIAS, MUNICH, resting, walking


@pytest.fixture(scope="module")
def leg():
    return walking(12.0)


def links_of(recording, bias=np.zeros(3), node_s=0.5):
    node = place_nodes(recording.t, node_s)
    return node, preintegrate_links(node, recording.t, recording.acc, recording.gyr - bias, recording.mag)


def test_nodes_are_where_they_should_be_and_the_last_sample_is_one():
    t = np.delete(np.arange(1234) * 0.01, slice(301, 330))
    node = place_nodes(t, 0.5)
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
    for k in (0, 5, len(links.h) - 1):
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
    assert np.allclose(rate, links.per_sensor[:, :, axis], atol=1e-6)
    # z = dR y turns by K about itself: -[z]x K, as long as all of a link's y are alike
    field_rate = (more.field - less.field) / (2 * step)
    assert np.allclose(field_rate, -np.cross(links.field, links.lever[:, :, axis]), atol=0.02)
    assert np.abs(field_rate).max() > 1.0


def test_a_known_field_is_its_mean_in_the_body_at_the_node(leg):
    node, links = links_of(leg.recording(bias=np.zeros(3)))
    assert np.allclose(links.field, leg.attitude[node[:-1]].transpose(0, 2, 1) @ MUNICH, atol=1e-9)
    assert np.allclose(links.strength, np.linalg.norm(MUNICH))
    assert (links.n_fields == np.diff(node)).all()


def test_rows_without_a_field_are_left_out(leg):
    recording = leg.recording(bias=np.zeros(3))
    mag = recording.mag.copy()
    mag[::3] = np.nan
    mag[200:260] = np.nan
    mag[260:320] = 0.0
    node = place_nodes(recording.t, 0.5)
    links = preintegrate_links(node, recording.t, recording.acc, recording.gyr, mag)
    assert (links.n_fields[4:6] == 0).all()
    assert np.isnan(links.strength[4:6]).all()
    full = links.n_fields > 0
    expected = leg.attitude[node[:-1]].transpose(0, 2, 1) @ MUNICH
    assert np.allclose(links.field[full], expected[full], atol=1e-9)


def test_no_magnetometer_is_no_field(leg):
    _, links = links_of(leg.recording(field=None))
    assert not links.n_fields.any()
    assert not links.field.any()


def test_parts_of_links_are_links_of_parts(leg):
    recording = leg.recording()
    _, links = links_of(recording)
    joined = links.slice(0, 7).append(links.slice(7, len(links.h)))
    assert len(joined.h) == len(links.h)
    assert np.array_equal(joined.turn, links.turn)
    node = np.arange(350, 651, 50)
    there = preintegrate_links(node, recording.t, recording.acc, recording.gyr, recording.mag)
    assert np.allclose(there.field, links.field[7:13])
    assert np.allclose(there.delta_v, links.delta_v[7:13])


def test_a_constant_rate_and_force_gain_what_they_should():
    """A force that is constant in nav, seen by a body that turns: its velocity comes out whole."""
    n, h, rate = 100, 0.01, np.array([0.3, -2.0, 1.0])
    t = np.arange(n + 1) * h
    R = rotation_exp(rate * ((np.arange(20 * n) + 0.5) * h / 20)[:, None])
    force = np.array([1.0, 2.0, 9.0])
    body = np.einsum("nji,j->ni", R, force).reshape(n, 20, 3).mean(axis=1)
    acc = np.concatenate([body, body[-1:]])
    links = preintegrate_links(np.array([0, n]), t, acc, np.tile(rate, (n + 1, 1)), None)
    assert np.allclose(links.delta_v[0], force * n * h, atol=1e-3)
    assert np.allclose(links.delta_p[0], force * (n * h) ** 2 / 2, atol=1e-3)


@pytest.mark.parametrize("element", range(9))
def test_a_scale_error_changes_a_link_as_the_derivatives_say(leg, element):
    recording, step = leg.recording(bias=np.zeros(3)), 1e-4
    S = np.zeros(9)
    S[element] = step
    S = S.reshape(3, 3)
    (_, links), (_, more), (_, less) = (
        links_of(replace(recording, gyr=recording.gyr @ (np.eye(3) - sign * S).T)) for sign in (0, 1, -1)
    )
    turned = np.swapaxes(less.turn, 1, 2) @ more.turn
    rate = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1) / (2 * step)
    assert np.allclose(rate, links.per_sensor[:, :, 3 + element], atol=1e-4)
    for moved, by in (("delta_v", "delta_v_per_sensor"), ("delta_p", "delta_p_per_sensor")):
        change = (getattr(more, moved) - getattr(less, moved)) / (2 * step)
        assert np.allclose(change, getattr(links, by)[:, :, 3 + element], atol=0.02)


def test_rest_is_seen_in_the_links():
    recording = resting(10.0).recording(sigma=(np.radians(0.1), 0.05, 0.5))
    _, links = links_of(recording)
    assert np.allclose(links.rate, BIAS, atol=np.radians(0.1) / np.sqrt(25) * 5)
    assert np.allclose(links.rate_spread, np.radians(0.1) * np.sqrt(3), rtol=0.5)
    assert np.allclose(links.force_spread, 0.05 * np.sqrt(3), rtol=0.5)
    assert np.isfinite(detect_rests(links).variance).sum() == len(links.h) - REST_LINKS + 1


def test_what_sways_does_not_rest():
    """0.2 deg/s to and fro within some seconds, as a standing thigh does: quiet, but no rest."""
    recording = resting(60.0).recording(sigma=(np.radians(0.1), 0.05, 0.5))
    sway = np.radians(0.2) * np.sin(2 * np.pi * recording.t / 3.0)
    _, links = links_of(replace(recording, gyr=recording.gyr + sway[:, None]))
    assert not np.isfinite(detect_rests(links).variance).any()
