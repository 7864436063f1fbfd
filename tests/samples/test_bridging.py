"""What a sensor would have read is known better where the other one read meanwhile, and its sigma says how well."""

import tracemalloc

import numpy as np
import pytest

from fg_nav.recording import Recording, find_extra_sigmas
from fg_nav.samples import gaps
from fg_nav.samples.gaps import _UnreadSamples, bridge_unread
from fg_nav.samples.readings import ACC_OUT, GYR_OUT, interpolate_unread
from tests.smoother.walks import demo

PERIOD_S = 0.005
STRIDE = 200
N = 60 * STRIDE
NOISE = 0.02


def struck() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A foot whose every strike is another one: what it turns by hangs on its force at that very moment."""
    rng = np.random.default_rng(2)
    t, phase = PERIOD_S * np.arange(N), 2 * np.pi * np.arange(N) / STRIDE
    blow = np.convolve(rng.normal(0, 30, N), [0.5, 1.0, 0.5], "same") * (np.arange(N) % STRIDE < 12)
    acc = np.column_stack([blow, 3 * np.sin(phase), 9.8 + np.cos(phase)]) + rng.normal(0, NOISE, (N, 3))
    gyr = np.column_stack([np.sin(phase), 0.1 * blow, np.cos(phase)]) + rng.normal(0, NOISE, (N, 3))
    return t, acc, gyr


@pytest.mark.parametrize("which", [ACC_OUT, GYR_OUT])
@pytest.mark.parametrize("lost", [1, 5])
def test_what_one_sensor_would_have_read_is_known_as_well_as_is_said(which, lost):
    t, acc, gyr = struck()
    truth, unread = (acc if which == ACC_OUT else gyr).copy(), np.zeros(N, dtype=np.int64)
    for start in range(5 * STRIDE + 3, N - STRIDE, 2 * STRIDE):  # amid a strike
        unread[start : start + lost] = which
    for one, x in ((ACC_OUT, acc), (GYR_OUT, gyr)):
        x[unread == one] = 1e3
    interpolate_unread(t, acc, gyr, unread)
    bridge = bridge_unread(t, acc, gyr, unread)[which == GYR_OUT]
    assert bridge.sample.tolist() == np.flatnonzero(unread).tolist()
    mean = (bridge.value - truth[bridge.sample]).reshape(-1, lost, 3).mean(axis=1)
    z = mean / (bridge.sigma[::lost] / np.sqrt(lost))
    assert 0.5 < np.sqrt((z**2).mean()) < 1.5
    axis, size = (0, 30.0) if which == ACC_OUT else (1, 3.0)
    assert np.sqrt((mean[:, axis] ** 2).mean()) < 0.1 * size  # a line from sample to sample misses all of it


def test_a_bridged_sample_is_doubted_in_its_sensor_alone_and_so_is_a_slice():
    t, acc, gyr = struck()
    unread = np.where(np.arange(N) == 803, GYR_OUT, 0)
    truth = gyr[803, 1]
    interpolate_unread(t, acc, gyr, unread)
    recording = Recording(t, acc, gyr, unread=unread)
    cut = recording.slice(700, 900)
    assert cut.unread[103] == GYR_OUT
    for part, at in ((recording, 803), (cut, 103)):
        of_acc, of_gyr = find_extra_sigmas(part, 0.0)
        assert not np.any(of_acc)
        assert np.flatnonzero(of_gyr.any(axis=1)).tolist() == [at]
        np.testing.assert_array_equal(part.bridges[1].value, recording.bridges[1].value)
    assert abs(recording.integrable[1][803, 1] - truth) < 0.3 < abs(recording.gyr[803, 1] - truth)


def test_where_little_or_nothing_is_known_the_line_is_kept_and_doubted_by_all_that_moves():
    t, acc, gyr = (x[:60] for x in struck())
    unread = np.where(np.isin(np.arange(60), [0, 59]), ACC_OUT, 0)
    interpolate_unread(t, acc, gyr, unread)
    bridge, other = bridge_unread(t, acc, gyr, unread)
    np.testing.assert_allclose(bridge.value, acc[[1, 58]])
    np.testing.assert_allclose(bridge.sigma[0], acc.std(axis=0))
    assert not len(other.sample)
    bridge, _ = bridge_unread(t, acc, gyr, np.full(60, ACC_OUT))
    np.testing.assert_allclose(bridge.value, np.broadcast_to(acc[0], acc.shape))


def test_one_bad_sample_of_an_hour_takes_less_memory_than_two_more_columns_of_it():
    t, acc, gyr = (np.zeros((720_000, *shape)) for shape in ((), (3,), (3,)))
    t += PERIOD_S * np.arange(len(t))
    seen = _UnreadSamples(t, acc, gyr, np.where(np.arange(len(t)) == 803, ACC_OUT, 0))
    tracemalloc.start()
    seen.bridge(ACC_OUT)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2 * acc.nbytes


@pytest.fixture(scope="module")
def recording() -> Recording:
    whole = demo().recording
    return Recording(whole.t[:2400], whole.acc[:2400], whole.gyr[:2400])


def test_samples_are_prepared_in_blocks_as_in_one(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    there = np.r_[0:698, 703:2400]  # a gap, which begins at the end of a block
    t, acc, gyr = (samples[there] for samples in (recording.t, recording.acc, recording.gyr))
    whole = Recording(t, acc, gyr).integrable
    monkeypatch.setattr(gaps, "BLOCK", 100)
    for one, blocks in zip(whole, Recording(t, acc, gyr).integrable, strict=True):
        np.testing.assert_allclose(blocks, one, rtol=1e-9, atol=1e-11)


def test_what_was_not_cut_takes_no_memory(recording: Recording) -> None:
    whole = Recording(recording.t, recording.acc, recording.gyr)
    for peaks, samples in zip(whole.peaks, (whole.acc, whole.gyr), strict=True):
        assert np.shares_memory(peaks.whole, samples)
        assert peaks.sigma.strides == peaks.run.strides == (0, 0)
    assert all(sigma.strides == (0, 0) for sigma in find_extra_sigmas(whole, 0.3))
