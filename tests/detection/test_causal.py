"""Stances in a stream: the same as in the recording, told soon, never taken back, however the samples come."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

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
    ends = np.concatenate([np.stack([f.start, f.stop], axis=1).ravel() for f in found])
    assert (np.diff(ends)[::2] > 0).all()  # in order and apart
    assert (np.diff(ends)[1::2] >= 0).all()
    assert all(((f.start <= f.stillest) & (f.stillest < f.stop)).any() for f in found)


def test_neither_blocks_nor_what_comes_later_matter():
    recording = straight_walk(PERSON, strides=15).recording
    whole, _ = pushed(recording, [])
    rng = np.random.default_rng(0)
    draws = [np.sort(rng.integers(0, len(recording), rng.integers(1, 200))) for _ in range(3)]
    for cuts in (range(1, len(recording)), *draws):
        assert same(whole, pushed(recording, cuts)[0])
    for share in (0.3, 0.55, 0.8):
        part = recording.slice(0, int(share * len(recording)))
        told = CausalStances().push(part.t, part.acc, part.gyr)
        assert len(told) > 2
        assert same(told, whole[: len(told)])

    def see(size):
        stream, seen = CausalStances(), []
        for start in range(0, len(recording), size):
            part = slice(start, start + size)
            found = stream.search(recording.t[part], recording.acc[part], recording.gyr[part])
            seen += [(footfall.stillest, stream.seen.first, stream.seen.last) for footfall in found]
        return seen

    assert see(7) == see(len(recording))
    assert len(see(7)) > 10


def test_who_stands_for_long_is_told_of_in_pieces():
    there = Walk(straight(5.0), Style.WALK, 5)
    course = [there, Stand(15.0), replace(there, path=there.path.translate([0.0, 5.0, 0.0]))]
    recording = simulated(course, PERSON).recording
    found, _ = pushed(recording)
    assert sum(bool(f.continues) for f in found) >= 6
    ends = recording.t[[f.stop[-1] - 1 for f in found]]
    assert np.diff(ends).max() < CausalParameters().piece_s + MAX_SWING_S
    assert join_footfalls(found, len(recording)).n_footfalls == detect_stances(recording).n_footfalls


@pytest.mark.parametrize("start_s", [2.0, 3.3, 4.13, 5.4, 6.71, 8.0])
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


def test_the_work_and_the_memory_do_not_grow():
    """Two minutes and a half on the same twenty strides: the window is as long as ever."""
    recording = straight_walk(PERSON, strides=20).recording
    stream, footfalls = CausalStances(), []
    for turn in range(7):
        t = recording.t + turn * (recording.duration_s + 0.005)
        footfalls.append(len(stream.push(t, recording.acc, recording.gyr)))
    assert max(footfalls[1:]) - min(footfalls[1:]) <= 1
    assert len(stream._search._level) < 2.5 * 20.0 * 200


def test_nothing_too_little_and_what_never_stands_are_no_walk_and_other_detectors_are_refused():
    stream, nothing = CausalStances(), np.empty((0, 3))
    assert stream.push(np.empty(0), nothing, nothing) == stream.finish() == []
    recording = straight_walk(PERSON, strides=5).recording
    short = CausalStances()
    assert short.push(recording.t[:40], recording.acc[:40], recording.gyr[:40]) == []
    assert len(short.finish()) == 1
    t, rng = np.arange(2000) / 200.0, np.random.default_rng(1)
    assert pushed(Recording(t, rng.normal(0, 30, (2000, 3)), rng.normal(0, 10, (2000, 3))))[0] == []
    assert pushed(Recording(t, np.full((2000, 3), 1e-3), np.zeros((2000, 3))))[0] == []  # falling
    with pytest.raises(DetectionError):
        join_footfalls([], 10)
    for stance in (StanceParameters(detector="are"), StanceParameters(threshold=1e5)):
        with pytest.raises(DetectionError):
            CausalStances(replace(CausalParameters(), stance=stance))
