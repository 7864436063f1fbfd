"""The field at each footfall, the input of every detector and every calibration from a walk; heading and inclination.

At the stillest sample of a footfall the samples around it, within its stance and `HALF_WINDOW_S`, are rotated by the
gyroscope into the body frame of that sample and averaged: field and specific force. A magnetometer slower than the rest
leaves NaN rows; only measured ones count.

The attitude is given, or that of the gyroscope, levelled in the stances: tilt good to a degree, heading drifting.

    start        level in the first stance; the gyro bias is that of the longest rest, or zero
    each sample  R <- R Exp((w - b) h); in stance, nudge the tilt towards the specific force

A live estimator gives its attitude of the time instead.

Magnetic heading and inclination are of the field in levelled axes, `level_field`: x along the body's x axis over the
ground, y to its left, z up (the sensor laid level without being turned).
With H the horizontal strength and psi the heading, north lies psi to the left of x:

    level_field = (H cos psi, H sin psi, -H tan I),    psi = atan2(y, x),    I = atan2(-z, H).

These are Ma (1)-(5) and AIEZ (19)-(25), in axes of their own (docs/equations.md).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from fg_nav.arrays import Bools, Brief, Floats, Ints
from fg_nav.detection.rest import find_longest, find_start
from fg_nav.detection.stance import Stances
from fg_nav.errors import MagneticError
from fg_nav.frames import average_angles, compute_heading, wrap_angle
from fg_nav.mechanisation import nudge_tilt, rotate_in_body
from fg_nav.recording import Recording
from fg_nav.system.compiled import njit


def compute_level_R_body(body_up: Floats) -> Floats:
    """Rotation level_R_body (..., 3, 3): x is the body's x axis made level, z up; `body_up` (..., 3) in the body frame.

    The body's x axis must not be vertical: over the ground it then has no direction.
    """
    up = body_up / np.linalg.norm(body_up, axis=-1, keepdims=True)
    forward = np.array([1.0, 0.0, 0.0]) - up[..., :1] * up
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    return np.stack([forward, np.cross(up, forward), up], axis=-2)


def rotate_to_level(body_field: Floats, body_up: Floats) -> Floats:
    """Field (..., 3) uT in levelled axes: Ma (3), (5), AIEZ (23), (24)."""
    return np.asarray(np.einsum("...ij,...j->...i", compute_level_R_body(body_up), body_field))


def compute_field_heading(level_field: Floats) -> Floats:
    """Magnetic heading (...,) rad of the body's x axis, clockwise from magnetic north: Ma (1), AIEZ (25)."""
    return np.asarray(np.arctan2(level_field[..., 1], level_field[..., 0]))


def compute_true_heading(magnetic_heading: Floats, declination: float) -> Floats:
    """Heading (...,) rad clockwise from true north, from that of the compass; `declination` rad, east positive."""
    return wrap_angle(magnetic_heading + declination)


def compute_inclination(up_field: Floats) -> Floats:
    """Inclination (...,) rad of a field (..., 3) in any axes whose third is up: Ma (2)."""
    return np.asarray(np.arctan2(-up_field[..., 2], np.linalg.norm(up_field[..., :2], axis=-1)))


HALF_WINDOW_S = 0.5  # About the stillest instant of a stance: later in a long one the foot may stand elsewhere.
TILT_TIME_S = 0.5  # Time constant of levelling in stance; 0.25 to 2 s differ by 0.1 deg on simulated walks.
MAX_FOOTFALLS = 1 << 12  # Averaged at once: an hour of walking.
UNKNOWN_IRON_UT = np.full(3, 30.0)  # Uncalibrated iron of shoe, battery and board, one sigma; real feet: 1 to 90 uT.
MIN_SAMPLES = 2  # Of the field at a footfall: scatter and drift need two.


@dataclass(frozen=True)
class FootfallField(Brief):
    """The field at F footfalls, at the stillest sample of each."""

    sample: Ints  # (F,) index into the recording.
    t: Floats  # (F,) s.
    body_field: Floats  # (F, 3) uT, mean over the stance in the body frame of `sample`; NaN where there was no field.
    body_force: Floats  # (F, 3) m/s^2, mean specific force there: up by the accelerometer alone.
    nav_R_body: Floats  # (F, 3, 3) inertial attitude at `sample`; tilt good to a degree, heading drifting.
    count: Ints  # (F,) samples of the field that were averaged.
    scatter_uT: Floats  # (F,) their standard deviation about the mean, per axis.
    strength_rate: Floats  # (F,) uT/s, slope of the strength within the stance: a straight line through them.
    strength_rate_sigma: Floats  # (F,) uT/s, its standard error by the scatter about that line.
    iron_sigma_uT: Floats  # (F, 3) uT, standard deviation of the iron that is left in `body_field`, body axes.

    def __len__(self) -> int:
        return len(self.sample)

    def select(self, rows: slice | Bools) -> FootfallField:
        """Return some of its footfalls."""
        return FootfallField(*(getattr(self, one.name)[rows] for one in fields(self)))

    def join(self, other: FootfallField) -> FootfallField:
        """Return its footfalls and those of another, in this order."""
        both = (np.concatenate([getattr(self, one.name), getattr(other, one.name)]) for one in fields(self))
        return FootfallField(*both)

    def leave_out(self, rows: Bools) -> FootfallField:
        """Return it without a field at some of its footfalls, (F,) flags."""
        body_field = np.where(rows[:, None], np.nan, self.body_field)
        scatter, rate, sigma = (
            np.where(rows, np.nan, one) for one in (self.scatter_uT, self.strength_rate, self.strength_rate_sigma)
        )
        return replace(self, body_field=body_field, scatter_uT=scatter, strength_rate=rate, strength_rate_sigma=sigma)

    @cached_property
    def level_field(self) -> Floats:
        """(F, 3) uT in levelled axes, levelled by the inertial attitude."""
        return rotate_to_level(self.body_field, self.nav_R_body[:, 2])

    @cached_property
    def nav_field(self) -> Floats:
        """(F, 3) uT in nav, as the drifting inertial attitude has it."""
        return np.asarray(np.einsum("nij,nj->ni", self.nav_R_body, self.body_field))

    @cached_property
    def strength(self) -> Floats:
        """(F,) uT."""
        return np.asarray(np.linalg.norm(self.body_field, axis=1))

    @cached_property
    def inclination(self) -> Floats:
        """(F,) rad below the horizon."""
        return compute_inclination(self.level_field)

    @cached_property
    def magnetic_heading(self) -> Floats:
        """(F,) rad of the body's x axis, clockwise from magnetic north."""
        return compute_field_heading(self.level_field)

    @cached_property
    def force_heading(self) -> Floats:
        """(F,) rad, magnetic heading levelled by the stance's mean specific force: Ma (3)-(5), AIEZ (19)-(24)."""
        return compute_field_heading(rotate_to_level(self.body_field, self.body_force))

    @cached_property
    def gyro_heading(self) -> Floats:
        """(F,) rad of the body's x axis by the gyroscope, clockwise from the north of the inertial attitude."""
        return compute_heading(self.nav_R_body)

    @cached_property
    def heading_difference(self) -> Floats:
        """(F,) rad, magnetic minus gyro heading, wrapped."""
        return wrap_angle(self.magnetic_heading - self.gyro_heading)

    @property
    def mean_heading_difference(self) -> float:
        """Circular mean of the difference, rad; 0 where there is none."""
        return average_angles(self.heading_difference)


def average_footfall_field(
    recording: Recording,
    stances: Stances,
    heading: float = 0.0,
    nav_R_body: Floats | None = None,
) -> FootfallField:
    """Average the field over each footfall, magnetometer calibrated or not.

    Attitudes `nav_R_body` (N, 3, 3) are by gyroscope and stances if None, and then start with `heading`, rad clockwise
    from north, of the body's x axis.

    Raises `MagneticError` without a magnetometer, or if no footfall has a sample of the field; `EstimationError`
    without a stance, or with stances of another recording.

    Examples
    --------
    >>> recording = fg_nav.read("walk.csv")
    >>> field = fg_nav.average_footfall_field(recording, fg_nav.detect_stances(recording))
    >>> len(field)
    17
    """
    if recording.mag is None:
        raise MagneticError("the recording has no magnetometer, so nothing is known of the field: record with one.")
    attitude = integrate_attitude(recording, stances, heading) if nav_R_body is None else nav_R_body
    sample = stances.stillest(recording.gyr)
    # about each of them, within its stance
    interval = np.searchsorted(stances.stop, sample, side="right")
    first = np.searchsorted(recording.t, recording.t[sample] - HALF_WINDOW_S)
    last = np.searchsorted(recording.t, recording.t[sample] + HALF_WINDOW_S, side="right")
    first, last = np.maximum(first, stances.start[interval]), np.minimum(last, stances.stop[interval])
    parts = []
    for start in range(0, max(len(sample), 1), MAX_FOOTFALLS):
        some = np.s_[start : start + MAX_FOOTFALLS]
        windows = sample[some], first[some], last[some]
        parts.append(_average(recording.t, recording.acc, recording.mag, attitude, *windows))
    body_field, body_force, count, scatter, rate, sigma = map(np.concatenate, zip(*parts, strict=True))
    if not (count >= MIN_SAMPLES).any():
        raise MagneticError(
            f"none of the {len(sample)} footfalls has {MIN_SAMPLES} samples of the field: "
            "is the magnetometer recorded at 10 Hz or more?"
        )
    iron = np.tile(UNKNOWN_IRON_UT, (len(sample), 1))
    return FootfallField(
        sample, recording.t[sample], body_field, body_force, attitude[sample], count, scatter, rate, sigma, iron
    )


def _average(
    t: Floats, acc: Floats, mag: Floats, attitude: Floats, sample: Ints, first: Ints, last: Ints
) -> tuple[Floats, Floats, Ints, Floats, Floats, Floats]:
    """Mean field and force (F, 3) in the body at `sample`; count, scatter uT, slope of strength uT/s and its sigma."""
    # samples of all windows, one after the other, in the body frame of their footfall
    length, n = last - first, len(sample)
    of = np.repeat(np.arange(n), length)
    row = np.arange(len(of)) + np.repeat(first - np.cumsum(length) + length, length)
    turn = np.einsum("nki,nkj->nij", attitude[sample[of]], attitude[row])
    force = _sum_by(of, np.einsum("nij,nj->ni", turn, acc[row]), n) / length[:, None]
    measured = np.isfinite(mag[row]).all(axis=1)
    of, row, turn = of[measured], row[measured], turn[measured]
    count = np.bincount(of, minlength=n)
    b = np.einsum("nij,nj->ni", turn, mag[row])
    few = count < MIN_SAMPLES
    weight = np.where(few, np.nan, 1.0 / np.maximum(count, 1))
    field = _sum_by(of, b, n) * weight[:, None]
    # rms scatter per axis about the mean, and a line in time through the strength
    scatter = np.sqrt(_sum_by(of, ((b - field[of]) ** 2).sum(axis=1), n) / np.where(few, np.nan, 3.0 * (count - 1)))
    tau, strength = t[row], np.linalg.norm(mag[row], axis=1)
    tau = tau - (_sum_by(of, tau, n) * weight)[of]
    strength = strength - (_sum_by(of, strength, n) * weight)[of]
    spread = np.where(few, np.nan, _sum_by(of, tau**2, n))
    slope = _sum_by(of, tau * strength, n) / spread
    rest = _sum_by(of, (strength - slope[of] * tau) ** 2, n)
    sigma = np.sqrt(rest / np.where(count < 3, np.nan, (count - 2) * spread))
    return field, force, count, scatter, slope, sigma


def _sum_by(group: Ints, values: Floats, n: int) -> Floats:
    """Sum of the values (K, ...) of each of `n` groups."""
    total = np.zeros((n, *values.shape[1:]))
    np.add.at(total, group, values)
    return total


def integrate_attitude(recording: Recording, stances: Stances, heading: float = 0.0) -> Floats:
    """Integrate the attitude nav_R_body (N, 3, 3) of a walk that starts with this heading of the body's x axis.

    `heading` in rad, clockwise from north.

    Raises `EstimationError` without a stance, on stances of another recording, or where the specific force vanishes.
    """
    start = find_start(recording, stances, heading)
    longest = find_longest(start.rests)
    bias = np.zeros(3) if longest is None else longest.rate
    t, acc, gyr, mask, n = recording.t, recording.acc, recording.gyr, stances.mask, len(recording)
    attitude = np.empty((n, 3, 3))
    attitude[start.row] = start.nav_R_body
    # from there to the end, and back to the first sample
    _integrate(t, acc, gyr, mask, bias, attitude, start.row, n - 1, True)
    _integrate(t, acc, gyr, mask, bias, attitude, 0, start.row, False)
    return attitude


@njit(cache=True)
def _integrate(
    t: Floats,
    acc: Floats,
    gyr: Floats,
    stands: Bools,
    bias: Floats,
    attitude: Floats,
    first: int,
    last: int,
    forward: bool,
) -> None:
    """Integrate the attitude (N, 3, 3), in place, between samples `first` and `last`; if `forward`, level in stance."""
    for step in range(last - first):
        # a sample holds from its stamp to the next
        i = first + step if forward else last - 1 - step
        before, after = (i, i + 1) if forward else (i + 1, i)
        R, h = attitude[after], t[after] - t[before]
        for axis in range(3):
            for k in range(3):
                R[axis, k] = attitude[before, axis, k]
        rotate_in_body(R, (gyr[i, 0] - bias[0]) * h, (gyr[i, 1] - bias[1]) * h, (gyr[i, 2] - bias[2]) * h)
        if forward and stands[after]:
            nudge_tilt(R, acc[after], min(h / TILT_TIME_S, 1.0))
