"""Strides of a plan: counts, times and places are those asked for, and vary as a walker's do."""

import numpy as np
import pytest

from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import arc, closed_curve, straight
from fg_nav.lab.simulation.person import Person, Scatter
from fg_nav.lab.simulation.plan import Stairs, Stand, TurnOnSpot, Walk, plan, plan_walk

LONG = straight(1000.0)
STEADY = Scatter(footprint_m=0.0, heading_rad=0.0, wander_m=0.0, pace=0.0)
LAP = closed_curve([(0, 0), (0, 30), (25, 40), (50, 20), (25, -10)])


def rng(seed=0):
    return np.random.default_rng(seed)


def planned(*sections, seed=0, scatter=Scatter()):
    return plan(sections, Person(), rng(seed), scatter)


def lengths(strides):
    return np.linalg.norm(np.diff(strides.footprint, axis=0), axis=1)


def test_there_are_as_many_strides_as_asked_for_or_as_the_gait_has():
    strides, walk = planned(Walk(LONG, strides=786)), Person().walk
    assert len(strides) == 786
    assert strides.footprint[-1, 1] - strides.footprint[0, 1] == pytest.approx(1000.0, abs=1e-9)
    assert (np.diff(strides.footprint[:, 1]) > 0).all()
    assert len(planned(Walk(LONG))) == round(1000.0 / walk.stride_m + 1)
    assert len(planned(Walk(LONG, Style.RUN))) == round(1000.0 / Person().run.stride_m + 1)


def test_a_walk_begins_and_ends_with_half_a_stride():
    of_many = np.array([lengths(planned(Walk(straight(26.0)), seed=seed)) for seed in range(40)])
    usual = of_many[:, 1:-1].mean()
    np.testing.assert_allclose(of_many[:, [0, -1]].mean(axis=0), usual / 2, rtol=0.02)


def test_no_half_strides_where_walking_goes_on():
    half = LONG.length_m / 2
    strides = planned(Walk(LONG.part(0, half)), Walk(LONG.part(half, 2 * half), Style.RUN), scatter=STEADY)
    run = strides.style == Style.RUN
    assert lengths(strides)[~run][-1] > 0.9 * Person().walk.stride_m
    assert lengths(strides)[run][0] > 0.9 * Person().run.stride_m
    np.testing.assert_allclose(strides.footprint[np.argmax(run), 1], half, atol=1e-9)


@pytest.mark.parametrize("pace", [0.7, 1.0, 1.3])
def test_pace_is_speed_and_goes_half_into_length(pace):
    walk, strides = Person().walk, planned(Walk(LONG, pace=pace))
    usual = walk.stride_m / walk.stride_s
    assert LONG.length_m / strides.end_s == pytest.approx(pace * usual, rel=0.02)
    assert np.median(lengths(strides)) == pytest.approx(walk.stride_m * np.sqrt(pace), rel=0.02)
    assert np.median(strides.duration) == pytest.approx(walk.stride_s / np.sqrt(pace), rel=0.02)


def test_strides_follow_one_another_and_pauses_last_what_they_should():
    strides = planned(Stand(4.0), Walk(straight(20.0)), Stand(2.5), Stand(1.0), TurnOnSpot(1.0), Stand(3.0))
    gap = strides.start[1:] - (strides.start + strides.duration)[:-1]
    walked = int(np.sum(strides.style == Style.WALK))
    assert strides.start[0] == pytest.approx(4.0)
    assert gap[walked - 1] == pytest.approx(3.5)
    np.testing.assert_allclose(np.delete(gap, walked - 1), 0.0, atol=1e-9)
    assert strides.end_s - (strides.start + strides.duration)[-1] == pytest.approx(3.0)
    assert strides.duration.min() > 0.5


@pytest.mark.parametrize("seed", range(2))
def test_a_closed_walk_ends_exactly_where_it_began(seed):
    strides = planned(Stand(1.0), Walk(LAP.repeat(2)), Stand(1.0), seed=seed)
    np.testing.assert_array_equal(strides.footprint[-1], strides.footprint[0])
    assert strides.heading[-1] - strides.heading[0] == pytest.approx(4 * np.pi, abs=1e-12)


def test_the_foot_treads_to_the_right_of_the_path_whichever_way_it_goes():
    for angle in (0.0, 1.0, 2.5, -2.0):
        strides = planned(Walk(LONG.rotate(angle)), scatter=STEADY)
        right = np.array([np.cos(angle), -np.sin(angle), 0.0])
        np.testing.assert_allclose(strides.footprint @ right, 0.09, atol=1e-9)
        np.testing.assert_allclose(strides.heading, angle)


def test_footprints_scatter_and_the_center_wanders_slowly_and_comes_home():
    aside = planned(Walk(straight(4000.0)), scatter=Scatter(wander_m=0.0)).footprint[1:-1, 0]
    assert aside.mean() == pytest.approx(0.09, abs=0.001)
    assert aside.std() == pytest.approx(0.015, rel=0.06)
    strides = planned(Walk(straight(40_000.0)), scatter=Scatter(footprint_m=0.0))
    assert strides.heading[1:-1].std() == pytest.approx(np.deg2rad(1.5), rel=0.06)
    wander = strides.footprint[20:-20, 0] - 0.09
    assert wander.std() == pytest.approx(0.05, rel=0.1)
    assert np.corrcoef(wander[:-20], wander[20:])[0, 1] == pytest.approx(np.exp(-1), abs=0.08)
    np.testing.assert_allclose(strides.footprint[[0, -1], 0], 0.09, atol=1e-12)


def test_strides_vary_as_the_gait_says():
    strides, walk = planned(Walk(straight(6000.0)), scatter=STEADY), Person().walk
    for values, usual in ((lengths(strides)[1:-1], walk.stride_m), (strides.duration, walk.stride_s)):
        assert values.mean() == pytest.approx(usual, rel=0.005)
        assert values.std() / usual == pytest.approx(walk.variation, rel=0.06)
    assert abs(np.corrcoef(strides.duration[1:], strides.duration[:-1])[0, 1]) < 0.05


def test_pace_changes_slowly():
    strides = planned(Walk(straight(20_000.0)), scatter=Scatter(pace=0.10))
    speed = lengths(strides)[1:-1] / strides.duration[1:-1]
    slow = np.convolve(speed / speed.mean(), np.ones(10) / 10, "valid")
    assert slow.std() == pytest.approx(0.10, rel=0.2)
    assert np.corrcoef(slow[:-20], slow[20:])[0, 1] > 0.25


def test_strides_are_shorter_in_bends():
    way = straight(100.0).then(arc(1.0, 40.0).translate((0.0, 100.0)))
    strides = planned(Walk(way), scatter=STEADY)
    arc_of_bend = np.abs(np.diff(strides.heading))[-20:-2].mean()  # its radius is 1 m
    assert arc_of_bend / np.median(lengths(strides)[5:50]) == pytest.approx(1 / 1.25, rel=0.03)


def test_one_foot_takes_every_second_tread():
    up = planned(Walk(straight(5.0)), Stairs(7), Walk(straight(5.0).translate((0, 5 + 7 * 0.29, 7 * 0.17))))
    on = up.style == Style.STAIRS_UP
    np.testing.assert_allclose(np.diff(up.footprint[:, 2])[on] / 0.17, [1, 2, 2, 2])
    assert up.footprint[-1, 2] == pytest.approx(7 * 0.17)
    down = planned(Stairs(8, up=False), scatter=STEADY)
    np.testing.assert_allclose(np.diff(down.footprint, axis=0), np.tile([0, 2 * 0.29, -2 * 0.17], (4, 1)), atol=1e-12)
    assert set(down.style) == {Style.STAIRS_DOWN}


@pytest.mark.parametrize(("angle", "count"), [(np.pi / 2, 2), (-np.pi / 3, 2), (np.pi, 3), (-np.pi, 3)])
def test_turning_on_the_spot(angle, count):
    strides = planned(Stand(1.0), TurnOnSpot(angle), Stand(1.0), scatter=STEADY)
    assert len(strides) == count
    assert set(strides.style) == {Style.TURN}
    assert strides.heading[-1] - strides.heading[0] == pytest.approx(angle)
    np.testing.assert_allclose(np.linalg.norm(strides.footprint, axis=1), 0.09, atol=1e-12)


def test_landmarks_are_crossed_by_the_nearest_footfall():
    arcs = np.array([11.0, 60.0, 100.0])
    path = LAP.with_landmarks(arcs).repeat(2)
    walk = plan_walk([Stand(5.0), Walk(path), Stand(5.0)], Person(), rng(3), STEADY)
    strides, crossings = walk.strides, walk.crossings
    assert [crossing.landmark for crossing in crossings] == ["1", "2", "3"] * 2
    for crossing, mark in zip(crossings, path.landmarks, strict=True):
        place = path.at([mark.arc])[0][0]
        away = np.linalg.norm(strides.footprint - place, axis=1)
        assert away[crossing.stride + 1] < 0.75
        began, lasted = strides.start[crossing.stride], strides.duration[crossing.stride]
        assert began + 0.6 * lasted < crossing.time_s < began + lasted
    assert np.diff([crossing.time_s for crossing in crossings]).min() > 5.0


IMPOSSIBLE = {
    "has no strides": lambda: planned(Stand(5.0)),
    "seconds cannot be nan": lambda: Stand(np.nan),
    "a gap of 1 m": lambda: planned(Walk(straight(5.0)), Walk(straight(5.0).translate((0, 6)))),
    "strides of 100 m: ask for about 775": lambda: planned(Walk(LONG, strides=11)),
    "pace cannot be 5.0": lambda: Walk(LONG, pace=5.0),
    "style cannot be": lambda: Walk(LONG, Style.STAIRS_UP),
    "treads cannot be 0": lambda: Stairs(0),
}


def test_what_cannot_be_walked_is_refused_in_one_sentence():
    for words, make in IMPOSSIBLE.items():
        with pytest.raises(SimulationError, match=words) as refusal:
            make()
        assert str(refusal.value).count(". ") == 0, words
