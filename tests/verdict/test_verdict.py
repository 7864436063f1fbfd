"""The verdict on a path: signs against physics, their weights, and what they make together."""

from collections.abc import Iterator
from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from fg_nav.detection.mount import DECISIVE, SUSPECT, AxesEvidence
from fg_nav.detection.stance import Stances
from fg_nav.estimators import estimate
from fg_nav.lab.simulation import simulate
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import RawRecording, Recording
from fg_nav.solution import Solution
from fg_nav.verdict import (
    Verdict,
    WalkSigns,
    combine,
    compare_bias,
    judge_path,
    limits,
    list_foot_signs,
    list_light_signs,
    list_path_signs,
    measure_hidden_turning,
    measure_time_without_footfall,
)
from fg_nav.verdict.limits import LIGHT, NAMING, NO_USE, UNSEEN, Reason, find_height_rate, weigh, weigh_error
from fg_nav.walk import Options, Walk


@cache
def demo() -> Recording:
    return replace(simulate("demo", 4).recording, mag=None)


def solved(recording: Recording, method: str = "iez") -> tuple[Walk, Solution]:
    walk = prepare_walk(Walk.of(recording, Options(mount="foot")))
    return walk, estimate(walk, method)


def judged(recording: Recording, method: str = "iez") -> Verdict:
    return judge_path(*solved(recording, method))


@cache
def good() -> WalkSigns:
    return WalkSigns(*solved(demo()))


def seen(recording: Recording | None = None, stances: Stances | None = None, **table: Any) -> WalkSigns:
    """The good walk with other samples, other stances, or other columns of its table."""
    walk, solution = good().walk, good().solution
    walk = replace(walk, recording=recording or walk.recording, stances=stances or walk.stances)
    return WalkSigns(walk, replace(solution, stances=replace(solution.stances, **table)))


def sign(observed: WalkSigns, words: str) -> Reason:
    signs: Iterator[Reason | None] = iter([*list_foot_signs(observed), *list_path_signs(observed)])
    return next(reason for reason in signs if reason is not None and words in reason.words)


def samples(**changed: np.ndarray) -> Recording:
    return replace(demo(), **changed)


def keep(stances: Stances, footfalls: np.ndarray) -> Stances:
    kept = np.isin(stances.footfall, footfalls)
    numbers = np.unique(stances.footfall[kept], return_inverse=True)[1]
    return replace(stances, start=stances.start[kept], stop=stances.stop[kept], footfall=numbers)


# --- weights ---------------------------------------------------------------------------------------------------------


def test_a_weight_is_one_and_two_at_the_limits_and_linear_in_the_logarithm() -> None:
    assert [weigh(value, 0.1, 0.4) for value in (0.1, 0.4, 0.2, np.nan)] == pytest.approx([1.0, 2.0, 1.5, 2.0])
    assert weigh(0.0, 0.1, 0.4) < 0
    # of an error of the end: one at the sigma of the result, and 1 per cent of the way beside it, two at a tenth
    for error, sigma, weight in ((3.0, 3.0, 0.96), (1.0, 0.0, 1.0), (10.0, 0.1, 2.0), (10.0, 8.0, 1.3)):
        assert weigh_error(error, sigma, 100.0) == pytest.approx(weight, abs=0.05)
    assert weigh_error(0.0, 1.0, 100.0) < 0.0
    assert weigh_error(0.5, 0.0, 1.0) == weigh_error(0.5, 0.0, 10.0)  # a shorter way counts as ten metres


def position(sigma: float, in_pocket: bool = False) -> Reason:
    return limits.judge_position(np.diag([sigma**2, 0.1]), 100.0, in_pocket)


def odds(against: float) -> Reason:
    """Of axes that two strides favour alike."""
    return limits.judge_axes(AxesEvidence(np.tile(against / 2 * np.eye(48)[9], (2, 1)), np.full(2, 9.81)))


@pytest.mark.parametrize(
    ("reason", "weight"),
    [
        (limits.judge_strides(4, 60.0), 1.0),
        (limits.judge_strides(3, 60.0), 2.0),
        (limits.judge_beginning(4, 9), 1.0),
        (limits.judge_beginning(19, 4), 1.0),
        (limits.judge_beginning(5, 5), 0.0),
        (limits.judge_beginning(20, 0), 0.0),  # which never stands, and cannot show its axes
        (limits.judge_speed(12.0, 1.0), 1.0),
        (limits.judge_speed(18.0, 1.0), 2.0),
        (limits.judge_stride(3.0 + 1.5 * 2.0, 1.0, 9.0, 2.0, 3.0, 10.0), weigh_error(3.0, 3.0, 10.0)),
        (limits.judge_height_rate(0.8, 9.0), 1.0),
        (limits.judge_height_rate(1.5, 9.0), 2.0),
        (position(4.0), UNSEEN),  # a 95 % region of a tenth of the way is of no use, in a pocket of six tenths
        (position(4.2), NO_USE),
        (position(20.0, in_pocket=True), UNSEEN),
        (position(25.0, in_pocket=True), NO_USE),
        (position(np.nan), NO_USE),
        (limits.judge_unfollowed(2.0, 1.5, 3.0, 100.0, "lost"), weigh_error(3.0, 3.0, 100.0)),
        (limits.judge_gravity(1.02 * 9.80665, 50.0, 2.0, 90.0), weigh_error(1.0, 2.0, 90.0)),
        (limits.judge_gravity(0.98 * 9.80665, 50.0, 2.0, 90.0), weigh_error(1.0, 2.0, 90.0)),
        (odds(SUSPECT), 1.0),
        (odds(DECISIVE), 2.0),
        (limits.judge_rate(0.01), LIGHT),
        (limits.judge_rate(0.0), UNSEEN),
    ],
    ids=lambda x: x.words[:40] if isinstance(x, Reason) else f"{x:.3g}",
)
def test_limits_of_a_person_and_of_a_sensor(reason: Reason, weight: float) -> None:
    assert reason.weight == pytest.approx(weight)


@pytest.mark.parametrize(
    ("weights", "word"),
    [
        ([], "trusted"),
        ([0.99, LIGHT], "trusted"),
        ([1.0], "doubtful"),
        ([1.2, 1.3], "doubtful"),
        ([1.3, 1.3, 1.4], "not to be used"),
        ([2.0], "not to be used"),
        ([0.9, 0.9, 0.9, 0.9, 0.9], "trusted"),
    ],
)
def test_the_heaviest_sign_decides_or_many_together(weights: list[float], word: str) -> None:
    assert combine([Reason(weight, str(weight)) for weight in weights]).word == word
    light = combine([Reason(1.1, "b"), Reason(NAMING, "d"), Reason(0.3, "never"), Reason(1.9, "a"), Reason(LIGHT, "c")])
    assert light.reasons == ("a", "b", "d", "c")


# --- signs: value, limits, direction ---------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["iez", "smoother", "online"])
def test_an_ordinary_walk_is_trusted_by_each_kind_of_method(method: str) -> None:
    assert judged(demo(), method) == Verdict("trusted", ())


def climbing(stride_m: float) -> WalkSigns:
    height = stride_m * np.arange(len(good().table))
    return seen(position=np.column_stack([good().table.position[:, :2], height]))


def heading_sigma(last_deg: float) -> WalkSigns:
    return seen(heading_sigma=np.radians(np.linspace(1.0, last_deg, len(good().table))))


def stride_of(length_m: float) -> WalkSigns:
    return seen(position=good().table.position * length_m / np.median(good().lengths))


def leaning(deg: float) -> WalkSigns:
    """Each row is tilted by so much more than the one before."""
    angle = np.radians(deg) * np.arange(len(good().table))
    tilt = Rotation.from_rotvec(angle[:, None] * [1.0, 0.0, 0.0]).as_matrix()
    return seen(nav_R_body=tilt @ good().table.nav_R_body)


def turning(rate_rad_s: float) -> WalkSigns:
    return seen(gyro_bias=good().table.gyro_bias + np.array([rate_rad_s, 0.0, 0.0]))


def shaken(rms_rad_s: float) -> WalkSigns:
    shake = np.sqrt(2.0) * rms_rad_s * np.sin(2 * np.pi * 30.0 * demo().t)
    return seen(samples(gyr=demo().gyr + shake[:, None] * [1.0, 0.0, 0.0]))


def pushed(share: float) -> WalkSigns:
    """The force is off by 3 m/s^2 in so many of the strides."""
    rows = good().table.sample
    off = np.arange(len(demo())) < rows[round(share * (len(rows) - 1))]
    return seen(samples(acc=demo().acc + np.outer(off, [3.0, 0.0, 0.0])))


@pytest.mark.parametrize(
    ("change", "words", "limits"),
    [
        (climbing, "more than stairs do", (0.5, 1.0)),
        (climbing, "more than stairs do", (-0.5, -1.0)),
        (heading_sigma, "the heading at the end", (30.0, 90.0)),
        (stride_of, "the median stride", (0.15, 0.10)),
        (leaning, "the gyroscope misses the vertical", (2.0, 5.0)),
        (turning, "the foot does not stand", (0.8, 1.2)),
        (shaken, "the sensor is loose on the shoe", (0.3, 0.9)),
        (pushed, "of the strides velocity does not close", (0.2, 0.5)),
    ],
)
def test_signs_that_contradict_walking_weigh_one_and_two_at_their_limits(change, words, limits) -> None:
    assert [sign(change(limit), words).weight for limit in limits] == pytest.approx([1.0, 2.0], abs=0.12)
    assert sign(good(), words).weight < 0.9


def test_velocity_that_a_wrong_bias_leaves_and_a_scale_of_the_accelerometer() -> None:
    tilted = seen(samples(acc=demo().acc + np.array([0.5, 0.0, 0.0])))
    left = np.linalg.norm(tilted.ends[0] - good().ends[0], axis=1)
    np.testing.assert_allclose(left, 0.5 * np.diff(good().table.t), rtol=0.35)
    share = np.median(np.linalg.norm(tilted.ends[0], axis=1)) / np.median(tilted.fastest)
    assert sign(tilted, "velocity does not close: ").weight == pytest.approx(weigh(share, 0.15, 0.3))

    def gravity_of(signs: WalkSigns) -> float:
        return float(np.median(9.80665 + signs.ends[0][:, 2] / np.diff(signs.table.t)))

    reach = np.hypot(*good().table.position[:, :2].T).max()
    for scale in (1.0, 1.04, 0.9):
        scaled = seen(samples(acc=scale * demo().acc))
        error = abs(gravity_of(scaled) / 9.80665 - 1.0) * reach
        weight = weigh_error(error, scaled.sigma, scaled.way)
        assert sign(scaled, "gravity is ").weight == pytest.approx(weight, abs=0.05)
        assert gravity_of(scaled) == pytest.approx(scale * gravity_of(good()), rel=0.02)


def test_strides_without_footfalls_are_seen_between_and_at_the_ends() -> None:
    stances, count = good().walk.stances, good().walk.stances.n_footfalls
    assert measure_time_without_footfall(good()).weight < 0
    half = keep(stances, np.arange(count // 2))
    cut = measure_time_without_footfall(seen(stances=half))
    assert cut.weight > 2
    assert float(cut.words.split(" s ")[0]) == pytest.approx(demo().t[-1] - demo().t[half.stop[-1]], abs=0.1)
    # where one footfall is missing the next is overdue
    gap = measure_time_without_footfall(seen(stances=keep(stances, np.delete(np.arange(count), 21))))
    swing_s = np.median(np.diff(good().table.t))
    assert float(gap.words.split(" s ")[0]) == pytest.approx(2.0 * swing_s, rel=0.3)
    # swings without end are none though they are the usual ones
    assert measure_time_without_footfall(seen(stances=keep(stances, np.array([0, 30, 59])))).weight > 2


def test_a_constant_bias_is_no_fault_of_whatever_size() -> None:
    assert judged(samples(gyr=demo().gyr + np.radians([2.0, -3.2, 4.3])), "smoother").word == "trusted"


def test_a_bias_that_is_not_that_of_the_rests_turns_the_path() -> None:
    table, strides = good().table, good().strides

    def left(deg_s: float) -> Reason:
        return compare_bias(seen(gyro_bias=table.gyro_bias + np.radians(deg_s) * table.nav_R_body[:, 2]))

    assert left(0.0).weight < 1.0
    assert left(2.0).weight > 2.0
    turn = np.radians(2.0) * (table.t - table.t[0])
    expected = np.hypot(*(((turn[1:] + turn[:-1]) / 2) @ strides[:, :2]))
    assert float(left(2.0).words.split(" m at the end")[0].split()[-1]) == pytest.approx(expected, rel=0.05)


def test_a_bias_that_no_rest_shows_is_judged_by_what_gravity_shows_of_it() -> None:
    stances = good().walk.stances
    walk, solution = solved(demo().slice(int(stances.start[3]), int(stances.stop[-3])))
    table, weights = solution.stances, []
    for level_deg_s in (0.1, 3.0):
        bias = np.radians(level_deg_s) * table.nav_R_body[:, 0]
        spoiled = replace(solution, stances=replace(table, gyro_bias=bias))
        weights.append(compare_bias(WalkSigns(walk, spoiled)).weight)
    assert weights[0] < 1.0 < weights[1]
    # a filter that leaves as much open has it in its sigma, and a graph in any case
    open_sigma = np.full_like(table.gyro_bias_sigma, np.radians(4.0))
    unsure = replace(spoiled, stances=replace(spoiled.stances, gyro_bias_sigma=open_sigma))
    for honest in (unsure, replace(spoiled, graph={"imu": 1})):
        assert compare_bias(WalkSigns(walk, honest)).weight < 0.0


def test_samples_behind_a_low_pass_and_a_gyroscope_behind_a_high_pass_are_named() -> None:
    sos = butter(2, 5.0, fs=1.0 / demo().period_s, output="sos")
    smoothed = samples(acc=sosfiltfilt(sos, demo().acc, axis=0), gyr=sosfiltfilt(sos, demo().gyr, axis=0))
    rate, passed = np.exp(-demo().period_s / 10.0), np.zeros((len(demo()), 3))
    for i in range(1, len(demo())):
        passed[i] = rate * (passed[i - 1] + demo().gyr[i] - demo().gyr[i - 1])
    for spoiled, words in ((smoothed, "smoothed"), (samples(gyr=passed), "high-pass")):
        reason = limits.judge_filters(spoiled, good().walk.stances)
        assert reason.weight > 1.0
        assert words in reason.words
    assert limits.judge_filters(demo(), good().walk.stances).weight < 1.0


def test_a_height_that_does_not_close_is_named_but_not_doubted() -> None:
    table = good().table
    shape = np.linspace(0.0, 1.0, len(table))[:, None]
    closed = table.position - shape * (table.position[-1] - table.position[0])
    lifted = closed + shape * [0.0, 0.0, 5.0 * table.position_sigma[-1, 2]]
    for path, weights in ((closed, []), (lifted, [LIGHT])):
        assert [reason.weight for reason in list_light_signs(seen(position=path))] == weights


def spinning(rate_rad_s: float, clipped: float, turns: int) -> tuple[Recording, Recording]:
    """The walk's samples, but the foot turns about up and back so many times, 0.2 s each; as it is, and clipped."""
    t, gyr = demo().t, np.zeros_like(demo().gyr)
    for k in range(turns):
        for way, begin in ((1.0, 5.0 + 2.0 * k), (-1.0, 6.0 + 2.0 * k)):
            at = (t - begin) / 0.2
            inside = (at > 0) & (at < 1)
            gyr[inside, 2] = way * rate_rad_s * np.sin(np.pi * at[inside])
    return samples(gyr=gyr), samples(gyr=np.clip(gyr, -clipped, clipped))


def test_what_clipped_peaks_hide_of_the_heading_adds_up_over_the_walk() -> None:
    level, weights = replace(good().solution, nav_R_body=np.tile(np.eye(3), (len(demo()), 1, 1))), []
    for turns in (4, 8):
        whole, clipped = spinning(12.0, 9.0, turns)
        assert measure_hidden_turning(WalkSigns(replace(good().walk, recording=whole), level)) is None
        reason = measure_hidden_turning(WalkSigns(replace(good().walk, recording=clipped), level))
        one = np.degrees(np.abs(whole.gyr - clipped.gyr).sum() * demo().period_s) / (2 * turns)
        open_deg = float(reason.words.split(" leave ")[1].split(" deg")[0])
        assert 0.3 * one < open_deg / (np.sqrt(2) * turns) < one  # OFF_SHARE of it
        weights.append(reason.weight)
    assert weights[0] < weights[1]


@pytest.mark.parametrize("footfalls", [0, 1, 2])
def test_a_path_without_strides_has_a_verdict(footfalls: int) -> None:
    walk, solution = good().walk, good().solution
    table = solution.stances
    kept = {f.name: getattr(table, f.name)[:footfalls] for f in fields(table) if getattr(table, f.name) is not None}
    few = keep(walk.stances, np.arange(footfalls))
    found = judge_path(replace(walk, stances=few), replace(solution, stances=replace(table, **kept)))
    assert found.word == "not to be used"
    assert f"no walking: {max(footfalls - 1, 0)} stride" in " ".join(found.reasons)
    assert "nan" not in " ".join(found.reasons)


def test_a_path_that_runs_off_before_or_behind_all_footfalls_is_not_to_be_used() -> None:
    walk, solution = good().walk, good().solution
    for sample in (3, -3):
        velocity, path = solution.velocity.copy(), solution.position.copy()
        velocity[sample, 0] = 19.0
        path[sample:] += [2.0, 0.0, 0.0]
        for spoiled in (replace(solution, velocity=velocity), replace(solution, position=path)):
            found = judge_path(walk, spoiled)
            assert found.word == "not to be used"
            (words,) = (reason for reason in found.reasons if "the foot reaches" in reason)
            assert float(words.split(" at ")[1].split()[0]) == pytest.approx(demo().t[sample], abs=0.15)


def test_a_stride_that_is_longer_than_the_others_is_doubted_and_says_when() -> None:
    path = good().table.position.copy()
    path[7:] += (3.51 - np.linalg.norm(path[7] - path[6])) * np.array([0.0, 0.0, 1.0])
    path[7] = path[6] + [0.0, 3.51, 0.0]
    found = judge_path(good().walk, seen(position=path).solution)
    assert found.word == "doubtful"
    assert any(f"a stride of 3.5 m, at {good().table.t[7]:.1f} s" in reason for reason in found.reasons)


def test_height_that_changes_like_in_a_fall_for_ten_seconds() -> None:
    t = np.arange(0.0, 40.0, 1.2)
    for slope in (0.4, -0.4):
        assert find_height_rate(t, slope * t)[0] == pytest.approx(0.4)
    assert find_height_rate(t, np.where(t > 20.0, 4.0, 0.0))[0] < 0.4  # a jump
    rate, when = find_height_rate(t, np.where(t > 20.0, 1.6 * (t - 20.0), 0.0))
    assert rate == pytest.approx(1.6)
    assert when > 30.0
    assert find_height_rate(t[:3], 9.0 * t[:3])[0] == 0.0


# --- spoiled recordings ----------------------------------------------------------------------------------------------


def raw(recording: Recording, kept: np.ndarray | slice = np.s_[:]) -> Recording:
    """The samples once more through the door of a file."""
    row = np.arange(len(recording))[kept]
    return Recording.from_raw(RawRecording(recording.t[kept], recording.acc[kept], recording.gyr[kept], row))


def ringing() -> Recording:
    """A sensor that rings on the shoe, at 9 Hz."""
    angle = np.radians(2.0) * np.sin(2 * np.pi * 9.0 * demo().t)
    turn = Rotation.from_rotvec(angle[:, None] * [1.0, 0.0, 0.0]).inv()
    rate = np.gradient(angle, demo().t)[:, None] * [1.0, 0.0, 0.0]
    return samples(acc=turn.apply(demo().acc), gyr=turn.apply(demo().gyr) + rate)


def clipped() -> Recording:
    limit = 0.5 * np.abs(demo().gyr).max()
    return samples(gyr=np.clip(demo().gyr, -limit, limit))


def test_half_a_range_20_hz_and_a_loose_sensor_are_named() -> None:
    for spoiled, words in (
        (clipped(), "clipped peaks"),
        (raw(demo(), np.s_[::10]), "velocity does not close"),
        (ringing(), "loose on the shoe"),
    ):
        found = judged(spoiled)
        assert found.word != "trusted"
        assert any(words in reason for reason in found.reasons)


@pytest.mark.parametrize("hole_s", [0.02, 3.0, 12.0])
def test_a_hole_counts_by_the_way_that_it_hides(hole_s: float) -> None:
    kept = np.ones(len(demo()), dtype=bool)
    middle = int(good().walk.stances.stop[20]) + 5
    kept[middle : middle + round(hole_s / demo().period_s)] = False
    found = judged(raw(demo(), kept))
    assert (found.word == "trusted") == (hole_s < 1.0)
    if hole_s > 10.0:  # the recording ends there, and the longer part is taken
        assert found.word == "not to be used"
        assert any("cut off by a hole" in reason for reason in found.reasons)


def test_bad_samples_that_are_many_and_wrong_axes_spoil_a_path_that_passes_else() -> None:
    for share, word in ((0.0, "trusted"), (0.001, "trusted"), (0.01, "doubtful"), (0.1, "not to be used")):
        told = replace(demo().provenance, bad_samples=round(share * len(demo())))
        assert judge_path(seen(replace(demo(), provenance=told)).walk, good().solution).word == word
    mirrored = judge_path(seen(samples(gyr=-demo().gyr)).walk, good().solution)
    assert mirrored.word == "not to be used"
    assert any("negate gyr" in words for words in mirrored.reasons)
