"""Whether a path is to be trusted: measured signs make one verdict and its reasons.

The verdict is on the path, not on the sensor. Most signs are an error of the end of the path, m; an estimated quantity
counts by its remaining uncertainty, not by its size. Such a sign weighs 1 where the error is the sigma of the result
(or 1 per cent of the way, where the sigma is less), from which on the path is doubtful, and 2 at a tenth of the way,
from which on it is of no use. Others contradict walking itself, each between two physical limits. Between and beyond
the weight is linear in the logarithm. The heaviest sign decides, and signs of `MANY` together spoil a path as one of
weight 2 does.

Each sign is a function of `WalkSigns`, or a step of `list_*_signs`, which says what it measures, and on what its limits
(doubtful, no use) rest; those that online lines share are in `fg_nav.verdict.limits`. docs/files.md lists all of them.
In a pocket only signs that need no stances count; a path without a stride is judged by its samples alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.mount import measure_axes, measure_swing_axes, measure_turning, remove_fast
from fg_nav.detection.rest import RestParameters, find_still_stretches
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.magnetic.detectors import QUASI_STATIC
from fg_nav.mechanisation import integrate_strides
from fg_nav.samples.gaps import list_bridged, measure_unseen
from fg_nav.solution import Solution, StanceTable
from fg_nav.verdict import limits
from fg_nav.verdict.limits import (
    LIGHT,
    NAMING,
    NO_USE,
    UNSEEN,
    UNUSABLE,
    Reason,
    Verdict,
    Word,
    combine,
    weigh,
    weigh_error,
)
from fg_nav.walk import Walk

__all__ = ["UNUSABLE", "Verdict", "Word", "combine", "judge_footfalls", "judge_path"]

SPAN_S = 0.1  # Between the two positions of a speed.
RUN_CYCLE_S = 0.85  # Median stride below which a walk is a run: the foot is never as still.
DUE_SWINGS, DUE_S = 1.6, 1.2  # A stance is due when a swing has lasted for this many usual ones, and this long;
LATEST_S = 2.0  # in any case after this: where most stances were missed no swing is usual.
MOVING_RAD_S = 1.0  # Mean rate of a moving foot before or after all footfalls.
OPEN_SHARE = 0.3  # Residual velocity at a stance over the swing's speed: its stride is wrong by half of it.
LOW_RATE_HZ = 80.0
CLOSED_SHARE = 0.02  # Distance of the end from the start, over the way, of a walk that ends where it began.


class WalkSigns:
    """Quantities of a walk and its solution that several signs need.

    Strides are those from one row of the solution's table to the next; the recording is the one that was solved, in a
    stream without provenance, which is that of `walk.recording`.
    """

    def __init__(self, walk: Walk, solution: Solution) -> None:
        self.walk, self.solution, self.table = walk, solution, solution.stances
        self.recording = walk.recording if solution.recording is None else solution.recording
        t = self.table.t
        self.strides = np.diff(self.table.position, axis=0)  # (K, 3) m, from footfall to footfall
        self.lengths = np.hypot(self.strides[:, 0], self.strides[:, 1])  # (K,) m, over the ground
        self.way = float(self.lengths.sum())  # m, of the path over the ground
        # m, claimed sigma of the end over the ground; 0 without footfalls
        self.sigma = float(np.hypot(*self.table.position_sigma[-1, :2])) if len(self.table) else 0.0
        # (K,) m/s, of each stride in space; 0 where the foot was not recorded in between
        speed = np.linalg.norm(self.strides, axis=1) / np.maximum(np.diff(t), 1e-9)
        self.stride_speed = np.where(np.diff(self.sum_bridged(t)) > 0.0, 0.0, speed)
        self.usual_m_s = float(np.median(self.stride_speed)) if len(self.strides) else 0.0  # median of these

    def displace_end(self, turn: Floats) -> float:
        """Displacement of the end, m, by an error of the heading, (K + 1,) rad at the rows, to first order."""
        east, north = ((turn[1:] + turn[:-1]) / 2) @ self.strides[:, :2]
        return float(np.hypot(east, north))

    @cached_property
    def fastest(self) -> Floats:
        """(K,) m/s, the highest speed in each stride."""
        speed = np.linalg.norm(self.solution.velocity, axis=1)
        return np.maximum.reduceat(speed[: self.table.sample[-1]], self.table.sample[:-1])

    def sum_bridged(self, t: Floats) -> Floats:
        """Cumulative time, s, up to each stamp of `t`, in which only the other foot was recorded."""
        beside = self.walk.beside
        if beside is None:
            return np.zeros(t.shape)
        bridged = list_bridged(self.recording.t, beside)
        if not len(bridged):
            return np.zeros(t.shape)
        so_far = np.cumsum(np.diff(bridged, axis=1))
        both_ends = np.stack([np.append(0.0, so_far[:-1]), so_far], axis=1)
        return np.asarray(np.interp(t, bridged.ravel(), both_ends.ravel()))

    @cached_property
    def gait(self) -> float:
        """Allowed motion of a foot in its stances, as a multiple of a walk's: 2 in a run."""
        return 2.0 if float(np.median(np.diff(self.table.t))) < RUN_CYCLE_S else 1.0

    @cached_property
    def ends(self) -> tuple[Floats, Floats]:
        """Velocity (K, 3) m/s and vertical axis (K, 3) in the body at the end of each stride, by strapdown alone."""
        table, (acc, gyr) = self.table, self.recording.integrable
        attitude = np.array(table.nav_R_body, order="C")
        bias = np.ascontiguousarray(table.gyro_bias)
        strides = table.sample[:-1], table.sample[1:]
        velocity = integrate_strides(acc, gyr, self.recording.periods_s, *strides, attitude, bias, GRAVITY_M_S2)
        return velocity, attitude[: len(velocity), 2]

    @cached_property
    def left(self) -> Floats:
        """(K,) m/s, the speed at the end of each stride, where the foot stands."""
        return np.asarray(np.linalg.norm(self.ends[0], axis=1))


# --- signs of samples and stances ------------------------------------------------------------------------------------


def measure_time_without_footfall(observed: WalkSigns) -> Reason | None:
    """Untracked motion before the first footfall and after the last, and error of strides in which a stance was due.

    A stance is due after 1.6 usual swings and 1.2 s, in any case after 2 s. Outside, motion counts at the usual speed;
    between two footfalls the strapdown goes on: half of the variance of the residual velocity v of a stride of time T
    is that of a random walk, which leaves a position error v T / sqrt(12); the other half grew evenly, and leaves none.
    """
    stances, t = observed.walk.stances, observed.recording.t
    if len(stances) == 0:
        return None
    # before the first, after the last
    rate = np.linalg.norm(observed.recording.gyr, axis=1)
    ends = [np.s_[: stances.start[0]], np.s_[stances.stop[-1] :]]
    moves = [t[end] for end in ends if len(t[end]) and rate[end].mean() > MOVING_RAD_S]
    outside = np.array([np.ptp(one - observed.sum_bridged(one)) for one in moves])
    # s without a stance, from footfall to footfall
    spans = np.stack([t[stances.stop[:-1] - 1], t[stances.start[1:]]])[:, np.diff(stances.footfall) > 0]
    swings = np.asarray(np.diff(spans - observed.sum_bridged(spans), axis=0)[0])
    due_s = float(np.clip(DUE_SWINGS * np.median(swings), DUE_S, LATEST_S)) if len(swings) else DUE_S
    lost_s = float(outside[outside > due_s].sum())
    # between; where the rows of the solution are other footfalls, all of it is untracked
    overdue, error = swings > due_s, 0.0
    if len(overdue) != len(observed.strides):
        lost_s += float(swings[overdue].sum())
    elif overdue.any():
        left = observed.left * np.diff(observed.table.t)
        overdue &= np.diff(observed.sum_bridged(observed.table.t)) == 0.0
        error = float(np.sqrt(np.sum(left[overdue] ** 2) / 24.0))
    words = f"{lost_s:.1f} s of motion without a footfall are not followed"
    lost = limits.judge_unfollowed(lost_s, observed.usual_m_s, observed.sigma, observed.way, words)
    words = f"{swings[overdue].sum():.1f} s of motion without a footfall: strides were missed, {error:.1f} m open"
    missed = Reason(weigh_error(error, observed.sigma, observed.way), words)
    return max(lost, missed, key=lambda reason: reason.weight)


def measure_gap(observed: WalkSigns) -> Reason:
    """Motion in the gaps, at one sigma: half of each at the usual speed, root sum square of all; either foot sees."""
    longest_s = float(observed.recording.gaps.unseen_s.max(initial=0.0))
    words, beside = f"nothing was recorded for {longest_s:.2f} s amid the walk", observed.walk.beside
    unseen_s = observed.recording.gaps.unseen_s
    if beside is not None:
        t, gaps = observed.recording.t, observed.recording.gaps.sample
        unseen_s = np.array([measure_unseen(float(t[i]), float(t[i + 1]), beside) for i in gaps])
        words = f"{words}, and of neither foot for {unseen_s.max(initial=0.0):.2f} s"
    error = 0.5 * observed.usual_m_s * float(np.sqrt(np.sum(unseen_s**2)))
    weight, alone = weigh_error(error, observed.sigma, observed.way), beside is not None and longest_s > LATEST_S
    return Reason(max(weight, 1.0 if alone else UNSEEN), words)


def check_mount(observed: WalkSigns) -> Reason | None:
    """Turning that contradicts the mount as given: a thigh's on a foot, a foot's in a pocket, or names its like."""
    turning = measure_turning(observed.recording)
    wearing = turning.wearing
    on_foot = observed.walk.options.mount != "pocket"
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


def compare_bias(observed: WalkSigns) -> Reason:
    """Turning about up that the solution's bias leaves in the rests; a rest counts by its excess over its sway.

    Without a rest gravity alone shows a filter the bias about level axes: where that exceeds the filter's own sigma
    about up, it is assumed to be as large there. A graph has it in its sigmas; a field that was used shows it.
    """
    table, recording, solution = observed.table, observed.recording, observed.solution
    rests = find_still_stretches(recording, RestParameters())
    if rests:
        middle = recording.t[[(rest.start + rest.stop) // 2 for rest in rests]]
        row = np.abs(table.t[:, None] - middle).argmin(axis=0)
        up, biases = table.nav_R_body[row, 2], table.gyro_bias[row]
        left = np.array([(rest.rate - bias) @ one for rest, bias, one in zip(rests, biases, up, strict=True)])
        variance = np.array([one @ rest.covariance @ one for rest, one in zip(rests, up, strict=True)])
        # shrink a residual rate within the sway of its rest toward zero; linear between rests
        rate = np.interp(table.t, middle, left**3 / (left**2 + variance))
        turn = np.append(0.0, np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(table.t)))
        error, worst = observed.displace_end(turn), np.degrees(np.abs(rate).max())
        words = (
            f"rests show another gyroscope bias, by up to {worst:.2g} deg/s about up: {np.degrees(np.ptp(turn)):.0f} "
            f"deg of heading, {error:.1f} m at the end"
        )
    elif solution.graph or (solution.uses_field and QUASI_STATIC in table.field):
        return Reason(UNSEEN, "")
    else:
        end_up, bias, since = table.nav_R_body[-1, 2], table.gyro_bias[-1], table.t - table.t[0]
        level = (bias @ bias - (bias @ end_up) ** 2) / 2.0
        beyond = float(np.sqrt(max(level - (table.gyro_bias_sigma[-1] ** 2) @ end_up**2, 0.0)))
        error = observed.displace_end(beyond * since)
        words = (
            f"no rest shows the gyroscope's bias, and about level axes it is {np.degrees(np.sqrt(level)):.2g} deg/s, "
            f"more than the filter leaves open about up: {np.degrees(beyond * since[-1]):.0f} deg of heading, "
            f"{error:.1f} m at the end"
        )
    return Reason(weigh_error(error, observed.sigma, observed.way), words)


def measure_hidden_turning(observed: WalkSigns) -> Reason | None:
    """Heading error that rebuilt gyroscope peaks leave in a filter; a graph has it in its sigmas."""
    recording, solution = observed.recording, observed.solution
    peaks = recording.peaks[1]
    if solution.graph or not peaks.run.any():
        return None
    if QUASI_STATIC in solution.stances.field and solution.uses_field:
        return None  # the field shows the heading
    # the samples' sigmas are for independent errors; if the n samples of a peak share one, each has sigma / sqrt(n)
    missing = np.sign(recording.gyr) * peaks.sigma / np.sqrt(np.maximum(peaks.run, 1.0))
    about_up = (solution.nav_R_body[:, 2] * missing).sum(axis=1) * recording.period_s
    # left and right turns are two phases of the gait; each repeats its error in every stride, summed to each footfall
    row = solution.stances.sample
    sides = [np.cumsum(np.where(side * about_up > 0, about_up, 0.0))[row] for side in (1.0, -1.0)]
    error = float(np.linalg.norm([observed.displace_end(side - side[0]) for side in sides]))
    hidden = float(np.degrees(np.linalg.norm([side[-1] - side[0] for side in sides])))
    words = f"clipped peaks of the gyroscope, rebuilt, leave {hidden:.0f} deg of heading open, {error:.1f} m at the end"
    return Reason(weigh_error(error, observed.sigma, observed.way), words)


# --- the verdict -----------------------------------------------------------------------------------------------------


def judge_path(walk: Walk, solution: Solution) -> Verdict:
    """Judge the solution of a walk by all signs that apply to its mount; return word and reasons."""
    observed, has_strides = WalkSigns(walk, solution), len(solution.stances) > 1
    on_foot = walk.options.mount != "pocket"
    found = [
        *(list_foot_signs(observed) if has_strides and on_foot else ()),
        *(list_path_signs(observed) if has_strides else ()),
        *list_sample_signs(observed),
        *(list_light_signs(observed) if has_strides and on_foot else ()),
    ]
    return combine([reason for reason in found if reason is not None])


def list_foot_signs(observed: WalkSigns) -> Iterator[Reason | None]:
    """Yield what strides and stances of a foot show."""
    table, recording, stances = observed.table, observed.recording, observed.walk.stances
    # does strapdown close from stance to stance? Half of the velocity left is an error of the stride's length
    swing, left = max(np.median(observed.fastest), 1e-3), np.median(observed.left)
    yield Reason(
        weigh(left / swing, 0.15, 0.3),
        f"velocity does not close: {left:.2f} m/s, {100 * left / swing:.0f} % of the swing's, is left where the foot "
        "stands",
    )
    # share of the strides with so much of it that there are stances missing in them
    share = float(np.mean(observed.left / swing > OPEN_SHARE))
    words = f"in {100 * share:.0f} % of the strides velocity does not close by a third of the swing's: no stances there"
    yield Reason(weigh(share, 0.2, 0.5), words)
    # error of the vertical by the gyroscope alone, which turns 100 deg in a swing: a scale error of 1 % makes 1 deg
    cosine = (observed.ends[1] * table.nav_R_body[1:, 2]).sum(axis=1)
    tilt_deg = np.median(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    words = (
        f"the gyroscope misses the vertical by {tilt_deg:.1f} deg a stride: its axes, scale or range, or it is loose"
    )
    yield Reason(weigh(tilt_deg, 2.0, 5.0), words)
    # vertical force of the strides, which begin and end at rest, against gravity: a scale of the path
    force = GRAVITY_M_S2 + observed.ends[0][:, 2] / np.diff(table.t)
    reach = float(np.hypot(*(table.position[:, :2] - table.position[0, :2]).T).max())
    yield limits.judge_gravity(np.median(force), reach, observed.sigma, observed.way)
    # does the foot stand? Its median rate is 0.1 to 0.4 rad/s in the stillest moment, twice that in a run
    rate = np.median(np.linalg.norm(recording.gyr[table.sample] - table.gyro_bias, axis=1))
    words = f"the foot does not stand: it turns by {rate:.1f} rad/s in its stances"
    yield Reason(weigh(rate / observed.gait, 0.8, 1.2), words)
    # rate above 6 Hz in the stances, where a shoe on the ground has come to rest: twice as much in a run
    power = sum((axis - remove_fast(axis, recording.period_s)) ** 2 for axis in recording.gyr.T)  # by axis: less memory
    ends = np.column_stack([stances.start, np.minimum(stances.stop, len(recording) - 1)]).ravel()
    shaking = np.median(np.sqrt(np.add.reduceat(power, ends)[::2] / (stances.stop - stances.start)))
    words = (
        f"the sensor is loose on the shoe, or the foot not on the ground: it shakes by {shaking:.1f} rad/s in stances"
    )
    yield Reason(weigh(shaking / observed.gait, 0.3, 0.9), words)
    yield measure_time_without_footfall(observed)
    # a possible cause of other signs: a heel strikes within 20 ms
    if 1.0 / recording.period_s < LOW_RATE_HZ:
        yield Reason(NAMING, f"the sample rate of {1.0 / recording.period_s:.0f} Hz is low for a foot")
    yield limits.judge_filters(recording, stances)
    # is it a walk? Shorter strides are none, or on the spot; stairs make 0.36 m of height
    length, climb = np.median(observed.lengths), float(np.quantile(np.abs(observed.strides[:, 2]), 0.95))
    yield Reason(weigh(1.0 / max(length, 1e-3), 1 / 0.15, 1 / 0.1), f"no walking: the median stride is {length:.2f} m")
    yield Reason(weigh(climb, 0.5, 1.0), f"strides climb or fall by {climb:.1f} m, more than stairs do")
    yield limits.judge_height_rate(*limits.find_height_rate(table.t, table.position[:, 2]))
    # turning about up that the solution leaves
    yield compare_bias(observed)
    yield measure_hidden_turning(observed)


def list_path_signs(observed: WalkSigns) -> Iterator[Reason]:
    """Yield what the path on a foot, or in a pocket, shows."""
    table, recording, solution = observed.table, observed.recording, observed.solution
    in_pocket = observed.walk.options.mount == "pocket"
    yield limits.judge_longest_stride(observed.stride_speed, table.t, observed.sigma, observed.way)
    # the highest speed, by velocity and by positions, the greater of the two
    over = max(1, round(SPAN_S / recording.period_s))
    speed = np.linalg.norm(solution.velocity, axis=1)
    moved = np.linalg.norm(solution.position[over:] - solution.position[:-over], axis=1)
    speed[over:] = np.maximum(speed[over:], moved / (solution.t[over:] - solution.t[:-over]))
    fastest = int(np.argmax(np.where(np.isnan(speed), np.inf, speed)))
    yield limits.judge_speed(float(speed[fastest]), float(solution.t[fastest]))
    # axes of the gyroscope that contradict the accelerometer's
    measure = measure_swing_axes if in_pocket else measure_axes
    yield limits.judge_axes(measure(recording.t, recording.acc, recording.gyr))
    # its own sigmas at the end
    sigma_deg = float(np.degrees(table.heading_sigma[-1]))
    yield Reason(weigh(sigma_deg, 30.0, 90.0), f"the heading at the end is known to {sigma_deg:.0f} deg only")
    yield limits.judge_position(table.position_cov[-1, :2, :2], observed.way, in_pocket)
    # a step constant that is no adult's
    step_length = solution.parameters.get("step_length")
    if in_pocket and isinstance(step_length, dict):
        from fg_nav.pocket.dead_reckoning import DEFAULT_CONSTANT_M, DEFAULT_SIGMA  # loaded of a pocket alone

        constant, source = step_length["constant_m"], step_length["source"]
        sigmas = abs(constant / DEFAULT_CONSTANT_M - 1.0) / DEFAULT_SIGMA
        words = f"the step constant is {constant:.2f} m ({source}), {sigmas:.1f} sigma from an adult's"
        yield Reason(weigh(sigmas, 3.0, 10.0), f"{words} {DEFAULT_CONSTANT_M:.2f} m")


def list_sample_signs(observed: WalkSigns) -> Iterator[Reason | None]:
    """Yield what the samples show, of a path without a stride too."""
    recording, given = observed.recording, observed.walk.recording
    yield limits.judge_strides(len(observed.strides), recording.duration_s)
    yield limits.judge_rate(given.provenance.rate_sigma)
    yield measure_gap(observed)
    # motion, at the usual speed, in the parts of the recording that a hole cut off
    cut_s = given.provenance.cut_samples * recording.period_s
    words = f"{cut_s:.0f} s of the recording are cut off by a hole, and not used"
    speed = max(observed.usual_m_s, observed.way / max(recording.duration_s, 1e-9))
    yield limits.judge_unfollowed(cut_s, speed, observed.sigma, observed.way, words)
    yield limits.judge_bad_samples(given)
    yield check_mount(observed)


def list_light_signs(observed: WalkSigns) -> Iterator[Reason]:
    """Yield what is named, and makes no path doubtful."""
    # axes of the magnetometer that contradict the gyroscope's
    aligned = observed.walk.magnetometer
    if aligned is not None and aligned.wrong_axes is not None:
        warning = aligned.wrong_axes.warning
        yield Reason(LIGHT, f"the magnetometer contradicts the gyroscope and is left out: {warning}")
    # height of the end of a closed walk, in its sigmas, which may be another floor
    table = observed.table
    east, north, up = table.position[-1] - table.position[0]
    sigma = float(table.position_sigma[-1, 2])
    apart = abs(up) / sigma if sigma > 0 else 0.0
    if np.hypot(east, north) <= CLOSED_SHARE * observed.way and apart >= 3.0:
        yield Reason(LIGHT, f"it ends where it began, but {up:+.1f} m in height, {apart:.0f} of its sigmas")


def judge_footfalls(table: StanceTable) -> Verdict:
    """Judge a path by its footfalls alone, without samples, by the limits of a person."""
    speed = np.linalg.norm(np.diff(table.position, axis=0), axis=1) / np.maximum(np.diff(table.t), 1e-9)
    way = float(np.hypot(*np.diff(table.position[:, :2], axis=0).T).sum())
    found = [limits.judge_strides(len(speed), float(np.ptp(table.t)))]
    if len(speed):
        sigma = float(np.hypot(*table.position_sigma[-1, :2]))
        found.append(limits.judge_longest_stride(speed, table.t, sigma, way))
        found.append(limits.judge_speed(float(speed.max()), float(table.t[1 + int(np.argmax(speed))])))
    found.append(limits.judge_height_rate(*limits.find_height_rate(table.t, table.position[:, 2])))
    found.append(limits.judge_position(table.position_cov[-1, :2, :2], way))
    return combine(found)
