"""How a sensor in a trouser pocket moves: the thigh of the right leg in a walk.

The thigh hangs from the hip joint; the sensor sits at a lever from it (thigh frame: x forward, y left, z up along the
bone), turned by a constant `thigh_R_body` (`motion.compute_kinematics`); pitch = -flexion, yaw = pi / 2 - heading +
twist.

tau is the share of a stride since heel-off, e(t) an envelope that rises from standing (0) to the leg's full swing (1)
and grows with the stride's length to the power 0.8. The parts, n to a stride, are e A cos(2 pi (n tau - p)):

* flexion: one, two and three to a stride about a mean that is flexed; most extended just after heel-off, flexed from
  mid-swing till after contact. Abduction and twist, that of the pelvis included: one and two to a stride.
* hip over the ground: above the footprint in mid-stance, between them on a monotone cubic; it sways to the standing
  side, surges twice a stride, and bounces twice, lowest when both feet are down (running: in mid-stance).
* after each contact of either foot hip and pocket ring, (1 - exp(-s / r)) exp(-s / d) sin(2 pi f s), s being the time
  since: a shock through the leg, and soft cloth and flesh.

All this gives the control points, every `CONTROL_S`, of two uniform quintic B-splines, hip and angles: four times
differentiable, so rate and specific force are exact derivatives of the pose; never outside the range of its control
points, so that standing is standing but for a slow sway. As a filter the spline has a standard deviation of 9 ms.

Where the figures come from: the shares and sizes of the waves of flexion are rounded from the mean stride of one real
subject (`qmt_fullbody`); swing, twist, abduction and ringing were then set by hand with that subject's rates and forces
in view, the swing near the +-25 degrees usual for a pocket. So a comparison of them with the
same subject, shows a fit and is no independent test. Bounce, sway, surge, posture and all styles but walking are
assumed, and compared with nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline, PchipInterpolator
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.lab.simulation.checks import Checked, NotNegative
from fg_nav.lab.simulation.motion import Kinematics, Strides, Style, average_over_period, compute_kinematics
from fg_nav.lab.simulation.person import DEG

CONTROL_S = 0.0125  # Between control points.
_MARGIN_S = 2.0  # By how much the splines reach beyond the recording.
_MIDSTANCE = 0.87  # Share of a stride at which the hip is above the foot.

_FLEXION = ((1, 1.0, 0.585), (2, 0.18, 0.70), (3, 0.07, 0.13))
_ABDUCTION = ((1, 0.7, 0.30), (2, 0.5, 0.25))
_TWIST = ((1, 0.8, 0.55), (2, 0.5, 0.10))
"""Waves: how many to a stride, amplitude over that of the part, phase in cycles."""


HIP_M = 0.90  # Height of the hip joint over the floor when standing.
LEVER_M = (0.08, -0.03, -0.20)  # From the hip to the sensor: in the front pocket, a hand's length below the joint.
ABDUCTION_RAD, TWIST_RAD = 6.0 * DEG, 10.0 * DEG
SWAY_M, SURGE_M = 0.02, 0.009  # Of the hip to the side, once a stride, and forward, twice.
POSTURE_S = 1.0  # Of a slow sway (assumed).

RINGING_HZ, DECAY_S, ONSET_S = 8.0, 0.07, 0.015  # f, d and r above (assumed).
RINGING_HIP_M = (-0.006, 0.002, -0.008)  # Forward, left and up.
RINGING_RAD = (0.06, 0.07, 0.10)  # Standard deviation in roll, pitch and twist, drawn for each contact.
OTHER_FOOT = 0.4  # Share of all this that arrives from the other foot.


class Leg(NamedTuple):
    """How a thigh goes in one style."""

    swing_rad: float  # Amplitude of flexion once a stride, and its mean against standing.
    flexed_rad: float
    bounce_m: float  # Of the hip, from lowest to highest.
    low_share: float = 0.13  # Share of a stride at which the hip is lowest, once for each foot.
    contact_share: float = 0.54  # Share of a stride at which the heel strikes.
    stride_m: float = 0.0  # Length of a stride of this swing; 0 where the swing does not go by the length.


LEGS: Mapping[Style, Leg] = {
    Style.WALK: Leg(25.0 * DEG, 8.0 * DEG, 0.045, stride_m=1.29),
    Style.RUN: Leg(28.0 * DEG, 14.0 * DEG, 0.080, 0.26, 0.59, stride_m=2.30),
    Style.STAIRS_UP: Leg(22.0 * DEG, 28.0 * DEG, 0.020),
    Style.STAIRS_DOWN: Leg(12.0 * DEG, 16.0 * DEG, 0.030),
    Style.TURN: Leg(8.0 * DEG, 4.0 * DEG, 0.015),
}


@dataclass(frozen=True)
class Pocket(Checked):
    """How a sensor sits in a pocket."""

    tilt_rad: NotNegative = 12.0 * DEG  # Constant rotation between thigh and sensor, standard deviation per axis.
    posture_rad: NotNegative = 0.1 * DEG  # Slow sway of the thigh, standard deviation per axis.
    ringing: NotNegative = 1.0  # Strength of what a contact leaves.


@dataclass(frozen=True)
class ThighMotion:
    """A walk of one thigh; a `Motion`."""

    hip: BSpline  # Position (3) m.
    angles: BSpline  # Roll, pitch and yaw (3) rad.
    thigh_R_body: Floats  # (3, 3), how the sensor sits.

    def at(self, t: Floats) -> Kinematics:
        """Exact state at the instants `t` (N,) s."""
        moved = [np.hstack([self.hip(t, order), self.angles(t, order)]) for order in range(3)]
        return compute_kinematics(np.array(moved), np.array(LEVER_M), self.thigh_R_body)

    def sampled(self, t: Floats, period_s: float) -> tuple[Floats, Floats]:
        """Rate (N, 3) rad/s and specific force (N, 3) m/s^2, each the mean over [t, t + period].

        By quadrature with three nodes: its error is of sixth order in the period.
        """
        return average_over_period(self, t, period_s, nodes=3)


def build_thigh_motion(
    strides: Strides, pocket: Pocket, rng: np.random.Generator, mounting: np.random.Generator | None = None
) -> ThighMotion:
    """Motion of a sensor in the pocket on the side of the foot that makes these strides.

    `rng` draws what is new on every walk, ringing and sway; `mounting`, or `rng` if left out, what stays: the tilt. The
    motion goes from 1 s before the recording to 1 s after it.
    """
    t = np.arange(-_MARGIN_S, strides.end_s + _MARGIN_S, CONTROL_S)
    cycle = _Cycle(strides, t)
    tilt = Rotation.from_rotvec(pocket.tilt_rad * (mounting or rng).standard_normal(3)).as_matrix()
    kick = pocket.ringing * (1 + 0.3 * rng.standard_normal((2, len(strides), 1)))
    tremble = pocket.ringing * np.array(RINGING_RAD) * rng.standard_normal((2, len(strides), 3))
    # the way of the hip over the ground, above the foot in each mid-stance and pause
    stood = np.concatenate([[strides.start[0] - 0.1], strides.start + _MIDSTANCE * strides.duration])
    ends = np.concatenate([strides.start, [strides.end_s + _MARGIN_S]])
    paused = np.flatnonzero(ends - np.concatenate([[-np.inf], strides.start + strides.duration]) > 0.05)
    which = np.concatenate([np.arange(len(stood)), paused])
    poses = np.column_stack([strides.footprint, strides.heading])[which]
    course = _interpolate(np.concatenate([stood, ends[paused]]), poses, t)
    hip = course[:, :3] + _move_hip(cycle, course[:, 3], cycle.ring(kick * np.array(RINGING_HIP_M)))
    # the slow sway of one who stands, and of one who walks as well
    knots = np.arange(t[0], t[-1] + 2 * POSTURE_S, POSTURE_S)
    posture = _interpolate(knots, pocket.posture_rad * rng.standard_normal((len(knots), 3)), t)
    angles = _move_angles(cycle, course[:, 3]) + cycle.ring(tremble) + posture
    return ThighMotion(_make_spline(t, hip), _make_spline(t, angles), tilt)


class _Cycle:
    """Where in the stride the leg is at each control point, and how it goes there."""

    def __init__(self, strides: Strides, t: Floats) -> None:
        end = strides.start + strides.duration
        index = np.arange(len(strides), dtype=np.float64)
        self.phase = np.interp(t, _interleave(strides.start, end), _interleave(index, index + 1))
        self._strides = strides
        legs = [LEGS[Style(style)] for style in strides.style]
        # stride lengths over those of the styles, to the power 0.8, within reason
        length = np.linalg.norm(np.diff(strides.footprint[:, :2], axis=0), axis=1)
        usual = np.array([leg.stride_m for leg in legs])
        ratio = np.divide(length, usual, out=np.ones(len(length)), where=usual > 0)
        vigour: Floats = np.clip(ratio, 0.3, 1.5) ** 0.8
        self.swing = self._ease(t, vigour * [leg.swing_rad for leg in legs])
        self.flexed = self._ease(t, vigour * [leg.flexed_rad for leg in legs])
        self.bounce_m = self._ease(t, vigour**1.5 * [leg.bounce_m for leg in legs])
        self.vigour = self._ease(t, vigour)
        self.low_share = self._ease(t, np.array([leg.low_share for leg in legs]), standing=False)
        self._contact = np.array([leg.contact_share for leg in legs])

    def waves(self, parts: tuple[tuple[int, float, float], ...]) -> Floats:
        """Sum (M,) of the waves of one motion, of amplitude 1."""
        total: Floats = np.sum([a * np.cos(2 * np.pi * (n * self.phase - p)) for n, a, p in parts], axis=0)
        return total

    def ring(self, amplitude: Floats) -> Floats:
        """The ringing (M, 3) after the contacts of this foot and of the other, of amplitudes (2, K, 3)."""
        other = OTHER_FOOT * self._ring_at(self._contact + 0.5, amplitude[1])
        return self.vigour[:, None] * (self._ring_at(self._contact, amplitude[0]) + other)

    def _ring_at(self, share: Floats, amplitude: Floats) -> Floats:
        """The ringing after contacts at these shares (K,) of the strides."""
        contact = np.arange(len(share)) + share
        last = np.searchsorted(contact, self.phase, side="right") - 1
        since = np.where(last < 0, 0.0, (self.phase - contact[last]) * self._strides.duration[last])
        rise_and_fall = -np.expm1(-since / ONSET_S) * np.exp(-since / DECAY_S)
        wave: Floats = rise_and_fall * np.sin(2 * np.pi * RINGING_HZ * since)
        return wave[:, None] * amplitude[last]

    def _ease(self, t: Floats, value: Floats, standing: bool = True) -> Floats:
        """A value (M,) per stride (K,) that goes smoothly from stride to stride, through nought where one stands."""
        middle = self._strides.start + self._strides.duration / 2
        # before, between and after the strides
        begins = np.concatenate([[-_MARGIN_S], self._strides.start + self._strides.duration])
        ends = np.concatenate([self._strides.start, [self._strides.end_s + _MARGIN_S]])
        paused = ends - begins > (0.05 if standing else np.inf)
        begins, ends = begins[paused], ends[paused]
        return _interpolate(
            np.concatenate([middle, begins, ends]), np.concatenate([value, np.zeros(2 * len(begins))]), t
        )


def _move_hip(cycle: _Cycle, heading: Floats, shock: Floats) -> Floats:
    """The hip (M, 3) m against the ground below it; `shock` (M, 3) m is forward, left and up."""
    surge = SURGE_M * cycle.vigour * np.sin(4 * np.pi * (cycle.phase - cycle.low_share))
    sway = -SWAY_M * cycle.vigour * np.cos(2 * np.pi * (cycle.phase - _MIDSTANCE))
    bounce = -cycle.bounce_m / 2 * (1 + np.cos(4 * np.pi * (cycle.phase - cycle.low_share)))
    forward, left = surge + shock[:, 0], sway + shock[:, 1]
    s, c = np.sin(heading), np.cos(heading)
    up = HIP_M + bounce + shock[:, 2]
    return np.stack([s * forward - c * left, c * forward + s * left, up], axis=1)


def _move_angles(cycle: _Cycle, heading: Floats) -> Floats:
    """Roll, pitch and yaw (M, 3) rad of the thigh."""
    roll = ABDUCTION_RAD * cycle.vigour * cycle.waves(_ABDUCTION)
    pitch = -(cycle.flexed + cycle.swing * cycle.waves(_FLEXION))
    twist = TWIST_RAD * cycle.vigour * cycle.waves(_TWIST)
    return np.stack([roll, pitch, np.pi / 2 - heading + twist], axis=1)


def _interpolate(at: Floats, value: Floats, t: Floats) -> Floats:
    """The monotone cubic through values (P, ...) at `at` (P,) s in any order, constant beyond its ends."""
    order = np.argsort(at, kind="stable")
    at, value = at[order], value[order]
    apart = np.concatenate([[True], np.diff(at) > 1e-6])
    if apart.sum() == 1:
        return np.repeat(value[:1], len(t), axis=0)
    inside = np.clip(t, at[apart][0], at[apart][-1])
    smooth: Floats = PchipInterpolator(at[apart], value[apart])(inside)
    return smooth


def _interleave(first: Floats, second: Floats) -> Floats:
    return np.stack([first, second], axis=1).ravel()


def _make_spline(t: Floats, control: Floats) -> BSpline:
    """The uniform quintic B-spline with control points (M, D) at `t` (M,) s."""
    degree = 5
    before = (degree + 1) // 2
    knots = t[0] + CONTROL_S * (np.arange(len(t) + degree + 1) - before)
    return BSpline(knots, control, degree)
