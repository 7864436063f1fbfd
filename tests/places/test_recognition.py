"""Stretches that are recognized: returns in both directions, with a drift; nothing where nothing returns."""

import numpy as np
import pytest

from fg_nav.places import Drift, recognition, recognize, recognize_known, select_consistent
from fg_nav.places.alignment import MIN_LISTED, align, measure_chance, trace
from fg_nav.places.candidates import BLOCK, find_candidates, pair_all
from fg_nav.places.signature import Features, whiten
from tests.places.floors import LOOP, OPEN, Floor, along, carry

ASIDE = [0.0, 0.25, 0.0]


def laps(count, aside=0.25):
    """Laps of the loop, every second one moved aside."""
    place = along(LOOP)
    return np.vstack([place + np.array([0.0, aside * (k % 2), 0.0]) for k in range(count)])


def errors(walk, place, stretches):
    """True displacement (M, 3) m of the points of stretches from those that they are recognized as."""
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])
    passes = [np.concatenate([getattr(s, name) for s in stretches]) for name in ("later", "earlier")]
    passed_m = [np.interp(at, np.arange(len(walk)), walk.distance_m) for at in passes]
    later, earlier = (np.stack([np.interp(m, walked, c) for c in place.T], axis=1) for m in passed_m)
    return later - earlier


def test_a_second_lap_is_recognized_whatever_the_heading_drifts():
    for drift_deg_m in (0.0, 0.03):
        place = laps(2)
        walk = carry(Floor.draw(1), place, drift_deg_m)
        used = select_consistent(walk, recognize(walk).stretches, Drift())
        assert sum(s.length_m for s in used) > 80.0
        assert np.sqrt(np.mean(np.sum(errors(walk, place, used)[:, :2] ** 2, axis=1))) < 0.6
        assert not any(s.opposite for s in used)


def test_parts_of_a_long_walk_are_compared_with_first_passes_only(monkeypatch):
    place = laps(5)
    walk = carry(Floor.draw(1), place)
    monkeypatch.setattr(recognition, "PART_M", 110.0)
    used = select_consistent(walk, recognize(walk).stretches, Drift())
    again = np.zeros(len(walk), dtype=bool)
    for stretch in used:
        again[stretch.later.astype(int)] = True
    assert again[len(walk) // 5 + 10 :].mean() > 0.85
    assert np.sqrt(np.mean(np.sum(errors(walk, place, used)[:, :2] ** 2, axis=1))) < 0.6
    late = np.concatenate([s.earlier for s in used if walk.distance_m[int(s.later[0])] > 330.0])
    assert np.mean(walk.distance_m[late.astype(int)] < 220.0) > 0.8


def test_a_way_back_is_recognized_as_the_opposite_direction():
    there = along([(0, 0), (70, 0), (70, 4)])
    place = np.vstack([there, there[::-1] + ASIDE])
    walk = carry(Floor.draw(5), place)
    used = select_consistent(walk, recognize(walk).stretches, Drift())
    assert used
    assert all(s.opposite for s in used)
    error = errors(walk, place, used)
    assert np.percentile(np.abs(error[:, 0]), 95.0) < 1.0


def test_nothing_is_used_where_nothing_returns():
    for seed in range(4):
        walk = carry(Floor.draw(10 + seed), along(OPEN), 0.02)
        anywhere = Drift(position_share=1e3, heading_rad_m=1.0)
        assert select_consistent(walk, recognize(walk, anywhere).stretches, anywhere) == ()
    sure = find_candidates(walk, Drift()).same.area_m2  # the cost follows the candidates
    assert sure < 0.05 * find_candidates(walk, Drift(1e3, 10.0)).same.area_m2


def test_a_place_out_of_the_paths_uncertainty_is_not_the_same():
    """Rows of a building that repeats itself, 20 m apart."""
    row = along([(0, 0), (60, 0)])
    place = np.vstack([row, along([(60, 0), (60, 20), (0, 20)]), along([(0, 20), (0, 40), (60, 40)])])
    field = np.column_stack([place[:, 0], np.mod(place[:, 1] + 5.0, 20.0) - 5.0, place[:, 2]])
    floor = Floor.draw(7)

    class Rows:
        def at(self, _):
            return floor.at(field)

    walk = carry(Rows(), place)
    sure = Drift(position_share=0.005, heading_rad_m=np.deg2rad(0.02))
    assert recognize(walk, sure).stretches == ()


def test_a_later_walk_is_found_on_an_earlier_one():
    floor = Floor.draw(8)
    known = carry(floor, along(OPEN))
    piece = along([(25, 0.2), (60, 0.2), (60, 40)])
    found = recognize_known(carry(floor, piece, seed=1), known).stretches
    assert found
    start = np.interp(found[0].earlier[0] - found[0].later[0], np.arange(len(known)), known.distance_m)
    assert start == pytest.approx(25.0, abs=1.5)
    assert recognize_known(carry(Floor.draw(9), piece), known).stretches == ()


def test_an_alignment_follows_a_path_that_is_stretched():
    rng = np.random.default_rng(3)
    x = rng.standard_normal((200, 3))
    # Every 25th point twice.
    y = np.repeat(x, np.where(np.arange(200) % 25 == 12, 2, 1), axis=0)
    y = np.pad(y, ((0, -len(y) % BLOCK), (0, 0)))
    a, b = (Features(v, np.ones_like(v)) for v in (x, y))
    for one, other in ((a, b), (b, a)):  # a path that is stretched, and one that is shortened
        found = align(one, other, pair_all(len(one), len(other)))
        best = int(np.argmax(found.score))
        points = trace(one, other, found.begin[best], found.end[best])[:, :: 1 if one is a else -1]
        assert len(points) > 180
        assert np.abs(points[:, 1] - points[:, 0] - points[:, 0] // 25).max() <= 2


def test_chance_has_the_rate_and_decay_of_its_scores():
    rng = np.random.default_rng(2)
    scores = MIN_LISTED + rng.exponential(1 / 0.8, 2000)
    chance = measure_chance(scores, 1e6, 2e6)
    assert chance.count == pytest.approx(4000, rel=0.05)
    assert chance.decay == pytest.approx(0.8, rel=0.07)
    assert chance.expected(np.array([chance.score_of(0.01)]))[0] == pytest.approx(0.01)


def test_the_negated_field_shows_what_chance_does():
    """As many alignments as between unrelated floors."""
    one, other = (whiten(carry(Floor.draw(seed), along(OPEN))) for seed in (20, 21))
    pairs = pair_all(len(one), len(other))
    by_chance = [len(align(one, other, pairs)), len(align(one, other.negate(), pairs))]
    assert 0.3 < (by_chance[0] + 5) / (by_chance[1] + 5) < 3.0
