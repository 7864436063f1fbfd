"""Stances in a stream: the same as in the recording, told soon, never taken back, however the samples come."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fg_nav.detection import StanceParameters, detect_stances
from fg_nav.detection.causal import CausalParameters, CausalStances, Footfall, join_footfalls
from fg_nav.detection.footfalls import MAX_SWING_S
from fg_nav.errors import DetectionError
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.plan import Stand, Walk
from fg_nav.recording import Recording
from tests.simulated import PERSON, WALKERS, corridor, simulated, straight_walk


def pushed(recording: Recording, cuts=None, parameters=CausalParameters()) -> tuple[list[Footfall], np.ndarray]:
    """The footfalls of a recording that comes in blocks between `cuts`, and the delay of each in s."""
    cuts = range(10, len(recording), 10) if cuts is None else cuts
    edges = [0, *cuts, len(recording)]
    stream, found, delay = CausalStances(parameters), [], []
    for start, stop in pairwise(edges):
        new = stream.push(recording.t[start:stop], recording.acc[start:stop], recording.gyr[start:stop])
        delay += [recording.t[stop - 1] - recording.t[f.stop[-1] - 1] for f in new]
        found += new
    return found + stream.finish(), np.array(delay)


def same(one: list[Footfall], other: list[Footfall]) -> bool:
    return len(one) == len(other) and all(
        np.array_equal(getattr(a, name), getattr(b, name))
        for a, b in zip(one, other, strict=True)
        for name in ("start", "stop", "threshold", "stillest", "continues")
    )


@WALKERS
def test_they_are_those_of_the_recording(person, mount):
    recording = corridor(person, mount).recording
    offline = detect_stances(recording)
    found, delay = pushed(recording)
    stances = join_footfalls(found, len(recording))
    assert stances.n_footfalls == offline.n_footfalls
    assert np.mean(stances.mask != offline.mask) < 0.002
    assert np.median(delay) < 0.45
    assert delay.max() < 0.6


@pytest.mark.parametrize("style", [Style.WALK, Style.RUN], ids=["walk", "run"])
def test_they_are_those_of_the_feet(style):
    walk = straight_walk(PERSON, style, strides=20)
    found, _ = pushed(walk.recording)
    flat, t = walk.motion.flat, walk.recording.t
    began, ended = (t[[pick(f) for f in found]] for pick in (lambda f: f.start[0], lambda f: f.stop[-1] - 1))
    assert ((began[:, None] < flat[:, 1]) & (ended[:, None] > flat[:, 0])).any(axis=1).all()
    assert join_footfalls(found, len(walk.recording)).n_footfalls == len(flat)


def test_blocks_do_not_matter():
    recording = straight_walk(PERSON, strides=15).recording
    whole, _ = pushed(recording, [])
    assert same(whole, pushed(recording, range(1, len(recording)))[0])
    rng = np.random.default_rng(0)
    for _ in range(5):
        cuts = np.sort(rng.integers(0, len(recording), rng.integers(1, 200)))
        assert same(whole, pushed(recording, cuts)[0])


def test_what_was_told_lies_in_order_and_apart():
    found, _ = pushed(corridor(PERSON).recording)
    ends = np.concatenate([np.stack([f.start, f.stop], axis=1).ravel() for f in found])
    assert (np.diff(ends)[::2] > 0).all()
    assert (np.diff(ends)[1::2] >= 0).all()
    for footfall in found:
        assert ((footfall.start <= footfall.stillest) & (footfall.stillest < footfall.stop)).any()


def test_nothing_that_comes_later_changes_what_was_told():
    recording = straight_walk(PERSON, strides=15).recording
    whole, _ = pushed(recording)
    for share in (0.3, 0.55, 0.8):
        part = recording.slice(0, int(share * len(recording)))
        stream = CausalStances()
        told = stream.push(part.t, part.acc, part.gyr)
        assert len(told) > 2
        assert same(told, whole[: len(told)])


def test_who_stands_for_long_is_told_of_in_pieces():
    course = [
        Walk(straight(5.0), Style.WALK, 5),
        Stand(15.0),
        Walk(straight(5.0).translate([0.0, 5.0, 0.0]), Style.WALK, 5),
    ]
    recording = simulated(course, PERSON).recording
    found, _ = pushed(recording)
    pieces = [f for f in found if f.continues]
    p = CausalParameters()
    assert len(pieces) >= 6
    ends = recording.t[[f.stop[-1] - 1 for f in found]]
    assert np.diff(ends).max() < p.piece_s + MAX_SWING_S
    assert join_footfalls(found, len(recording)).n_footfalls == detect_stances(recording).n_footfalls


@settings(max_examples=15, deadline=None)
@given(start_s=st.floats(2.0, 8.0))
def test_a_walk_may_begin_anywhere(start_s):
    walk = straight_walk(PERSON, strides=15)
    recording = walk.recording.slice(int(start_s * 200), len(walk.recording))
    offline = detect_stances(recording)
    stances = join_footfalls(pushed(recording, range(100, len(recording), 100))[0], len(recording))
    assert abs(stances.n_footfalls - offline.n_footfalls) <= 1
    late = recording.t > recording.t[0] + 3.0
    assert np.mean((stances.mask != offline.mask)[late]) < 0.01


@pytest.mark.parametrize("lost_s", [0.3, 2.0, 30.0])
def test_a_gap_is_survived(lost_s):
    recording = straight_walk(PERSON, strides=20).recording
    keep = (recording.t < 9.0) | (recording.t > 9.0 + min(lost_s, 2.0))
    t = recording.t[keep] + np.where(recording.t[keep] > 9.0, lost_s - min(lost_s, 2.0), 0.0)
    broken = Recording(t, recording.acc[keep], recording.gyr[keep])
    offline = detect_stances(recording).mask[keep]
    stances = join_footfalls(pushed(broken)[0], len(broken))
    away = np.abs(recording.t[keep] - 9.0) > 2.0 + lost_s % 30.0
    assert np.mean((stances.mask != offline)[away]) < 0.01


def test_what_is_seen_with_a_footfall_does_not_depend_on_blocks():
    recording = straight_walk(PERSON, strides=20).recording

    def see(size):
        stream, seen = CausalStances(), []
        for start in range(0, len(recording), size):
            part = slice(start, start + size)
            found = stream.search(recording.t[part], recording.acc[part], recording.gyr[part])
            seen += [(footfall.stillest, stream.seen.first, stream.seen.last) for footfall in found]
        return seen

    in_blocks = see(7)
    assert len(in_blocks) > 15
    assert in_blocks == see(len(recording))


def test_the_work_and_the_memory_do_not_grow():
    """Two minutes and a half on the same twenty strides: the window is as long as ever."""
    recording = straight_walk(PERSON, strides=20).recording
    stream, footfalls = CausalStances(), []
    for turn in range(7):
        t = recording.t + turn * (recording.duration_s + 0.005)
        footfalls.append(len(stream.push(t, recording.acc, recording.gyr)))
    assert max(footfalls[1:]) - min(footfalls[1:]) <= 1
    assert len(stream._search._level) < 2.5 * 20.0 * 200


def test_nothing_and_too_little_are_no_walk():
    stream = CausalStances()
    nothing = np.empty((0, 3))
    assert stream.push(np.empty(0), nothing, nothing) == []
    assert stream.finish() == []
    with pytest.raises(DetectionError):
        join_footfalls([], 10)
    recording = straight_walk(PERSON, strides=5).recording
    short = CausalStances()
    assert short.push(recording.t[:40], recording.acc[:40], recording.gyr[:40]) == []
    assert len(short.finish()) == 1


def test_what_never_stands_is_never_told():
    t = np.arange(2000) / 200.0
    rng = np.random.default_rng(1)
    assert pushed(Recording(t, rng.normal(0, 30, (2000, 3)), rng.normal(0, 10, (2000, 3))))[0] == []
    falling = Recording(t, np.full((2000, 3), 1e-3), np.zeros((2000, 3)))
    assert pushed(falling)[0] == []


def test_other_detectors_are_refused():
    for stance in (StanceParameters(detector="are"), StanceParameters(threshold=1e5)):
        with pytest.raises(DetectionError):
            CausalStances(replace(CausalParameters(), stance=stance))
