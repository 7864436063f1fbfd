"""The field along a path by distance: what it does not depend on."""

import numpy as np
import pytest

from fg_nav.frames import yaw_rotation
from fg_nav.places import trace_signature
from fg_nav.places.signature import SPACING_M
from tests.places.floors import LOOP, Floor, along

PLACE = along(LOOP)
FLOOR = Floor.draw(1)
T = np.arange(len(PLACE)) * 0.04
UPRIGHT = np.broadcast_to(np.eye(3), (len(PLACE), 3, 3))


def traced(t=T, place=PLACE, R=UPRIGHT, mag=None):
    return trace_signature(t, place, R, FLOOR.at(PLACE) if mag is None else mag)


def test_it_is_the_mean_of_the_field_over_the_distance():
    found, b = traced(), FLOOR.at(PLACE)
    k = 20  # the eleventh meter, straight to the east
    inside = slice(round(k * SPACING_M / 0.05), round((k + 1) * SPACING_M / 0.05) + 1)
    mean = np.trapezoid(b[inside], dx=0.05, axis=0) / SPACING_M
    np.testing.assert_allclose(found.field[k], mean, atol=1e-6)
    assert found.heading[k] == pytest.approx(0.0, abs=1e-9)


def test_a_heading_that_is_wrong_changes_nothing():
    turn = yaw_rotation(np.full(len(PLACE), 1.1))
    turned = traced(place=np.einsum("nij,nj->ni", turn, PLACE), R=turn)
    np.testing.assert_allclose(turned.field, traced().field, atol=1e-6)


def test_standing_still_and_the_pace_change_nothing():
    stop = np.repeat(np.arange(len(PLACE)), np.where(np.arange(len(PLACE)) == 400, 500, 1))
    t = np.arange(len(stop)) * 0.01
    stood = trace_signature(t, PLACE[stop], UPRIGHT[stop % len(PLACE)], FLOOR.at(PLACE)[stop])
    np.testing.assert_allclose(stood.field, traced().field, atol=1e-6)


def test_in_the_opposite_direction_along_and_left_change_sign():
    line = np.linspace(0.0, 60.0, 1201)
    place = np.stack([0.8 * line, 0.6 * line, 0.15 + 0.0 * line], axis=1)
    t, upright = line / 1.2, np.broadcast_to(np.eye(3), (len(line), 3, 3))
    there, back = (trace_signature(t, p, upright, FLOOR.at(p)) for p in (place, place[::-1]))
    # The last half meter of the one is the first of the other, and neither has both.
    np.testing.assert_allclose(back.field[::-1][:-1] * [-1, -1, 1], there.field[1:], atol=1e-6)


def test_where_the_magnetometer_does_not_read_it_is_not_seen():
    mag = FLOOR.at(PLACE)
    mag[400:500] = np.nan
    found = traced(mag=mag)
    assert not found.seen[42:48].any()
    assert found.seen[:38].all()
    assert np.isfinite(found.field).all()


def test_a_signature_follows_the_rate_of_the_samples_and_a_path_too_short_has_none():
    some = slice(None, None, 4)
    coarse = trace_signature(T[some], PLACE[some], UPRIGHT[some], FLOOR.at(PLACE)[some])
    n = min(len(coarse), len(traced()))
    assert np.abs(coarse.field[: n - 1] - traced().field[: n - 1]).max() < 0.5
    assert len(trace_signature(T[:100], PLACE[:100], UPRIGHT[:100], FLOOR.at(PLACE)[:100])) == 0
