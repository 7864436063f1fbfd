"""Footfalls on simulated walks of many gaits: the count is exact, and the foot does stand where it is said to."""

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.signal import find_peaks
from scipy.spatial.transform import Rotation

from fg_nav.detection import StanceParameters, detect_stances
from fg_nav.detection import footfalls as ff
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording
from fg_nav.simulation import demo_walk
from fg_nav.simulation.demo import demo_motion
from tests.detection.walks import RUNNING, WALKING, mounted, simulate

STANDING_M_S, TOUCHING_M_S = 0.06, 0.2
"""Speed of the sensor on a walker's and on a runner's foot in stance."""


def in_mid_swing(t, swing):
    """(N,) True in the middle three fifths of each swing."""
    share = (t[:, None] - swing[:, 0]) / np.diff(swing).T
    return ((share > 0.2) & (share < 0.8)).any(axis=1)


def assert_true(walk, stances, slow_m_s, strides=None):
    """Every stride is counted, and in no stance does the foot move, let alone swing."""
    strides = len(walk.swing) if strides is None else strides
    assert stances.n_footfalls == strides + 1
    assert walk.speed[stances.mask].max() < slow_m_s
    assert not (stances.mask & in_mid_swing(walk.recording.t, walk.swing)).any()


@pytest.mark.parametrize("seed", range(6))
def test_demo_walks(seed):
    motion, _ = demo_motion(np.random.default_rng(seed))
    recording = demo_walk(np.random.default_rng(seed))
    stances = detect_stances(recording)
    strides = len(motion.angles[1].start)
    assert stances.n_footfalls == strides + 1
    assert np.linalg.norm(motion.at(recording.t).velocity, axis=1)[stances.mask].max() < 0.03
    duration = (stances.stop - stances.start) * recording.period_s
    assert duration.min() > 0.25  # all of the stance is found: it takes 0.35 s


@pytest.mark.parametrize("noise", [0.0, 0.3, 3.0, 10.0])
@pytest.mark.parametrize(("gait", "slow"), [(WALKING, STANDING_M_S), (RUNNING, TOUCHING_M_S)], ids=["walk", "run"])
def test_sensor_noise_does_not_matter(gait, slow, noise):
    walk = simulate(gait, noise=noise)
    assert_true(walk, detect_stances(walk.recording), slow)


@pytest.mark.parametrize("stride_s", [0.55, 0.7, 1.2, 1.7, 2.3])
def test_hurry_and_leisure(stride_s):
    """The same path in another time: rates change with the pace, accelerations with its square."""
    walk = simulate(replace(WALKING, stride_s=stride_s), seed=2)
    assert_true(walk, detect_stances(walk.recording), STANDING_M_S)


@pytest.mark.parametrize("seed", range(4))
def test_running(seed):
    """A runner's foot is on the ground for 0.14 s and rolls all the time: still, but as still as a mid-swing."""
    walk = simulate(RUNNING, seed=seed)
    stances = detect_stances(walk.recording)
    assert_true(walk, stances, TOUCHING_M_S)
    assert len(stances) >= 13


def test_walking_then_running_then_walking():
    walks = [simulate(gait, strides=8, standing_s=1.0, seed=s) for s, gait in enumerate([WALKING, RUNNING, WALKING])]
    acc, gyr = (np.vstack([getattr(w.recording, name) for w in walks]) for name in ("acc", "gyr"))
    recording = Recording(t=np.arange(len(acc)) / 200, acc=acc, gyr=gyr)
    assert detect_stances(recording).n_footfalls == 25


@pytest.mark.parametrize("rate_hz", [100.0, 137.0, 200.0, 400.0, 800.0])
@pytest.mark.parametrize(("gait", "slow"), [(WALKING, STANDING_M_S), (RUNNING, TOUCHING_M_S)], ids=["walk", "run"])
def test_sample_rate_does_not_matter(gait, slow, rate_hz):
    walk = simulate(gait, rate_hz=rate_hz)
    assert_true(walk, detect_stances(walk.recording), slow)


def test_stances_begin_and_end_at_the_same_time_at_every_rate():
    edges = []
    for rate_hz in (100.0, 400.0):
        recording = simulate(rate_hz=rate_hz, noise=0.0).recording
        stances = detect_stances(recording)
        edges.append([recording.t[stances.start], recording.t[stances.stop - 1]])
    np.testing.assert_allclose(*edges, atol=0.016)


FIXED = simulate(RUNNING, strides=6)


@given(rotvec=st.lists(st.floats(-3, 3), min_size=3, max_size=3))
@settings(max_examples=15, deadline=None)
def test_mounting_does_not_matter(rotvec):
    turned = detect_stances(mounted(FIXED.recording, Rotation.from_rotvec(rotvec)))
    asis = detect_stances(FIXED.recording)
    np.testing.assert_array_equal(turned.start, asis.start)
    np.testing.assert_array_equal(turned.footfall, asis.footfall)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_upside_down(axis):
    walk = simulate()
    flipped = mounted(walk.recording, Rotation.from_euler(axis, 180, degrees=True))
    assert_true(walk, detect_stances(flipped), STANDING_M_S)


@pytest.mark.parametrize("bias_deg_s", [0.5, 3.0])
def test_an_uncalibrated_gyroscope_does_not_matter(bias_deg_s):
    walk = simulate()
    bias = np.radians(bias_deg_s) * np.array([0.6, -0.6, 0.5])
    recording = replace(walk.recording, gyr=walk.recording.gyr + bias)
    assert_true(walk, detect_stances(recording), STANDING_M_S)


def true_stances(walk, t):
    """Seconds of each stance, of the standing before and after too, that lie within t."""
    begin = np.append(0.0, walk.swing[:, 1])
    end = np.append(walk.swing[:, 0], np.inf)
    return np.clip(np.minimum(end, t[-1]) - np.maximum(begin, t[0]), 0.0, None)


@pytest.mark.parametrize("gait", [WALKING, RUNNING], ids=["walk", "run"])
@pytest.mark.parametrize("side", ["start", "end"])
def test_a_recording_may_begin_and_end_anywhere(gait, side):
    """Cut at every phase of a stride: no swing is taken for a stance, and only a cut stance may be missed.

    Of a runner the outermost stance may be missed: one velocity more does not tell it from a mid-swing.
    """
    walk = simulate(gait, strides=9)
    a, b = np.searchsorted(walk.recording.t, walk.swing[[3, 4], 0])
    slow = STANDING_M_S if gait is WALKING else TOUCHING_M_S
    for cut in range(a, b, 6):
        part = walk.recording.slice(cut, len(walk.recording)) if side == "start" else walk.recording.slice(0, cut)
        stances = detect_stances(part)
        lasting = true_stances(walk, part.t)
        whole = np.count_nonzero(lasting > 0.12) - (gait is RUNNING)
        assert whole <= stances.n_footfalls <= np.count_nonzero(lasting)
        assert np.linalg.norm(walk.motion.at(part.t).velocity, axis=1)[stances.mask].max() < max(slow, 0.15)


def test_a_walk_without_any_standing():
    walk = simulate(strides=10)
    a, b = np.searchsorted(walk.recording.t, [walk.swing[1].mean(), walk.swing[8].mean()])
    part = walk.part(a, b)
    assert_true(part, detect_stances(part.recording), STANDING_M_S, strides=6)


def test_the_first_and_the_last_rest_reach_to_the_ends():
    recording = simulate().recording
    stances = detect_stances(recording)
    assert stances.start[0] == 0
    assert stances.stop[-1] == len(recording)
    assert recording.t[stances.stop[0] - 1] == pytest.approx(2.0, abs=0.05)


def test_a_pause_in_mid_walk_is_one_footfall():
    first, second = simulate(strides=5, seed=1), simulate(strides=5, seed=2)
    acc, gyr = (np.vstack([getattr(w.recording, name) for w in (first, second)]) for name in ("acc", "gyr"))
    recording = Recording(t=np.arange(len(acc)) / 200, acc=acc, gyr=gyr)
    stances = detect_stances(recording)
    assert stances.n_footfalls == 11
    duration = (stances.stop - stances.start) / 200
    assert np.count_nonzero(duration > 3.5) == 1


# the parts of the search


def brute_force(t, worth, velocity, s0, sa, longest, swing):
    """Score of the best chain by trying all of them."""

    def link(i, j):
        elapsed = t[0, j] - t[1, i]
        if elapsed > longest and j - i > 1:
            return np.inf
        change = ((velocity[0, j] - velocity[1, i]) ** 2).sum()
        return min(2 * np.log(1 + change / (4 * (s0**2 + (sa * elapsed) ** 2))), ff.BROKEN / 2)

    def score(chain):
        ends = (t[0, chain[0]] - t[0, 0] > swing, t[1, -1] - t[1, chain[-1]] > swing)
        links = sum(link(i, j) for i, j in pairwise(chain))
        return sum(worth[list(chain)]) - links - ff.BROKEN * sum(ends)

    n = len(worth)
    chains = [c for size in range(1, n + 1) for c in combinations(range(n), size)]
    return max(map(score, chains)), score


@pytest.mark.parametrize("seed", range(40))
def test_the_best_chain_is_the_best_of_all(seed):
    rng = np.random.default_rng(seed)
    n = rng.integers(1, 9)
    edges = np.cumsum(rng.uniform(0.05, 0.8, (n, 2))).reshape(n, 2).T.copy()
    worth = rng.uniform(-1, 3, n)
    velocity = rng.choice([0.2, 1.0, 4.0]) * rng.standard_normal((2, n, 3))
    problem = (edges, worth, velocity, 0.2, 0.3, rng.uniform(0.5, 2.5), rng.uniform(0.3, 1.5))
    best, score = brute_force(*problem)
    chain = ff._best_chain(*problem)
    assert np.all(np.diff(chain) > 0)
    assert score(tuple(chain)) == pytest.approx(best, rel=1e-12)


@given(
    values=st.lists(st.integers(-50, 50), min_size=1, max_size=40, unique=True), prominence=st.sampled_from([1, 5, 20])
)
@settings(max_examples=200, deadline=None)
def test_minima_are_the_prominent_ones(values, prominence):
    level = np.array(values, dtype=np.float64) + 0.5 * np.arange(len(values)) / len(values)  # no two equally prominent
    assume(len(level) == 1 or np.abs(np.abs(np.subtract.outer(level, level)) - prominence).min() > 1e-9)
    first, last = ff._minima(level, float(prominence))
    walled = np.concatenate([[1e3], level, [1e3]])
    peaks, _ = find_peaks(-walled, prominence=prominence)
    np.testing.assert_array_equal(first, peaks - 1)
    np.testing.assert_array_equal(last, first)


def test_a_rest_is_one_minimum_from_its_first_sample_to_its_last():
    level = np.array([5.0, 3, 3, 3.2, 3, 5, 4, 5, 3, 3])
    first, last = ff._minima(level, 0.5)
    np.testing.assert_array_equal(first, [1, 6, 8])
    np.testing.assert_array_equal(last, [4, 6, 9])


@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_free_velocity_both_ways_from_any_sample(rate_hz):
    """Without noise and without nudges it is the true velocity, but for what held samples leave out."""
    walk = simulate(strides=3, rate_hz=rate_hz, noise=0.0)
    t, acc, gyr = walk.recording.t, walk.recording.acc, walk.recording.gyr
    true = walk.motion.at(t)
    start = len(t) // 2
    never = np.zeros(len(t), dtype=bool)
    velocity = ff._free_velocity(t, acc, gyr, never, start, true.nav_R_body[start], GRAVITY_M_S2)
    error = velocity - (true.velocity - true.velocity[start])
    assert np.abs(error).max() < 0.3 * (100 / rate_hz) ** 2
    assert np.ptp(true.velocity, axis=0).max() > 3.0


def test_tilt_is_forgotten_at_the_same_pace_at_every_rate():
    """A still sensor, levelled wrongly: what is left after the nudges is a velocity of g tilt times their time."""
    tilt, reached = 0.05, []
    for rate_hz in (100.0, 800.0):
        n = round(3 * rate_hz)
        acc = np.tile([0.0, 0.0, GRAVITY_M_S2], (n, 1))
        wrong = Rotation.from_rotvec([tilt, 0.0, 0.0]).as_matrix()
        still = np.ones(n, dtype=bool)
        reached.append(ff._free_velocity(np.arange(n) / rate_hz, acc, 0 * acc, still, 0, wrong, GRAVITY_M_S2)[-1])
    expected = GRAVITY_M_S2 * tilt * ff.TILT_TIME_S
    np.testing.assert_allclose([np.linalg.norm(v[:2]) for v in reached], expected, rtol=0.02)


def intervals(*pairs):
    return np.array([[a for a, _ in pairs], [b for _, b in pairs], [0.0] * len(pairs)], dtype=np.float64)


def test_gaps_longer_than_a_swing_are_filled_from_the_rough_search():
    t = np.arange(1200) / 200
    found = intervals((100, 140), (500, 540), (700, 740))
    rough = intervals((10, 20), (130, 160), (300, 310), (560, 570), (900, 1200))
    start, stop, _ = ff._fill_gaps(t, found, rough, 1.2)
    # filled: the gap of 1.8 s, and the end of 2.3 s; not: the start of 0.5 s, one that overlaps, a swing of 0.8 s
    np.testing.assert_array_equal(start, [100, 300, 500, 700, 900])
    np.testing.assert_array_equal(stop, [140, 310, 540, 740, 1200])


def test_without_any_footfall_all_of_the_rough_search_is_taken():
    rough = intervals((10, 20))
    np.testing.assert_array_equal(ff._fill_gaps(np.arange(50) / 200, np.empty((3, 0)), rough, 1.2), rough)


def test_the_second_search_finds_what_tilt_hides_from_the_first():
    """Where the gyroscope clips, each stride leaves a change of velocity that the narrow links do not believe."""
    walk = simulate(RUNNING, strides=10, seed=1)
    clip = np.radians(480.0)
    recording = replace(walk.recording, gyr=np.clip(walk.recording.gyr, -clip, clip))
    walking_only = replace(ff.FootfallParameters(), rough=ff.FootfallParameters().walking)
    with_both = detect_stances(recording).n_footfalls
    with_one = detect_stances(recording, StanceParameters(footfalls=walking_only)).n_footfalls
    assert with_one < with_both
    assert with_both >= 10


P = ff.FootfallParameters()


def apart(pairs, levels, rate_rad_s, p=P):
    """What `_apart` keeps of intervals with these least levels, the foot turning at a rate elsewhere."""
    n = pairs[-1][1] + 20
    level, gyr = np.full(n, 6.0), np.zeros((n, 3))
    gyr[:, 1] = rate_rad_s
    for (a, b), least in zip(pairs, levels, strict=True):
        level[a:b], gyr[a:b] = least, 0.0
    start, stop = np.array(pairs).T
    return ff._apart(np.arange(n) / 200, gyr, level, start, stop, p).tolist()


def test_of_two_stances_too_close_for_a_swing_the_stiller_stays():
    landing = [(20, 30), (50, 120)]  # 0.1 s apart
    assert apart(landing, [5.0, 4.0], 3.0) == [1]
    assert apart(landing, [4.0, 5.0], 3.0) == [0]


def test_a_mid_swing_between_two_stances_goes():
    assert apart([(20, 60), (90, 100), (130, 200)], [4.0, 5.0, 4.2], 8.0) == [0, 2]


def test_stances_a_swing_apart_a_fidget_and_two_rests_stay():
    assert apart([(20, 60), (160, 200)], [4.0, 5.0], 8.0) == [0, 1]  # 0.5 s
    assert apart([(20, 30), (50, 120)], [5.0, 4.0], 1.0) == [0, 1]  # does not turn as in a swing
    assert apart([(20, 30), (50, 120)], [2.0, 1.0], 3.0) == [0, 1]


def test_overlapping_intervals_become_one():
    level = np.array([9, 4, 3, 4, 5, 4, 2, 4, 9, 3, 9.0])
    for limits, expected in (([4.5, 4.5, 4.0], [(1, 4), (5, 8), (9, 10)]), ([4.5, 5.5, 4.0], [(1, 8), (9, 10)])):
        start, stop, _ = ff._grow(level, np.array([2, 6, 9]), np.array(limits))
        assert list(zip(start, stop, strict=True)) == expected
