"""From a recording or a stream to stances: the statistics and their law, one threshold, footfalls, refusals."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from fg_nav.detection import StanceParameters, detect_stances
from fg_nav.detection import stance as stance_module
from fg_nav.detection.causal import CausalParameters, CausalStances, join_footfalls
from fg_nav.detection.footfalls import MAX_SWING_S
from fg_nav.detection.stance import STATISTICS, Stances, threshold_at_rest
from fg_nav.errors import DetectionError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.plan import Stand, Walk
from fg_nav.recording import Recording
from tests.simulated import PERSON, WALKERS, corridor, simulated, straight_walk

S_A, S_W = stance_module.ACC_NOISE_M_S2, np.radians(stance_module.GYR_NOISE_DEG_S)
EACH = pytest.mark.parametrize("name", STATISTICS)


# the four statistics against their formulas, and the chi-square law they promise


def windowed(name, acc, gyr):
    """The statistic of one window (W, 3) as Skog et al. print it (MV with the divisor W)."""
    W = len(acc)
    mean = sum(acc) / W
    total = 0.0
    for a, w in zip(acc, gyr, strict=True):
        if name in ("shoe", "are"):
            total += w @ w / S_W**2
        if name == "shoe":
            off = a - GRAVITY_M_S2 * mean / np.sqrt(mean @ mean)
            total += off @ off / S_A**2
        if name == "mv":
            total += (a - mean) @ (a - mean) / S_A**2
        if name == "mag":
            total += (np.sqrt(a @ a) - GRAVITY_M_S2) ** 2 / S_A**2
    return total / W


def noisy(n, seed=0, tilt=(0.3, -0.5, 1.0), acc_sigma=S_A, gyr_sigma=S_W):
    """Specific force and rate (n, 3): white noise about gravity, in any attitude; of the nominal strength at rest."""
    rng = np.random.default_rng(seed)
    up = Rotation.from_rotvec(tilt).inv().apply([0.0, 0.0, GRAVITY_M_S2])
    return up + acc_sigma * rng.standard_normal((n, 3)), gyr_sigma * rng.standard_normal((n, 3))


@EACH
def test_each_window_has_the_value_of_the_formula_in_any_mounting(name):
    acc, gyr = noisy(60, acc_sigma=5.0, gyr_sigma=3.0)
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5])
    for window in (1, 3, 10, 21):
        ours = STATISTICS[name](acc, gyr, window)
        padded = [np.pad(x, [(window // 2, window), (0, 0)], mode="edge") for x in (acc, gyr)]
        theirs = [windowed(name, *(x[i : i + window] for x in padded)) for i in range(len(acc))]
        for found in (ours, STATISTICS[name](turn.apply(acc), turn.apply(gyr), window)):
            np.testing.assert_allclose(found, theirs, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("rate", [0.5, 0.05, 0.002])
@EACH
def test_a_threshold_is_a_false_alarm_rate(name, rate):
    """A fitted direction of gravity costs SHOE two of its 6 W degrees of freedom, a fitted mean MV three of its 3 W."""
    for window in (5, 10):
        acc, gyr = noisy(8000 * window, seed=window)
        apart = STATISTICS[name](acc, gyr, window)[window // 2 :: window]  # windows that share no sample
        alarms = np.count_nonzero(apart > threshold_at_rest(name, window, rate))
        low, high = binom.interval(1 - 1e-5, len(apart), rate)
        assert low <= alarms <= high


@EACH
def test_a_shock_leaves_no_trace_behind(name):
    acc, gyr = noisy(3000)
    clean = STATISTICS[name](acc, gyr, 10)
    for shock in (2000.0, 1e9):
        acc[100] = gyr[100] = shock
        found = STATISTICS[name](acc, gyr, 10)
        assert (found >= 0.0).all()
        assert np.allclose(found[120:], clean[120:], rtol=1e-4, atol=1e-4) or shock > 1e6


# intervals: mask and intervals are one another, and the stillest sample of a footfall is its stillest


@given(bits=st.lists(st.booleans(), max_size=60), seed=st.integers(0, 9))
def test_a_mask_comes_back_from_its_intervals_and_the_stillest_sample_lies_in_its_footfall(bits, seed):
    mask = np.array(bits, dtype=bool)
    stances = Stances.from_mask(mask, "labels")
    start, stop = stances.start, stances.stop
    assert np.all(stop > start)
    assert np.all(start[1:] > stop[:-1])  # else they would be one
    assert all(mask[a:b].all() for a, b in zip(start, stop, strict=True))
    assert (stop - start).sum() == mask.sum()
    np.testing.assert_array_equal(stances.mask, mask)
    assert (stances.n_samples, stances.detector, stances.n_footfalls) == (len(mask), "labels", len(stances))
    rate = np.linalg.norm(np.random.default_rng(seed).standard_normal((len(mask), 3)), axis=1)
    sample = stances.stillest(rate[:, None] * [1.0, 0.0, 0.0])
    assert np.all((sample >= start) & (sample < stop))
    assert rate[sample].tolist() == [rate[a:b].min() for a, b in zip(start, stop, strict=True)]
    assert [len(one) for one in stances.spans] == [len(stances)] * 2


def test_a_footfall_of_several_intervals_has_one_span_and_one_stillest_sample():
    edges = np.array([0, 10, 20]), np.array([5, 15, 30]), np.array([0, 0, 1])
    stances = Stances(*edges, n_samples=30, detector="shoe")
    assert [one.tolist() for one in stances.spans] == [[0, 20], [15, 30]]
    assert (len(stances), stances.n_footfalls, stances.mask.sum()) == (3, 2, 20)
    gyr = np.ones((30, 3))
    gyr[[3, 12, 17, 25]] *= np.array([[0.5], [0.2], [0.01], [0.3]])  # 17 lies in the swing
    assert stances.stillest(gyr).tolist() == [12, 25]
    statistic = np.full(30, 0.9)
    statistic[[4, 29]] = 0.1
    assert replace(stances, statistic=statistic).stillest(gyr).tolist() == [4, 29]  # which goes first


# one threshold, and footfalls


def standing(seconds):
    """A sensor at rest, with its nominal noise."""
    n = round(seconds * 200)
    return Recording(np.arange(n) / 200, *noisy(n, tilt=(0.0, 0.0, 0.0)))


def with_turns(recording, rate_rad_s, at_s, lasting_s=0.15):
    """The same, turning at a rate for a moment at each of these times."""
    gyr = recording.gyr.copy()
    for begin in at_s:
        gyr[(recording.t >= begin) & (recording.t < begin + lasting_s), 1] += rate_rad_s
    return replace(recording, gyr=gyr)


@EACH
def test_one_threshold_cuts_the_statistic_at_that_level(name, monkeypatch):
    monkeypatch.setattr(stance_module, "MIN_S", 0.0)
    for rate_hz in (200.0, 800.0):
        recording = straight_walk(strides=3, rate_hz=rate_hz).recording
        statistic = STATISTICS[name](recording.acc, recording.gyr, round(0.05 * rate_hz))
        threshold = float(np.quantile(statistic, 0.4))
        stances = detect_stances(recording, StanceParameters(name, threshold=threshold))
        np.testing.assert_array_equal(stances.mask, statistic < threshold)
        np.testing.assert_allclose(stances.statistic, statistic / threshold)
        assert (stances.detector, stances.threshold, stances.n_samples) == (name, threshold, len(recording))


def test_stances_shorter_than_the_shortest_are_dropped(monkeypatch):
    monkeypatch.setattr(stance_module, "MIN_S", 0.0)
    recording = with_turns(standing(4.0), 1.0, [0.5, 0.8, 2.0, 2.4])
    found = detect_stances(recording, StanceParameters("are", threshold=100.0))
    long = recording.t[found.stop - 1] - recording.t[found.start] >= 0.3
    assert np.count_nonzero(~long) == 2
    monkeypatch.setattr(stance_module, "MIN_S", 0.3)
    kept = detect_stances(recording, StanceParameters("are", threshold=100.0))
    np.testing.assert_array_equal([kept.start, kept.stop], [found.start[long], found.stop[long]])


def test_a_foot_that_fidgets_on_the_ground_makes_one_footfall_and_a_swing_divides():
    assert detect_stances(with_turns(standing(4.0), 1.5, [1.0, 2.0, 2.6])).footfall.tolist() == [0, 0, 0, 0]
    assert detect_stances(with_turns(standing(4.0), 3.0, [1.0], lasting_s=0.5)).footfall.tolist() == [0, 1]
    stances = detect_stances(standing(5.0))
    assert (stances.start.tolist(), stances.stop.tolist(), stances.n_footfalls) == ([0], [1000], 1)
    assert len(detect_stances(standing(0.1))) == 1


@WALKERS
@pytest.mark.parametrize("style", [Style.WALK, Style.RUN], ids=["walk", "run"])
def test_the_statistic_is_relative_to_the_threshold_of_the_nearest_stance(person, mount, style):
    stances = detect_stances(straight_walk(person, style, strides=6, mount=mount).recording)
    assert stances.statistic[stances.mask].max() < 1.0
    # the threshold is where the stance ends
    assert min(*stances.statistic[stances.start[1:] - 1], *stances.statistic[stances.stop[:-1]]) >= 1.0


# nothing found, nothing sensible asked


def refused(recording, **parameters):
    with pytest.raises(DetectionError, match=r"^[^\n]*[?.]$") as error:
        detect_stances(recording, StanceParameters(**parameters))
    return str(error.value)


def test_what_cannot_be_is_refused():
    still = standing(2.0)
    for parameters, words in (
        ({"detector": "glrt"}, "there is no stance detector 'glrt': choose one of shoe, are, mv, mag."),
        ({"detector": "are"}, "give are a threshold or a false-alarm rate"),
        ({"threshold": 10.0, "false_alarm_rate": 0.01}, "choose one of them"),
        ({"false_alarm_rate": 0.0}, "between 0 and 1"),
        ({"false_alarm_rate": 20.0}, "between 0 and 1"),
        ({"false_alarm_rate": np.nan}, "between 0 and 1"),
        ({"threshold": 1e-3}, "the threshold 0.001; raise it"),
    ):
        assert words in refused(still, **parameters)
    turning = refused(replace(still, gyr=still.gyr + np.array([0.0, 0.0, 5.0])))
    assert "no stance was found in 2.0 s" in turning
    assert "turns at 286 deg/s with a specific force of 9.8 m/s^2" in turning
    for acc in (still.acc - np.array([0, 0, GRAVITY_M_S2]), 0.0 * still.acc):
        assert "specific force of 0.0" in refused(replace(still, acc=acc))


@WALKERS
@pytest.mark.parametrize(("style", "pace"), [(Style.WALK, 2.5), (Style.RUN, 1.0)], ids=["brisk", "run"])
def test_a_swing_alone(person, mount, style, pace):
    """Of a slower one the middle may pass for a stance: nothing else is there to compare it with."""
    walk = straight_walk(person, style, strides=4, pace=pace, mount=mount)
    inner = walk.swing[2] @ np.array([[0.85, 0.15], [0.15, 0.85]])
    a, b = np.searchsorted(walk.recording.t, inner)
    assert "no stance was found" in refused(walk.recording.slice(a, b))


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
    # of several intervals, in whichever it is
    fidgeting = with_turns(standing(4.0), 1.5, [1.0, 2.0, 2.6])
    stillest = detect_stances(fidgeting).stillest(fidgeting.gyr)
    first = pushed(fidgeting)[0][0]
    assert first.start[1] < first.stillest == stillest[0]


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
