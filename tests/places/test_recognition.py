"""Stretches that are recognized, in both directions and with a drift; which agree, and how sharp they are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from fg_nav.places import Drift, Stretch, recognition, recognize, select_consistent
from fg_nav.places.alignment import MIN_LISTED, MIN_RATIO, SHARE, ChanceLevel, align, measure_chance, trace
from fg_nav.places.candidates import APART_M, BLOCK, find_candidates, pair_all
from fg_nav.places.recognition import (
    LATERAL_SIGMA_M,
    MIN_LIKENESS,
    REACH_M,
    RHO,
    SHIFTS_M,
    _weigh_positions,
    find_shift,
    weigh_shifts,
)
from fg_nav.places.signature import Features, whiten
from tests.places.floors import EARTH, LOOP, OPEN, Floor, along, carry, retrace

ASIDE = np.array([0.0, 0.25, 0.0])
SURE = Drift(position_share=0.01)


def laps(count):
    """Laps of the loop, every second one moved aside."""
    return np.vstack([along(LOOP) + ASIDE * (k % 2) for k in range(count)])


def errors(walk, place, stretches):
    """True displacement (M, 2) m of the points of stretches from those that they are recognized as."""
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])
    passes = [np.concatenate([getattr(s, name) for s in stretches]) for name in ("later", "earlier")]
    passed_m = [np.interp(at, np.arange(len(walk)), walk.distance_m) for at in passes]
    later, earlier = (np.stack([np.interp(m, walked, c) for c in place.T[:2]], axis=1) for m in passed_m)
    return later - earlier


def test_a_second_lap_is_recognized_whatever_the_heading_drifts():
    for drift_deg_m in (0.0, 0.03):
        place = laps(2)
        walk = carry(Floor.draw(1), place, drift_deg_m)
        used = select_consistent(walk, recognize(walk).stretches, Drift())
        assert sum(s.length_m for s in used) > 80.0
        assert np.sqrt(np.mean(np.sum(errors(walk, place, used) ** 2, axis=1))) < 0.6
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
    assert np.sqrt(np.mean(np.sum(errors(walk, place, used) ** 2, axis=1))) < 0.6
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


def test_neither_the_next_metres_nor_another_storey_are_candidates():
    walk = carry(Floor.draw(1), laps(2))
    for storey_m, found in ((0.0, True), (0.9, True), (3.4, False)):  # 0.4 m is one sigma
        higher = walk.position + np.outer(walk.distance_m > 96.0, [0.0, 0.0, storey_m])
        pairs = find_candidates(replace(walk, position=higher), Drift(height_share=0.001)).same
        walked_m = (pairs.later - pairs.earlier) * BLOCK * 0.5
        assert walked_m.min() > APART_M
        assert (walked_m.max() > 95.0) == found


def test_what_a_stretch_is_worth_falls_with_its_distance_and_with_rivals_and_nothing_unlike_is_listed():
    """expected = chance exp(D^2 / 2) + odds of the rivals, D^2 = |e|^2 / sigma^2; along the first leg of a lap."""
    walk, later, drift = carry(Floor.draw(1), laps(2)), np.arange(202, 232), Drift(position_share=0.02)

    def at(shift_m, score=30.0):
        return Stretch(later, later - 192 + round(shift_m / 0.5), False, score, 1e-6)

    def weigh(*stretches):
        return [one.expected_false for one in _weigh_positions(stretches, ChanceLevel(1.0, 0.8), walk, drift)]

    def half_square(shift_m):
        e = (walk.position[later, :2] - walk.position[at(shift_m).earlier, :2]).mean(axis=0)
        return 0.5 * (e @ e) / ((0.02 * (96.0 - shift_m)) ** 2 + LATERAL_SIGMA_M**2)

    own, off = half_square(0.0), half_square(6.0)
    assert weigh(at(0.0)) == pytest.approx([1e-6 * np.exp(own)], rel=0.01)
    assert weigh(at(6.0)) == pytest.approx([1e-6 * np.exp(off)], rel=0.01)
    assert weigh(at(10.0)) == weigh(at(0.0, 0.9 * MIN_LIKENESS * at(0.0).length_m)) == []
    assert weigh(at(0.0), at(6.0, 29.0)) == pytest.approx([np.exp(-0.8 + own - off)], rel=0.01)
    assert weigh(at(0.0), at(3.0, 29.0))[0] < 1e-5  # as near it is no rival
    beside = replace(at(6.0, 29.0), later=later + 20.0)  # nor is one of another piece of the walk
    assert weigh(at(0.0), beside)[0] < 1e-5


def test_a_place_out_of_the_paths_uncertainty_is_not_the_same():
    """Rows of a building that repeats itself, 20 m apart."""
    row = along([(0, 0), (60, 0)])
    place = np.vstack([row, along([(60, 0), (60, 20), (0, 20)]), along([(0, 20), (0, 40), (60, 40)])])
    field = np.column_stack([place[:, 0], np.mod(place[:, 1] + 5.0, 20.0) - 5.0, place[:, 2]])
    walk = carry(SimpleNamespace(at=lambda _: Floor.draw(7).at(field)), place)
    sure = Drift(position_share=0.005, heading_rad_m=np.deg2rad(0.02))
    assert recognize(walk, sure).stretches == ()


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


def cut(stretch, first, points, shift_m=0.0, expected=1e-5):
    """A part of a stretch; its earlier pass so much further on."""
    rows = slice(first, first + points)
    earlier = stretch.move_earlier(shift_m)[rows]
    return replace(stretch, later=stretch.later[rows], earlier=earlier, expected_false=expected)


@pytest.mark.parametrize("opposite", [False, True])
def test_true_stretches_agree_whatever_the_drift_and_false_ones_are_left_out(opposite):
    for drift_deg_m in (0.0, 0.1, -0.3):
        walk, whole = retrace(opposite, drift_deg_m)
        sure = Drift(position_share=0.01, heading_rad_m=2.0 * np.deg2rad(abs(drift_deg_m)) + 1e-4)
        true = [cut(whole, at, 30) for at in (0, 60, 120)]
        other_way = replace(cut(whole, 40, 30), opposite=not opposite)
        elsewhere = [cut(whole, 40, 16, shift_m) for shift_m in (-8.0, 8.0)]
        for false in (other_way, *elsewhere):
            kept = select_consistent(walk, [*true, false], sure)
            assert len(kept) == 3, drift_deg_m
            assert all(any(s is t for t in true) for s in kept)


def test_a_stretch_alone_has_to_be_sure_and_the_recognized_ones_agree():
    walk, whole = retrace(False)
    alone, sure = cut(whole, 28, 40, expected=1e-2), cut(whole, 88, 40, expected=1e-6)
    assert select_consistent(walk, [], SURE) == select_consistent(walk, [alone], SURE) == ()
    assert select_consistent(walk, [alone, sure], SURE) == (sure, alone)  # the surest first
    found = recognize(walk, SURE).stretches
    assert len(select_consistent(walk, found, SURE)) == len(found) > 0


@pytest.mark.parametrize("opposite", [False, True])
def test_a_shift_that_was_put_in_comes_out_within_its_sigma(opposite):
    walk, true = retrace(opposite)
    features = whiten(walk)
    for shift_m in (-0.8, 0.0, 0.3):
        wrong = replace(true, earlier=true.move_earlier(-shift_m))
        ratio = weigh_shifts(features, wrong)
        found = np.array([find_shift(ratio[k : k + 40]) for k in range(0, 140, 40)])
        assert np.abs(found[:, 0] - shift_m).max() < 0.1
        assert found[:, 1].max() < 0.3
        np.testing.assert_allclose(wrong.move_earlier(shift_m), true.earlier)


def test_the_ratio_of_two_points_is_that_of_jointly_normal_values_over_independent_ones():
    walk, true = retrace(False)
    features, rows = whiten(walk), slice(20, 60)
    i, j = true.later[rows].astype(int), true.earlier[rows].astype(int) + 7
    expected = np.zeros(len(i))
    for c, rho in enumerate(RHO):
        x, y = features.values[i, c], features.values[j, c]
        r = rho * features.signal[i, c] * features.signal[j, c]
        given = norm.logpdf(y, r * x, np.sqrt(1.0 - r**2))
        expected += given - norm.logpdf(y)
    assert expected.min() < MIN_RATIO < 0.0 < expected.max()
    found = weigh_shifts(features, cut(true, 20, 40, 3.5))[:, len(SHIFTS_M) // 2]
    np.testing.assert_allclose(found, SHARE * np.maximum(expected, MIN_RATIO), atol=1e-9)


def test_a_field_that_is_the_same_everywhere_shows_no_shift_and_none_is_out_of_reach():
    walk, true = retrace(False)
    quiet = replace(walk, field=np.tile(EARTH, (len(walk), 1)))
    shift, sigma = find_shift(weigh_shifts(whiten(quiet), true))
    assert shift == pytest.approx(0.0, abs=1e-6)
    assert sigma == pytest.approx(REACH_M / np.sqrt(3.0), rel=0.1)
    shift, sigma = find_shift(np.where(SHIFTS_M == REACH_M, 50.0, 0.0)[None])
    assert shift == pytest.approx(REACH_M)
    step = SHIFTS_M[1] - SHIFTS_M[0]
    assert sigma == pytest.approx(step / np.sqrt(12.0))  # of a shift somewhere in its step
