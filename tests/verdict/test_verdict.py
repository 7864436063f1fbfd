"""The verdict on a path: signs against physics, their weights, and what they make together."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

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
    list_foot_signs,
    list_light_signs,
    measure_hidden_turning,
    measure_time_without_footfall,
)
from fg_nav.verdict.limits import (
    LIGHT,
    NAMING,
    NO_USE,
    Reason,
    find_height_rate,
    judge_filters,
    judge_position,
    weigh,
    weigh_error,
)
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


def sign(observed: WalkSigns, words: str) -> Reason:
    """The sign of a foot with these words."""
    return next(reason for reason in list_foot_signs(observed) if reason is not None and words in reason.words)


def samples(**changed: np.ndarray) -> Recording:
    return replace(demo(), **changed)


# --- weights ---------------------------------------------------------------------------------------------------------


def test_a_weight_is_one_and_two_at_the_limits_and_linear_in_the_logarithm() -> None:
    assert weigh(0.1, 0.1, 0.4) == pytest.approx(1.0)
    assert weigh(0.4, 0.1, 0.4) == pytest.approx(2.0)
    assert weigh(0.2, 0.1, 0.4) == pytest.approx(1.5)
    assert weigh(0.0, 0.1, 0.4) < 0
    assert weigh(np.nan, 0.1, 0.4) == 2.0


def test_an_error_weighs_one_at_the_sigma_of_the_result_and_two_at_a_tenth_of_the_way() -> None:
    assert weigh_error(3.0, 3.0, 100.0) == pytest.approx(1.0, abs=0.05)  # and 1 per cent of the way beside it
    assert weigh_error(1.0, 0.0, 100.0) == pytest.approx(1.0)
    assert weigh_error(10.0, 0.1, 100.0) == pytest.approx(2.0)
    assert weigh_error(10.0, 8.0, 100.0) == pytest.approx(1.3, abs=0.1)  # it said so
    assert weigh_error(0.0, 1.0, 100.0) < 0.0


@pytest.mark.parametrize(
    ("sigma", "in_pocket", "is_known"), [(4.0, False, True), (4.2, False, False), (20.0, True, True)]
)
def test_a_result_whose_own_region_is_a_tenth_of_the_way_is_of_no_use(
    sigma: float, in_pocket: bool, is_known: bool
) -> None:
    """2.45 sigmas hold 95 % of a plane."""
    weight = judge_position(np.diag([sigma**2, 0.1]), 100.0, in_pocket).weight
    assert (weight < NO_USE) == is_known
    assert judge_position(np.full((2, 2), np.nan), 100.0, in_pocket).weight == NO_USE


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


def test_reasons_come_by_weight_and_light_ones_last() -> None:
    found = combine([Reason(1.1, "b"), Reason(NAMING, "d"), Reason(0.3, "never"), Reason(1.9, "a"), Reason(LIGHT, "c")])
    assert found.reasons == ("a", "b", "d", "c")
    assert combine([Reason(NAMING, "d"), Reason(LIGHT, "c")]) == Verdict("trusted", ("c",))


# --- signs -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["iez", "smoother", "online"])
def test_an_ordinary_walk_is_trusted_by_each_kind_of_method(method: str) -> None:
    assert judged(demo(), method) == Verdict("trusted", ())


def test_velocity_that_a_wrong_bias_leaves() -> None:
    """A force that is off by 0.5 m/s^2 leaves that times the stride's duration: 0.5 m/s, an eighth of the swing's."""
    walk, solution = good().walk, good().solution
    tilted = replace(walk, recording=samples(acc=demo().acc + np.array([0.5, 0.0, 0.0])))
    seen = WalkSigns(tilted, solution)
    left = np.linalg.norm(seen.ends[0] - good().ends[0], axis=1)
    np.testing.assert_allclose(left, 0.5 * np.diff(solution.stances.t), rtol=0.35)
    reason = sign(seen, "velocity does not close: ")
    share = np.median(np.linalg.norm(seen.ends[0], axis=1)) / np.median(seen.fastest)
    assert reason.weight == pytest.approx(weigh(share, 0.15, 0.3))


def test_a_scale_error_shows_in_the_vertical() -> None:
    scaled = WalkSigns(replace(good().walk, recording=samples(gyr=demo().gyr * [1.0, 0.9, 1.0])), good().solution)
    weight, weight_scaled = (sign(one, "misses the vertical").weight for one in (good(), scaled))
    assert weight < 0
    assert weight_scaled > weight + 1


def test_strides_without_footfalls_are_seen_between_and_at_the_ends() -> None:
    walk, solution = good().walk, good().solution
    assert measure_time_without_footfall(good()).weight < 0
    kept = walk.stances.footfall < walk.stances.n_footfalls // 2
    stances = replace(walk.stances, start=walk.stances.start[kept], stop=walk.stances.stop[kept],
                      footfall=walk.stances.footfall[kept])  # fmt: skip
    cut = measure_time_without_footfall(WalkSigns(replace(walk, stances=stances), solution))
    assert cut.weight > 2
    lost_s = float(cut.words.split(" s ")[0])
    assert lost_s == pytest.approx(demo().t[-1] - demo().t[stances.stop[-1]], abs=0.1)


@pytest.mark.parametrize("bias_deg_s", [[0.0, 0.0, 0.0], [2.0, -3.2, 4.3]])
def test_a_constant_bias_is_no_fault_of_whatever_size(bias_deg_s: list[float]) -> None:
    assert judged(samples(gyr=demo().gyr + np.radians(bias_deg_s)), "smoother").word == "trusted"


def test_a_bias_that_is_not_that_of_the_rests_turns_the_path() -> None:
    """A tenth of a degree a second turns a walk of a minute by 6 deg."""

    def left(deg_s: float) -> Reason:
        table = good().solution.stances
        shifted = replace(table, gyro_bias=table.gyro_bias + np.radians(deg_s) * table.nav_R_body[:, 2])
        reason = compare_bias(WalkSigns(good().walk, replace(good().solution, stances=shifted)))
        assert reason is not None
        return reason

    assert left(0.0).weight < 1.0
    assert left(2.0).weight > 2.0
    t, strides = good().solution.stances.t, good().strides
    turn = np.radians(2.0) * (t - t[0])
    expected = np.hypot(*(((turn[1:] + turn[:-1]) / 2) @ strides[:, :2]))
    assert float(left(2.0).words.split(" m at the end")[0].split()[-1]) == pytest.approx(expected, rel=0.05)


def test_a_bias_that_no_rest_shows_is_judged_by_what_gravity_shows_of_it() -> None:
    stances = good().walk.stances
    moving = demo().slice(int(stances.start[3]), int(stances.stop[-3]))
    walk, solution = solved(moving)
    table = solution.stances

    def found(level_deg_s: float) -> float:
        bias = np.radians(level_deg_s) * table.nav_R_body[:, 0]
        shifted = replace(solution, stances=replace(table, gyro_bias=bias))
        reason = compare_bias(WalkSigns(walk, shifted))
        assert reason is not None
        return reason.weight

    assert found(0.1) < 1.0
    assert found(3.0) > 1.0


def test_samples_behind_a_low_pass_and_a_gyroscope_behind_a_high_pass_are_named() -> None:
    sos = butter(2, 5.0, fs=1.0 / demo().period_s, output="sos")
    smoothed = samples(acc=sosfiltfilt(sos, demo().acc, axis=0), gyr=sosfiltfilt(sos, demo().gyr, axis=0))
    rate, passed = np.exp(-demo().period_s / 10.0), np.zeros((len(demo()), 3))
    for i in range(1, len(demo())):
        passed[i] = rate * (passed[i - 1] + demo().gyr[i] - demo().gyr[i - 1])
    for spoiled, words in ((smoothed, "smoothed"), (samples(gyr=passed), "high-pass")):
        reason = judge_filters(spoiled, good().walk.stances)
        assert reason.weight > 1.0
        assert words in reason.words
    assert judge_filters(demo(), good().walk.stances).weight < 1.0


def test_a_height_that_does_not_close_is_named_but_not_doubted() -> None:
    table = good().solution.stances
    shape = np.linspace(0.0, 1.0, len(table))[:, None]
    closed = table.position - shape * (table.position[-1] - table.position[0])
    lifted = closed + shape * [0.0, 0.0, 5.0 * table.position_sigma[-1, 2]]
    for position, weights in ((closed, []), (lifted, [LIGHT])):
        solution = replace(good().solution, stances=replace(table, position=position))
        assert [reason.weight for reason in list_light_signs(WalkSigns(good().walk, solution))] == weights


def test_strides_that_end_in_motion_are_counted_one_by_one() -> None:
    """A third of the rows are taken from mid-swing: the median is what it was, the share is not."""
    table, t = good().solution.stances, demo().t
    sample = table.sample.copy()
    sample[1:-1:3] += np.searchsorted(t, t[0] + 0.5)
    moved = replace(good().solution, stances=replace(table, sample=sample, t=t[sample]))
    assert sign(good(), "of the strides velocity").weight < 0
    assert sign(WalkSigns(good().walk, moved), "of the strides velocity").weight > 1


def test_the_samples_that_were_solved_are_judged() -> None:
    """Peaks that the walk shows higher than their flanks do: what is left of the velocity is that of these."""
    limit = 0.9 * np.abs(demo().gyr).max()
    clipped = samples(gyr=np.clip(demo().gyr, -limit, limit))
    walk, solution = solved(clipped)
    raised = clipped.raise_peaks(2.2)
    seen = WalkSigns(walk, replace(solution, recording=raised))
    assert seen.recording is raised
    np.testing.assert_array_equal(seen.ends[1], WalkSigns(replace(walk, recording=raised), solution).ends[1])
    assert (seen.ends[1] != WalkSigns(walk, solution).ends[1]).any()


def spinning(rate_rad_s: float, clipped: float, turns: int = 4) -> tuple[Recording, Recording]:
    """The walk's samples, but the foot turns about up and back so many times, 0.2 s each; as it is, and clipped."""
    t, gyr = demo().t, np.zeros_like(demo().gyr)
    for k in range(turns):
        for sign, begin in ((1.0, 5.0 + 2.0 * k), (-1.0, 6.0 + 2.0 * k)):
            at = (t - begin) / 0.2
            inside = (at > 0) & (at < 1)
            gyr[inside, 2] = sign * rate_rad_s * np.sin(np.pi * at[inside])
    return samples(gyr=gyr), samples(gyr=np.clip(gyr, -clipped, clipped))


def test_what_clipped_peaks_hide_of_the_heading_adds_up_over_the_walk() -> None:
    """One error in all turns to the left and one in all to the right: each of them grows with the number of turns."""
    walk, solution = good().walk, good().solution
    level = replace(solution, nav_R_body=np.tile(np.eye(3), (len(demo()), 1, 1)))
    table = level.stances

    def hidden(turns: int, sigma_deg: float) -> float:
        claimed = replace(table, heading_sigma=np.full(len(table), np.radians(sigma_deg)))
        whole, clipped = spinning(12.0, 9.0, turns)
        seen = WalkSigns(replace(walk, recording=clipped), replace(level, stances=claimed))
        assert measure_hidden_turning(WalkSigns(replace(walk, recording=whole), level)) is None
        one = np.degrees(np.abs(whole.gyr - clipped.gyr).sum() * demo().period_s) / (2 * turns)
        reason = measure_hidden_turning(seen)
        open_deg = float(reason.words.split(" leave ")[1].split(" deg")[0])
        assert 0.3 * one < open_deg / (np.sqrt(2) * turns) < one  # OFF_SHARE of it
        return reason.weight

    assert hidden(4, 4.0) < hidden(8, 4.0)


def test_clipped_peaks_hide_no_heading_that_is_shown_otherwise() -> None:
    walk, solution = replace(good().walk, recording=spinning(12.0, 9.0)[1]), good().solution
    table = replace(solution.stances, field=("quasi-static",) * len(solution.stances))
    with_field = replace(solution, stances=table)
    assert measure_hidden_turning(WalkSigns(walk, solution)) is not None
    assert (
        measure_hidden_turning(WalkSigns(walk, replace(with_field, method="ma2018", uses_field=True, graph={}))) is None
    )
    assert measure_hidden_turning(WalkSigns(walk, replace(with_field, method="iez", graph={}))) is not None
    counted = replace(solution, method="smoother", graph={"inertial": 60})
    assert measure_hidden_turning(WalkSigns(walk, counted)) is None  # in its sigmas


def test_the_fastest_of_the_last_stride_is_not_what_came_after_it() -> None:
    walk, solution = good().walk, good().solution
    velocity, last = solution.velocity.copy(), int(solution.stances.sample[-1])
    velocity[last + 1 :] = [99.0, 0.0, 0.0]
    np.testing.assert_array_equal(WalkSigns(walk, replace(solution, velocity=velocity)).fastest, good().fastest)
    speed = np.linalg.norm(solution.velocity, axis=1)
    assert good().fastest[-1] == speed[solution.stances.sample[-2] : last].max()


@pytest.mark.parametrize("footfalls", [0, 1])
def test_a_path_without_footfalls_has_a_verdict(footfalls: int) -> None:
    walk, solution = good().walk, good().solution
    table = solution.stances
    kept = {f.name: getattr(table, f.name)[:footfalls] for f in fields(table) if getattr(table, f.name) is not None}
    stands = walk.stances.footfall < footfalls
    few = replace(walk.stances, start=walk.stances.start[stands], stop=walk.stances.stop[stands],
                  footfall=walk.stances.footfall[stands])  # fmt: skip
    found = judge_path(replace(walk, stances=few), replace(solution, stances=replace(table, **kept)))
    assert found.word == "not to be used"
    assert "no walking: 0 strides" in " ".join(found.reasons)
    assert "nan" not in " ".join(found.reasons)


# --- spoiled recordings ----------------------------------------------------------------------------------------------


def raw(recording: Recording, kept: np.ndarray | slice = np.s_[:]) -> Recording:
    """The samples once more through the door of a file."""
    row = np.arange(len(recording))[kept]
    return Recording.from_raw(RawRecording(recording.t[kept], recording.acc[kept], recording.gyr[kept], row))


def test_half_a_range_is_named() -> None:
    limit = 0.5 * np.abs(demo().gyr).max()
    spoiled = samples(gyr=np.clip(demo().gyr, -limit, limit))
    found = judged(spoiled)
    assert found.word != "trusted"
    assert any("clipped peaks" in reason for reason in found.reasons)


def test_twenty_samples_a_second_are_too_few() -> None:
    found = judged(raw(demo(), np.s_[::10]))
    assert found.word == "not to be used"
    assert any("velocity does not close" in reason for reason in found.reasons)


def test_a_sensor_that_rings_on_the_shoe_is_named_loose() -> None:
    t = demo().t
    turn = Rotation.from_rotvec(np.radians(2.0) * np.sin(2 * np.pi * 9.0 * t)[:, None] * [1.0, 0.0, 0.0])
    rate = np.gradient(np.radians(2.0) * np.sin(2 * np.pi * 9.0 * t), t)[:, None] * [1.0, 0.0, 0.0]
    found = judged(samples(acc=turn.inv().apply(demo().acc), gyr=turn.inv().apply(demo().gyr) + rate))
    assert found.word != "trusted"
    assert any("loose on the shoe" in reason for reason in found.reasons)


def test_a_sensor_that_slips_from_stride_to_stride_unseen() -> None:
    """A turn of the shoe's sensor in the blow of a heel that the gyroscope does not see: the vertical jumps."""
    walk, rng = good().walk, np.random.default_rng(3)
    slip = np.zeros((len(demo()), 3))
    for start in walk.stances.start[1:]:
        slip[start:] = np.radians(8.0) * rng.uniform(-1.0, 1.0, 3)
    shoe_R_sensor = Rotation.from_rotvec(slip)
    found = judged(samples(acc=shoe_R_sensor.inv().apply(demo().acc), gyr=shoe_R_sensor.inv().apply(demo().gyr)))
    assert found.word != "trusted"


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


def test_a_walk_of_one_stride_is_not_trusted_wherever_the_sensor_is() -> None:
    table = good().solution.stances
    kept = {f.name: getattr(table, f.name)[:2] for f in fields(table) if getattr(table, f.name) is not None}
    for mount in ("foot", "pocket"):
        walk = replace(good().walk, options=Options(mount=mount))
        found = judge_path(walk, replace(good().solution, stances=replace(table, **kept)))
        assert found.word == "not to be used"
        assert any("no walking: 1 stride " in reason for reason in found.reasons)


def test_a_recording_that_was_moved_by_hand_is_not_to_be_used() -> None:
    t = np.arange(0.0, 60.0, 0.005)
    angle = np.column_stack([np.sin(1.3 * t), np.sin(0.9 * t + 1.0), 0.5 * np.sin(1.7 * t)])
    nav_R_body = Rotation.from_rotvec(angle)
    gyr = np.vstack([(nav_R_body[:-1].inv() * nav_R_body[1:]).as_rotvec() / 0.005, np.zeros(3)])
    noise = np.random.default_rng(1).normal(0.0, 0.01, (len(t), 3))
    by_hand = Recording(t, nav_R_body.inv().apply([0.0, 0.0, 9.80665]) + noise, gyr + 0.1 * noise)
    assert judged(by_hand).word == "not to be used"


# --- limits of a person ----------------------------------------------------------------------------------------------


def test_a_path_that_runs_off_before_or_behind_all_footfalls_is_not_to_be_used() -> None:
    walk, solution = good().walk, good().solution
    for sample in (3, -3):
        velocity, position = solution.velocity.copy(), solution.position.copy()
        velocity[sample, 0] = 19.0
        position[sample:] += [2.0, 0.0, 0.0]
        for spoiled in (replace(solution, velocity=velocity), replace(solution, position=position)):
            found = judge_path(walk, spoiled)
            assert found.word == "not to be used"
            (words,) = (reason for reason in found.reasons if "the foot reaches" in reason)
            assert float(words.split(" at ")[1].split()[0]) == pytest.approx(demo().t[sample], abs=0.15)


def test_a_stride_that_is_longer_than_the_others_is_doubted_and_says_when() -> None:
    walk, solution = good().walk, good().solution
    table = solution.stances
    position = table.position.copy()
    position[7:] += (3.01 - np.linalg.norm(position[7] - position[6])) * np.array([0.0, 0.0, 1.0])
    position[7] = position[6] + [0.0, 3.01, 0.0]
    found = judge_path(walk, replace(solution, stances=replace(table, position=position)))
    assert found.word == "doubtful"
    assert any(f"a stride of 3.0 m, at {table.t[7]:.1f} s" in reason for reason in found.reasons)


def test_height_that_changes_like_in_a_fall_for_ten_seconds() -> None:
    t = np.arange(0.0, 40.0, 1.2)
    assert find_height_rate(t, 0.4 * t)[0] == pytest.approx(0.4)
    jump = np.where(t > 20.0, 4.0, 0.0)
    assert find_height_rate(t, jump)[0] < 0.4
    rate, when = find_height_rate(t, np.where(t > 20.0, 1.6 * (t - 20.0), 0.0))
    assert rate == pytest.approx(1.6)
    assert when > 30.0
    assert find_height_rate(t[:3], 9.0 * t[:3])[0] == 0.0


def test_a_scale_of_the_accelerometer_shows_in_the_strides() -> None:
    def gravity_of(signs: WalkSigns) -> float:
        return float(np.median(9.80665 + signs.ends[0][:, 2] / np.diff(signs.table.t)))

    reach = np.hypot(*good().solution.stances.position[:, :2].T).max()
    for scale in (1.0, 1.04, 0.9):
        seen = WalkSigns(replace(good().walk, recording=samples(acc=scale * demo().acc)), good().solution)
        error = abs(gravity_of(seen) / 9.80665 - 1.0) * reach
        assert sign(seen, "gravity is ").weight == pytest.approx(weigh_error(error, seen.sigma, seen.way), abs=0.05)
        assert gravity_of(seen) == pytest.approx(scale * gravity_of(good()), rel=0.02)


def test_swings_without_end_are_none_though_they_are_the_usual_ones() -> None:
    """Two footfalls in a minute of walking: the median swing is half a minute."""
    walk, solution = good().walk, good().solution
    kept = np.isin(walk.stances.footfall, [0, 30, 59])
    stances = replace(walk.stances, start=walk.stances.start[kept], stop=walk.stances.stop[kept],
                      footfall=np.searchsorted([0, 30, 59], walk.stances.footfall[kept]))  # fmt: skip
    assert measure_time_without_footfall(WalkSigns(replace(walk, stances=stances), solution)).weight > 2


def test_bad_samples_that_are_many_spoil_a_path_that_passes_else() -> None:
    for share, word in ((0.0, "trusted"), (0.001, "trusted"), (0.01, "doubtful"), (0.1, "not to be used")):
        told = replace(demo().provenance, bad_samples=round(share * len(demo())))
        found = judge_path(replace(good().walk, recording=replace(demo(), provenance=told)), good().solution)
        assert found.word == word


def test_a_stride_of_three_metres_spoils_a_path_in_a_pocket_too() -> None:
    walk, solution = replace(good().walk, options=Options(mount="pocket")), good().solution
    position = solution.stances.position.copy()
    position[7:] += [0.0, 3.0, 0.0]
    jumped = replace(solution, stances=replace(solution.stances, position=position))
    words = [any("longer than others" in one for one in judge_path(walk, path).reasons) for path in (solution, jumped)]
    assert words == [False, True]


def test_wrong_axes_spoil_a_path_of_any_method() -> None:
    mirrored = replace(good().walk, recording=samples(gyr=-demo().gyr))
    verdict = judge_path(mirrored, good().solution)
    assert verdict.word == "not to be used"
    assert any("negate gyr" in words for words in verdict.reasons)
    assert not any("negate gyr" in words for words in judge_path(good().walk, good().solution).reasons)
