"""The signs: each a number with its limits, in the table of `fg_nav.verdict`, and the words that go with it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.mount import remove_fast
from fg_nav.samples.gaps import measure_unseen
from fg_nav.samples.plausibility import measure_sharpness
from fg_nav.verdict.limits import (
    POSITION_SHARE,
    POSITION_SHARE_IN_POCKET,
    find_height_rate,
    judge_axes,
    judge_gravity,
    judge_height_rate,
    judge_lost_time,
    judge_position,
    judge_speed,
    judge_stride,
    judge_strides,
)
from fg_nav.verdict.reason import LIGHT, NAMING, NO_USE, Reason, weigh
from fg_nav.verdict.seen import Seen

DUE_SWINGS, DUE_S, LATEST_S = 1.6, 1.2, 2.0
"""A stance is due when a swing has lasted for so many usual ones, and so long; and at the latest then, for where most
stances were missed no swing is usual."""

MOVING_RAD_S = 1.0
"""A foot that turns by less is not in a swing; on average over the time before or behind all footfalls."""

RUN_CYCLE_S = 0.85
"""Strides that are shorter, median, are those of a run."""

OPEN_SHARE = 0.3
"""Of the swing's speed: where so much is left at a stance, its stride is too long or short by half of it."""

HARMLESS_RAD = np.radians(2.0)
"""Of heading: it puts the end of a walk off by 2 per cent of the distance, or less."""

CLOSED_SHARE = 0.02
"""A walk that ends so near to its start, of the distance, ends where it began."""


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
    return Reason(weigh(rate, 0.8, 1.2), f"the foot does not stand: it turns by {rate:.1f} rad/s in its stances")


def measure_shaking(seen: Seen) -> Reason | None:
    """How a sensor rings on the shoe where the foot stands."""
    gyr, stances = seen.recording.gyr, seen.walk.stances
    power = sum((axis - remove_fast(axis, seen.recording.period_s)) ** 2 for axis in gyr.T)  # a third of the memory
    mean = np.add.reduceat(power, np.column_stack([stances.start, np.minimum(stances.stop, len(gyr) - 1)]).ravel())[::2]
    shaking = _median(np.sqrt(mean / (stances.stop - stances.start)))
    gait = 2.0 if seen.cycle_s < RUN_CYCLE_S else 1.0
    words = (
        f"the sensor is loose on the shoe, or the foot not on the ground: it shakes by {shaking:.1f} rad/s in stances"
    )
    return Reason(weigh(shaking, 0.3 * gait, 0.9 * gait), words)


def measure_time_without_footfall(seen: Seen) -> Reason | None:
    """Time in which a stance was due, between footfalls, before the first and behind the last."""
    stances, t = seen.walk.stances, seen.recording.t
    if len(stances) == 0:
        return None
    due_s = float(np.clip(DUE_SWINGS * _median(seen.swings), DUE_S, LATEST_S)) if len(seen.swings) else DUE_S
    rate = np.linalg.norm(seen.recording.gyr, axis=1)
    ends = [np.s_[: stances.start[0]], np.s_[stances.stop[-1] :]]
    moves = [t[end] for end in ends if len(t[end]) and rate[end].mean() > MOVING_RAD_S]
    outside = [float(np.ptp(one - seen.sum_bridged(one))) for one in moves]
    missed = np.concatenate([seen.swings, outside])
    lost_s = float(missed[missed > due_s].sum())
    return judge_lost_time(lost_s, seen.recording.duration_s)


def measure_clipping(seen: Seen) -> Reason | None:
    """Share of the swings in which a sensor is at the end of its range."""
    swings = ~seen.walk.stances.mask if len(seen.walk.stances) else np.ones(len(seen.recording), dtype=np.bool_)
    if not swings.any():
        return None
    shares = [float(np.asarray((peaks.run > 0).any(axis=1))[swings].mean()) for peaks in seen.recording.peaks]
    share, sensor = max(zip(shares, ("accelerometer", "gyroscope"), strict=True))
    words = f"the {sensor} is at the end of its range in {100 * share:.0f} % of the swings, and rebuilt there"
    return Reason(weigh(share, 0.05, 0.15), words)


def measure_rate(seen: Seen) -> Reason | None:
    """A low sample rate."""
    rate_hz = 1.0 / seen.recording.period_s
    return Reason(weigh(1.0 / rate_hz, 1 / 80, 1 / 40), f"the sample rate of {rate_hz:.0f} Hz is too low for a foot")


def name_nominal_rate(seen: Seen) -> Reason | None:
    """A sample rate that nothing shows but what was said of it."""
    sigma = seen.recording.provenance.rate_sigma
    words = f"the sample rate is nominal, known to {100 * sigma:.2g} %, and the path to {200 * sigma:.2g} %"
    return Reason(LIGHT, words) if sigma > 0.0 else None


def measure_smoothing(seen: Seen) -> Reason | None:
    """Power of the fast motion that a foot has and a smoothed recording lost."""
    sharpness = measure_sharpness(seen.recording.acc, seen.recording.gyr, seen.recording.period_s)
    if np.isnan(sharpness):
        return None
    words = "the samples are smoothed: a foot has power above 8 Hz, and they have none; log them without the filter"
    return Reason(weigh(1.0 / max(sharpness, 1e-12), 1 / 0.004, 1 / 1e-5), words)


def measure_gap(seen: Seen) -> Reason | None:
    """The longest time that was not observed; where the other foot was, it is doubtful at most."""
    longest_s = float(seen.recording.gaps.unseen_s.max(initial=0.0))
    words, beside = f"nothing was recorded for {longest_s:.2f} s amid the walk", seen.walk.beside
    if beside is None:
        return Reason(weigh(longest_s, 0.1, 0.5), words)
    t, gaps = seen.recording.t, seen.recording.gaps.sample
    by_neither = max((measure_unseen(float(t[i]), float(t[i + 1]), beside) for i in gaps), default=0.0)
    weight = max(weigh(by_neither, 0.1, 0.5), min(weigh(longest_s, 0.1, 0.5), 1.0))
    return Reason(weight, f"{words}, and of neither foot for {by_neither:.2f} s")


def measure_bad_samples(seen: Seen) -> Reason | None:
    """Share of the samples of which a sensor was bad: others may be as wrong, and not be seen."""
    bad = seen.recording.provenance.bad_samples
    share = bad / (bad + len(seen.recording))
    words = f"{100 * share:.1f} % of the samples were bad, and not used: the sensor or its connection is broken"
    return Reason(weigh(share, 0.005, 0.05), words)


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
    return Reason(NAMING, "it does not turn in the rhythm of a foot, more like a sensor in a hand")


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
    """A stride longer than a foot makes."""
    if not len(seen.strides):
        return None
    t = seen.solution.stances.t
    length = np.where(np.diff(seen.sum_bridged(t)) > 0.0, 0.0, np.linalg.norm(seen.strides, axis=1))
    longest = _find_worst(length)
    in_pocket = seen.walk.options.mount == "pocket"
    return judge_stride(float(length[longest]), float(t[longest + 1]), in_pocket)


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
    return judge_gravity(_median(seen.gravity)) if len(seen.strides) else None


def contradict_axes(seen: Seen) -> Reason | None:
    """Axes of the gyroscope that are not the accelerometer's."""
    return judge_axes(seen.axes)


def measure_climbing(seen: Seen) -> Reason | None:
    """Height of the strides."""
    climb = float(np.quantile(np.abs(seen.strides[:, 2]), 0.95)) if len(seen.strides) else 0.0
    return Reason(weigh(climb, 0.5, 1.0), f"strides climb or fall by {climb:.1f} m, more than stairs do")


def measure_bias(seen: Seen) -> Reason | None:
    """A gyroscope bias out of range."""
    bias = float(np.degrees(np.abs(seen.solution.stances.gyro_bias).max(initial=0.0)))
    return Reason(weigh(bias, 1.0, 3.0), f"a gyroscope bias of {bias:.1f} deg/s is out of range")


def measure_heading_sigma(seen: Seen) -> Reason | None:
    """A heading that is not known any more."""
    sigma = float(np.degrees(seen.solution.stances.heading_sigma[-1:].max(initial=0.0)))
    return Reason(weigh(sigma, 30.0, 90.0), f"the heading at the end is known to {sigma:.0f} deg only")


def measure_hidden_turning(seen: Seen) -> Reason | None:
    """Heading that clipped peaks may hide, over the sigma that the solution claims."""
    recording, solution = seen.recording, seen.solution
    peaks = recording.peaks[1]
    if not peaks.run.any() or seen.holds_heading:
        return None
    # The sigmas of a peak's samples are those of independent errors: as one error each has its share of the whole.
    missing = np.sign(recording.gyr) * peaks.sigma / np.sqrt(np.maximum(peaks.run, 1.0))
    about_up = (solution.nav_R_body[:, 2] * missing).sum(axis=1) * recording.period_s
    # Peaks to the left and to the right are those of two moments of the gait, each with one error in all strides.
    hidden = float(np.hypot(about_up[about_up > 0].sum(), about_up[about_up < 0].sum()))
    apart = hidden / float(np.hypot(solution.stances.heading_sigma[-1], HARMLESS_RAD))
    words = (
        f"clipped peaks of the gyroscope, rebuilt, leave {np.degrees(hidden):.0f} deg of heading open, "
        f"{apart:.1f} of the sigmas claimed"
    )
    return Reason(weigh(apart, 2.0, 3.0), words)


def measure_position_sigma(seen: Seen) -> Reason | None:
    """A place that is not known any more."""
    table = seen.solution.stances
    if len(table) < 2:
        return None
    limits = POSITION_SHARE_IN_POCKET if seen.walk.options.mount == "pocket" else POSITION_SHARE
    return judge_position(float(np.hypot(*table.position_sigma[-1, :2])), float(seen.lengths.sum()), limits)


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
    measure_rate,
    name_nominal_rate,
    measure_gap,
    measure_clipping,
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
    count_footfalls,
    measure_velocity_closure,
    count_open_strides,
    measure_tilt_closure,
    measure_turning_at_stances,
    measure_shaking,
    measure_time_without_footfall,
    measure_stride,
    measure_longest_stride,
    measure_speed,
    measure_climbing,
    measure_height_rate,
    measure_gravity,
    contradict_axes,
    measure_bias,
    measure_heading_sigma,
    measure_hidden_turning,
    measure_smoothing,
    measure_position_sigma,
    *SIGNS_WITHOUT_FOOTFALLS,
    contradict_magnetometer,
    compare_heights,
)
