"""Steps of one thigh: the axis of its swing, flexion, and the steps in it. No mounting is assumed.

A walking thigh turns about one axis more than about all others, that from hip to hip. In the body

    left     the first principal axis of the slow rate, made level in the mean
    up       the mean direction of up while the leg swings
    forward  left x up

and flexion is the angle by which the knee is ahead of that mean,

    flexion = atan2(up_now . forward, up_now . up),     its rate = -rate . left,

up_now being the third row of nav_R_body. The gait distinguishes left from right: a leg swings forward off the ground in
less time than it is carried back on it, so the slow rate of flexion is skewed to flexing. Over both walks of real
thighs (`qmt_fullbody`) its skewness is 0.22, in 5 s of them 0 to 0.44; simulated legs have 0.21 to 0.25. Who walks
backward is taken to walk forward.

The leg that wears the sensor swings forward while its foot is in the air, and is carried back while it stands and the
other foot swings. So between two turning points of flexion lies one step, with either foot:

    opening   the angle between the directions of up, in the body, at the two turning points: by how much the legs are
              open at a footfall. Where a sensor slips about the thigh the difference of flexion is less, not this
    step      one opening, forward or back
    stride    one swing of the leg forward, and what follows until the next: two steps

A turning point is one after which flexion comes back by more than a hysteresis. An opening that is too small (shifting
from leg to leg, turning on the spot), too slow (sitting down), too far flexed (moving while seated) or alone is no
step. The first step out of standing and the last one into it are half a one, and counted as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import maximum_filter1d

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection.mount import remove_fast
from fg_nav.errors import EstimationError
from fg_nav.pocket.track import PocketTrack
from fg_nav.recording import Recording
from fg_nav.stances import find_runs

SWINGING_DEG_S = 60.0
"""A thigh that turns faster than this is on its way; one that stands or sits is not."""

LEAST_SHARE = 0.5
"""The principal axis has so much of the power of the rate (evenly spread: a third), or there is no swing in it."""

GAIT_HZ = 4.0
"""Front and back follow from what is slower than this: three a stride, and nothing of the footfalls."""

UPRIGHT_DEG = 45.0
"""A thigh farther off its mean is sitting down or getting up, which shows nothing of front and back."""

LEAST_SKEW = 0.1
"""A skewness below this does not distinguish forward from backward."""

HYSTERESIS_DEG = 12.0
"""A turning point is one after which flexion comes back by so much, deg. After a footfall in a tight turn a real thigh
(`qmt_fullbody`) gives way by 7 to 11 and goes on."""

LEAST_OPENING_DEG = 20.0
"""Less, deg, is no step: legs that turn on the spot open by some 16, and the first step out of standing by more."""

MOST_OPENING_DEG = 85.0
"""More, deg, is no step: a runner opens by up to 75."""

MOST_FLEXED_DEG = 50.0
"""The middle of a step is no farther from that of the walk, deg: seated it is at 60 to 80."""

SHORTEST_S = 0.12
"""A step takes longer, s, from a tenth of its opening to nine tenths: a runner's 0.2."""

LONGEST_S = 1.0
"""... and no longer than this, s: sitting down takes 1 or more."""

PAUSE_S = 0.6
"""Longer between two steps, s, is a pause."""

LEAST_STEPS = 3
"""Fewer steps in a row are not a walk: a kick, or a leg that is crossed."""

_LEVELS = np.arange(0.15, 0.9, 0.1)
"""Shares of an opening; between two of them a leg on its way does not pause."""


@dataclass(frozen=True)
class ThighSwing:
    """The thigh's swing.

    Attributes
    ----------
    left, up : (3,) unit vectors in the body, level to the left and up in the mean.
    up_now : (N, 3) direction of up in the body, slow.
    flexion : (N,) rad, positive with the knee ahead, slow.
    skewness : of the rate of flexion; forward is known where it is well above zero.
    slipped_deg : by how much the axis of one half of the swinging is turned about up from that of the other.
    """

    left: Floats
    up: Floats
    up_now: Floats
    flexion: Floats
    skewness: float
    slipped_deg: float

    @property
    def is_forward_known(self) -> bool:
        """Whether the gait distinguishes forward from backward."""
        return self.skewness > LEAST_SKEW


def estimate_swing(recording: Recording, track: PocketTrack) -> ThighSwing:
    """Find the axes of the thigh, and its flexion.

    Raises `EstimationError` if the sensor hardly turns, or about no axis in particular.
    """
    rate = remove_fast(recording.gyr - track.gyro_bias, recording.period_s)
    swinging = np.linalg.norm(rate, axis=1) > np.radians(SWINGING_DEG_S)
    if swinging.sum() * recording.period_s < 1.0:
        raise EstimationError(
            f"the sensor turns by {SWINGING_DEG_S:g} deg/s or more for {swinging.sum() * recording.period_s:.1f} s "
            "in all, so there is no walk in it: record some strides, with the sensor in a trouser pocket."
        )
    up_now = remove_fast(track.nav_R_body[:, 2], recording.period_s)
    up_now /= np.linalg.norm(up_now, axis=1, keepdims=True)
    up = _unit(up_now[swinging].mean(axis=0))
    left = find_level_axis(rate[swinging].T @ rate[swinging], up)
    flexion = compute_flexion(up_now, left, up)
    upright = spread_flags(swinging, recording.period_s) & (np.abs(flexion) < np.radians(UPRIGHT_DEG))
    skewness = _compute_skewness(-remove_fast(rate @ left, recording.period_s, GAIT_HZ)[upright])
    if skewness < 0:
        left, flexion = -left, -flexion
    return ThighSwing(left, up, up_now, flexion, abs(skewness), _measure_slip(rate[swinging], up))


def spread_flags(flags: Bools, period_s: float) -> Bools:
    """(N,) True within half a second of a flag: the turning back of a swing too."""
    return np.asarray(maximum_filter1d(flags, 2 * round(0.5 / period_s) + 1))


def compute_flexion(up_now: Floats, left: Floats, up: Floats) -> Floats:
    """Flexion (N,) rad of a thigh with these directions of up (N, 3), by its axes."""
    return np.asarray(np.unwrap(np.arctan2(up_now @ np.cross(left, up), up_now @ up)))


def find_level_axis(power: Floats, up: Floats) -> Floats:
    """Axis (3,) about which most of the rate is, made level; `power` (3, 3) is the sum of its squares.

    Raises `EstimationError` if it is about no level axis in particular.
    """
    share, axis = _find_principal_axis(power)
    axis = axis - (axis @ up) * up
    if share < LEAST_SHARE or np.linalg.norm(axis) < 0.5:
        raise EstimationError(
            "the sensor turns about no level axis in particular, as a thigh does in walking: "
            "is it in a trouser pocket, and held there?"
        )
    return _unit(axis)


def _find_principal_axis(power: Floats) -> tuple[float, Floats]:
    """Axis (3,) about which most of the rate is, and how much of its `power` (3, 3) that is."""
    powers, axes = np.linalg.eigh(power)
    return float(powers[2] / powers.sum()), axes[:, 2]


def _measure_slip(rate: Floats, up: Floats) -> float:
    """Angle between the axes of the first and the second half of the swinging."""
    halves = (rate[: len(rate) // 2], rate[len(rate) // 2 :])
    one, other = (_find_principal_axis(half.T @ half)[1] for half in halves)
    axes = [_unit(axis - (axis @ up) * up) for axis in (one, other)]
    return float(np.degrees(np.arccos(min(abs(float(axes[0] @ axes[1])), 1.0))))


def _compute_skewness(values: Floats) -> float:
    return float((values**3).mean() / (values**2).mean() ** 1.5) if values.any() else 0.0


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))


# steps in flexion


@dataclass(frozen=True)
class Steps:
    """Steps of a walk, in order.

    ========= ==== ================================================================================
    start     (S,) sample at which the step begins
    stop      (S,) sample at which it ends; the next one begins there or, after a pause, later
    opening   (S,) rad
    forward   (S,) True where the leg that wears the sensor swings
    bout      (S,) number of the walk without a pause that it belongs to, from 0
    ========= ==== ================================================================================
    """

    start: Ints
    stop: Ints
    opening: Floats
    forward: Bools
    bout: Ints

    def __len__(self) -> int:
        return len(self.start)

    @property
    def strides(self) -> Ints:
        """First step (K,) of each stride: a swing, or the first step of a bout where that is the other leg's."""
        begins = self.forward.copy()
        first = np.flatnonzero(np.diff(self.bout, prepend=-1))
        other = first[~self.forward[first]]
        begins[other] = True
        begins[other + 1] = False  # that swing goes with the step before it
        return np.flatnonzero(begins)


def find_steps(t: Floats, flexion: Floats, up: Floats) -> Steps:
    """Find the steps of a thigh; there may be none.

    Parameters
    ----------
    t : (N,) s.
    flexion : (N,) rad, positive with the knee ahead, and free of what is faster than 6 Hz.
    up : (N, 3) direction of up in the body, likewise.
    """
    # turning points, and each pause within an opening
    turn = split_at_pauses(t, flexion, find_turning_points(flexion, float(np.radians(HYSTERESIS_DEG))))
    start, stop = find_inner_spans(flexion, turn)
    # which openings are steps, and of which bout
    swept = np.diff(flexion[turn])
    took = t[stop] - t[start]
    together = t[start[1:]] - t[stop[:-1]] < PAUSE_S
    walked, bout = _number_bouts(are_step_like(flexion, turn, took), together)
    # steps that follow each other meet at the turning point
    start, stop = _join_steps(start, stop, turn, together)
    opening = 2.0 * np.arcsin(np.linalg.norm(np.diff(up[turn], axis=0), axis=1) / 2.0)
    return Steps(start[walked], stop[walked], opening[walked], swept[walked] > 0, bout[walked])


def find_turning_points(values: Floats, hysteresis: float) -> Ints:
    """Samples (M,) at which values (N,) turn, from high to low and back, by more than the hysteresis; ends included."""
    found, extreme, sense = [0], 0, 0  # since the last turning point the extreme, and whether up or down to it
    for corner in _find_corners(values):
        back = values[corner] - values[extreme]
        if sense != 0 and back * sense >= 0:
            extreme = corner
        elif abs(back) > hysteresis:
            if sense != 0:
                found.append(extreme)
            extreme, sense = corner, 1 if back > 0 else -1
    return np.array([*found, extreme] if sense != 0 else [], dtype=np.int64)


def _find_corners(values: Floats) -> list[int]:
    """Samples at which values (N,) stop rising or falling, and the last."""
    moving = np.flatnonzero(np.diff(values))
    rising = np.diff(values)[moving] > 0
    return [*moving[1:][rising[1:] != rising[:-1]].tolist(), len(values) - 1]


def split_at_pauses(t: Floats, flexion: Floats, turn: Ints) -> Ints:
    """Turning points, and one more in each opening with a pause: into standing, and on in the same direction."""
    parted = []
    for a, b in pairwise(turn.tolist()):
        if t[b] - t[a] > PAUSE_S:
            done = (flexion[a : b + 1] - flexion[a]) / (flexion[b] - flexion[a])
            reached = a + np.array([np.argmax(done >= level) for level in _LEVELS])
            longest = int(np.argmax(np.diff(t[reached])))
            if t[reached[longest + 1]] - t[reached[longest]] > PAUSE_S:
                parted.append((reached[longest] + reached[longest + 1]) // 2)
    return np.sort(np.append(turn, np.array(parted, dtype=np.int64)))


def find_inner_spans(flexion: Floats, turn: Ints) -> tuple[Ints, Ints]:
    """First and last sample (S,) of each opening that are a tenth of it away from its ends."""
    start, stop = np.zeros(max(len(turn) - 1, 0), dtype=np.int64), np.zeros(max(len(turn) - 1, 0), dtype=np.int64)
    for k, (a, b) in enumerate(pairwise(turn.tolist())):
        done = (flexion[a : b + 1] - flexion[a]) / (flexion[b] - flexion[a])
        middle = int(np.argmax(done > 0.5))
        start[k] = a + np.flatnonzero(done[: middle + 1] < 0.1)[-1]
        stop[k] = a + middle + np.argmax(done[middle:] > 0.9)
    return start, stop


def are_step_like(flexion: Floats, turn: Ints, took: Floats) -> Bools:
    """(S,) True where an opening is as large, as quick and as upright as that of a step."""
    swept, middle = np.degrees(np.abs(np.diff(flexion[turn]))), np.degrees(flexion[turn[1:]] + flexion[turn[:-1]]) / 2
    large = (swept > LEAST_OPENING_DEG) & (swept < MOST_OPENING_DEG)
    quick = (took > SHORTEST_S) & (took < LONGEST_S)
    return np.asarray(large & quick & (np.abs(middle) < MOST_FLEXED_DEG))


def _number_bouts(possible: Bools, together: Bools) -> tuple[Bools, Ints]:
    """(S,) which openings are steps of a walk, and the number of the walk of each."""
    walked, bout = np.zeros(len(possible), dtype=np.bool_), np.zeros(len(possible), dtype=np.int64)
    walks = [(first, last) for first, last in _find_bouts(possible, together) if last - first >= LEAST_STEPS]
    for number, (first, last) in enumerate(walks):
        walked[first:last], bout[first:last] = True, number
    return walked, bout


def _find_bouts(possible: Bools, together: Bools) -> list[tuple[int, int]]:
    """First, and after the last, of the openings that may be steps without a pause between."""
    found = []
    for first, last in zip(*find_runs(possible), strict=True):
        cuts = first + 1 + np.flatnonzero(~together[first : last - 1])
        ends = [int(first), *cuts.tolist(), int(last)]
        found += list(pairwise(ends))
    return found


def _join_steps(start: Ints, stop: Ints, turn: Ints, together: Bools) -> tuple[Ints, Ints]:
    """Let each step end at the turning point where the next begins, unless there is a pause between."""
    start, stop = start.copy(), stop.copy()
    start[1:] = np.where(together, turn[1:-1], start[1:])
    stop[:-1] = np.where(together, turn[1:-1], stop[:-1])
    return start, stop
