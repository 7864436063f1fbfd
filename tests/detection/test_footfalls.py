"""Footfalls on simulated walks of many gaits: the count is exact, and the foot does stand where it is said to."""

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.signal import find_peaks
from scipy.spatial.transform import Rotation

from fg_nav.detection import detect_stances
from fg_nav.detection import footfalls as ff
from fg_nav.detection.footfalls import MANY, integrate_both_ways, start_at_rest
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.mount import Mount
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.person import Person
from fg_nav.lab.simulation.plan import Stand, Walk
from fg_nav.mechanisation import TILT_TIME_S
from tests.simulated import WALKERS, SimulatedFoot, corridor, mounted, simulated, straight_walk

SLOW_M_S = {Style.WALK: 0.12, Style.RUN: 0.25}
"""Speed of the sensor in stance: 9 cm above a foot that rolls by 75 and, of a runner, by 160 degrees a second."""

STYLES = pytest.mark.parametrize("style", [Style.WALK, Style.RUN], ids=["walk", "run"])


def in_mid_swing(t, swing):
    """(N,) True in the middle three fifths of each swing."""
    share = (t[:, None] - swing[:, 0]) / np.diff(swing).T
    return ((share > 0.2) & (share < 0.8)).any(axis=1)


def assert_true(walk: SimulatedFoot, stances, slow_m_s, strides=None):
    """Every stride is counted, and in no stance does the foot move, let alone swing."""
    strides = len(walk.swing) if strides is None else strides
    assert stances.n_footfalls == strides + 1
    assert walk.speed[stances.mask].max() < slow_m_s
    assert not (stances.mask & in_mid_swing(walk.recording.t, walk.swing)).any()


@WALKERS
@pytest.mark.parametrize("seed", range(6))
def test_demo_walks(person: Person, mount: Mount, seed: int):
    walk = corridor(person, mount, seed=seed)
    stances = detect_stances(walk.recording)
    assert_true(walk, stances, SLOW_M_S[Style.WALK])
    found = ((stances.stop - stances.start) * walk.recording.period_s)[1:-1]
    share = found / np.diff(walk.motion.flat).ravel()[1:-1]  # of a stance; the foot lands and lifts for a third of it
    assert share.min() > 0.25
    assert np.median(share) > 0.5


@pytest.mark.parametrize(
    ("scenario", "choices"),
    [("demo", Choices()), ("stairs", Choices()), ("mixed-gait", Choices(sensor="mpu-9250", field="homogeneous"))],
    ids=["demo", "stairs", "mixed gait"],
)
@pytest.mark.parametrize("seed", range(2))
def test_every_stride_of_a_scenario_is_counted(scenario, choices, seed):
    """Stairs, running and turning on the spot, with all that sensors do; the gyroscope must not clip a runner's."""
    walk = simulate(scenario, seed, choices)
    t, stances = walk.recording.t, detect_stances(walk.recording)
    assert stances.n_footfalls == len(walk.strides) + 1
    begin, end = walk.flat.T
    flat = [stances.mask[(t >= a) & (t <= b)].any() for a, b in zip(begin, end, strict=True)]
    assert all(flat)


@WALKERS
@STYLES
@pytest.mark.parametrize("noise", [0.0, 0.3, 3.0, 10.0])
def test_sensor_noise_does_not_matter(person, mount, style, noise):
    walk = straight_walk(person, style, noise=noise, mount=mount)
    assert_true(walk, detect_stances(walk.recording), SLOW_M_S[style])


MAX_SWING_S = 0.87


@WALKERS
@pytest.mark.parametrize("stride_s", [0.55, 0.7, 1.2, 1.7, 2.3])
def test_hurry_and_leisure(person, mount, stride_s):
    """The same path in another time: rates change with the pace, accelerations with its square.

    Who strolls stands for longer; the swing hardly takes more time.
    """
    share = min(person.walk.swing_share, MAX_SWING_S / stride_s)
    paced = replace(person, walk=replace(person.walk, stride_s=stride_s, swing_share=share))
    walk = straight_walk(paced, seed=2, mount=mount)
    assert_true(walk, detect_stances(walk.recording), SLOW_M_S[Style.WALK])


@WALKERS
@pytest.mark.parametrize("pace", [0.5, 0.7, 1.3, 2.0])
def test_slow_and_fast_walkers(person, mount, pace):
    """Who walks faster makes longer strides in less time, and comes down harder."""
    walk = straight_walk(person, pace=pace, seed=2, mount=mount)
    assert_true(walk, detect_stances(walk.recording), SLOW_M_S[Style.WALK])


@WALKERS
@pytest.mark.parametrize("seed", range(4))
def test_running(person, mount, seed):
    """A runner's foot is on the ground for 0.18 s and rolls all the time: still, but as still as a mid-swing."""
    walk = straight_walk(person, Style.RUN, seed=seed, mount=mount)
    stances = detect_stances(walk.recording)
    assert_true(walk, stances, SLOW_M_S[Style.RUN])
    assert len(stances) >= 13


def in_a_row(*sections) -> list:
    """Sections with their paths moved to where the one before ended, straight ahead."""
    reached, placed = np.zeros(3), []
    for section in sections:
        if isinstance(section, Walk):
            section = replace(section, path=section.path.translate(reached))
            reached = section.path.end.position
        placed.append(section)
    return placed


@WALKERS
@pytest.mark.parametrize("seed", range(3))
def test_walking_then_running_then_walking(person, mount, seed):
    going, running = Walk(straight(10.0), strides=8), Walk(straight(18.0), Style.RUN, strides=8)
    walk = simulated(in_a_row(Stand(1.0), going, running, going, Stand(1.0)), person, mount, seed=seed)
    stances = detect_stances(walk.recording)
    assert_true(walk, stances, SLOW_M_S[Style.RUN], strides=24)


@WALKERS
@STYLES
@pytest.mark.parametrize("rate_hz", [100.0, 137.0, 200.0, 400.0, 800.0])
def test_sample_rate_does_not_matter(person, mount, style, rate_hz):
    walk = straight_walk(person, style, rate_hz=rate_hz, mount=mount)
    assert_true(walk, detect_stances(walk.recording), SLOW_M_S[style])


@WALKERS
def test_stances_begin_and_end_at_the_same_time_at_every_rate(person, mount):
    edges = []
    for rate_hz in (100.0, 400.0):
        recording = straight_walk(person, rate_hz=rate_hz, noise=0.0, mount=mount).recording
        stances = detect_stances(recording)
        edges.append([recording.t[stances.start], recording.t[stances.stop - 1]])
    np.testing.assert_allclose(*edges, atol=0.016)


FIXED = straight_walk(style=Style.RUN, strides=6)


@given(rotvec=st.lists(st.floats(-3, 3), min_size=3, max_size=3))
@settings(max_examples=15, deadline=None)
def test_mounting_does_not_matter(rotvec):
    turned = detect_stances(mounted(FIXED.recording, Rotation.from_rotvec(rotvec)))
    asis = detect_stances(FIXED.recording)
    np.testing.assert_array_equal(turned.start, asis.start)
    np.testing.assert_array_equal(turned.footfall, asis.footfall)


@WALKERS
@pytest.mark.parametrize("axis", ["x", "y"])
def test_upside_down(person, mount, axis):
    walk = straight_walk(person, mount=mount)
    flipped = mounted(walk.recording, Rotation.from_euler(axis, 180, degrees=True))
    assert_true(walk, detect_stances(flipped), SLOW_M_S[Style.WALK])


@WALKERS
@pytest.mark.parametrize("bias_deg_s", [0.5, 3.0])
def test_an_uncalibrated_gyroscope_does_not_matter(person, mount, bias_deg_s):
    walk = straight_walk(person, mount=mount)
    bias = np.radians(bias_deg_s) * np.array([0.6, -0.6, 0.5])
    recording = replace(walk.recording, gyr=walk.recording.gyr + bias)
    assert_true(walk, detect_stances(recording), SLOW_M_S[Style.WALK])


HARDLY_LIFTED_S = 0.06  # A foot that pushes off moves slowly for so long, and may pass for standing.


def true_stances(walk, t, longer_s=0.0):
    """Seconds of each stance, of the standing before and after too, that lie within t."""
    begin = np.append(0.0, walk.swing[:, 1])
    end = np.append(walk.swing[:, 0], np.inf) + longer_s
    return np.clip(np.minimum(end, t[-1]) - np.maximum(begin, t[0]), 0.0, None)


@WALKERS
@STYLES
@pytest.mark.parametrize("side", ["start", "end"])
def test_a_recording_may_begin_and_end_anywhere(person, mount, style, side):
    """Cut at every phase of a stride: no swing is taken for a stance, and only a cut stance may be missed.

    Of a runner the outermost stance may be missed: one velocity more does not tell it from a mid-swing.
    """
    walk = straight_walk(person, style, strides=9, mount=mount)
    a, b = np.searchsorted(walk.recording.t, walk.swing[[3, 4], 0])
    for cut in range(a, b, 6):
        part = walk.recording.slice(cut, len(walk.recording)) if side == "start" else walk.recording.slice(0, cut)
        stances = detect_stances(part)
        lasting = true_stances(walk, part.t)
        whole = np.count_nonzero(lasting > 0.12) - (style is Style.RUN)
        assert whole <= stances.n_footfalls <= np.count_nonzero(true_stances(walk, part.t, HARDLY_LIFTED_S))
        speed = np.linalg.norm(walk.motion.at(part.t).velocity, axis=1)
        assert speed[stances.mask].max() < max(SLOW_M_S[style], 0.15)


@WALKERS
def test_a_walk_without_any_standing(person, mount):
    walk = straight_walk(person, strides=10, mount=mount)
    a, b = np.searchsorted(walk.recording.t, [walk.swing[1].mean(), walk.swing[8].mean()])
    part = walk.part(a, b)
    assert_true(part, detect_stances(part.recording), SLOW_M_S[Style.WALK], strides=6)


@WALKERS
def test_the_first_and_the_last_rest_reach_to_the_ends(person, mount):
    recording = straight_walk(person, mount=mount).recording
    stances = detect_stances(recording)
    assert stances.start[0] == 0
    assert stances.stop[-1] == len(recording)
    assert recording.t[stances.stop[0] - 1] == pytest.approx(2.0, abs=0.08)  # the push begins before heel-off


@WALKERS
def test_a_pause_in_mid_walk_is_one_footfall(person, mount):
    some = Walk(straight(5.0), strides=5)
    walk = simulated(in_a_row(Stand(2.0), some, Stand(4.0), some, Stand(2.0)), person, mount)
    stances = detect_stances(walk.recording)
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
    chain = ff._find_best_chain(*problem)
    assert np.all(np.diff(chain) > 0)
    assert score(tuple(chain)) == pytest.approx(best, rel=1e-12)


@given(
    values=st.lists(st.integers(-50, 50), min_size=1, max_size=40, unique=True), prominence=st.sampled_from([1, 5, 20])
)
@settings(max_examples=200, deadline=None)
def test_minima_are_the_prominent_ones(values, prominence):
    level = np.array(values, dtype=np.float64) + 0.5 * np.arange(len(values)) / len(values)  # no two equally prominent
    assume(len(level) == 1 or np.abs(np.abs(np.subtract.outer(level, level)) - prominence).min() > 1e-9)
    first, last = ff._find_minima(level, float(prominence))
    walled = np.concatenate([[1e3], level, [1e3]])
    peaks, _ = find_peaks(-walled, prominence=prominence)
    np.testing.assert_array_equal(first, peaks - 1)
    np.testing.assert_array_equal(last, first)


def test_a_rest_is_one_minimum_from_its_first_sample_to_its_last():
    level = np.array([5.0, 3, 3, 3.2, 3, 5, 4, 5, 3, 3])
    first, last = ff._find_minima(level, 0.5)
    np.testing.assert_array_equal(first, [1, 6, 8])
    np.testing.assert_array_equal(last, [4, 6, 9])


def integrate_velocity(t, acc, gyr, still, first, nav_R_body):
    """Free velocity from rest and this attitude at a sample, both ways."""
    h, hole = np.diff(t, append=2 * t[-1] - t[-2]), np.zeros(len(t), dtype=bool)
    return integrate_both_ways(start_at_rest(nav_R_body), np.array([MANY]), first, acc, gyr, h, still, hole)


@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_free_velocity_both_ways_from_any_sample(rate_hz):
    """Without noise and without nudges it is the true velocity, but for what held samples leave out."""
    walk = straight_walk(strides=3, rate_hz=rate_hz, noise=0.0)
    t, acc, gyr = walk.recording.t, walk.recording.acc, walk.recording.gyr
    true = walk.motion.at(t)
    start = len(t) // 2
    never = np.zeros(len(t), dtype=bool)
    velocity = integrate_velocity(t, acc, gyr, never, start, true.nav_R_body[start])
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
        reached.append(integrate_velocity(np.arange(n) / rate_hz, acc, 0 * acc, still, 0, wrong)[-1])
    expected = GRAVITY_M_S2 * tilt * TILT_TIME_S
    np.testing.assert_allclose([np.linalg.norm(v[:2]) for v in reached], expected, rtol=0.02)


def intervals(*pairs):
    return np.array([[a for a, _ in pairs], [b for _, b in pairs], [0.0] * len(pairs)], dtype=np.float64)


def test_gaps_longer_than_a_swing_are_filled_from_the_rough_search():
    t = np.arange(1200) / 200
    found = intervals((100, 140), (500, 540), (700, 740))
    rough = intervals((10, 20), (130, 160), (300, 310), (560, 570), (900, 1200))
    start, stop, _ = ff._fill_gaps(t, found, rough)
    # filled: the gap of 1.8 s, and the end of 2.3 s; not: the start of 0.5 s, one that overlaps, a swing of 0.8 s
    np.testing.assert_array_equal(start, [100, 300, 500, 700, 900])
    np.testing.assert_array_equal(stop, [140, 310, 540, 740, 1200])


def test_without_any_footfall_all_of_the_rough_search_is_taken():
    rough = intervals((10, 20))
    np.testing.assert_array_equal(ff._fill_gaps(np.arange(50) / 200, np.empty((3, 0)), rough), rough)


def test_the_second_search_finds_what_tilt_hides_from_the_first(monkeypatch):
    """Where the gyroscope clips, each stride leaves a change of velocity that the narrow links do not believe.

    A runner's foot turns by 850 to 900 degrees a second: here a fifth of each peak is cut off.
    """
    walk = straight_walk(style=Style.RUN, strides=10, seed=1)
    clip = np.radians(700.0)
    recording = replace(walk.recording, gyr=np.clip(walk.recording.gyr, -clip, clip))
    monkeypatch.setattr(ff, "_fill_cycles", lambda t, acc, level, stances: stances)  # which would find them too
    with_both = detect_stances(recording).n_footfalls
    monkeypatch.setattr(ff, "ROUGH", ff.WALKING)
    with_one = detect_stances(recording).n_footfalls
    assert with_one < with_both
    assert with_both >= 10


def apart(pairs, levels, rate_rad_s):
    """What `_choose_apart` keeps of intervals with these least levels, the foot turning at a rate elsewhere."""
    n = pairs[-1][1] + 20
    level, gyr = np.full(n, 6.0), np.zeros((n, 3))
    gyr[:, 1] = rate_rad_s
    for (a, b), least in zip(pairs, levels, strict=True):
        level[a:b], gyr[a:b] = least, 0.0
    start, stop = np.array(pairs).T
    return ff._choose_apart(np.arange(n) / 200, gyr, level, start, stop).tolist()


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
        found = np.empty((3, 3))
        start, stop, _ = found[:, : ff._grow_and_merge(level, np.array([2, 6, 9]), np.array(limits), found)]
        assert list(zip(start, stop, strict=True)) == expected
