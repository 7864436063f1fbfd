"""Physical limits of a person on foot, the weight of an error of the end, and the verdict of several reasons.

The limits (doubtful, no use) hold for a path at its end, and for each line online.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.mount import DECISIVE, SUSPECT, AxesEvidence
from fg_nav.detection.sensor_processing import measure_high_pass, measure_smoothing
from fg_nav.detection.stance import Stances
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.recording import Recording
from fg_nav.text import format_count

Word = Literal["trusted", "doubtful", "not to be used"]

UNUSABLE: Word = "not to be used"

NO_USE = 2.0  # Weight of a sign that spoils a path alone.
LIGHT = 0.8  # Weight of a sign that is named, and makes no path doubtful.
NAMING = 0.0  # Weight of words that name a possible cause of other signs.
UNSEEN = -1.0  # Weight of an absent sign.
MANY = 4.0  # Sum of the weights, of those of 1 and more, that spoils a path.
HARMLESS_SHARE = 0.01  # Error of a good path, whatever its sigma, over the way.
USE_SHARE = 0.1  # Error, or 95 % region, from which on a path is of no use, over the way;
USE_SHARE_IN_POCKET = 0.6  # in a pocket more: the length of a step is known to 0.12.
MIN_WAY_M = 10.0  # A shorter way counts as this: seven strides.

FEW_STRIDES = 1 / 4, 1 / 3  # One over their number: three or fewer are no walk.
SEEN_BY = 20  # Strides, of which those tested are at least a half in any ordinary walk.

SPEED_M_S = 12.0, 18.0  # Of the foot: 2.5 times that of the person, who runs at 5.
HEIGHT_RATE_M_S = 0.8, 1.5  # Over 10 s and more: 0.5 is to run up stairs, 1 to run down.
CLIMBED_S = 10.0  # Over which the height rate is measured: a jump, or a slide down a pole, is shorter.
AXES_ODDS = SUSPECT, DECISIVE  # Log of the odds of other axes of the gyroscope than those given.
FASTER, FAST_SHARE = 1.5, 0.9  # No stride is faster by this factor than this quantile of the strides.
SIGMAS_95 = float(np.sqrt(-2.0 * np.log(0.05)))  # Radius of the 95 % ellipse of a normal distribution.
SMOOTHED = 100.0, 1e4  # Power at the gait's rate over that of heel strikes: 4 times the softest foot's, and 400 times.
BAD_SHARE = 0.005, 0.05  # At 200 Hz one in every stride, or ten; others may be as wrong and unnoticed.


@dataclass(frozen=True)
class Reason:
    """An observed sign: its weight, and words with the measured value."""

    weight: float
    words: str


@dataclass(frozen=True)
class Verdict:
    """The word, and the reasons against the path, heaviest first; a trusted path may have light reasons."""

    word: Word
    reasons: tuple[str, ...]


def weigh(value: float, doubtful: float, no_use: float) -> float:
    """Weight of a value: 1 at the first limit, 2 at the second, linear in the logarithm; 2 for NaN."""
    if np.isnan(value):
        return NO_USE
    return 1.0 + float(np.log(max(value, 1e-12) / doubtful) / np.log(no_use / doubtful))


def weigh_error(error_m: float, sigma_m: float, way_m: float) -> float:
    """Weight of an error of the end, m: 1 at the sigma of the result, 2 at a tenth of the way, or two sigmas."""
    way_m = max(way_m, MIN_WAY_M)
    known_m = float(np.hypot(sigma_m, HARMLESS_SHARE * way_m))
    return weigh(error_m, known_m, max(USE_SHARE * way_m, 2.0 * known_m))


def combine(found: Sequence[Reason]) -> Verdict:
    """Return the verdict: unusable from a weight of `NO_USE`, or a sum of `MANY`; doubtful from 1 on."""
    heavy = sorted((reason for reason in found if reason.weight >= 1.0), key=lambda reason: -reason.weight)
    light = [reason for reason in found if reason.weight in (LIGHT, NAMING)]
    words = tuple(reason.words for reason in (*heavy, *light))
    if not heavy:
        return Verdict("trusted", tuple(reason.words for reason in light if reason.weight == LIGHT))
    spoiled = heavy[0].weight >= NO_USE or sum(min(reason.weight, NO_USE) for reason in heavy) >= MANY
    return Verdict(UNUSABLE if spoiled else "doubtful", words)


def judge_strides(count: int, duration_s: float) -> Reason:
    """Judge the number of strides in a time, s."""
    words = f"no walking: {format_count(count, 'stride')} in {duration_s:.0f} s"
    return Reason(weigh(1.0 / max(count, 1), *FEW_STRIDES), words)


def judge_beginning(walked: int, tested: int) -> Reason:
    """Judge the number of strides of a walk in progress, and of those whose axes were tested: too few are doubtful.

    From `SEEN_BY` strides on, untested axes are no objection: a sensor that never stands cannot show them.
    """
    known = walked if walked >= SEEN_BY else min(walked, tested)
    few = weigh(1.0 / max(known, 1), *FEW_STRIDES) >= 1.0
    return Reason(float(few), f"too little has been walked to know: {format_count(walked, 'stride')}")


def judge_speed(speed: float, t: float) -> Reason:
    """Judge the highest speed, m/s, at time t, s."""
    return Reason(weigh(speed, *SPEED_M_S), f"the foot reaches {speed:.0f} m/s, at {t:.1f} s")


def judge_stride(length: float, took_s: float, t: float, fast_m_s: float, sigma: float, way: float) -> Reason:
    """Judge a stride of `length` m in `took_s`, up to t, s: the excess over one at `FASTER` times `fast_m_s`."""
    excess = length - FASTER * fast_m_s * took_s
    words = f"a stride of {length:.1f} m, at {t:.1f} s, is {excess:.1f} m longer than others: it drifted, or slipped"
    return Reason(weigh_error(excess, sigma, way), words)


def judge_longest_stride(speed: Floats, t: Floats, sigma: float, way: float) -> Reason:
    """Judge the stride longest for its time, of strides at `speed` (K,) m/s between footfalls at t (K + 1,) s."""
    fast, took = float(np.quantile(speed, FAST_SHARE, method="lower")), np.maximum(np.diff(t), 1e-9)
    excess = (speed - fast) * took
    i = int(np.argmax(np.where(np.isnan(excess), np.inf, excess)))
    return judge_stride(float(speed[i] * took[i]), float(took[i]), float(t[i + 1]), fast, sigma, way)


def judge_height_rate(rate: float, t: float) -> Reason:
    """Judge the highest rate of the height, m/s, over `CLIMBED_S` up to time t, s."""
    words = f"it climbs or falls by {rate:.1f} m/s for {CLIMBED_S:.0f} s and more, up to {t:.1f} s"
    return Reason(weigh(rate, *HEIGHT_RATE_M_S), words)


def judge_position(covariance: Floats, way: float, in_pocket: bool = False) -> Reason:
    """Judge the covariance (2, 2) of the end, m^2, after a way, m."""
    region = SIGMAS_95 * float(np.sqrt(np.linalg.eigvalsh(covariance)[-1])) if np.isfinite(covariance).all() else np.inf
    words = f"the end is known to {region:.1f} m only (95 %), after {way:.0f} m"
    limit = USE_SHARE_IN_POCKET if in_pocket else USE_SHARE
    return Reason(UNSEEN if region <= limit * max(way, MIN_WAY_M) else NO_USE, words)


def judge_unfollowed(lost_s: float, usual_m_s: float, sigma: float, way: float, what: str) -> Reason:
    """Judge a time, s, of untracked motion at a usual speed, m/s; `what` happened, in words."""
    missing = lost_s * usual_m_s
    return Reason(weigh_error(missing, sigma, way), f"{what}, {missing:.0f} m at the usual speed")


def judge_gravity(gravity: float, reach: float, sigma: float, way: float) -> Reason:
    """Judge the strides' mean vertical force, m/s^2, as a scale error at `reach`, the farthest from the start, m."""
    words = f"gravity is {gravity:.2f} m/s^2 in the strides, not {GRAVITY_M_S2:.2f}: the accelerometer's scale or unit"
    return Reason(weigh_error(abs(gravity / GRAVITY_M_S2 - 1.0) * reach, sigma, way), words)


def judge_rate(sigma: float) -> Reason:
    """Judge a nominal sample rate by its sigma, a share of it; 0 where samples have stamps."""
    words = f"the sample rate is nominal, known to {100 * sigma:.2g} %, and the path to {200 * sigma:.2g} %"
    return Reason(LIGHT if sigma > 0.0 else UNSEEN, words)


def judge_filters(recording: Recording, stances: Stances) -> Reason:
    """Judge low-pass and high-pass filters in the sensor; return the heavier reason."""
    smoothing, passed = measure_smoothing(recording), measure_high_pass(recording, stances)
    smoothed = Reason(
        weigh(smoothing, *SMOOTHED) if np.isfinite(smoothing) else UNSEEN,
        "the samples are smoothed, or no walk: no heel strike is in them above 8 Hz; low-pass at 20 Hz or more",
    )
    high = Reason(weigh(passed.evidence, DECISIVE, 2 * DECISIVE), passed.problem)
    return max(smoothed, high, key=lambda reason: reason.weight)


def judge_bad_samples(recording: Recording) -> Reason:
    """Judge the share of bad samples."""
    bad = recording.provenance.bad_samples
    share = bad / (bad + len(recording))
    words = f"{100 * share:.1f} % of the samples were bad, and not used: the sensor or its connection is broken"
    return Reason(weigh(share, *BAD_SHARE), words)


def judge_axes(axes: AxesEvidence) -> Reason:
    """Judge the axes of the gyroscope by the evidence of the strides."""
    return Reason(weigh(axes.against, *AXES_ODDS), axes.problem)


def find_height_rate(t: Floats, height: Floats) -> tuple[float, float]:
    """Largest rate of height (K,) m at stamps t (K,) s over `CLIMBED_S` or just more, m/s, and its end, s."""
    since = np.searchsorted(t, t - CLIMBED_S, side="right") - 1
    known = since >= 0
    if not known.any():
        return 0.0, float(t[-1]) if len(t) else 0.0
    rate = np.abs(height[known] - height[since[known]]) / (t[known] - t[since[known]])
    worst = int(np.argmax(rate))
    return float(rate[worst]), float(t[known][worst])
