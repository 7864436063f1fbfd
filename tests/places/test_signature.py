"""The field along a path by distance, and what of it is compared: sources below and above, all waves alike."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.frames import yaw_rotation
from fg_nav.places import trace_signature
from fg_nav.places.signature import BLOCK, MAX_UNREAD_M, SPACING_M, remove_common_field, whiten
from tests.places.floors import LOOP, OPEN, Floor, along, carry

PLACE = along(LOOP)
FLOOR = Floor.draw(1)
T = np.arange(len(PLACE)) * 0.04
UPRIGHT = np.broadcast_to(np.eye(3), (len(PLACE), 3, 3))


def traced(place=PLACE, R=UPRIGHT, mag=None, rows=slice(None)):
    return trace_signature(T[rows], place[rows], R[rows], (FLOOR.at(PLACE) if mag is None else mag)[rows])


def test_it_is_the_mean_of_the_field_over_the_distance():
    found, b = traced(), FLOOR.at(PLACE)
    for k in (20, 80, 110):  # to the east, to the north and to the west
        inside = slice(round(k * SPACING_M / 0.05), round((k + 1) * SPACING_M / 0.05) + 1)
        east, north, up = np.trapezoid(b[inside], dx=0.05, axis=0) / SPACING_M
        along_left = {20: (east, north), 80: (north, -east), 110: (-east, -north)}[k]
        np.testing.assert_allclose(found.field[k], [*along_left, up], atol=2e-2 if k > 20 else 1e-6)
        assert found.heading[k] == pytest.approx({20: 0.0, 80: np.pi / 2, 110: np.pi}[k], abs=1e-9)
        assert found.distance_m[k] == pytest.approx((k + 0.5) * SPACING_M)
        assert found.t[k] == pytest.approx(found.distance_m[k] / 0.05 * 0.04, abs=1e-6)
        np.testing.assert_allclose(found.position[k, :2], PLACE[inside, :2].mean(axis=0), atol=2e-2)


def test_neither_heading_nor_pace_nor_rate_nor_a_standing_changes_it_and_too_short_a_path_has_none():
    turn = yaw_rotation(np.full(len(PLACE), 1.1))
    turned = traced(place=np.einsum("nij,nj->ni", turn, PLACE), R=turn)
    stop = np.repeat(np.arange(len(PLACE)), np.where(np.arange(len(PLACE)) == 400, 500, 1))
    stood = trace_signature(np.arange(len(stop)) * 0.01, PLACE[stop], UPRIGHT[stop * 0], FLOOR.at(PLACE)[stop])
    coarse = traced(rows=slice(None, None, 4))
    n = len(coarse) - 1
    for found, error in ((turned, 1e-6), (stood, 1e-6), (coarse, 0.5)):
        np.testing.assert_allclose(found.field[:n], traced().field[:n], atol=error)
    assert len(traced(rows=slice(0, 100))) == 0


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
    unread = (found.distance_m > 0.05 * 399 + MAX_UNREAD_M) & (found.distance_m < 0.05 * 500 - MAX_UNREAD_M)
    np.testing.assert_array_equal(found.seen, ~unread)
    assert np.isfinite(found.field).all()
    assert not whiten(found).signal[: len(found)][~found.seen].any()


def test_features_have_unit_variance_and_whole_blocks_and_a_homogeneous_field_no_signal():
    floor = Floor.draw(2)
    features, quiet = (
        whiten(carry(one, along(OPEN))) for one in (floor, replace(floor, strength=0.0 * floor.strength))
    )
    assert len(features) % BLOCK == 0
    assert np.all(np.abs(features.values.std(axis=0) - 1.0) < 0.15)
    assert quiet.signal.mean() < 0.5 * features.signal.mean()


def test_a_source_under_the_path_is_seen_in_one_component():
    walk = carry(Floor.draw(2), along(OPEN))
    deviation = remove_common_field(walk.field, walk.heading)
    spectrum = np.fft.rfft(deviation * np.hanning(len(deviation))[:, None], axis=0)
    below, above = spectrum[:, 2] + 1j * spectrum[:, 0], spectrum[:, 2] - 1j * spectrum[:, 0]
    assert np.sum(np.abs(below) ** 2) > 2.0 * np.sum(np.abs(above) ** 2)
    signal = whiten(walk).signal.mean(axis=0)
    assert signal[0] > signal[2]


def test_the_reversed_walk_has_the_reversed_features():
    there, back = (whiten(carry(Floor.draw(3), p, noise_uT=0.0)) for p in (PLACE, PLACE[::-1]))
    turned = back.reverse().values[-len(carry(Floor.draw(3), PLACE)) :]
    for component in (0, 1):  # below and left
        shifted = [turned[30 + k : 150 + k, component] for k in (-1, 0, 1)]
        assert max(np.corrcoef(there.values[30:150, component], other)[0, 1] for other in shifted) > 0.9
