"""Stamps and losses: what a logger may do to a recording, and what the rest of the library makes of it."""

import numpy as np
import pytest

from fg_nav.errors import SimulationError
from fg_nav.lab.simulation.sensors import ClockPrior
from fg_nav.lab.simulation.sensors.clock import ClockRun
from fg_nav.samples.stamps import remove_jitter


def started(prior: ClockPrior, rate_hz: float = 200.0, seed: int = 0) -> ClockRun:
    rng = np.random.default_rng(seed)
    return prior.draw(rng).switch_on(rng, rate_hz)


def lost_runs(row: np.ndarray) -> np.ndarray:
    gaps = np.diff(row) - 1
    return gaps[gaps > 0]


@pytest.mark.parametrize("jitter_s", [1e-4, 2e-3, 2e-2])
def test_jittered_stamps_rise_and_keep_the_rate(jitter_s: float) -> None:
    t = np.arange(100_000) / 200.0
    stamps, _, row = started(ClockPrior(jitter_s=jitter_s)).stamp(t)
    assert np.array_equal(row, np.arange(len(t)))
    assert (np.diff(stamps) > 0).all()
    assert (stamps[-1] - stamps[0]) / t[-1] == pytest.approx(1.0, abs=10 * jitter_s / t[-1])
    assert (stamps - t).std() > 0.5 * jitter_s


def test_small_jitter_is_what_was_asked_for_and_right_on_average() -> None:
    t = np.arange(100_000) / 200.0
    delay = started(ClockPrior(jitter_s=3e-4)).stamp(t)[0] - t
    assert delay.mean() == pytest.approx(0.0, abs=1e-5)
    assert delay.std() == pytest.approx(3e-4, rel=0.03)
    assert delay.min() > -3.001e-4


def test_when_a_sample_was_taken_is_given_without_delay() -> None:
    t = np.arange(10_000) / 200.0
    run = started(ClockPrior(jitter_s=5e-3, scale_sd=1e-3, dropped_share=0.1))
    stamps, taken, row = run.stamp(t)
    assert taken == pytest.approx((1 + run.clock.scale_error) * t[row], rel=1e-12)
    assert len(stamps) == len(taken) < len(t)
    assert (stamps - taken).min() >= -5e-3 - 1e-9
    assert (stamps - taken).std() > 2e-3


def test_our_own_timing_undoes_the_jitter() -> None:
    t = np.arange(20_000) / 200.0
    stamps, _, _ = started(ClockPrior(jitter_s=1e-3, scale_sd=3e-5)).stamp(t)
    assert np.abs(np.diff(stamps - t)).max() > 2e-3
    assert np.abs(np.diff(remove_jitter(stamps) - t)).max() < 5e-6


def test_a_clock_runs_fast_or_slow_by_its_scale() -> None:
    t = np.arange(10) / 100.0
    errors = []
    for seed in range(150):
        run = started(ClockPrior(scale_sd=1e-3), seed=seed)
        stamps, _, _ = run.stamp(t)
        assert stamps == pytest.approx((1 + run.clock.scale_error) * t, rel=1e-12)
        errors.append(run.clock.scale_error)
    assert np.std(errors) == pytest.approx(1e-3, rel=0.2)


@pytest.mark.parametrize(("share", "burst"), [(0.01, 1.0), (0.05, 3.0), (0.3, 8.0), (0.5, 1.0)])
def test_the_share_is_lost_in_bursts_up_to_the_longest_gap(share: float, burst: float) -> None:
    prior = ClockPrior(dropped_share=share, burst=burst, longest_gap_s=0.05)
    stamps, _, row = started(prior).stamp(np.arange(400_000) / 200.0)
    assert row[0] == 0
    assert 1 - len(row) / 400_000 == pytest.approx(share, rel=0.08)
    assert np.diff(stamps).max() <= 0.05 + 1e-9
    runs = lost_runs(row)
    cut = np.minimum(np.random.default_rng(1).geometric(1 / burst, 100_000), 9)
    assert runs.mean() == pytest.approx(cut.mean(), rel=0.04)
    assert runs.std() == pytest.approx(cut.std(), rel=0.05, abs=1e-9)


def test_nothing_is_lost_or_late_without_being_asked() -> None:
    t = np.arange(1000) / 123.0
    stamps, _, row = started(ClockPrior()).stamp(t)
    assert np.array_equal(stamps, t)
    assert np.array_equal(row, np.arange(1000))


def test_a_slow_sensor_cannot_lose_what_leaves_too_long_a_gap() -> None:
    with pytest.raises(SimulationError, match="longest_gap_s"):
        started(ClockPrior(dropped_share=0.01, longest_gap_s=0.05), rate_hz=20.0)
