"""What is integrated where samples are lost, of one sensor alone, too slow for the motion, or cut at the range.

Each part is held against motions that are known: feet that never step twice alike, a cone, a rocking sledge.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Bools, Floats
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import NavState, strapdown
from fg_nav.recording import Recording, find_extra_sigmas
from fg_nav.samples import gaps as gaps_module
from fg_nav.samples import readings
from fg_nav.samples.gaps import (
    MAX_S,
    REACH,
    WALKING,
    Gaps,
    bridge_unread,
    compensate_coning,
    fill_gaps,
    list_bridged,
)
from fg_nav.samples.readings import ACC_OUT, GYR_OUT, MAX_RANGES, OFF_SHARE, interpolate_unread, rebuild_peaks

RATE_HZ = 100.0
STRIDE = 120  # Samples from one step to the next.


def strides(count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Acc and gyr (N, 3): half of each stride at rest, half a swing of three harmonics, each of new amplitude."""
    phase = np.linspace(0, 1, STRIDE // 2)
    shapes = np.stack([np.sin(np.pi * k * phase) * np.sin(np.pi * phase) for k in (1, 2, 3)])
    mixed = rng.standard_normal((3, 6)) * np.repeat([30.0, 6.0], 3)
    swing = (shapes * (1 + 0.3 * rng.standard_normal((count, 3, 1)))).transpose(0, 2, 1) @ mixed
    still = np.zeros((count, STRIDE - STRIDE // 2, 6))
    values = np.concatenate([still, swing], axis=1).reshape(-1, 6)
    values += rng.standard_normal(values.shape) * np.repeat([0.01, 0.001], 3)
    return values[:, :3], values[:, 3:]


def without(samples: tuple[Floats, Floats], kept: Bools) -> Gaps:
    """Gaps of a recording of which only the samples `kept` (N,) are left."""
    acc, gyr = samples
    return fill_gaps(np.flatnonzero(kept) / RATE_HZ, acc[kept], gyr[kept])


def dropped(count: int, first: Floats, lost: int) -> Bools:
    """Which of `count` samples are kept where so many are lost from each of the samples `first` on."""
    kept = np.ones(count, dtype=np.bool_)
    kept[(first[:, None] + np.arange(lost)).ravel()] = False
    return kept


def between(samples: Floats, first: Floats, lost: int) -> Floats:
    """What was lost (G, 3): the means."""
    return np.stack([samples[i : i + lost].mean(axis=0) for i in first])


@pytest.mark.parametrize("lost", [1, 2, 4])
def test_a_swing_is_bridged_better_than_by_a_line_and_the_sigma_is_true(lost: int) -> None:
    rng = np.random.default_rng(1)
    acc, gyr = samples = strides(60, rng)
    first = np.sort(rng.permutation(np.arange(5, 400))[:60]) * 16 + rng.integers(5)
    gaps = without(samples, dropped(len(acc), first, lost))
    np.testing.assert_allclose(gaps.unseen_s, lost / RATE_HZ)
    swings = np.abs(gyr[first]).max(axis=1) > 0.1
    for values, found, sigma in ((acc, gaps.acc, gaps.acc_sigma), (gyr, gaps.gyr, gaps.gyr_sigma)):
        truth = between(values, first, lost)
        line = (values[first - 1] + values[first + lost]) / 2
        assert np.std(found - truth) < np.std(line - truth) / 4
        for some in (swings, ~swings):
            assert 0.5 < np.sqrt(np.mean(((found - truth) / sigma)[some] ** 2)) < 1.4


def test_what_is_seen_but_once_is_doubted() -> None:
    """A stumble in a walk: nothing like it elsewhere shows what its gap holds, and the sigma says so."""
    rng = np.random.default_rng(2)
    acc, gyr = strides(40, rng)
    middle = 20 * STRIDE + 3 * STRIDE // 4
    rough = slice(middle - 15, middle + 15)
    gyr[rough] += rng.standard_normal((30, 3)) * 5.0
    stumbled = without((acc, gyr), dropped(len(acc), np.array([middle]), 2))
    assert (stumbled.gyr_sigma > 1.0).all()
    assert (np.abs(stumbled.gyr - between(gyr, np.array([middle]), 2)) < 4 * stumbled.gyr_sigma).all()


def test_how_the_sensor_is_mounted_does_not_matter() -> None:
    acc, gyr = strides(20, np.random.default_rng(3))
    turn = Rotation.random(rng=np.random.default_rng(4)).as_matrix()
    kept = dropped(len(acc), np.array([330, 701]), 2)
    one, other = without((acc, gyr), kept), without((acc @ turn.T, gyr @ turn.T), kept)
    np.testing.assert_allclose(other.acc, one.acc @ turn.T, atol=1e-9)
    np.testing.assert_allclose(other.gyr, one.gyr @ turn.T, atol=1e-9)


@pytest.mark.parametrize("count", [5, 60, 2000])
def test_a_line_is_carried_on_however_short_the_recording(count: int) -> None:
    """And where there is too little to learn from, its sigma is the spread of all there is."""
    line = np.outer(np.arange(count), [0.1, -0.2, 0.3])
    kept = dropped(count, np.array([2]), 1)
    gaps = without((line, line), kept)
    np.testing.assert_allclose(gaps.gyr, line[[2]], rtol=1e-3)
    if count < 100:
        np.testing.assert_allclose(gaps.gyr_sigma, line[kept].std(axis=0)[None])


def test_gaps_side_by_side_and_at_either_end() -> None:
    acc, gyr = samples = strides(20, np.random.default_rng(5))
    first = np.array([1, 700, 702, 705, 2 * REACH + 706, len(acc) - 2])
    gaps = without(samples, dropped(len(acc), first, 1))
    np.testing.assert_array_equal(gaps.sample, first - 1 - np.arange(6))
    assert all(np.isfinite(found).all() for found in gaps[2:])
    assert (np.abs(gaps.gyr - gyr[first]) < 5 * gaps.gyr_sigma).all()
    late = np.arange(len(acc)) / RATE_HZ + np.arange(len(acc)) % 2 * 0.2 / RATE_HZ
    assert len(fill_gaps(late, acc, gyr).sample) == 0  # late stamps are none


def test_one_sample_between_two_gaps_does_not_hide_those_beyond() -> None:
    """In every other swing four samples are lost, one is not, and the next one is."""
    rng = np.random.default_rng(9)
    acc, gyr = samples = strides(60, rng)
    first = np.arange(5, 58, 2) * STRIDE + 3 * STRIDE // 4
    kept = dropped(len(acc), first, 4) & dropped(len(acc), first + 5, 1)
    gaps = without(samples, kept)
    truth = between(gyr, first, 4)
    line = (gyr[first - 1] + gyr[first + 4]) / 2
    assert np.std(gaps.gyr[::2] - truth) < np.std(line - truth) / 5
    assert 0.4 < np.sqrt(np.mean(((gaps.gyr[::2] - truth) / gaps.gyr_sigma[::2]) ** 2)) < 1.4


def test_a_hole_is_bridged_where_another_recording_went_on_throughout() -> None:
    t = np.arange(6000) / RATE_HZ
    is_missing, stops = ((t > 20) & (t < 25)) | ((t > 40) & (t < 45)), (t > 42) & (t < 45)
    np.testing.assert_allclose(list_bridged(t[~is_missing], t[~stops]), [[20, 25]])


def test_a_sample_is_doubted_for_its_unseen_share() -> None:
    """Held for three periods of which it saw one; the sample after a gap and all others not at all."""
    acc, gyr = strides(20, np.random.default_rng(7))
    kept = dropped(len(acc), np.array([700]), 2)
    recording = Recording(t=np.flatnonzero(kept) / RATE_HZ, acc=acc[kept], gyr=gyr[kept])
    for doubt, sigma in zip(find_extra_sigmas(recording, 0.0), recording.gaps[4:], strict=True):
        np.testing.assert_allclose(doubt[699], 2 / 3 * sigma[0])
        assert (sigma > 0).all()
        assert not np.delete(doubt, 699, axis=0).any()


def test_a_clipped_sample_is_doubted_for_what_it_may_hide() -> None:
    acc, gyr = strides(20, np.random.default_rng(8))
    limit = 0.8 * np.abs(gyr[:, 1]).max()
    clipped = replace(
        Recording(t=np.arange(len(acc)) / RATE_HZ, acc=acc, gyr=gyr),
        gyr=np.stack([gyr[:, 0], np.clip(gyr[:, 1], -limit, limit), gyr[:, 2]], axis=1),
    )
    _, doubt = find_extra_sigmas(clipped, 0.3)
    cut = np.abs(gyr[:, 1]) > limit
    peaks = rebuild_peaks(clipped.gyr, clipped.period_s)
    share = np.sqrt(doubt[cut, 1] ** 2 - peaks.sigma[cut, 1] ** 2) / limit
    np.testing.assert_allclose(share, 0.3 * np.sqrt(peaks.run[cut, 1]))
    assert not find_extra_sigmas(clipped, 0.0)[1].any()
    assert not doubt[np.abs(gyr[:, 1]) < 0.97 * limit].any()
    assert not doubt[:, [0, 2]].any()


def test_a_part_of_a_recording_has_the_gaps_and_the_motion_of_the_whole() -> None:
    rng = np.random.default_rng(5)
    t = np.delete(np.arange(400) / 100.0, [60, 150, 151, 300])
    whole = Recording(t, rng.normal(0, 3, (len(t), 3)), rng.normal(0, 2, (len(t), 3)))
    assert whole.gaps.sample.tolist() == [59, 148, 296]
    part = whole.slice(59, 297)
    assert part.gaps.sample.tolist() == [0, 89]  # the last sample has no next one in the part
    np.testing.assert_array_equal(part.gaps.gyr, whole.gaps.gyr[:2])
    np.testing.assert_array_equal(part.integrable[1], whole.integrable[1][59:297])


@pytest.mark.parametrize("lost", [3, 15, 160])
def test_who_stood_before_a_long_gap_may_have_walked_in_it(lost: int) -> None:
    """Nothing but rest is on record: the angle and the change of velocity unseen are still those of a walking foot."""
    rng = np.random.default_rng(3)
    acc, gyr = (size * rng.standard_normal((600, 3)) for size in (0.01, 0.001))
    gaps = without((acc, gyr), dropped(600, np.array([300]), lost))
    if lost / RATE_HZ > MAX_S:
        np.testing.assert_allclose(gaps.acc_sigma[0], WALKING[:3])
        np.testing.assert_allclose(gaps.gyr_sigma[0], WALKING[3:])
    else:  # no step fits into it
        assert lost == 3
        assert (gaps.acc_sigma < 0.05).all()
        assert (gaps.gyr_sigma < 0.005).all()


def test_the_angle_unseen_in_a_long_gap_is_within_its_sigma() -> None:
    """Windows of 0.2 to 1.5 s of a walk, cut out one at a time: not believed too much, nor twenty times too little."""
    acc, gyr = samples = strides(40, np.random.default_rng(4))
    for lost in (20, 60, 150):
        over = []
        for first in range(600, 4000, 331):
            gaps = without(samples, dropped(len(acc), np.array([first]), lost))
            over.append((gaps.gyr - between(gyr, np.array([first]), lost)) / gaps.gyr_sigma)
        assert 0.05 < np.sqrt(np.mean(np.square(over))) < 1.5


N, EVERY = 12_000, 200  # Samples at 200 Hz, and from one strike to the next.


def struck() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A foot whose every strike is another one: what it turns by hangs on its force at that very moment."""
    rng, at = np.random.default_rng(2), np.arange(N)
    t, phase = 0.005 * at, 2 * np.pi * at / EVERY
    blow = np.convolve(rng.normal(0, 30, N), [0.5, 1.0, 0.5], "same") * (at % EVERY < 12)
    acc = np.column_stack([blow, 3 * np.sin(phase), 9.8 + np.cos(phase)]) + rng.normal(0, 0.02, (N, 3))
    gyr = np.column_stack([np.sin(phase), 0.1 * blow, np.cos(phase)]) + rng.normal(0, 0.02, (N, 3))
    return t, acc, gyr


@pytest.mark.parametrize("which", [ACC_OUT, GYR_OUT])
@pytest.mark.parametrize("lost", [1, 5])
def test_what_one_sensor_would_have_read_is_known_as_well_as_is_said(which, lost):
    t, acc, gyr = struck()
    truth, unread = (acc if which == ACC_OUT else gyr).copy(), np.zeros(N, dtype=np.int64)
    for start in range(5 * EVERY + 3, N - EVERY, 2 * EVERY):  # amid a strike
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


def test_samples_are_prepared_in_blocks_as_in_one_and_what_was_not_cut_takes_no_memory(monkeypatch) -> None:
    t, acc, gyr = struck()
    whole = Recording(t, acc, gyr)
    for peaks, samples in zip(whole.peaks, (whole.acc, whole.gyr), strict=True):
        assert np.shares_memory(peaks.whole, samples)
        assert peaks.sigma.strides == peaks.run.strides == (0, 0)
    assert all(sigma.strides == (0, 0) for sigma in find_extra_sigmas(whole, 0.3))
    there = np.r_[0:698, 703:2400]  # a gap, which begins at the end of a block
    part = t[there], acc[there], gyr[there]
    found = Recording(*part).integrable
    monkeypatch.setattr(gaps_module, "BLOCK", 100)
    for one, blocks in zip(found, Recording(*part).integrable, strict=True):
        np.testing.assert_allclose(blocks, one, rtol=1e-9, atol=1e-11)


TURNS_RAD_S = 2 * np.pi * 2.0  # Two cones a second.
HALF_ANGLE = 0.3
SWAY_M = 0.2
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(12)
UP = np.array([0.0, 0.0, 1.0])


def cone(t: Floats) -> Rotation:
    """The body's z axis goes about a cone, and the body does not turn about it: the classical coning motion."""
    phase = TURNS_RAD_S * t
    return Rotation.from_rotvec(HALF_ANGLE * np.stack([np.cos(phase), np.sin(phase), 0 * phase], axis=1))


def cone_rate(t: Floats) -> Floats:
    phase, sine = TURNS_RAD_S * t, np.sin(HALF_ANGLE)
    about = np.full_like(t, np.cos(HALF_ANGLE) - 1.0)
    return TURNS_RAD_S * np.stack([-sine * np.sin(phase), sine * np.cos(phase), about], axis=1)


def swayed(t: Floats) -> Floats:
    """Specific force in the coning body that sways along east, in step with its tilt."""
    acc = -SWAY_M * TURNS_RAD_S**2 * np.sin(TURNS_RAD_S * t)
    nav = np.stack([acc, 0 * t, np.full_like(t, GRAVITY_M_S2)], axis=1)
    return cone(t).inv().apply(nav)


def mean_over(of: Callable[[Floats], Floats], t: Floats, h: Floats) -> Floats:
    """Mean (N, 3) over each period by Gauss's rule."""
    return sum(w / 2 * of(t + h * (1 + x) / 2) for x, w in zip(POINTS, WEIGHTS, strict=True))


def coning_samples(t: Floats, h: Floats) -> tuple[Floats, Floats]:
    return mean_over(swayed, t, h), mean_over(cone_rate, t, h)


def left_over(acc: Floats, gyr: Floats, t: Floats, h: Floats) -> tuple[float, float]:
    """What integration misses by the end: of the turn about up, rad, and of the velocity, m/s."""
    velocity = SWAY_M * TURNS_RAD_S * np.array([np.cos(TURNS_RAD_S * t[0]), 0.0, 0.0])
    state = NavState(np.zeros(3), velocity, cone(t[:1]).as_matrix()[0], np.zeros(3), np.zeros(3))
    turn, push = np.empty((3, 3)), np.empty(3)
    for f, w, period in zip(acc, gyr, h, strict=True):
        strapdown(state, f, w, period, GRAVITY_M_S2, turn, push)
    end = t[-1:] + h[-1]
    truth = SWAY_M * TURNS_RAD_S * np.array([np.cos(TURNS_RAD_S * end[0]), 0.0, 0.0])
    missed = Rotation.from_matrix(state.nav_R_body) * cone(end).inv()
    return float(missed.as_rotvec()[0] @ UP), float(np.linalg.norm(state.velocity - truth))


def even(rate_hz: float, duration_s: float = 5.0) -> tuple[Floats, Floats]:
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    return t, np.full(len(t), 1 / rate_hz)


def test_what_is_left_falls_with_the_fourth_power_of_the_period() -> None:
    plain, better = [], []
    for rate_hz in (50.0, 100.0, 200.0):
        t, h = even(rate_hz)
        acc, gyr = coning_samples(t, h)
        plain.append(np.abs(left_over(acc, gyr, t, h)))
        better.append(np.abs(left_over(*compensate_coning(acc, gyr, h), t, h)))
    plain_ratio, ratio = (np.array(errors[:-1]) / np.array(errors[1:]) for errors in (plain, better))
    np.testing.assert_allclose(plain_ratio, 4.0, rtol=0.1)
    assert (ratio[:, 0] > 12.0).all()
    assert (better[1] < plain[1] / 40).all()
    assert (better[2] < plain[2] / 100).all()


@pytest.mark.parametrize("uneven", [False, True])
def test_a_change_at_one_rate_is_seen_whole_at_every_sample_from_the_first_to_the_last(uneven: bool) -> None:
    """Rate and force linear in time: the terms are h^2/12 w x w' and h^2/12 (w x f' - w' x f) exactly."""
    rng = np.random.default_rng(2)
    h = 0.01 * (rng.uniform(0.7, 3.0, 12) if uneven else np.ones(12))
    middle = (np.cumsum(h) - h / 2)[:, None]
    (w0, w1), (f0, f1) = rng.standard_normal((2, 2, 3)) * [[[5.0], [80.0]], [[20.0], [300.0]]]
    gyr, acc = w0 + w1 * middle, f0 + f1 * middle
    found_acc, found_gyr = compensate_coning(acc, gyr, h)
    share = h[:, None] ** 2 / 12
    np.testing.assert_allclose(found_gyr - gyr, share * np.cross(gyr, w1), atol=1e-9)
    np.testing.assert_allclose(found_acc - acc, share * (np.cross(gyr, f1) - np.cross(w1, acc)), atol=1e-8)


@pytest.mark.parametrize("lost", [1, 2, 4])
def test_lost_samples_are_made_good(lost: int) -> None:
    """Of a cone at 100 Hz every 37th sample is lost, and so many after it: the sample before it is held for all.

    It integrates nearly to what was moved: with coning, with sculling.
    """
    t, h = even(100.0, 20.0)
    acc, gyr = coning_samples(t, h)
    kept = (np.arange(len(t)) < 100) | (np.arange(len(t)) % 37 >= lost)
    kept[-8:] = True
    recording = Recording(t=t[kept], acc=acc[kept], gyr=gyr[kept])
    h = np.append(np.diff(recording.t), 0.01)
    held = np.abs(left_over(recording.acc, recording.gyr, recording.t, h))
    bridged = np.abs(left_over(*recording.integrable, recording.t, h))
    assert (bridged < held / 20).all()


PEAK_RATE_HZ = 200.0
LIMIT = 8.7


def swings(rng: np.random.Generator, count: int = 30, pointed: float = 2.0) -> Floats:
    """Pitch rate (N, 3) of swings with peaks of 8 to 12 rad/s either way, and a little about the other axes."""
    phase = np.linspace(0, 1, 60)[:, None]
    high = rng.uniform(8.0, 12.0, count) * np.where(np.arange(count) % 2, 1.0, -1.0)
    swing = high * np.sin(np.pi * phase) ** pointed
    pitch = np.concatenate([swing, np.zeros((60, count))]).T.ravel()
    return np.stack([0.2 * pitch, pitch, -0.1 * pitch], axis=1) + 0.002 * rng.standard_normal((len(pitch), 3))


def pitch_cut(gyr: Floats, limit: float = LIMIT) -> Floats:
    """Clip the pitch rate (N, 3)."""
    return np.stack([gyr[:, 0], np.clip(gyr[:, 1], -limit, limit), gyr[:, 2]], axis=1)


def by_swing(rate: Floats) -> Floats:
    """Angle of each swing."""
    return np.asarray(rate.reshape(-1, 120).sum(axis=1) / PEAK_RATE_HZ)


def test_most_of_what_was_cut_is_given_back() -> None:
    """On both sides, and of the angle of every peak; the other axes and all that was not cut stay as they are."""
    gyr = swings(np.random.default_rng(1))
    cut = pitch_cut(gyr)
    found = rebuild_peaks(cut, 1 / PEAK_RATE_HZ)
    hidden, left = (by_swing((gyr - some)[:, 1]) for some in (cut, found.whole))
    deep = np.abs(hidden) > np.radians(1.0)
    assert deep.sum() > 10
    assert (np.abs(left) < 0.35 * np.abs(hidden))[deep].all()
    np.testing.assert_array_equal(found.whole[:, [0, 2]], gyr[:, [0, 2]])
    below = np.abs(gyr[:, 1]) < 0.97 * LIMIT
    np.testing.assert_array_equal(found.whole[below, 1], gyr[below, 1])
    assert not found.sigma[below].any()
    assert (np.abs(found.whole[:, 1]) >= np.abs(cut[:, 1])).all()
    # a sensor within its range is left alone
    found = rebuild_peaks(gyr, 1 / PEAK_RATE_HZ)
    np.testing.assert_array_equal(found.whole, gyr)
    assert not found.sigma.any()
    assert not found.run.any()


def test_a_parabola_sampled_finely_is_found_but_for_what_the_range_forbids() -> None:
    """Slopes of its ends make it; a height H becomes H / (1 + H / (2 L))."""
    rate_hz, height, half_s = 500.0, 4.0, 0.05
    t = np.arange(-500, 500) / rate_hz
    curve = height / half_s**2
    gyr = np.zeros((len(t), 3))
    for middle in (-0.6, 0.0, 0.6):
        gyr[:, 2] += np.maximum(LIMIT + height - curve * (t - middle - 0.0013) ** 2, 0.0)
    cut = np.minimum(gyr, LIMIT) + 1e-6 * np.random.default_rng(4).standard_normal(gyr.shape)
    found = rebuild_peaks(cut, 1 / rate_hz)
    hidden = (gyr - cut)[:, 2]
    np.testing.assert_allclose(
        (found.whole - cut)[:, 2], hidden / (1 + height / (MAX_RANGES * LIMIT)), atol=0.07 * height
    )
    angle = hidden.sum() / 3 / rate_hz
    off_share = np.sqrt(np.sum(found.sigma[:, 2] ** 2) / 3) / rate_hz / angle
    assert OFF_SHARE < off_share < 1.2 * OFF_SHARE  # of a flank as steep throughout as where it is steepest


@pytest.mark.parametrize("share", [0.95, 0.85, 0.7])
def test_a_low_pass_behind_the_range_changes_little(share: float) -> None:
    """It bends the corners of the flat top: fewer samples reach the level, and the steps next to them are smaller."""
    gyr = swings(np.random.default_rng(7))
    cut = pitch_cut(gyr, share * 10.0)
    bent = np.apply_along_axis(np.convolve, 0, cut, [0.25, 0.5, 0.25], "same")
    sharp, smooth = (by_swing((rebuild_peaks(some, 1 / PEAK_RATE_HZ).whole - some)[:, 1]) for some in (cut, bent))
    np.testing.assert_allclose(smooth, sharp, atol=0.35 * np.abs(sharp).max())
    assert np.abs(smooth).sum() > 0.8 * np.abs(sharp).sum()


@pytest.mark.parametrize("pointed", [0.5, 1.0, 2.0, 6.0])
@pytest.mark.parametrize("share", [0.95, 0.8, 0.6])
def test_what_is_left_of_an_angle_is_as_its_sigma_says(pointed: float, share: float) -> None:
    """Flat and pointed peaks, cut a little and deeply: the sigma of a whole peak, from those of its samples."""
    gyr = swings(np.random.default_rng(5), 60, pointed)
    cut = pitch_cut(gyr, share * 10.0)
    found = rebuild_peaks(cut, 1 / PEAK_RATE_HZ)
    left = by_swing((gyr - found.whole)[:, 1])
    variance = by_swing(found.sigma[:, 1] ** 2) / PEAK_RATE_HZ
    deep = np.abs(by_swing((gyr - cut)[:, 1])) > np.radians(0.5)
    assert deep.sum() > 15
    over_sigma = np.sqrt(np.mean(left[deep] ** 2 / variance[deep]))
    assert 0.02 < over_sigma < 1.5  # a peak that is nearly a parabola is found to a fiftieth of it


def test_without_flanks_a_run_stays_and_may_hide_as_much_as_it_shows() -> None:
    """Clipped for longer than a peak lasts; at an end, one flank is enough."""
    gyr = swings(np.random.default_rng(2))[60:]
    cut = np.clip(gyr, -LIMIT, LIMIT)
    long = slice(200, 201 + int(readings.MAX_S * PEAK_RATE_HZ))
    cut[long] = cut[:5] = cut[-5:] = LIMIT
    found = rebuild_peaks(cut, 1 / PEAK_RATE_HZ)
    np.testing.assert_array_equal(found.whole[long], cut[long])
    angle = np.sqrt(np.sum(found.sigma[long] ** 2, axis=0)) / PEAK_RATE_HZ
    np.testing.assert_allclose(angle, LIMIT * (long.stop - long.start) / PEAK_RATE_HZ, rtol=1e-9)
    assert np.isfinite(found.whole).all()
    for end in (slice(0, 5), slice(-5, None)):
        assert (found.whole[end] > LIMIT).any()
    nothing_else = np.concatenate([cut[long], -cut[long]])
    np.testing.assert_array_equal(rebuild_peaks(nothing_else, 1 / PEAK_RATE_HZ).whole, nothing_else)
