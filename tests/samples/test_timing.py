"""Even stamps: simulated sensors behind a jittering transport."""

import numpy as np
import pytest

from fg_nav.io import read, read_raw
from fg_nav.samples.stamps import fit_clock, remove_jitter
from tests.real_data import DATA, needs_data

RATE = 200.0
N = 12_000


def _ticks(drift_ppm: float = 0.0) -> np.ndarray:
    """True sample times of a crystal that drifts linearly by so much in a minute."""
    t = np.arange(N) / RATE
    return t + drift_ppm * 1e-6 * t**2 / 60.0


def _bursts(t: np.ndarray, rng: np.random.Generator, stalls: int, length_s: float) -> np.ndarray:
    """Stamps of a transport that stalls now and then and then delivers all at once, 50 us apart."""
    late = t.copy()
    for start in rng.uniform(t[0] + 1, t[-1] - 1, stalls):
        held = (t >= start) & (t < start + length_s)
        late[held] = start + length_s + 5e-5 * np.arange(np.count_nonzero(held))
    return np.maximum.accumulate(late + 1e-9 * np.arange(len(t)))


@pytest.mark.parametrize("drift_ppm", [0.0, 20.0, -20.0])
@pytest.mark.parametrize("jitter_ms", [0.1, 0.5, 1.0])
def test_white_jitter_and_drift(drift_ppm: float, jitter_ms: float) -> None:
    rng = np.random.default_rng(1)
    truth = _ticks(drift_ppm)
    stamps = np.sort(truth + 1e-3 * jitter_ms * rng.exponential(size=N))
    even = remove_jitter(stamps)
    assert np.std(stamps - truth) > 0.5e-3 * jitter_ms
    assert np.std(even - truth) < 0.15e-3 * jitter_ms
    assert np.std(np.diff(even) - np.diff(truth)) < 0.01e-3 * jitter_ms


def test_dropped_samples_stay_dropped() -> None:
    rng = np.random.default_rng(2)
    kept = np.sort(rng.choice(N, N - 150, replace=False))
    truth = _ticks()[kept]
    even = remove_jitter(np.sort(truth + 3e-4 * rng.exponential(size=len(kept))))
    np.testing.assert_allclose(np.diff(even) * RATE, np.diff(kept), atol=0.02)


def test_bursts_are_no_gaps() -> None:
    rng = np.random.default_rng(3)
    truth = _ticks()
    stamps = _bursts(truth + 1e-4 * rng.exponential(size=N), rng, stalls=40, length_s=0.06)
    assert np.diff(stamps).max() > 0.05
    even = remove_jitter(stamps)
    np.testing.assert_allclose(np.diff(even), 1 / RATE, rtol=1e-3)
    assert np.abs(even - truth - np.median(even - truth)).max() < 5e-4


def test_polling_slower_than_the_sensor() -> None:
    """A logger that looks every 6 ms stamps what it finds with the time of its look."""
    truth = _ticks()
    look = np.ceil(truth / 0.006) * 0.006
    stamps = look + 2e-5 * np.concatenate(([0], np.cumsum(np.diff(look) == 0)))
    stamps = np.maximum.accumulate(stamps) + 1e-7 * np.arange(N)
    assert np.median(np.diff(stamps)) > 0.0055
    assert fit_clock(stamps).period == pytest.approx(1 / RATE, rel=1e-2)
    np.testing.assert_allclose(np.diff(remove_jitter(stamps)), np.mean(np.diff(stamps)), rtol=1e-2)


def test_a_true_gap_that_is_no_whole_number_of_ticks() -> None:
    rng = np.random.default_rng(4)
    truth = _ticks()
    truth[5000:] += 0.1017
    even = remove_jitter(truth + 2e-4 * rng.uniform(size=N))
    assert even[5000] - even[4999] == pytest.approx(0.1067, abs=2e-4)
    np.testing.assert_allclose(np.delete(np.diff(even), 4999), 1 / RATE, rtol=1e-2)


def test_few_uneven_and_even_stamps_are_left_alone() -> None:
    """Where the sensor itself samples unevenly, the deviations add up: its stamps are right."""
    rng = np.random.default_rng(5)
    few = (_ticks()[:n] + 1e-4 * rng.uniform(size=n) for n in (2, 20, 49))
    for t in (np.cumsum(rng.uniform(4e-3, 6e-3, N)), *few, _ticks() + 1e-6 * rng.normal(size=N)):
        assert remove_jitter(t) is t


@needs_data
def test_real_stamps() -> None:
    """Those of vicon and a gdin recording become even; drops of x-io stay."""
    for path in sorted((DATA / "vicon").glob("*.mat"))[::7]:
        t = read_raw(path).t
        even = remove_jitter(t)
        np.testing.assert_allclose(np.diff(even), 0.005, rtol=1e-3)
        assert np.abs(even - t).max() < 5e-3
    t = read_raw(DATA / "gdin/own/SensorConnectData_40.csv").t
    assert np.median(np.diff(t)) > 0.0059
    np.testing.assert_allclose(np.diff(remove_jitter(t)), 0.005, rtol=1e-3)
    t = read(DATA / "xio/short_walk.csv").t
    assert remove_jitter(t) is t
    assert np.count_nonzero(np.diff(fit_clock(t).tick) > 1) == np.count_nonzero(np.diff(t) > 0.004)
