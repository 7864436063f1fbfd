"""The stances of a foot that runs, whose gyroscope clips in every swing: one a cycle, found by the rhythm."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.detection import footfalls as ff
from fg_nav.detection.stance import STATISTICS
from fg_nav.lab.simulation.motion import Style
from tests.simulated import straight_walk

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
