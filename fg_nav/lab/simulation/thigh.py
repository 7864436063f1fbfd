"""How a sensor in a trouser pocket moves: the thigh of the right leg in a walk.

Model
-----
The thigh hangs from the hip joint; the sensor sits at `lever` from it (thigh frame: x forward, y left, z up along the
bone), turned by a constant `thigh_R_body`:

    position = hip + nav_R_thigh lever,    nav_R_body = nav_R_thigh thigh_R_body,
    nav_R_thigh = Rz(yaw) Ry(pitch) Rx(roll),    pitch = -flexion,    yaw = pi / 2 - heading + twist.

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

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import BSpline, PchipInterpolator
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation.motion import Kinematics, Strides, Style, average_over_period

CONTROL_S = 0.0125  # Between control points.
_MARGIN_S = 2.0  # By how much the splines reach beyond the recording.
_MIDSTANCE = 0.87  # Share of a stride at which the hip is above the foot.

_FLEXION = ((1, 1.0, 0.585), (2, 0.18, 0.70), (3, 0.07, 0.13))
_ABDUCTION = ((1, 0.7, 0.30), (2, 0.5, 0.25))
_TWIST = ((1, 0.8, 0.55), (2, 0.5, 0.10))
"""Waves: how many to a stride, amplitude over that of the part, phase in cycles."""


@dataclass(frozen=True)
class Leg:
    """How a thigh goes in one style.

    Attributes
    ----------
    swing_rad, flexed_rad : amplitude of flexion once a stride, and its mean against standing.
    bounce_m : of the hip, from lowest to highest.
    low_share : share of a stride at which the hip is lowest, once for each foot.
    contact_share : share of a stride at which the heel strikes.
    stride_m : length of a stride of this swing; None where the swing does not go by the length.
    """

    swing_rad: float
    flexed_rad: float
    bounce_m: float
    low_share: float = 0.13
    contact_share: float = 0.54
    stride_m: float | None = None


def _usual_legs() -> dict[Style, Leg]:
    degrees = np.pi / 180
    return {
        Style.WALK: Leg(25.0 * degrees, 8.0 * degrees, 0.045, stride_m=1.29),
        Style.RUN: Leg(28.0 * degrees, 14.0 * degrees, 0.080, low_share=0.26, contact_share=0.59, stride_m=2.30),
        Style.STAIRS_UP: Leg(22.0 * degrees, 28.0 * degrees, 0.020),
        Style.STAIRS_DOWN: Leg(12.0 * degrees, 16.0 * degrees, 0.030),
        Style.TURN: Leg(8.0 * degrees, 4.0 * degrees, 0.015),
    }


@dataclass(frozen=True)
class Ringing:
    """What a contact of the foot leaves in hip and pocket.

    Attributes
    ----------
    frequency_hz, decay_s, onset_s : f, d and r above (assumed).
    hip_m : amplitude forward, left and up.
    angle_rad : standard deviation of the amplitudes in roll, pitch and twist, drawn for each contact.
    other_foot : share of all this that arrives from the other foot.
    """

    frequency_hz: float = 8.0
    decay_s: float = 0.07
    onset_s: float = 0.015
    hip_m: tuple[float, float, float] = (-0.006, 0.002, -0.008)
    angle_rad: tuple[float, float, float] = (0.06, 0.07, 0.10)
    other_foot: float = 0.4


@dataclass(frozen=True)
class Pocket:
    """A leg with a sensor in the pocket.

    Attributes
    ----------
    hip_m : height of the hip joint over the floor when standing.
    lever_m : from the hip to the sensor, thigh frame: in the front pocket, a hand's length below the joint.
    tilt_rad : standard deviation, per axis, of the constant rotation between thigh and sensor, drawn once.
    abduction_rad, twist_rad : amplitudes.
    sway_m, surge_m : amplitudes of the hip's motion to the side, once a stride, and forward, twice.
    posture_rad, posture_s : slow sway, standard deviation per axis and duration (assumed).
    legs : the thigh in each style.
    ringing : what a contact leaves.
    """

    hip_m: float = 0.90
    lever_m: tuple[float, float, float] = (0.08, -0.03, -0.20)
    tilt_rad: float = float(np.deg2rad(12.0))
    abduction_rad: float = float(np.deg2rad(6.0))
    twist_rad: float = float(np.deg2rad(10.0))
    sway_m: float = 0.02
    surge_m: float = 0.009
    posture_rad: float = float(np.deg2rad(0.1))
    posture_s: float = 1.0
    legs: dict[Style, Leg] = field(default_factory=_usual_legs)
    ringing: Ringing = Ringing()

    def __post_init__(self) -> None:
        if not (self.hip_m > 0 and self.posture_s > 0):
            raise SimulationError("A pocket has a hip below the floor or a sway of no duration: give positive numbers.")
        if not (self.tilt_rad >= 0 and self.posture_rad >= 0):
            raise SimulationError("A pocket has a tilt or sway of a negative scatter: give 0 for none.")


@dataclass(frozen=True)
class ThighMotion:
    """A walk of one thigh; a `Motion`.

    `hip` is a spline of the hip's position (3) m, `angles` one of roll, pitch, yaw (3) rad; `lever` (3,) m points from
    the hip to the sensor in the thigh frame; `thigh_R_body` (3, 3) is how the sensor sits.
    """

    hip: BSpline
    angles: BSpline
    lever: Floats
    thigh_R_body: Floats

    def at(self, t: Floats) -> Kinematics:
        """Exact state at the instants `t` (N,) s."""
        angle = self.angles(t)
        nav_R_thigh = _compute_attitude(angle)
        rate, rate_change = _compute_rate(angle, self.angles(t, 1), self.angles(t, 2))
        arm_velocity = np.cross(rate, self.lever)
        lift = self.hip(t, 2) + np.array([0.0, 0.0, GRAVITY_M_S2])
        force = np.einsum("nji,nj->ni", nav_R_thigh, lift)
        force += np.cross(rate_change, self.lever) + np.cross(rate, arm_velocity)
        return Kinematics(
            position=self.hip(t) + nav_R_thigh @ self.lever,
            velocity=self.hip(t, 1) + np.einsum("nij,nj->ni", nav_R_thigh, arm_velocity),
            nav_R_body=nav_R_thigh @ self.thigh_R_body,
            rate=rate @ self.thigh_R_body,
            force=force @ self.thigh_R_body,
        )

    def sampled(self, t: Floats, period_s: float) -> tuple[Floats, Floats]:
        """Rate (N, 3) rad/s and specific force (N, 3) m/s^2, each the mean over [t, t + period].

        By quadrature with three nodes: its error is of sixth order in the period.
        """
        return average_over_period(self, t, period_s, nodes=3)


def build_thigh_motion(
    strides: Strides, pocket: Pocket, rng: np.random.Generator, mounting: np.random.Generator | None = None
) -> ThighMotion:
    """Motion of a sensor in the pocket on the side of the foot that makes these strides.

    Parameters
    ----------
    strides : of the foot below.
    pocket : leg and pocket.
    rng : source of what is new on every walk: ringing and sway.
    mounting : source of what stays, the sensor's tilt; `rng` if left out.

    Returns
    -------
    ThighMotion
        From 1 s before the recording to 1 s after it.
    """
    t = np.arange(-_MARGIN_S, strides.end_s + _MARGIN_S, CONTROL_S)
    cycle = _Cycle(strides, pocket, t)
    tilt = Rotation.from_rotvec(pocket.tilt_rad * (mounting or rng).standard_normal(3)).as_matrix()
    kick = 1 + 0.3 * rng.standard_normal((2, len(strides), 1))
    tremble = np.array(pocket.ringing.angle_rad) * rng.standard_normal((2, len(strides), 3))
    ground, heading = _make_course(strides, t)
    hip = ground + _move_hip(cycle, pocket, heading, cycle.ring(kick * np.array(pocket.ringing.hip_m)))
    angles = _move_angles(cycle, pocket, heading) + cycle.ring(tremble) + _draw_posture(t, pocket, rng)
    return ThighMotion(_make_spline(t, hip), _make_spline(t, angles), np.array(pocket.lever_m), tilt)


class _Cycle:
    """Where in the stride the leg is at each control point, and how it goes there."""

    def __init__(self, strides: Strides, pocket: Pocket, t: Floats) -> None:
        end = strides.start + strides.duration
        index = np.arange(len(strides), dtype=np.float64)
        self.phase = np.interp(t, _interleave(strides.start, end), _interleave(index, index + 1))
        self._strides, self._ringing = strides, pocket.ringing
        legs = [pocket.legs[Style(style)] for style in strides.style]
        vigour = _compute_vigour(strides, legs)
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
        other = self._ringing.other_foot * self._ring_at(self._contact + 0.5, amplitude[1])
        return self.vigour[:, None] * (self._ring_at(self._contact, amplitude[0]) + other)

    def _ring_at(self, share: Floats, amplitude: Floats) -> Floats:
        """The ringing after contacts at these shares (K,) of the strides."""
        contact = np.arange(len(share)) + share
        last = np.searchsorted(contact, self.phase, side="right") - 1
        since = np.where(last < 0, 0.0, (self.phase - contact[last]) * self._strides.duration[last])
        ring = self._ringing
        rise_and_fall = -np.expm1(-since / ring.onset_s) * np.exp(-since / ring.decay_s)
        wave: Floats = rise_and_fall * np.sin(2 * np.pi * ring.frequency_hz * since)
        return wave[:, None] * amplitude[last]

    def _ease(self, t: Floats, value: Floats, standing: bool = True) -> Floats:
        """A value (M,) per stride (K,) that goes smoothly from stride to stride, through nought where one stands."""
        middle = self._strides.start + self._strides.duration / 2
        begins, ends = _find_pauses(self._strides) if standing else (np.zeros(0), np.zeros(0))
        return _interpolate(
            np.concatenate([middle, begins, ends]), np.concatenate([value, np.zeros(2 * len(begins))]), t
        )


def _compute_vigour(strides: Strides, legs: list[Leg]) -> Floats:
    """Stride lengths over those of the styles (K,), to the power 0.8, within reason."""
    length = np.linalg.norm(np.diff(strides.footprint[:, :2], axis=0), axis=1)
    usual = np.array([leg.stride_m or 0.0 for leg in legs])
    ratio = np.divide(length, usual, out=np.ones(len(length)), where=usual > 0)
    vigour: Floats = np.clip(ratio, 0.3, 1.5) ** 0.8
    return vigour


def _find_pauses(strides: Strides) -> tuple[Floats, Floats]:
    """When standing begins and ends (P,) s: before, between and after the strides."""
    begins = np.concatenate([[-_MARGIN_S], strides.start + strides.duration])
    ends = np.concatenate([strides.start, [strides.end_s + _MARGIN_S]])
    long = ends - begins > 0.05
    return begins[long], ends[long]


def _make_course(strides: Strides, t: Floats) -> tuple[Floats, Floats]:
    """Ground (M, 3) m below the hip and heading (M,) rad at `t` (M,) s: over the foot in each mid-stance and pause."""
    stood = np.concatenate([[strides.start[0] - 0.1], strides.start + _MIDSTANCE * strides.duration])
    ends = np.concatenate([strides.start, [strides.end_s + _MARGIN_S]])
    paused = np.flatnonzero(ends - np.concatenate([[-np.inf], strides.start + strides.duration]) > 0.05)
    which = np.concatenate([np.arange(len(stood)), paused])
    at = np.concatenate([stood, ends[paused]])
    poses = np.column_stack([strides.footprint, strides.heading])[which]
    route = _interpolate(at, poses, t)
    return route[:, :3], route[:, 3]


def _move_hip(cycle: _Cycle, pocket: Pocket, heading: Floats, shock: Floats) -> Floats:
    """The hip (M, 3) m against the ground below it; `shock` (M, 3) m is forward, left and up."""
    surge = pocket.surge_m * cycle.vigour * np.sin(4 * np.pi * (cycle.phase - cycle.low_share))
    sway = -pocket.sway_m * cycle.vigour * np.cos(2 * np.pi * (cycle.phase - _MIDSTANCE))
    bounce = -cycle.bounce_m / 2 * (1 + np.cos(4 * np.pi * (cycle.phase - cycle.low_share)))
    forward, left = surge + shock[:, 0], sway + shock[:, 1]
    s, c = np.sin(heading), np.cos(heading)
    up = pocket.hip_m + bounce + shock[:, 2]
    return np.stack([s * forward - c * left, c * forward + s * left, up], axis=1)


def _move_angles(cycle: _Cycle, pocket: Pocket, heading: Floats) -> Floats:
    """Roll, pitch and yaw (M, 3) rad of the thigh."""
    roll = pocket.abduction_rad * cycle.vigour * cycle.waves(_ABDUCTION)
    pitch = -(cycle.flexed + cycle.swing * cycle.waves(_FLEXION))
    twist = pocket.twist_rad * cycle.vigour * cycle.waves(_TWIST)
    return np.stack([roll, pitch, np.pi / 2 - heading + twist], axis=1)


def _draw_posture(t: Floats, pocket: Pocket, rng: np.random.Generator) -> Floats:
    """The slow sway (M, 3) rad of the thigh of one who stands, and of one who walks as well."""
    knots = np.arange(t[0], t[-1] + 2 * pocket.posture_s, pocket.posture_s)
    return _interpolate(knots, pocket.posture_rad * rng.standard_normal((len(knots), 3)), t)


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


def _compute_attitude(angle: Floats) -> Floats:
    """Rz(yaw) Ry(pitch) Rx(roll) (N, 3, 3) of roll, pitch, yaw (N, 3)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(angle).T, np.cos(angle).T
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _compute_rate(angle: Floats, d_angle: Floats, dd_angle: Floats) -> tuple[Floats, Floats]:
    """Rate (N, 3) in the thigh frame and its derivative, of roll, pitch, yaw (N, 3) and their derivatives."""
    (sr, sp, _), (cr, cp, _) = np.sin(angle).T, np.cos(angle).T
    r, p, y = d_angle.T
    rr, pp, yy = dd_angle.T
    rate = np.stack([r - y * sp, p * cr + y * cp * sr, -p * sr + y * cp * cr], axis=1)
    change = np.stack(
        [
            rr - yy * sp - y * p * cp,
            pp * cr - p * r * sr + yy * cp * sr - y * p * sp * sr + y * r * cp * cr,
            -pp * sr - p * r * cr + yy * cp * cr - y * p * sp * cr - y * r * cp * sr,
        ],
        axis=1,
    )
    return rate, change
