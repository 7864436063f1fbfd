"""Steps of one thigh: the axis of its swing, flexion, and the steps in it. No mounting is assumed.

A walking thigh turns about the axis from hip to hip more than about any other level axis; about up a sensor in a loose
pocket turns as much and more, which is left out. In the body

    up       the mean direction of up while the leg swings
    left     the principal axis of the level part of the slow rate, and what follows from the force (below)
    forward  left x up

and flexion, the angle by which the knee is ahead of that mean, is

    flexion = atan2(up_now . forward, up_now . up),     its rate = -rate . left,

up_now being the third row of nav_R_body. The gait distinguishes left from right: a leg swings forward off the ground in
less time than it is carried back on it, so the slow rate of flexion is skewed to flexing: by 0.22 on real thighs
(`qmt_fullbody`), in 5 s of them by 0 to 0.44. Who walks backward is taken to walk forward.

Sway. A walker is an inverted pendulum, slowest where he is highest: at the frequency of the steps

    a_forward = -k dh/dt,       h the height of the body, k > 0,

so the level force that goes with -dh/dt points forward, whatever the thigh does. It is the only direction of a sensor
that does not swing, at the hip or in a coat. Running has a flight phase, and the opposite phase: such samples
are left out.

The level force at the frequency of the swing lies in its plane as well. On 24 real thighs (`feet_thighs`) the direction
by the rate points inward of the force's, on either leg, by 3 to 18 deg, so the mean of both is taken, each weighted by
how much of its power is along one axis. While it is walked the axis is that of the rate alone.

The leg that wears the sensor swings forward while its foot is in the air, and is carried back while it stands and the
other foot swings. So between two turning points of flexion lies one step, with either foot:

    opening   the angle between the directions of up, in the body, at the two turning points: by how much the legs are
              open at a footfall. Where a sensor slips about the thigh the difference of flexion is less, not this
    step      one opening, forward or back
    stride    one swing of the leg forward, and what follows until the next: two steps

A turning point is one after which flexion comes back by more than a hysteresis. An opening that is too small (shifting
from leg to leg, turning on the spot), too slow (sitting down), too far flexed (moving while seated) or alone is no
step. The first step out of standing and the last one into it are half a one, and counted as they are.

A pocket that does not swing, at the hip or of a coat, shows no opening. There a step is one bounce of the body, from
one peak of the vertical force to the next, and its opening is not known.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

from fg_nav.arrays import Bools, Floats, Ints, find_runs
from fg_nav.detection.mount import remove_fast
from fg_nav.errors import EstimationError
from fg_nav.pocket.track import PocketTrack
from fg_nav.recording import Recording

# the axis of the swing
SWINGING_DEG_S = 60.0  # A thigh that turns faster than this is on its way; one that stands or sits is not.
MIN_SWING_S = 1.0  # Swinging in all, s, before which there are no axes
MIN_SHARE = 0.6  # of the level rate's power about its principal axis (evenly spread: half), else it shows no axis
MIN_SWAY = 0.3  # correlation of the level force with -dh/dt, else it shows no direction: chance in ten strides is 0.2
THIGH_DEG = 7.0  # rms of a swing by the least opening of a step, 20 deg
SWING_HZ = 0.5, 1.3  # frequencies of strides, from a stroll to a quick walk
STEP_HZ = 1.2, 3.5  # frequencies of steps, from a stroll to a run
MIN_FORCE_M_S2 = 3.0  # slow vertical force: a third of gravity, and less is the flight of a run
GAIT_HZ = 4.0  # Front and back follow from what is slower than this: three a stride, and nothing of the footfalls.
UPRIGHT_DEG = 45.0  # A thigh farther off its mean is sitting down or getting up, which shows nothing of front and back.
MIN_SKEW = 0.1  # a skewness below this does not distinguish forward from backward
HYSTERESIS = np.radians(12.0)  # Flexion comes back by so much after a turn, rad; a thigh gives way by 7 to 11 deg.
MIN_OPENING_DEG = 20.0  # Less is no step: legs that turn on the spot open by 16, the first step of a walk by more.
MAX_OPENING_DEG = 85.0  # More, deg, is no step: a runner opens by up to 75.
MAX_FLEXED_DEG = 50.0  # The middle of a step is no farther from that of the walk, deg: seated it is at 60 to 80.
MIN_S = 0.12  # A step takes longer, s, from a tenth of its opening to nine tenths: a runner's 0.2.
MAX_S = 1.0  # ... and no longer than this, s: sitting down takes 1 or more.
PAUSE_S = 0.6  # Longer between two steps, s, is a pause.
MIN_STEPS = 3  # Fewer steps in a row are not a walk: a kick, or a leg that is crossed.
BOUNCE_M_S2 = 1.0  # hysteresis of the vertical force: the bounce of a slow walker is 1.5 to either side
BOUNCE_S = 0.28, 1.0  # duration of a step by its bounce, from a run to a stroll
MIN_BOUNCES = 6  # in a row: nothing else shows that it is a walk
_LEVELS = np.arange(0.15, 0.9, 0.1)  # Shares of an opening; between two of them a leg on its way does not pause.


class SwingSums:
    """Sums over the swing, of all of a recording or of a walk so far, from which the axes of the thigh follow."""

    def __init__(self) -> None:
        self._up, self._power, self.swinging_s = np.zeros(3), np.zeros((3, 3)), 0.0
        self._count, self._square, self._cube = 0, np.zeros((3, 3)), np.zeros((3, 3, 3))
        self._left: Floats | None = None

    def add_swing(self, rate: Floats, up: Floats, period_s: float) -> None:
        """Add low-passed rates (n, 3) rad/s and unit vectors up (n, 3), in the body, while the leg swings."""
        self.swinging_s += len(rate) * period_s
        self._power += rate.T @ rate
        self._up += up.sum(axis=0)

    def update_skewness(self, rate: Floats, left: Floats) -> float:
        """Add rates (n, 3) rad/s below `GAIT_HZ` of an upright leg; return the skewness of all about `left` (3,).

        The sign gives the front: a leg swings faster forward than back. 0 without any rotation.
        """
        self._count += len(rate)
        self._square += rate.T @ rate
        self._cube += np.einsum("ni,nj,nk->ijk", rate, rate, rate)
        square = float(left @ self._square @ left)
        if square == 0.0:
            return 0.0
        cube = -float(np.einsum("ijk,i,j,k->", self._cube, left, left, left))
        return float(cube / self._count / (square / self._count) ** 1.5)

    def find_axis(self) -> tuple[float, Floats, Floats]:
        """Share of the level rate's power about its principal axis, that axis, and up, unit vectors (3,) in body."""
        up = _unit(self._up)
        return *find_level_axis(self._power, up), up

    @property
    def axes(self) -> tuple[Floats, Floats] | None:
        """Level axis of the swing, its sign arbitrary but constant, and up, unit vectors (3,) in body; None at first.

        Once the swing no longer has a dominant axis, the last one is kept.
        """
        if self.swinging_s < MIN_SWING_S:
            return None
        share, left, up = self.find_axis()
        if share < MIN_SHARE:
            return None if self._left is None else (self._left, up)
        self._left = left if self._left is None or left @ self._left > 0 else -left
        return self._left, up


@dataclass(frozen=True)
class ThighSwing:
    """The thigh's swing."""

    left: Floats  # (3,) unit vector in the body, level to the left.
    up: Floats  # (3,) unit vector in the body, up in the mean.
    up_now: Floats  # (N, 3) direction of up in the body, slow.
    flexion: Floats  # (N,) rad, positive with the knee ahead, slow.
    forward_evidence: float  # Of front against back, by the skew of flexion's rate and the sway; known from 1 on.
    slipped_deg: float  # By how much the axis of one half of the swinging is turned about up from that of the other.

    @property
    def is_forward_known(self) -> bool:
        """Whether the gait distinguishes forward from backward."""
        return self.forward_evidence > 1.0


def estimate_swing(recording: Recording, track: PocketTrack, with_force: bool = True) -> ThighSwing:
    """Find left and up of the thigh in the body, and its flexion; without the force by the rate alone, as online.

    Raises `EstimationError` if the sensor hardly turns, or neither its rate nor its force shows a level axis.
    """
    period_s, sums = recording.period_s, SwingSums()
    rate = remove_fast(recording.gyr - track.gyro_bias, period_s)
    swinging = np.linalg.norm(rate, axis=1) > np.radians(SWINGING_DEG_S)
    up_now = remove_fast(track.nav_R_body[:, 2], period_s)
    up_now /= np.linalg.norm(up_now, axis=1, keepdims=True)
    sums.add_swing(rate[swinging], up_now[swinging], period_s)
    if sums.swinging_s < MIN_SWING_S:
        raise EstimationError(
            f"the sensor turns by {SWINGING_DEG_S:g} deg/s or more for {sums.swinging_s:.1f} s "
            "in all, so there is no walk in it: record some strides, with the sensor in a trouser pocket."
        )
    # axis of the rate; front and back by the skewness of flexion's rate
    share, left, up = sums.find_axis()
    near = spread_flags(swinging, period_s)
    flexion = compute_flexion(up_now, left, up)
    upright = near & (np.abs(flexion) < np.radians(UPRIGHT_DEG))
    skewness = sums.update_skewness(remove_fast(rate, period_s, GAIT_HZ)[upright], left)
    forward, evidence = np.cross(left, up), skewness / MIN_SKEW
    # directions of the force
    surely = 0.0
    if with_force:
        level, vertical = _level_force(recording, track)
        sway, surely = measure_sway(level, vertical, near, period_s)
    if share < MIN_SHARE and surely < MIN_SWAY:
        raise EstimationError(
            "neither the rate nor the force of the sensor shows a level axis, as those of a walker do: "
            "is it in a trouser pocket, and held there?"
        )
    if with_force:
        # of a thigh, by the probability that the sensor swings as one: the mean of the axes of rate and force
        swing_deg = float(np.degrees(np.std(_select(flexion, SWING_HZ, period_s)[upright]))) if upright.any() else 0.0
        thigh = 1.0 / (1.0 + (THIGH_DEG / max(swing_deg, 1e-3)) ** 8)
        swung = _select(level, SWING_HZ, period_s)[near]
        in_plane, plane = find_level_axis(swung.T @ swung, up)
        plane = plane * (1.0 if plane @ forward >= 0 else -1.0)
        weight = thigh * np.array([(2.0 * share - 1.0) ** 2, (2.0 * in_plane - 1.0) ** 2])
        mean = weight @ np.array([forward, plane])
        # front and back by the skewness, and by the sway
        strength = float(np.linalg.norm(sway))
        evidence += surely / MIN_SWAY * float(_unit(forward) @ sway) / max(strength, 1e-9)
        sign = 1.0 if evidence >= 0 else -1.0
        # of a sensor that does not swing: the sway
        forward = _unit(sign * mean + (1.0 - thigh) * strength * (sway - (sway @ up) * up))
        evidence = max(abs(evidence), surely / MIN_SWAY)
    sign = 1.0 if evidence >= 0 else -1.0
    left = np.cross(up, sign * forward)
    # slip of the axis from one half of the swinging to the other
    swings = rate[swinging]
    halves = (swings[: len(swings) // 2], swings[len(swings) // 2 :])
    one, other = (find_level_axis(half.T @ half, up)[1] for half in halves)
    slipped_deg = float(np.degrees(np.arccos(min(abs(float(one @ other)), 1.0))))
    return ThighSwing(left, up, up_now, compute_flexion(up_now, left, up), abs(evidence), slipped_deg)


def _level_force(recording: Recording, track: PocketTrack) -> tuple[Floats, Floats]:
    """Level force (N, 3) m/s^2 in the body, and the vertical one (N,)."""
    acc, up = np.nan_to_num(recording.acc), track.nav_R_body[:, 2]
    vertical = (acc * up).sum(axis=1)
    return acc - vertical[:, None] * up, vertical


def measure_sway(level: Floats, vertical: Floats, moving: Bools, period_s: float) -> tuple[Floats, float]:
    """Axis (3,) in the body of the level force coherent with the vertical one, and the evidence that it points forward.

    The axis has the coherence for length. Forward, the `level` force (N, 3) m/s^2 correlates with -dh/dt, the integral
    of the `vertical` one (N,). `moving` (N,) flags the samples to use; those in the flight of a run are left out.
    """
    used = moving & ~spread_flags(remove_fast(vertical, period_s) < MIN_FORCE_M_S2, period_s)
    level = _select(level, STEP_HZ, period_s)[used]
    bounce = _select(vertical, STEP_HZ, period_s)
    falling = -_select(np.cumsum(bounce) * period_s, STEP_HZ, period_s)
    with np.errstate(invalid="ignore"):
        parts = [x[used] @ level / np.sqrt((x[used] ** 2).sum() * (level**2).sum()) for x in (bounce, falling)]
    in_phase, ahead = np.nan_to_num(parts)
    powers, axes = np.linalg.eigh(np.outer(in_phase, in_phase) + np.outer(ahead, ahead))
    axis = axes[:, 2] if axes[:, 2] @ ahead >= 0 else -axes[:, 2]
    return np.asarray(np.sqrt(max(powers[2], 0.0)) * axis), float(axis @ ahead)


def _select(values: Floats, band_hz: tuple[float, float], period_s: float) -> Floats:
    """Values (N, ...) within a band of frequencies."""
    slow, fast = band_hz
    return np.asarray(remove_fast(values, period_s, fast) - remove_fast(values, period_s, slow))


def spread_flags(flags: Bools, period_s: float) -> Bools:
    """(N,) True within half a second of a flag: the turning back of a swing too."""
    return np.asarray(maximum_filter1d(flags, 2 * round(0.5 / period_s) + 1))


def compute_flexion(up_now: Floats, left: Floats, up: Floats) -> Floats:
    """Flexion (N,) rad of a thigh with these directions of up (N, 3), by its axes."""
    return np.asarray(np.unwrap(np.arctan2(up_now @ np.cross(left, up), up_now @ up)))


def find_level_axis(power: Floats, up: Floats) -> tuple[float, Floats]:
    """Level axis (3,) about which most of the rate is, and its share; `power` (3, 3) is the sum of its squares."""
    level = np.eye(3) - np.outer(up, up)
    powers, axes = np.linalg.eigh(level @ power @ level)
    return float(powers[2] / max(powers[1] + powers[2], 1e-300)), axes[:, 2]


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))


# steps in flexion


@dataclass(frozen=True)
class Steps:
    """S steps of a walk, in order."""

    start: Ints  # (S,) sample at which the step begins.
    stop: Ints  # (S,) sample at which it ends; the next one begins there or, after a pause, later.
    opening: Floats  # (S,) rad; NaN where the sensor does not swing.
    took: Floats  # (S,) s, half of the stride about it.
    forward: Bools  # (S,) True where the leg that wears the sensor swings.
    bout: Ints  # (S,) number of the walk without a pause that it belongs to, from 0.

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


class Openings(NamedTuple):
    """P openings of a leg, in order."""

    sample: Ints  # (P, 4): the turning point before, both ends of the inner 80 % of flexion, the turning point after.
    t: Floats  # (P, 4) s, of these.
    opening: Floats  # (P,) rad, by the directions of up.
    swept: Floats  # (P,) rad, by flexion, signed.
    is_step_like: Bools  # (P,).


def find_steps(t: Floats, flexion: Floats, up: Floats) -> Steps:
    """Find the steps of a thigh, if any, by flexion (N,) rad, knee ahead, and up (N, 3) in body, both below 6 Hz."""
    return join_openings(measure_openings(t, flexion, up, find_turning_points(flexion, HYSTERESIS)))[0]


def measure_openings(t: Floats, flexion: Floats, up: Floats, turn: Ints) -> Openings:
    """Return the openings between turning points (M,), split at each pause; other arguments as of `find_steps`."""
    # one more turning point in each opening with a pause: a step into standing, and one out of it
    parted = []
    for a, b in pairwise(turn.tolist()):
        if t[b] - t[a] > PAUSE_S:
            done = (flexion[a : b + 1] - flexion[a]) / (flexion[b] - flexion[a])
            reached = a + np.array([np.argmax(done >= level) for level in _LEVELS])
            longest = int(np.argmax(np.diff(t[reached])))
            if t[reached[longest + 1]] - t[reached[longest]] > PAUSE_S:
                parted.append((reached[longest] + reached[longest + 1]) // 2)
    turn = np.sort(np.append(turn, np.array(parted, dtype=np.int64)))
    start, stop = find_inner_spans(flexion, turn)
    sample = np.stack([turn[:-1], start, stop, turn[1:]], axis=1)
    opening = 2.0 * np.arcsin(np.linalg.norm(np.diff(up[turn], axis=0), axis=1) / 2.0)
    # those as large, as quick and as upright as of a step
    swept, took = np.diff(flexion[turn]), t[stop] - t[start]
    size_deg, middle_deg = np.degrees(np.abs(swept)), np.degrees(flexion[turn[1:]] + flexion[turn[:-1]]) / 2
    large = (size_deg > MIN_OPENING_DEG) & (size_deg < MAX_OPENING_DEG)
    quick = (took > MIN_S) & (took < MAX_S)
    is_step_like = large & quick & (np.abs(middle_deg) < MAX_FLEXED_DEG)
    return Openings(sample, t[sample], opening, swept, is_step_like)


def find_ends(openings: Openings, is_open: bool) -> tuple[Bools, Ints, Ints]:
    """Return which openings (P - 1,) the next one follows without a pause, and the columns (P,) of both ends of each.

    Steps that follow each other meet at the turning point; `is_open`: the last one may still be followed.
    """
    sample, t = openings.sample, openings.t
    together = (sample[1:, 0] == sample[:-1, 3]) & (t[1:, 1] - t[:-1, 2] < PAUSE_S)
    begin, end = np.where(np.append(False, together), 0, 1), np.where(np.append(together, is_open), 3, 2)
    return together, begin[: len(t)], end[: len(t)]


def join_openings(openings: Openings, is_open: bool = False) -> tuple[Steps, Ints]:
    """Return the steps among openings, and the opening (S,) of each."""
    together, begin, end = find_ends(openings, is_open)
    # bouts of openings that may be steps, without a pause between
    bouts = []
    for first, last in zip(*find_runs(openings.is_step_like), strict=True):
        cuts = first + 1 + np.flatnonzero(~together[first : last - 1])
        bouts += [(a, b) for a, b in pairwise([first, *cuts, last]) if b - a >= MIN_STEPS]
    walked = np.concatenate([np.arange(0), *(np.arange(a, b) for a, b in bouts)]).astype(np.int64)
    bout = np.repeat(np.arange(len(bouts)), [b - a for a, b in bouts]).astype(np.int64)
    # the steps
    begin, end = begin[walked], end[walked]
    took = average_durations(openings.t[walked, end] - openings.t[walked, begin], bout)
    start, stop = openings.sample[walked, begin], openings.sample[walked, end]
    return Steps(start, stop, openings.opening[walked], took, openings.swept[walked] > 0, bout), walked


def find_bounces(t: Floats, vertical: Floats, moving: Bools) -> Steps:
    """Find steps by the bounce in the `vertical` force (N,) m/s^2, for a sensor that need not swing; possibly none.

    `moving` (N,) flags the samples in which steps may be.
    """
    period_s = float(np.median(np.diff(t)))
    slow = remove_fast(vertical, period_s, STEP_HZ[1])
    turn = find_turning_points(slow, BOUNCE_M_S2)
    peak = turn[1:-1][slow[turn[1:-1]] > slow[turn[:-2]]]
    took = np.diff(t[peak])
    possible = (took > BOUNCE_S[0]) & (took < BOUNCE_S[1]) & moving[peak[:-1]] & moving[peak[1:]]
    bouts = [(a, b) for a, b in zip(*find_runs(possible), strict=True) if b - a >= MIN_BOUNCES]
    step = np.concatenate([np.arange(0), *(np.arange(a, b) for a, b in bouts)]).astype(np.int64)
    count = np.array([b - a for a, b in bouts], dtype=np.int64)
    bout = np.repeat(np.arange(len(bouts)), count)
    number = step - np.repeat([a for a, _ in bouts], count)
    unknown = np.full(len(step), np.nan)
    return Steps(peak[step], peak[step + 1], unknown, average_durations(took[step], bout), number % 2 == 0, bout)


def find_all_steps(recording: Recording, track: PocketTrack, swing: ThighSwing) -> Steps:
    """Find the steps by the swing of the thigh and, outside its bouts, by the bounce of the body; in order of time."""
    t, period_s = recording.t, recording.period_s
    of_swing = find_steps(t, swing.flexion, swing.up_now)
    rate = np.linalg.norm(remove_fast(recording.gyr - track.gyro_bias, period_s), axis=1)
    moving = spread_flags(rate > np.radians(SWINGING_DEG_S), period_s)
    for a, b in zip(of_swing.start, of_swing.stop, strict=True):
        moving[a:b] = False
    of_bounce = find_bounces(t, _level_force(recording, track)[1], moving)
    # both in order, each bout with a number of its own
    bout = np.append(of_swing.bout, of_bounce.bout + len(of_swing))
    order = np.argsort(np.append(of_swing.start, of_bounce.start), kind="stable")
    joined = {
        name: np.append(getattr(of_swing, name), getattr(of_bounce, name))[order]
        for name in ("start", "stop", "opening", "took", "forward")
    }
    return Steps(**joined, bout=np.cumsum(np.diff(bout[order], prepend=bout[order][:1]) != 0))


def average_durations(took: Floats, bout: Ints) -> Floats:
    """Durations (S,) s smoothed over neighbours in the bout: the two legs alternate, so asymmetry cancels."""
    total, weight = 2.0 * took, np.full(len(took), 2.0)
    same = np.diff(bout) == 0
    total[1:][same] += took[:-1][same]
    total[:-1][same] += took[1:][same]
    weight[1:][same] += 1.0
    weight[:-1][same] += 1.0
    return np.asarray(total / weight)


def find_turning_points(values: Floats, hysteresis: float) -> Ints:
    """Samples (M,) of alternating maxima and minima of values (N,) more than `hysteresis` apart; both ends included."""
    found, extreme, sense = [0], 0, 0  # since the last turning point the extreme, and whether up or down to it
    # corners: where values stop rising or falling, and the last
    moving = np.flatnonzero(np.diff(values))
    rising = np.diff(values)[moving] > 0
    for corner in [*moving[1:][rising[1:] != rising[:-1]].tolist(), len(values) - 1]:
        back = values[corner] - values[extreme]
        if sense != 0 and back * sense >= 0:
            extreme = corner
        elif abs(back) > hysteresis:
            if sense != 0:
                found.append(extreme)
            extreme, sense = corner, 1 if back > 0 else -1
    return np.array([*found, extreme] if sense != 0 else [], dtype=np.int64)


def find_inner_spans(flexion: Floats, turn: Ints) -> tuple[Ints, Ints]:
    """First and last sample (S,) of the inner 80 % of the flexion of each opening: without the slow ends."""
    start, stop = np.zeros(max(len(turn) - 1, 0), dtype=np.int64), np.zeros(max(len(turn) - 1, 0), dtype=np.int64)
    for k, (a, b) in enumerate(pairwise(turn.tolist())):
        done = (flexion[a : b + 1] - flexion[a]) / (flexion[b] - flexion[a])
        middle = int(np.argmax(done > 0.5))
        start[k] = a + np.flatnonzero(done[: middle + 1] < 0.1)[-1]
        stop[k] = a + middle + np.argmax(done[middle:] > 0.9)
    return start, stop
