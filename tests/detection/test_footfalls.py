"""Footfalls on simulated walks of many gaits: the count is exact, and the foot does stand where it is said to.

Of a foot that runs, whose gyroscope clips in every swing, there is one a cycle, found by the rhythm.
"""

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from scipy.signal import find_peaks
from scipy.spatial.transform import Rotation

from fg_nav.detection import detect_stances
from fg_nav.detection import footfalls as ff
from fg_nav.detection.footfalls import MANY, integrate_both_ways, start_at_rest
from fg_nav.detection.stance import STATISTICS
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.plan import Stand, Walk
from fg_nav.mechanisation import TILT_TIME_S
from tests.simulated import WALKERS, SimulatedFoot, corridor, mounted, simulated, straight_walk

SLOW_M_S = {Style.WALK: 0.12, Style.RUN: 0.25}
"""Speed of the sensor in stance: 9 cm above a foot that rolls by 75 and, of a runner, by 160 degrees a second."""


def in_mid_swing(t, swing):
    """(N,) True in the middle three fifths of each swing."""
    share = (t[:, None] - swing[:, 0]) / np.diff(swing).T
    return ((share > 0.2) & (share < 0.8)).any(axis=1)


def assert_true(walk: SimulatedFoot, stances, style, strides=None):
    """Every stride is counted, and in no stance does the foot move, let alone swing."""
    strides = len(walk.swing) if strides is None else strides
    assert stances.n_footfalls == strides + 1
    assert walk.speed[stances.mask].max() < SLOW_M_S[style]
    assert not (stances.mask & in_mid_swing(walk.recording.t, walk.swing)).any()


@WALKERS
def test_demo_walks(person, mount):
    for seed in range(3):
        walk = corridor(person, mount, seed=seed)
        stances = detect_stances(walk.recording)
        assert_true(walk, stances, Style.WALK)
        found = ((stances.stop - stances.start) * walk.recording.period_s)[1:-1]
        share = found / np.diff(walk.motion.flat).ravel()[1:-1]  # of a stance; it lands and lifts for a third of it
        assert share.min() > 0.25
        assert np.median(share) > 0.5


@pytest.mark.parametrize("scenario", ["demo", "stairs", "mixed-gait"])
@pytest.mark.parametrize("seed", range(2))
def test_every_stride_of_a_scenario_is_counted(scenario, seed):
    """Stairs, running and turning on the spot, with all that sensors do; the gyroscope must not clip a runner's."""
    choices = Choices(sensor="mpu-9250", field="homogeneous") if scenario == "mixed-gait" else Choices()
    walk = simulate(scenario, seed, choices)
    t, stances = walk.recording.t, detect_stances(walk.recording)
    assert stances.n_footfalls == len(walk.strides) + 1
    assert all(stances.mask[(t >= begin) & (t <= end)].any() for begin, end in walk.flat)


@WALKERS
@pytest.mark.parametrize(
    ("style", "name", "values"),
    [
        (Style.WALK, "stride_s", [0.55, 0.7, 1.2, 1.7, 2.3]),
        (Style.WALK, "noise", [0.0, 0.3, 3.0, 10.0]),
        (Style.RUN, "noise", [0.0, 0.3, 3.0, 10.0]),
        (Style.WALK, "rate_hz", [100.0, 137.0, 400.0, 800.0]),
        (Style.RUN, "rate_hz", [100.0, 137.0, 400.0, 800.0]),
        (Style.WALK, "pace", [0.5, 0.7, 1.3, 2.0]),  # longer strides in less time, and harder
        (Style.RUN, "seed", range(4)),  # on the ground for 0.18 s, and as still as in a mid-swing
    ],
)
def test_hurry_noise_rate_and_pace_do_not_matter(person, mount, style, name, values):
    """Rates change with the pace, accelerations with its square. Who strolls stands for longer; the swing does not."""
    for value in values:
        if name == "stride_s":
            share = min(person.walk.swing_share, 0.87 / value)
            paced = replace(person, walk=replace(person.walk, stride_s=value, swing_share=share))
            walk = straight_walk(paced, seed=2, mount=mount)
        else:
            walk = straight_walk(person, style, mount=mount, **{name: value})
        assert_true(walk, detect_stances(walk.recording), style)


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
def test_walking_then_running_then_walking_and_a_pause(person, mount):
    going, running = Walk(straight(10.0), strides=8), Walk(straight(18.0), Style.RUN, strides=8)
    for seed in range(3):
        walk = simulated(in_a_row(Stand(1.0), going, running, going, Stand(1.0)), person, mount, seed=seed)
        assert_true(walk, detect_stances(walk.recording), Style.RUN, strides=24)
    some = Walk(straight(5.0), strides=5)
    walk = simulated(in_a_row(Stand(2.0), some, Stand(4.0), some, Stand(2.0)), person, mount)
    stances = detect_stances(walk.recording)
    assert stances.n_footfalls == 11
    assert np.count_nonzero((stances.stop - stances.start) / 200 > 3.5) == 1


@WALKERS
def test_neither_mounting_nor_an_uncalibrated_gyroscope_matter(person, mount):
    walk = straight_walk(person, Style.RUN, mount=mount)
    asis = detect_stances(walk.recording)
    for rotvec in ([np.pi, 0.0, 0.0], [0.0, np.pi, 0.0], [1.0, -2.0, 0.5], [-0.3, 0.1, 2.8]):
        turned = detect_stances(mounted(walk.recording, Rotation.from_rotvec(rotvec)))
        np.testing.assert_array_equal(turned.start, asis.start)
        np.testing.assert_array_equal(turned.footfall, asis.footfall)
    walk = straight_walk(person, mount=mount)
    for bias_deg_s in (0.0, 0.5, 3.0):
        bias = np.radians(bias_deg_s) * np.array([0.6, -0.6, 0.5])
        stances = detect_stances(replace(walk.recording, gyr=walk.recording.gyr + bias))
        assert_true(walk, stances, Style.WALK)
        assert stances.start[0] == 0
        assert stances.stop[-1] == len(walk.recording)
        assert walk.recording.t[stances.stop[0] - 1] == pytest.approx(2.0, abs=0.08)  # the push precedes heel-off


@WALKERS
@pytest.mark.parametrize("style", [Style.WALK, Style.RUN])
def test_a_recording_may_begin_and_end_anywhere(person, mount, style):
    """Cut at every phase of a stride: no swing is taken for a stance, and only a cut stance may be missed.

    Of a runner the outermost stance may be missed: one velocity more does not tell it from a mid-swing. A foot that
    pushes off moves slowly for 0.06 s, and may pass for standing.
    """
    walk = straight_walk(person, style, strides=9, mount=mount)
    begin, end = np.append(0.0, walk.swing[:, 1]), np.append(walk.swing[:, 0], np.inf)
    a, b = np.searchsorted(walk.recording.t, walk.swing[[3, 4], 0])
    parts = [walk.recording.slice(cut, len(walk.recording)) for cut in range(a, b, 6)]
    for part in (*parts, *(walk.recording.slice(0, cut) for cut in range(a, b, 6))):
        stances, (first, last) = detect_stances(part), part.t[[0, -1]]
        sure, hardly = (np.minimum(end + lifted, last) - np.maximum(begin, first) for lifted in (0.0, 0.06))
        assert np.count_nonzero(sure > 0.12) - (style is Style.RUN) <= stances.n_footfalls
        assert stances.n_footfalls <= np.count_nonzero(hardly > 0.0)
        speed = np.linalg.norm(walk.motion.at(part.t).velocity, axis=1)
        assert speed[stances.mask].max() < max(SLOW_M_S[style], 0.15)
    if style is Style.WALK:  # and cut at both ends, without any standing
        part = walk.part(*np.searchsorted(walk.recording.t, [walk.swing[1].mean(), walk.swing[7].mean()]))
        assert_true(part, detect_stances(part.recording), style, strides=5)


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


def test_the_best_chain_is_the_best_of_all():
    for seed in range(40):
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


def test_minima_are_the_prominent_ones():
    rng = np.random.default_rng(1)
    for count in (1, 2, 7, 40, 40, 40):
        level = 50.0 * rng.standard_normal(count)
        for prominence in (1.0, 5.0, 20.0):
            first, last = ff._find_minima(level, prominence)
            peaks, _ = find_peaks(-np.concatenate([[1e3], level, [1e3]]), prominence=prominence)
            np.testing.assert_array_equal(first, peaks - 1)
            np.testing.assert_array_equal(last, first)
    rest = np.array([5.0, 3, 3, 3.2, 3, 5, 4, 5, 3, 3])  # of which each is one from its first sample to its last
    np.testing.assert_array_equal(ff._find_minima(rest, 0.5), [[1, 6, 8], [4, 6, 9]])


@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_free_velocity_both_ways_from_any_sample_and_of_a_still_sensor_what_tilt_leaves(rate_hz):
    """Without noise and nudges it is the true velocity, but for what held samples leave out.

    A still sensor, levelled wrongly: what the nudges leave is a velocity of g tilt times their time, at every rate.
    """
    walk = straight_walk(strides=3, rate_hz=rate_hz, noise=0.0)
    t, true, start = walk.recording.t, walk.motion.at(walk.recording.t), len(walk.recording) // 2
    h, no = np.full(len(t), 1 / rate_hz), np.zeros(len(t), dtype=bool)
    at_rest = start_at_rest(true.nav_R_body[start]), np.array([MANY]), start
    velocity = integrate_both_ways(*at_rest, walk.recording.acc, walk.recording.gyr, h, no, no)
    assert np.abs(velocity - (true.velocity - true.velocity[start])).max() < 0.3 * (100 / rate_hz) ** 2
    assert np.ptp(true.velocity, axis=0).max() > 3.0
    tilted = start_at_rest(Rotation.from_rotvec([0.05, 0.0, 0.0]).as_matrix()), np.array([MANY]), 0
    still = np.tile([0.0, 0.0, GRAVITY_M_S2], (len(t), 1))
    reached = integrate_both_ways(*tilted, still, 0 * still, h, ~no, no)[-1]
    assert np.linalg.norm(reached[:2]) == pytest.approx(GRAVITY_M_S2 * 0.05 * TILT_TIME_S, rel=0.02)
    # behind a hole, in which the sensor was turned, the still samples level it at once
    hole, turned = np.arange(len(t)) == start, Rotation.from_rotvec([0.5, 0.0, 0.0]).apply(still)
    level = start_at_rest(np.eye(3)), np.array([MANY]), 0
    after = np.where((np.arange(len(t)) > start)[:, None], turned, still)
    assert np.linalg.norm(integrate_both_ways(*level, after, 0 * still, h, ~no, hole)[-1]) < 0.2


def test_gaps_longer_than_a_swing_are_filled_from_the_rough_search():
    found, rough = (
        np.array([*np.transpose(pairs), [0.0] * len(pairs)])
        for pairs in (
            [(100, 140), (500, 540), (700, 740)],
            [(10, 20), (130, 160), (300, 310), (560, 570), (900, 1200)],
        )
    )
    start, stop, _ = ff._fill_gaps(np.arange(1200) / 200, found, rough)
    # filled: the gap of 1.8 s, and the end of 2.3 s; not: the start of 0.5 s, one that overlaps, a swing of 0.8 s
    np.testing.assert_array_equal(start, [100, 300, 500, 700, 900])
    np.testing.assert_array_equal(stop, [140, 310, 540, 740, 1200])
    np.testing.assert_array_equal(ff._fill_gaps(np.arange(1200) / 200, np.empty((3, 0)), rough), rough)


@pytest.mark.parametrize(
    ("pairs", "levels", "rate_rad_s", "kept"),
    [
        ([(20, 30), (50, 120)], [5.0, 4.0], 3.0, [1]),  # 0.1 s apart, too close for a swing: the stiller stays
        ([(20, 30), (50, 120)], [4.0, 5.0], 3.0, [0]),
        ([(20, 60), (90, 100), (130, 200)], [4.0, 5.0, 4.2], 8.0, [0, 2]),  # a mid-swing goes
        ([(20, 60), (160, 200)], [4.0, 5.0], 8.0, [0, 1]),  # a swing apart, 0.5 s
        ([(20, 30), (50, 120)], [5.0, 4.0], 1.0, [0, 1]),  # a fidget: it does not turn as in a swing
        ([(20, 30), (50, 120)], [2.0, 1.0], 3.0, [0, 1]),  # two rests
    ],
)
def test_which_of_close_stances_stay(pairs, levels, rate_rad_s, kept):
    n = pairs[-1][1] + 20
    level, gyr = np.full(n, 6.0), np.zeros((n, 3))
    gyr[:, 1] = rate_rad_s
    for (a, b), least in zip(pairs, levels, strict=True):
        level[a:b], gyr[a:b] = least, 0.0
    start, stop = np.array(pairs).T
    assert ff._choose_apart(np.arange(n) / 200, gyr, level, start, stop).tolist() == kept


def test_overlapping_intervals_become_one():
    level = np.array([9, 4, 3, 4, 5, 4, 2, 4, 9, 3, 9.0])
    for limits, expected in (([4.5, 4.5, 4.0], [(1, 4), (5, 8), (9, 10)]), ([4.5, 5.5, 4.0], [(1, 8), (9, 10)])):
        found = np.empty((3, 3))
        start, stop, _ = found[:, : ff._grow_and_merge(level, np.array([2, 6, 9]), np.array(limits), found)]
        assert list(zip(start, stop, strict=True)) == expected


RANGE_RAD_S = 8.9  # Of a sensor of 500 deg/s.


@pytest.fixture(scope="module", params=range(2))
def run(request):
    foot = straight_walk(style=Style.RUN, strides=30, seed=request.param)
    gyr = np.clip(foot.recording.gyr, -RANGE_RAD_S, RANGE_RAD_S)
    return replace(foot, recording=replace(foot.recording, gyr=gyr))


def without_cycles(monkeypatch, recording):
    monkeypatch.setattr(ff, "_fill_cycles", lambda t, acc, level, stances: stances)
    return detect_stances(recording)


def test_a_run_with_a_clipped_gyroscope_has_one_stance_a_cycle_on_the_ground(run, monkeypatch):
    """A foot in mid-swing moves at 6 m/s."""
    t, found = run.recording.t, detect_stances(run.recording)
    assert found.n_footfalls == len(run.swing) + 1
    assert run.speed[found.stillest(run.recording.gyr)].max() < 0.3
    assert max(t[found.start[0]] - t[0], t[-1] - t[found.stop[-1] - 1]) < 0.1
    by_velocity = without_cycles(monkeypatch, run.recording)
    assert by_velocity.n_footfalls < 0.6 * len(run.swing)  # velocity does not show the others ...
    pairs, all_pairs = (set(zip(one.start, one.stop, strict=True)) for one in (by_velocity, found))
    assert pairs < all_pairs  # ... and what it shows stays


def test_of_a_foot_that_walks_nothing_is_changed(monkeypatch):
    recording = straight_walk(style=Style.WALK, strides=12, seed=3).recording
    with_cycles, without = detect_stances(recording), without_cycles(monkeypatch, recording)
    np.testing.assert_array_equal(with_cycles.start, without.start)
    np.testing.assert_array_equal(with_cycles.stop, without.stop)


def test_the_period_is_that_of_the_gait_and_its_lowest_level_is_a_stance_and_no_mid_swing(run):
    r, nothing = run.recording, np.empty(0)
    level = np.log10(STATISTICS["shoe"](r.acc, r.gyr, 10))

    def stillest(spans):
        return [int(a + np.argmin(level[a:b])) for a, b in (np.searchsorted(r.t, span) for span in spans)]

    flat, cycle_s = run.motion.flat[1:-1], np.median(np.diff(run.motion.flat[:, 0]))
    middle = run.swing[1:-1] @ np.array([[0.7, 0.3], [0.3, 0.7]])
    for i in stillest(flat):
        assert ff.measure_period(r.t, level, i) == pytest.approx(
            cycle_s, abs=0.05
        )  # one cycle of a runner, who varies by 3 %,
    assert np.mean([ff.is_lowest_of_cycle(r.t, level, i, cycle_s) for i in stillest(flat)]) > 0.8
    assert not any(ff.is_lowest_of_cycle(r.t, level, i, cycle_s) for i in stillest(middle))
    noise = np.random.default_rng(1).normal(5.5, 0.5, len(level))
    for other in (noise, np.full(len(level), 5.0)):
        assert ff.measure_period(r.t, other, len(level) // 2) == 0.0
    for k in range(50):  # whatever rounding says, near the end
        assert ff.measure_period(r.t + 0.1 * k, level, len(level) - 450) > 0.0
    # all stances, of which none is known: but where the foot never lands, or is never still
    minima = ff._find_minima(level, ff.PROMINENCE)[0]
    found = ff.find_cycle_stances(r.t, r.acc, level, minima, nothing, nothing)
    assert abs(len(found) - len(flat)) <= 1
    assert run.speed[found].max() < 0.3
    # the last one waits for what is not recorded yet: that may be lower
    n = int(np.searchsorted(r.t, r.t[found[-1]] + 0.4 * cycle_s))
    part = ff.find_cycle_stances(r.t[:n], r.acc[:n], level[:n], minima[minima < n], nothing, nothing)
    assert part.tolist() == found[:-1].tolist()
    landless = np.tile([0.0, 0.0, 9.81], (len(level), 1))
    for acc, of in ((landless, level), (r.acc, level - level.min() + ff.MAX_CYCLE_LEVEL)):
        assert len(ff.find_cycle_stances(r.t, acc, of, minima, nothing, nothing)) == 0


def test_of_a_sprinter_two_cycles_correlate_as_well_as_one_and_one_is_the_period():
    foot = straight_walk(style=Style.RUN, strides=20, pace=1.5, noise=0.0)
    r, flat = foot.recording, foot.motion.flat
    level = np.log10(STATISTICS["shoe"](r.acc, r.gyr, 10))
    period_s = [ff.measure_period(r.t, level, i) for i in np.searchsorted(r.t, flat[4:-4].mean(axis=1))]
    np.testing.assert_allclose(period_s, np.median(np.diff(flat[:, 0])), atol=0.03)
