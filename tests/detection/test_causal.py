"""Stances in a stream: the same as in the recording, told soon, never taken back, however the samples come."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fg_nav.detection import StanceParameters, detect_stances
from fg_nav.detection.causal import CausalParameters, CausalStances, join_footfalls
from fg_nav.detection.footfalls import MAX_SWING_S
from fg_nav.errors import DetectionError
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.plan import Stand, Walk
from fg_nav.recording import Recording
from tests.simulated import PERSON, WALKERS, corridor, simulated, straight_walk


def pushed(recording, cuts=None, parameters=CausalParameters()):
    """The footfalls of a recording that comes in blocks between `cuts`, and the delay of each in s."""
    cuts = range(10, len(recording), 10) if cuts is None else cuts
    stream, found, delay = CausalStances(parameters), [], []
    for start, stop in pairwise([0, *cuts, len(recording)]):
        new = stream.push(recording.t[start:stop], recording.acc[start:stop], recording.gyr[start:stop])
        delay += [recording.t[stop - 1] - recording.t[f.stop[-1] - 1] for f in new]
        found += new
    return found + stream.finish(), np.array(delay)


def listed(footfalls):
    """Footfalls in numbers, to compare them."""
    names = ("start", "stop", "threshold", "stillest", "continues")
    return [[np.asarray(getattr(f, name)).tolist() for name in names] for f in footfalls]


@pytest.fixture(scope="module")
def walk():
    return straight_walk(PERSON, strides=20).recording


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


def test_neither_blocks_nor_what_comes_later_matter(walk):
    recording, rng = walk.slice(0, 3600), np.random.default_rng(0)
    whole = listed(pushed(recording, [])[0])
    draws = [np.sort(rng.integers(0, len(recording), rng.integers(1, 200))) for _ in range(3)]
    for cuts in (range(1, len(recording)), *draws):
        assert listed(pushed(recording, cuts)[0]) == whole
    for share in (0.3, 0.55, 0.8):
        part = recording.slice(0, int(share * len(recording)))
        told = listed(CausalStances().push(part.t, part.acc, part.gyr))
        assert len(told) > 2
        assert told == whole[: len(told)]

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
def test_a_walk_may_begin_anywhere(walk, start_s):
    recording = walk.slice(int(start_s * 200), len(walk))
    offline = detect_stances(recording)
    stances = join_footfalls(pushed(recording, range(100, len(recording), 100))[0], len(recording))
    assert abs(stances.n_footfalls - offline.n_footfalls) <= 1
    late = recording.t > recording.t[0] + 3.0
    assert np.mean((stances.mask != offline.mask)[late]) < 0.01


@pytest.mark.parametrize("lost_s", [0.3, 2.0, 30.0])
def test_a_gap_is_survived(walk, lost_s):
    keep = (walk.t < 9.0) | (walk.t > 9.0 + min(lost_s, 2.0))
    t = walk.t[keep] + np.where(walk.t[keep] > 9.0, lost_s - min(lost_s, 2.0), 0.0)
    broken = Recording(t, walk.acc[keep], walk.gyr[keep])
    stances = join_footfalls(pushed(broken)[0], len(broken))
    away = np.abs(walk.t[keep] - 9.0) > 2.0 + lost_s % 30.0
    assert np.mean((stances.mask != detect_stances(walk).mask[keep])[away]) < 0.01


def test_the_work_and_the_memory_do_not_grow(walk):
    """Two minutes and a half on the same twenty strides: the window is as long as ever."""
    stream, turns = CausalStances(), np.arange(7) * (walk.duration_s + 0.005)
    footfalls = [len(stream.push(walk.t + since, walk.acc, walk.gyr)) for since in turns]
    assert max(footfalls[1:]) - min(footfalls[1:]) <= 1
    assert len(stream._search._level) < 2.5 * 20.0 * 200


def test_nothing_too_little_and_what_never_stands_are_no_walk_and_other_detectors_are_refused(walk):
    stream, nothing = CausalStances(), np.empty((0, 3))
    assert stream.push(np.empty(0), nothing, nothing) == stream.finish() == []
    assert stream.push(walk.t[:40], walk.acc[:40], walk.gyr[:40]) == []
    assert len(stream.finish()) == 1
    t, rng = np.arange(2000) / 200.0, np.random.default_rng(1)
    wild, falling = (rng.normal(0, 30, (2000, 3)), rng.normal(0, 10, (2000, 3))), (np.full((2000, 3), 1e-3), 0)
    for acc, gyr in (wild, falling):
        assert pushed(Recording(t, acc, np.broadcast_to(gyr, (2000, 3)).copy()))[0] == []
    with pytest.raises(DetectionError):
        join_footfalls([], 10)
    for stance in (StanceParameters(detector="are"), StanceParameters(threshold=1e5)):
        with pytest.raises(DetectionError):
            CausalStances(replace(CausalParameters(), stance=stance))
