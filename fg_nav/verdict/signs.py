"""The signs: each a number with its limits, in the table of `fg_nav.verdict`, and the words that go with it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.mount import remove_fast
from fg_nav.detection.rest import RestParameters, find_still_stretches
from fg_nav.samples.gaps import measure_unseen
from fg_nav.verdict.limits import (
    FAST_SHARE,
    find_height_rate,
    judge_axes,
    judge_bad_samples,
    judge_filters,
    judge_gravity,
    judge_height_rate,
    judge_position,
    judge_rate,
    judge_speed,
    judge_stride,
    judge_strides,
    judge_unfollowed,
)
from fg_nav.verdict.reason import LIGHT, NAMING, NO_USE, UNSEEN, Reason, weigh, weigh_error
from fg_nav.verdict.seen import Seen

DUE_SWINGS, DUE_S, LATEST_S = 1.6, 1.2, 2.0
"""A stance is due when a swing has lasted for so many usual ones, and so long; and at the latest then, for where most
stances were missed no swing is usual."""

MOVING_RAD_S = 1.0
"""A foot that turns by less is not in a swing; on average over the time before or behind all footfalls."""

OPEN_SHARE = 0.3
"""Of the swing's speed: where so much is left at a stance, its stride is too long or short by half of it."""

LOW_RATE_HZ = 80.0  # A heel strikes within 20 ms.
CLOSED_SHARE = 0.02  # A walk that ends so near to its start, of the distance, ends where it began.


# --- signs of samples and stances ------------------------------------------------------------------------------------


def _median(values: Floats) -> float:
    return float(np.median(values)) if len(values) else np.nan


def count_footfalls(seen: Seen) -> Reason | None:
    """Too few strides for a walk."""
    return judge_strides(len(seen.strides), seen.recording.duration_s)


def measure_turning_at_stances(seen: Seen) -> Reason | None:
    """How fast the sensor turns where it should stand."""
    table = seen.solution.stances
    rate = _median(np.linalg.norm(seen.recording.gyr[table.sample] - table.gyro_bias, axis=1))
    return Reason(
        weigh(rate / seen.gait, 0.8, 1.2), f"the foot does not stand: it turns by {rate:.1f} rad/s in its stances"
    )


def measure_shaking(seen: Seen) -> Reason | None:
    """How a sensor rings on the shoe where the foot stands."""
    gyr, stances = seen.recording.gyr, seen.walk.stances
    power = sum((axis - remove_fast(axis, seen.recording.period_s)) ** 2 for axis in gyr.T)  # a third of the memory
    mean = np.add.reduceat(power, np.column_stack([stances.start, np.minimum(stances.stop, len(gyr) - 1)]).ravel())[::2]
    shaking = _median(np.sqrt(mean / (stances.stop - stances.start)))
    words = (
        f"the sensor is loose on the shoe, or the foot not on the ground: it shakes by {shaking:.1f} rad/s in stances"
    )
    return Reason(weigh(shaking / seen.gait, 0.3, 0.9), words)


def measure_time_without_footfall(seen: Seen) -> Reason | None:
    """Time in which a foot that moves is not followed: before the first footfall and behind the last, and cut off.

    Between two footfalls it is, by strapdown: of the strides in which a stance was due, half of the variance of what is
    left of the velocity is taken for that of a random walk, which leaves v T / sqrt(12) of the place; the other half
    grew evenly, and leaves nothing.
    """
    stances, t = seen.walk.stances, seen.recording.t
    if len(stances) == 0:
        return None
    # before the first, behind the last
    rate = np.linalg.norm(seen.recording.gyr, axis=1)
    ends = [np.s_[: stances.start[0]], np.s_[stances.stop[-1] :]]
    moves = [t[end] for end in ends if len(t[end]) and rate[end].mean() > MOVING_RAD_S]
    outside = np.array([np.ptp(one - seen.sum_bridged(one)) for one in moves])
    due_s = float(np.clip(DUE_SWINGS * _median(seen.swings), DUE_S, LATEST_S)) if len(seen.swings) else DUE_S
    lost_s = float(outside[outside > due_s].sum())
    # between; where the rows of the solution are other footfalls, nothing followed it
    overdue, error = seen.swings > due_s, 0.0
    if len(overdue) != len(seen.strides):
        lost_s += float(seen.swings[overdue].sum())
    elif overdue.any():
        left = np.linalg.norm(seen.ends[0], axis=1) * np.diff(seen.solution.stances.t)
        overdue &= np.diff(seen.sum_bridged(seen.solution.stances.t)) == 0.0
        error = float(np.sqrt(np.sum(left[overdue] ** 2) / 24.0))
    words = f"{lost_s:.1f} s of motion without a footfall are not followed"
    lost = judge_unfollowed(lost_s, seen.usual_m_s, seen.sigma, seen.way, words)
    words = f"{seen.swings[overdue].sum():.1f} s of motion without a footfall: strides were missed, {error:.1f} m open"
    missed = Reason(weigh_error(error, seen.sigma, seen.way), words)
    return max(lost, missed, key=lambda reason: reason.weight)


def measure_cut(seen: Seen) -> Reason | None:
    """The part of the recording that a hole cut off."""
    cut_s = seen.recording.provenance.cut_samples * seen.recording.period_s
    words = f"{cut_s:.0f} s of the recording are cut off by a hole, and not used"
    speed = max(seen.usual_m_s, seen.way / max(seen.recording.duration_s, 1e-9))
    return judge_unfollowed(cut_s, speed, seen.sigma, seen.way, words)


def name_nominal_rate(seen: Seen) -> Reason | None:
    """A sample rate that nothing shows but what was said of it."""
    return judge_rate(seen.recording.provenance.rate_sigma)


def measure_gap(seen: Seen) -> Reason | None:
    """The time that was not observed, in half of which, one sigma, the foot went on or did not."""
    longest_s = float(seen.recording.gaps.unseen_s.max(initial=0.0))
    words, beside = f"nothing was recorded for {longest_s:.2f} s amid the walk", seen.walk.beside
    unseen_s = seen.recording.gaps.unseen_s
    if beside is not None:
        t, gaps = seen.recording.t, seen.recording.gaps.sample
        unseen_s = np.array([measure_unseen(float(t[i]), float(t[i + 1]), beside) for i in gaps])
        words = f"{words}, and of neither foot for {unseen_s.max(initial=0.0):.2f} s"
    error = 0.5 * seen.usual_m_s * float(np.sqrt(np.sum(unseen_s**2)))
    weight, alone = weigh_error(error, seen.sigma, seen.way), beside is not None and longest_s > LATEST_S
    return Reason(max(weight, 1.0 if alone else UNSEEN), words)


def name_rate(seen: Seen) -> Reason | None:
    """A low sample rate, from which what is wrong with a path may come."""
    rate_hz = 1.0 / seen.recording.period_s
    words = f"the sample rate of {rate_hz:.0f} Hz is low for a foot"
    return Reason(NAMING, words) if rate_hz < LOW_RATE_HZ else None


def measure_filters(seen: Seen) -> Reason | None:
    """A low-pass that took the heel strikes away, or a high-pass that took the slow rates."""
    return judge_filters(seen.recording, seen.walk.stances)


def measure_bad_samples(seen: Seen) -> Reason | None:
    """Share of the samples of which a sensor was bad: others may be as wrong, and not be seen."""
    return judge_bad_samples(seen.recording)


def name_wearing(seen: Seen) -> Reason | None:
    """What the turning is like, where it is not that of a foot."""
    turning, wearing = seen.turning, seen.turning.wearing
    on_foot = seen.walk.options.mount != "pocket"
    if wearing == "pocket" and on_foot:
        return Reason(NO_USE, f"the sensor turns like a thigh, not like a foot ({turning.words}): try --mount pocket")
    if wearing == "foot" and not on_foot:
        return Reason(NO_USE, f"the sensor turns like a foot, not like a thigh ({turning.words}): leave --mount out")
    if wearing is not None or turning.windows == 0:
        return None
    if turning.rhythm > 0.6 and turning.rest_share < 0.15 and turning.impact_m_s2 < 20.0:
        return Reason(
            NAMING, "it turns evenly and is never hit, like a foot on a bicycle's pedal, or a hand that swings"
        )
    limb = "foot" if on_foot else "thigh"
    return Reason(NAMING, f"it does not turn in the rhythm of a {limb}, more like a sensor in a hand")


# --- signs of the solution -------------------------------------------------------------------------------------------


def measure_velocity_closure(seen: Seen) -> Reason | None:
    """What is left of a stride's velocity where the foot stands."""
    if not len(seen.strides):
        return None
    left = _median(np.linalg.norm(seen.ends[0], axis=1))
    share = left / max(_median(seen.fastest), 1e-3)
    words = (
        f"velocity does not close: {left:.2f} m/s, {100 * share:.0f} % of the swing's, is left where the foot stands"
    )
    return Reason(weigh(share, 0.15, 0.3), words)


def count_open_strides(seen: Seen) -> Reason | None:
    """Share of the strides of which much of the velocity is left."""
    left = np.linalg.norm(seen.ends[0], axis=1) / max(_median(seen.fastest), 1e-3)
    share = float(np.mean(left > OPEN_SHARE)) if len(left) else 0.0
    words = f"in {100 * share:.0f} % of the strides velocity does not close by a third of the swing's: no stances there"
    return Reason(weigh(share, 0.2, 0.5), words)


def measure_tilt_closure(seen: Seen) -> Reason | None:
    """By how much the vertical misses from footfall to footfall."""
    if not len(seen.strides):
        return None
    up = seen.solution.stances.nav_R_body[1:, 2]
    tilt_deg = _median(np.degrees(np.arccos(np.clip((seen.ends[1] * up).sum(axis=1), -1.0, 1.0))))
    words = (
        f"the gyroscope misses the vertical by {tilt_deg:.1f} deg a stride: its axes, scale or range, or it is loose"
    )
    return Reason(weigh(tilt_deg, 2.0, 5.0), words)


def measure_stride(seen: Seen) -> Reason | None:
    """Strides that are none."""
    if not len(seen.strides):
        return None
    length = _median(seen.lengths)
    return Reason(weigh(1.0 / max(length, 1e-3), 1 / 0.15, 1 / 0.1), f"no walking: the median stride is {length:.2f} m")


def measure_longest_stride(seen: Seen) -> Reason | None:
    """A stride longer than the others for the time that it takes."""
    if not len(seen.strides):
        return None
    t, speed = seen.solution.stances.t, seen.stride_speed
    fast = float(np.quantile(speed, FAST_SHARE, method="lower"))
    longest = _find_worst((speed - fast) * np.diff(t))
    took = float(t[longest + 1] - t[longest])
    return judge_stride(float(speed[longest]) * took, took, float(t[longest + 1]), fast, seen.sigma, seen.way)


def measure_speed(seen: Seen) -> Reason | None:
    """A speed that no foot has, anywhere on the path."""
    fastest = _find_worst(seen.speed)
    return judge_speed(float(seen.speed[fastest]), float(seen.solution.t[fastest]))


def _find_worst(values: Floats) -> int:
    """Index of the largest; of the first that is NaN, if one is."""
    return int(np.argmax(np.where(np.isnan(values), np.inf, values)))


def measure_height_rate(seen: Seen) -> Reason | None:
    """A height that changes faster than on stairs, for long."""
    table = seen.solution.stances
    return judge_height_rate(*find_height_rate(table.t, table.position[:, 2]))


def measure_gravity(seen: Seen) -> Reason | None:
    """The vertical force from rest to rest that is not gravity's."""
    if not len(seen.strides):
        return None
    moved = seen.solution.stances.position[:, :2] - seen.solution.stances.position[0, :2]
    reach = float(np.hypot(*moved.T).max())
    return judge_gravity(_median(seen.gravity), reach, seen.sigma, seen.way)


def contradict_axes(seen: Seen) -> Reason | None:
    """Axes of the gyroscope that are not the accelerometer's."""
    return judge_axes(seen.axes)


def measure_climbing(seen: Seen) -> Reason | None:
    """Height of the strides."""
    climb = float(np.quantile(np.abs(seen.strides[:, 2]), 0.95)) if len(seen.strides) else 0.0
    return Reason(weigh(climb, 0.5, 1.0), f"strides climb or fall by {climb:.1f} m, more than stairs do")


def compare_bias(seen: Seen) -> Reason | None:
    """Turning about up that the solution leaves in the rests: its bias is not theirs, of whatever size both are.

    Without a rest gravity shows the bias about level axes: one that is larger than what the solution takes for likely
    about up says that it is as large there.
    """
    table, recording = seen.solution.stances, seen.recording
    if not len(seen.strides):
        return None
    rests = find_still_stretches(recording, RestParameters())
    if not rests:
        return _compare_bias_with_its_sigma(seen)
    middle = recording.t[[(rest.start + rest.stop) // 2 for rest in rests]]
    row = np.abs(table.t[:, None] - middle).argmin(axis=0)
    up = table.nav_R_body[row, 2]
    left = np.array([(rest.rate - bias) @ one for rest, bias, one in zip(rests, table.gyro_bias[row], up, strict=True)])
    variance = np.array([one @ rest.covariance @ one for rest, one in zip(rests, up, strict=True)])
    # what the sway of a rest may be counts as none, and between rests the bias is on a line
    rate = np.interp(table.t, middle, left**3 / (left**2 + variance))
    turn = np.append(0.0, np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(table.t)))
    error, worst = seen.displace_end(turn), np.degrees(np.abs(rate).max())
    words = (
        f"rests show another gyroscope bias, by up to {worst:.2g} deg/s about up: {np.degrees(np.ptp(turn)):.0f} deg "
        f"of heading, {error:.1f} m at the end"
    )
    return Reason(weigh_error(error, seen.sigma, seen.way), words)


def _compare_bias_with_its_sigma(seen: Seen) -> Reason:
    table = seen.solution.stances
    up, bias, since = table.nav_R_body[-1, 2], table.gyro_bias[-1], table.t - table.t[0]
    level = (bias @ bias - (bias @ up) ** 2) / 2.0
    beyond = float(np.sqrt(max(level - (table.gyro_bias_sigma[0] ** 2) @ up**2, 0.0)))
    error = seen.displace_end(beyond * since)
    words = (
        f"no rest shows the gyroscope's bias, and about level axes it is {np.degrees(np.sqrt(level)):.2g} deg/s, more "
        f"than assumed about up: {np.degrees(beyond * since[-1]):.0f} deg of heading, {error:.1f} m at the end"
    )
    return Reason(weigh_error(error, seen.sigma, seen.way), words)


def measure_heading_sigma(seen: Seen) -> Reason | None:
    """A heading that is not known any more."""
    sigma = float(np.degrees(seen.solution.stances.heading_sigma[-1:].max(initial=0.0)))
    return Reason(weigh(sigma, 30.0, 90.0), f"the heading at the end is known to {sigma:.0f} deg only")


def measure_hidden_turning(seen: Seen) -> Reason | None:
    """Heading that clipped peaks may hide from a filter; the sigmas of a graph have it (`smoother.gyro_scale`)."""
    recording, solution = seen.recording, seen.solution
    peaks = recording.peaks[1]
    if seen.solution.graph or not peaks.run.any() or seen.holds_heading or not len(seen.strides):
        return None
    # The sigmas of a peak's samples are those of independent errors: as one error each has its share of the whole.
    missing = np.sign(recording.gyr) * peaks.sigma / np.sqrt(np.maximum(peaks.run, 1.0))
    about_up = (solution.nav_R_body[:, 2] * missing).sum(axis=1) * recording.period_s
    # Peaks to the left and to the right are those of two moments of the gait, each with one error in all strides.
    row = solution.stances.sample
    sides = [np.cumsum(np.where(side * about_up > 0, about_up, 0.0))[row] for side in (1.0, -1.0)]
    error = float(np.linalg.norm([seen.displace_end(side - side[0]) for side in sides]))
    hidden = float(np.degrees(np.linalg.norm([side[-1] - side[0] for side in sides])))
    words = f"clipped peaks of the gyroscope, rebuilt, leave {hidden:.0f} deg of heading open, {error:.1f} m at the end"
    return Reason(weigh_error(error, seen.sigma, seen.way), words)


def measure_position_sigma(seen: Seen) -> Reason | None:
    """A place that is not known any more."""
    table = seen.solution.stances
    if len(table) < 2:
        return None
    return judge_position(table.position_cov[-1, :2, :2], seen.way, seen.walk.options.mount == "pocket")


def compare_heights(seen: Seen) -> Reason | None:
    """Start and end at one place but not at one height."""
    table = seen.solution.stances
    if len(table) < 2:
        return None
    east, north, up = table.position[-1] - table.position[0]
    sigma = float(table.position_sigma[-1, 2])
    apart = abs(up) / sigma if sigma > 0 else 0.0
    if np.hypot(east, north) > CLOSED_SHARE * seen.lengths.sum() or apart < 3.0:
        return None
    return Reason(LIGHT, f"it ends where it began, but {up:+.1f} m in height, {apart:.0f} of its sigmas")


def contradict_magnetometer(seen: Seen) -> Reason | None:
    """Axes of the magnetometer that are not the gyroscope's."""
    aligned = seen.walk.magnetometer
    if aligned is None or aligned.wrong_axes is None:
        return None
    return Reason(LIGHT, f"the magnetometer contradicts the gyroscope and is left out: {aligned.wrong_axes.warning}")


SIGNS_WITHOUT_FOOTFALLS: tuple[Callable[[Seen], Reason | None], ...] = (
    count_footfalls,
    name_nominal_rate,
    measure_gap,
    measure_cut,
    measure_bad_samples,
    name_wearing,
)

SIGNS_IN_POCKET = (
    measure_speed,
    measure_longest_stride,
    contradict_axes,
    measure_heading_sigma,
    measure_position_sigma,
    *SIGNS_WITHOUT_FOOTFALLS,
)

SIGNS: tuple[Callable[[Seen], Reason | None], ...] = (
    measure_velocity_closure,
    count_open_strides,
    measure_tilt_closure,
    measure_turning_at_stances,
    measure_shaking,
    name_rate,
    measure_filters,
    measure_time_without_footfall,
    measure_stride,
    measure_longest_stride,
    measure_speed,
    measure_climbing,
    measure_height_rate,
    measure_gravity,
    contradict_axes,
    compare_bias,
    measure_heading_sigma,
    measure_hidden_turning,
    measure_position_sigma,
    *SIGNS_WITHOUT_FOOTFALLS,
    contradict_magnetometer,
    compare_heights,
)
