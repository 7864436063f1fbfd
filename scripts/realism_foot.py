"""Facts of a foot that walks, real or simulated, each a number of a walk: for `realism.py`.

Axes are the foot's, found in the recording itself: up as the force in stance, left as the principal axis of the rate.
A stride reaches from the stillest instant of one footfall to that of the next. A fact of a walk is the median over its
strides where nothing else is said. Motion capture knows the true velocity in stance: that of a day of walking, in the
Vicon trials, has facts of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import walks
from sample_errors import integrate

from fg_nav.arrays import Floats, Ints
from fg_nav.detection import detect_stances
from fg_nav.detection.rest import estimate_lever
from fg_nav.detection.stance import shoe
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.mechanisation import NavState
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.solution import Solution
from fg_nav.truth import TrajectoryTruth

STRIDE_S, MIN_M = (0.6, 1.8), 0.8  # What counts as a stride of walking.
STRAIGHT_DEG = 20.0  # Yaw rates are compared on strides that turn by less.
WITHIN_S = 0.06  # On either side of the stillest instant: short enough for a cubic to follow the rolling foot.
MID_STANCE_S = 0.10  # On either side of the stillest instant, where the velocity in stance is looked at.
VICON_DAY = "2017-11-22"  # Its trials are of walking; on the other days people also ran.
FEWEST = 8  # A trial with fewer strides shows none.

SHARP_HZ = 24.0

SHARES = np.linspace(0.0, 1.0, 201)  # Of a stride, for curves.

PEAK_SHARE = 0.35
"""Where curves are laid over each other: the foot is steepest, toe down, after a third of a stride from mid-stance."""

FACTS: Mapping[str, tuple[str, str]] = {
    "stride_s": ("stride time (s)", "{:.2f}"),
    "stride_m": ("stride length (m)", "{:.2f}"),
    "stride_cv": ("stride time, coefficient of variation", "{:.3f}"),
    "stance_share": ("share of detected stance", "{:.2f}"),
    "toe_down_deg": ("pitch after push-off (deg)", "{:.0f}"),
    "toe_up_deg": ("pitch at heel strike, upward (deg)", "{:.0f}"),
    "rise_cm": ("rise of the sensor (cm)", "{:.1f}"),
    "pitch_deg_s": ("peak rate, pitch (deg/s)", "{:.0f}"),
    "pitch_back_deg_s": ("the same, toe coming up", "{:.0f}"),
    "pitch_per_stride": ("peak rate, pitch, times stride time (deg)", "{:.0f}"),
    "roll_deg_s": ("peak rate, roll", "{:.0f}"),
    "yaw_deg_s": ("peak rate, yaw, going straight", "{:.0f}"),
    "pitch_cv": ("peak rate, pitch: coefficient of variation", "{:.2f}"),
    "roll_cv": ("peak rate, roll: the same", "{:.2f}"),
    "curve_scatter": ("curve of the pitch rate: rms about the median curve (deg/s)", "{:.0f}"),
    "force": ("peak specific force (m/s^2)", "{:.0f}"),
    "force_95": ("the same, 95 % of strides", "{:.0f}"),
    "jerk": ("change of the force, rms (m/s^3)", "{:.0f}"),
    "angular_jerk": ("change of the rate, rms (rad/s^2)", "{:.0f}"),
    "sharp_force": ("force at heel strike: share of power above 24 Hz", "{:.3f}"),
    "sharp_rate": ("rate at heel strike: the same", "{:.4f}"),
    "stance_rate_deg_s": ("rate in stance (deg/s)", "{:.1f}"),
    "still_rate_deg_s": ("rate at the stillest instant (deg/s)", "{:.1f}"),
    "stance_gyr_deg_s": ("gyroscope within 60 ms of it, about a cubic (deg/s)", "{:.2f}"),
    "stance_acc": ("accelerometer, the same (m/s^2)", "{:.3f}"),
    "stance_sharp": ("gyroscope, the same: correlation of neighbours", "{:.2f}"),
    "shoe": ("SHOE at the stillest instant (decades)", "{:.2f}"),
    "shoe_stance": ("SHOE in stance (decades)", "{:.2f}"),
    "stance_velocity": ("change of velocity within 0.1 s of mid-stance, rms (mm/s)", "{:.1f}"),
    "lever_cm": ("height of the sensor above the rolling point (cm)", "{:.1f}"),
    "swing_velocity": ("velocity left over by strapdown after a swing (mm/s)", "{:.0f}"),
}
"""Of each fact: what it is, and how it is written."""

TRUE_FACTS: Mapping[str, tuple[str, str]] = {
    "speed": ("true speed at the stillest instant (mm/s)", "{:.1f}"),
    "speed_rms": ("true speed within 0.1 s of it, rms (mm/s)", "{:.1f}"),
    "forward": ("true forward velocity there (mm/s)", "{:.1f}"),
    "sinking": ("true downward velocity there (mm/s)", "{:.1f}"),
    "captured_rate_deg_s": FACTS["still_rate_deg_s"],
}


@dataclass(frozen=True)
class Foot:
    """A walk in the axes of its foot: rate (N, 3) deg/s less bias, force (N, 3) m/s^2, strides (K, 2) as samples."""

    name: str
    recording: Recording
    solution: Solution
    rate: Floats
    force: Floats
    nav_R_foot: Floats
    still: Ints
    strides: Ints
    stance: Floats

    @property
    def period_s(self) -> float:
        """Of the samples, s."""
        return self.recording.period_s


def read_captured(data: Path) -> list[Foot]:
    """The trials whose true velocity is known, those that show strides."""
    trials = [
        measure_foot(w.name, w.read().recording) for w in walks.list_set(data, "vicon") if w.name.startswith(VICON_DAY)
    ]
    return [walk for walk in trials if len(walk.strides) >= FEWEST]


def measure_foot(name: str, recording: Recording) -> Foot:
    """Find stances, attitude, axes and strides."""
    stances = detect_stances(recording)
    solution = smooth(recording, stances)
    rate = recording.gyr - solution.stances.gyro_bias.mean(axis=0)
    foot_R_body = find_foot_axes(rate, recording.acc[stances.mask].mean(axis=0), solution)
    still = stances.stillest(recording.gyr)
    strides = [
        (i, j)
        for i, j in pairwise(still)
        if STRIDE_S[0] < recording.t[j] - recording.t[i] < STRIDE_S[1]
        and np.linalg.norm(solution.position[j] - solution.position[i]) > MIN_M
    ]
    return Foot(
        name=name,
        recording=recording,
        solution=solution,
        rate=np.rad2deg(rate @ foot_R_body.T),
        force=recording.acc @ foot_R_body.T,
        nav_R_foot=solution.nav_R_body @ foot_R_body.T,
        still=still,
        strides=np.array(strides),
        stance=stances.mask,
    )


def find_foot_axes(rate: Floats, stance_force: Floats, solution: Solution) -> Floats:
    """foot_R_body (3, 3): up as `stance_force` (3,), left as the principal axis of the rate (N, 3), forward ahead."""
    up = stance_force / np.linalg.norm(stance_force)
    principal = np.linalg.eigh(rate.T @ rate)[1][:, -1]
    left = principal - (principal @ up) * up
    left /= np.linalg.norm(left)
    ahead = np.einsum("nji,nj->i", solution.nav_R_body, solution.velocity)
    left *= np.sign(np.cross(left, up) @ ahead)
    return np.stack([np.cross(left, up), left, up])


def measure_inertial(walk: Foot) -> dict[str, float]:
    """All of `FACTS` for a walk: name -> value."""
    return measure_gait(walk) | measure_rates(walk) | measure_forces(walk) | measure_stances(walk)


def measure_gait(walk: Foot) -> dict[str, float]:
    """Times, lengths, angles."""
    first, last = walk.strides.T
    seconds = walk.recording.t[last] - walk.recording.t[first]
    pitch = np.rad2deg(np.arcsin(-walk.nav_R_foot[:, 2, 0]))
    height = walk.solution.position[:, 2]
    begun, ended = walk.still[[0, -1]]
    return {
        "stride_s": float(np.median(seconds)),
        "stride_m": float(np.median(np.linalg.norm(np.diff(walk.solution.position[walk.strides], axis=1), axis=2))),
        "stride_cv": float(seconds.std() / seconds.mean()),
        "stance_share": float(walk.stance[begun:ended].mean()),
        "toe_down_deg": _median_over_strides(walk, lambda i, j: np.max(pitch[i:j]) - pitch[i]),
        "toe_up_deg": _median_over_strides(walk, lambda i, j: pitch[i] - np.min(pitch[i:j])),
        "rise_cm": 100 * _median_over_strides(walk, lambda i, j: np.max(height[i:j]) - height[i]),
    }


def _median_over_strides(walk: Foot, fact: Callable[[int, int], float]) -> float:
    return float(np.median([fact(i, j) for i, j in walk.strides]))


def measure_rates(walk: Foot) -> dict[str, float]:
    """Peaks of the angular rate, and how they scatter."""
    roll, pitch, yaw = (np.array([pick[i:j] for i, j in walk.strides], dtype=object) for pick in walk.rate.T)
    peak = np.array([np.max(x) for x in pitch])
    rolling = np.array([np.max(np.abs(x)) for x in roll])
    straight = np.array([abs(x.sum()) * walk.period_s < STRAIGHT_DEG for x in yaw])
    seconds = np.diff(walk.recording.t[walk.strides], axis=1)[:, 0]
    curve = np.array([resample_stride(walk, walk.rate[:, 1], i, j) for i, j in walk.strides[straight]])
    return {
        "pitch_deg_s": float(np.median(peak)),
        "pitch_back_deg_s": float(np.median([-np.min(x) for x in pitch])),
        "pitch_per_stride": float(np.median(peak * seconds)),
        "roll_deg_s": float(np.median(rolling)),
        "yaw_deg_s": float(np.median([np.max(np.abs(x)) for x in yaw[straight]])),
        "pitch_cv": float(peak.std() / peak.mean()),
        "roll_cv": float(rolling.std() / rolling.mean()),
        "curve_scatter": float(np.sqrt(np.mean((curve - np.median(curve, axis=0)) ** 2))),
    }


def resample_stride(walk: Foot, values: Floats, begin: int, end: int) -> Floats:
    """Values at `SHARES` of a stride, moved so that the foot is steepest at `PEAK_SHARE`."""
    pitch = -walk.nav_R_foot[begin:end, 2, 0]
    steepest = begin + int(np.argmax(pitch))
    at = steepest + (SHARES - PEAK_SHARE) * (end - begin)
    return np.interp(at, np.arange(len(values)), values)


def measure_forces(walk: Foot) -> dict[str, float]:
    """Peaks of the specific force, and how sharp force and rate are."""
    strength = np.linalg.norm(walk.force, axis=1)
    peak = [np.max(strength[i:j]) for i, j in walk.strides]
    moving = np.concatenate([np.arange(i, j) for i, j in walk.strides])
    jerk, angular = (
        np.gradient(values, walk.period_s, axis=0)[moving] for values in (walk.force, np.deg2rad(walk.rate))
    )
    return {
        "force": float(np.median(peak)),
        "force_95": float(np.percentile(peak, 95)),
        "jerk": float(np.sqrt((jerk**2).sum(axis=1).mean())),
        "angular_jerk": float(np.sqrt((angular**2).sum(axis=1).mean())),
        "sharp_force": _measure_sharpness(walk, walk.force),
        "sharp_rate": _measure_sharpness(walk, walk.rate),
    }


def _measure_sharpness(walk: Foot, values: Floats) -> float:
    """Share of the power above `SHARP_HZ`, in 0.32 s about heel strike: where the pitch is least."""
    count = round(0.32 / walk.period_s)
    frequency = np.fft.rfftfreq(count, walk.period_s)
    power = np.zeros(len(frequency))
    for i, j in walk.strides:
        strike = i + int(np.argmin(-walk.nav_R_foot[i:j, 2, 0]))
        part = values[max(strike - count // 3, 0) :][:count]
        if len(part) == count:
            window = np.hanning(count)[:, None]
            power += (np.abs(np.fft.rfft((part - part.mean(axis=0)) * window, axis=0)) ** 2).sum(axis=1)
    return float(power[frequency > SHARP_HZ].sum() / power[1:].sum())


def measure_stances(walk: Foot) -> dict[str, float]:
    """How still the standing foot is: of the footfalls between strides."""
    still = walk.strides[1:, 0]
    size = np.linalg.norm(walk.rate, axis=1)
    walking = walk.stance.copy()
    walking[: walk.strides[0, 0]] = walking[walk.strides[-1, 1] :] = False
    window = round(0.05 / walk.period_s)
    level = np.log10(shoe(walk.recording.acc, walk.recording.gyr, window))
    gyr, acc = _subtract_cubic(walk, walk.rate, still), _subtract_cubic(walk, walk.force, still)
    return {
        "stance_rate_deg_s": float(np.median(size[walking])),
        "still_rate_deg_s": float(np.median(size[still])),
        "stance_gyr_deg_s": float(np.median(np.sqrt((gyr**2).mean(axis=(1, 2))))),
        "stance_acc": float(np.median(np.sqrt((acc**2).mean(axis=(1, 2))))),
        "stance_sharp": float((gyr[:, 1:] * gyr[:, :-1]).mean() / (gyr**2).mean()),
        "shoe": float(np.median(level[still])),
        "shoe_stance": float(np.median(level[walking])),
        "stance_velocity": float(np.median([_velocity_change(walk, i) for i in still])),
        "lever_cm": _lever_cm(walk),
        "swing_velocity": float(np.median([_integrate_swing(walk, i, j) for i, j in walk.strides])),
    }


def _subtract_cubic(walk: Foot, values: Floats, still: Ints) -> Floats:
    """What a cubic leaves of values (N, 3) about each instant: (K, M, 3)."""
    reach = round(WITHIN_S / walk.period_s)
    x = np.linspace(-1.0, 1.0, 2 * reach + 1)
    cubic, _ = np.linalg.qr(np.vander(x, 4))
    parts = np.array([values[i - reach : i + reach + 1] for i in still])
    return np.asarray(parts - np.einsum("mp,np,kni->kmi", cubic, cubic, parts))


def _velocity_change(walk: Foot, still: int) -> float:
    """Rms over mid-stance of the velocity against that at the stillest instant, mm/s, from the force alone."""
    reach = round(MID_STANCE_S / walk.period_s)
    near = slice(still - reach, still + reach + 1)
    force = np.einsum("nij,nj->ni", walk.nav_R_foot[near], walk.force[near]) - [0.0, 0.0, GRAVITY_M_S2]
    velocity = np.cumsum(force, axis=0) * walk.period_s
    return float(1e3 * np.sqrt(((velocity - velocity[reach]) ** 2).sum(axis=1).mean()))


def _lever_cm(walk: Foot) -> float:
    stances = detect_stances(walk.recording)
    body_up = np.einsum(
        "nij,ni->j", walk.solution.nav_R_body[walk.still], np.tile([0.0, 0.0, 1.0], (len(walk.still), 1))
    )
    return float(100 * estimate_lever(walk.recording, stances).lever @ body_up / np.linalg.norm(body_up))


def _integrate_swing(walk: Foot, begin: int, end: int) -> float:
    """Velocity at the end of a stride that began at rest, mm/s, by strapdown from the smoother's attitude."""
    recording, bias = walk.recording, walk.solution.stances.gyro_bias.mean(axis=0)
    attitude = walk.solution.nav_R_body[begin].copy()
    state = NavState(np.zeros(3), np.zeros(3), attitude, bias, np.zeros(3))
    integrate(state, recording.acc[begin:end], recording.gyr[begin:end], walk.period_s)
    return float(1e3 * np.linalg.norm(state.velocity))


def measure_true(walk: Foot) -> dict[str, float]:
    """`TRUE_FACTS` of a walk whose truth is known at every sample."""
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    t = walk.recording.t
    place = np.stack([np.interp(t, truth.t, axis) for axis in truth.position.T], axis=1)
    velocity = _smooth_slope(place, walk.period_s)
    reach = round(MID_STANCE_S / walk.period_s)
    still = walk.strides[1:, 0]
    speed = np.linalg.norm(velocity, axis=1)
    way = np.array([place[j] - place[i] for i, j in walk.strides[1:]])[:, :2]
    ahead = way / np.linalg.norm(way, axis=1)[:, None]
    return {
        "speed": float(1e3 * np.median(speed[still])),
        "speed_rms": float(1e3 * np.median([np.sqrt(np.mean(speed[i - reach : i + reach] ** 2)) for i in still])),
        "forward": float(1e3 * np.median((velocity[still, :2] * ahead).sum(axis=1))),
        "sinking": float(-1e3 * np.median(velocity[still, 2])),
        "captured_rate_deg_s": float(np.median(np.linalg.norm(walk.rate[still], axis=1))),
    }


def _smooth_slope(place: Floats, period_s: float, reach: int = 4) -> Floats:
    """Velocity (N, 3) as the slope of a line through 2 reach + 1 positions: motion capture trembles by 0.1 mm."""
    offsets = np.arange(-reach, reach + 1)
    kernel = offsets[::-1] / (period_s * (offsets**2).sum())
    return np.stack([np.convolve(axis, kernel, mode="same") for axis in place.T], axis=1)
