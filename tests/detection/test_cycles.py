"""The stances of a foot that runs, whose gyroscope clips in every swing: one a cycle, found by the rhythm."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.detection import footfalls as ff
from fg_nav.detection.footfalls import find_cycle_stances, is_lowest_of_cycle, measure_period
from fg_nav.lab.simulation.motion import Style
from fg_nav.recording import Recording
from tests.simulated import SimulatedFoot, straight_walk

RANGE_RAD_S = 8.9  # Of a sensor of 500 deg/s.


def clipped(recording: Recording, limit: float = RANGE_RAD_S) -> Recording:
    return replace(recording, gyr=np.clip(recording.gyr, -limit, limit))


@pytest.fixture(scope="module", params=range(2))
def run(request) -> SimulatedFoot:
    return straight_walk(style=Style.RUN, strides=30, seed=request.param)


def test_a_run_with_a_clipped_gyroscope_has_one_stance_a_cycle_on_the_ground(run, monkeypatch):
    """A foot in mid-swing moves at 6 m/s."""
    t, found = run.recording.t, detect_stances(clipped(run.recording))
    assert found.n_footfalls == len(run.swing) + 1
    assert run.speed[found.stillest(run.recording.gyr)].max() < 0.3
    assert t[found.start[0]] - t[0] < 0.1
    assert t[-1] - t[found.stop[-1] - 1] < 0.1
    monkeypatch.setattr(ff, "_fill_cycles", lambda t, acc, level, stances: stances)
    by_velocity = detect_stances(clipped(run.recording))
    assert by_velocity.n_footfalls < 0.6 * len(run.swing)  # velocity does not show the others ...
    pairs, all_pairs = (set(zip(one.start, one.stop, strict=True)) for one in (by_velocity, found))
    assert pairs < all_pairs  # ... and what it shows stays


def test_of_a_foot_that_walks_nothing_is_changed(monkeypatch):
    recording = straight_walk(style=Style.WALK, strides=12, seed=3).recording
    with_cycles = detect_stances(recording)
    monkeypatch.setattr(ff, "_fill_cycles", lambda t, acc, level, stances: stances)
    without = detect_stances(recording)
    np.testing.assert_array_equal(with_cycles.start, without.start)
    np.testing.assert_array_equal(with_cycles.stop, without.stop)


# --- the parts, on a level that is made ------------------------------------------------------------------------------

PERIOD_S, RATE_HZ = 0.8, 200
T = np.arange(0, 8, 1 / RATE_HZ)
STANCES = np.arange(0.4, 8, PERIOD_S)


def make_level(swing: float = 5.9, stance: float = 5.2) -> np.ndarray:
    """Level with a dip at each stance, and a shallower one in the middle of each swing."""
    level = np.full(len(T), 6.8)
    for center, depth in ((0.4, stance), (0.75, swing)):
        apart = np.abs((T - center + PERIOD_S / 2) % PERIOD_S - PERIOD_S / 2)
        level = np.minimum(level, depth + 20 * apart)
    return level


def landing(at: np.ndarray) -> np.ndarray:
    """Specific force with a peak 0.1 s before each of these times."""
    acc = np.tile([0.0, 0.0, 9.81], (len(T), 1))
    acc[np.round((at - 0.1) * RATE_HZ).astype(int), 2] = 60.0
    return acc


def find(level: np.ndarray, acc: np.ndarray) -> np.ndarray:
    nothing = np.empty(0)
    return T[find_cycle_stances(T, acc, level, ff._find_minima(level, ff.PROMINENCE)[0], nothing, nothing)]


def test_the_period_is_that_of_the_level():
    middle = len(T) // 2
    assert measure_period(T, make_level(), middle) == pytest.approx(PERIOD_S, abs=0.021)
    noise = np.random.default_rng(1).normal(5.5, 0.5, len(T))
    assert measure_period(T, noise, middle) == 0.0
    assert measure_period(T, np.full(len(T), 5.0), middle) == 0.0
    assert all(
        measure_period(T + 0.1 * k, make_level(), len(T) - 250) > 0.0 for k in range(50)
    )  # whatever rounding says


def test_the_lowest_of_each_cycle_is_a_stance_and_the_mid_swing_is_not():
    """The last one waits for what is not recorded yet: that may be lower."""
    np.testing.assert_allclose(find(make_level(), landing(STANCES)), STANCES[:-1], atol=0.006)
    assert is_lowest_of_cycle(T, make_level(), round(0.4 * RATE_HZ), PERIOD_S)
    assert not is_lowest_of_cycle(T, make_level(), round(0.75 * RATE_HZ), PERIOD_S)
    assert len(find(make_level(), np.tile([0.0, 0.0, 9.81], (len(T), 1)))) == 0  # it never lands
    assert len(find(make_level(stance=6.6, swing=6.7), landing(STANCES))) == 0  # it is never still
