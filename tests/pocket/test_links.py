"""Links: rotations, their derivative by the bias, means of fields and forces, against differences and by hand."""

from dataclasses import replace

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


def test_turns_and_fields_without_errors_are_those_of_the_leg(leg):
    node, links = links_of(leg.recording(bias=np.zeros(3)))
    R = leg.attitude[node]
    assert np.allclose(np.swapaxes(R[:-1], 1, 2) @ R[1:], links.turn, atol=1e-12)
    assert np.allclose(links.h, np.diff(node) * leg.h)
    assert np.allclose(links.field, leg.attitude[node[:-1]].transpose(0, 2, 1) @ MUNICH, atol=1e-9)
    assert np.allclose(links.strength, np.linalg.norm(MUNICH))
    assert (links.n_fields == np.diff(node)).all()
    assert not links_of(leg.recording(field=None))[1].n_fields.any()


@pytest.mark.parametrize("error", range(12))
def test_errors_of_the_gyroscope_change_a_link_and_its_field_as_the_derivatives_say(leg, error):
    """Bias (3) and scale (9), by differences."""
    recording, step = leg.recording(bias=np.zeros(3)), 1e-5 if error < 3 else 1e-4
    d = step * np.eye(12)[error]
    (_, links), (_, more), (_, less) = (
        links_of(replace(recording, gyr=recording.gyr @ (np.eye(3) - sign * d[3:].reshape(3, 3)).T), sign * d[:3])
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


def test_rest_is_seen_in_the_links_and_not_what_sways():
    """0.2 deg/s to and fro within some seconds, as a standing thigh does: quiet, but no rest."""
    recording = resting(60.0).recording(sigma=(np.radians(0.1), 0.05, 0.5))
    _, links = links_of(recording)
    assert np.allclose(links.rate, BIAS, atol=np.radians(0.1) / np.sqrt(25) * 5)
    assert np.allclose(links.rate_spread, np.radians(0.1) * np.sqrt(3), rtol=0.5)
    assert np.allclose(links.force_spread, 0.05 * np.sqrt(3), rtol=0.5)
    assert np.isfinite(detect_rests(links).variance).sum() == len(links.h) - REST_LINKS + 1
    sway = np.radians(0.2) * np.sin(2 * np.pi * recording.t / 3.0)
    _, links = links_of(replace(recording, gyr=recording.gyr + sway[:, None]))
    assert not np.isfinite(detect_rests(links).variance).any()
