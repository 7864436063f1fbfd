"""From footprints and their times to the motion of the foot: the phases of a stride.

=============  =============  ==============================================================
share of swing moves          what happens
=============  =============  ==============================================================
0.00 - 0.46    pitch, height  push-off: the heel comes up, the toe points down and clears the floor
0.06 - 0.94    position       the foot swings to the next footprint
0.32 - 0.92    pitch, height  the toe comes up, the heel comes down
0.80 - 1.00    pitch, height  heel strike to foot flat
0.05 - 0.95    roll           the sole turns inward and back
0.15 - 0.90    yaw            the foot turns into the next direction
then, stance   pitch          the foot rolls slowly on about the pivot
0.80 - 0.10    height         the load of the body presses the sole together, up to the next push-off
0.10 - 0.35    height         the sole springs back as the foot unloads
=============  =============  ==============================================================

The sole is there because its motion does not cancel. A sensor on a shoe sinks in every stance, where an estimator
holds on to its velocity, and rises again in push-off; motion capture of people in shoes shows 2 to 9 mm/s in
mid-stance. Who takes that for zero climbs by some millimetres in every stride, and who allows for it would sink as
much on a rigid sole. A foot that stands on is pressed already, and stays where it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.simulation.gait import FootMotion, Ramps

_X, _Y, _Z = 0, 1, 2
_ROLL, _PITCH, _YAW = 0, 1, 2

_FACING_NORTH = Ramps(np.array([-1.0]), np.array([0.5]), np.array([[0.0, 0.0, np.pi / 2]]))
"""Yaw of a foot that points north, done before the recording begins."""


@dataclass(frozen=True)
class Gait:
    """A person: round figures of adult walking at 1.4 m/s, as a sensor on the instep sees it.

    Attributes
    ----------
    stride_m, stride_s : length and duration of a stride, m and s.
    variation : coefficient of variation of strides and of their vigour (healthy adults: 0.02-0.03).
    swing_share : part of a stride in which the foot is not flat, from heel-off to foot-flat.
    toe_down_rad, toe_up_rad : pitch after push-off and at heel strike; with these rates reach 560 deg/s.
    inversion_rad : roll in mid-swing.
    stance_pitch_rad : forward pitch while the foot is flat: two to three deg/s.
    clearance_m : height to which the pivot is lifted; the toe, 16 cm ahead and pointing down, just clears.
    heel_m : height of the pivot at heel strike, when the heel 10 cm behind touches.
    sole_m, sole_sd_m : by how much the sole gives way under the load of a stance, mean and scatter.
    footprint_m, toe_out_rad : scatter of the footprints about the path, and of the foot's direction.
    lever_m : from the pivot to the sensor, body frame (measured at real feet: 11 cm up).
    """

    stride_m: float = 1.29
    stride_s: float = 0.93
    variation: float = 0.025
    swing_share: float = 0.62
    toe_down_rad: float = float(np.deg2rad(58.0))
    toe_up_rad: float = float(np.deg2rad(25.0))
    inversion_rad: float = float(np.deg2rad(8.0))
    stance_pitch_rad: float = float(np.deg2rad(0.9))
    clearance_m: float = 0.19
    heel_m: float = 0.05
    sole_m: float = 0.0017
    sole_sd_m: float = 0.0005
    footprint_m: float = 0.015
    toe_out_rad: float = float(np.deg2rad(1.5))
    lever_m: tuple[float, float, float] = (-0.02, 0.0, 0.10)


@dataclass(frozen=True)
class Strides:
    """When and where: `start`, `duration` (K,) s; `footprint` (K + 1, 2) m, `heading` (K + 1,) rad."""

    start: Floats
    duration: Floats
    footprint: Floats
    heading: Floats

    def swing(self, gait: Gait, begin: float, end: float, axis: int, rise: Floats) -> Ramps:
        """Move one coordinate by `rise` (K,) between two shares of the swing."""
        width = gait.swing_share * self.duration
        return Ramps(self.start + begin * width, (end - begin) * width, _along(axis, rise))

    def stance(self, gait: Gait, axis: int, rise: Floats) -> Ramps:
        """Move one coordinate by `rise` (K,) while the foot is flat."""
        swing_s = gait.swing_share * self.duration
        return Ramps(self.start + swing_s, self.duration - swing_s, _along(axis, rise))


def foot_motion(strides: Strides, gait: Gait, rng: np.random.Generator) -> FootMotion:
    """Motion of a foot that makes these strides; every stride differs a little in vigour."""
    vigour = 1 + gait.variation * rng.standard_normal(len(strides.start))
    rolled = gait.stance_pitch_rad * (1 + 0.3 * rng.standard_normal(len(strides.start)))
    rolled[-1] = 0.0  # after the last stride the foot stands
    pressed = np.maximum(gait.sole_m + gait.sole_sd_m * rng.standard_normal(len(strides.start)), 0.0)
    angles = (_FACING_NORTH, *_pitch(strides, gait, vigour, rolled), *_roll_and_yaw(strides, gait, vigour))
    pivot = (*_pivot(strides, gait, vigour), *_sole(strides, gait, pressed))
    return FootMotion(pivot, angles, np.array(gait.lever_m))


def _pivot(strides: Strides, gait: Gait, vigour: Floats) -> tuple[Ramps, ...]:
    lift, heel = gait.clearance_m * vigour, np.full(len(vigour), gait.heel_m)
    step = np.diff(strides.footprint, axis=0)
    return (
        *(strides.swing(gait, 0.06, 0.94, axis, step[:, axis]) for axis in (_X, _Y)),
        strides.swing(gait, 0.00, 0.46, _Z, lift),
        strides.swing(gait, 0.34, 0.90, _Z, heel - lift),
        strides.swing(gait, 0.80, 1.00, _Z, -heel),
    )


def _sole(strides: Strides, gait: Gait, pressed: Floats) -> tuple[Ramps, ...]:
    """Height of a sole pressed together by `pressed` (K,) m in each stance; it begins as pressed as it ends."""
    next_swing = 1 / gait.swing_share
    return (
        strides.swing(gait, 0.10, 0.35, _Z, np.roll(pressed, 1)),
        strides.swing(gait, 0.80, next_swing + 0.10, _Z, -pressed),
    )


def _pitch(strides: Strides, gait: Gait, vigour: Floats, rolled: Floats) -> tuple[Ramps, ...]:
    toe_down, toe_up = gait.toe_down_rad * vigour, gait.toe_up_rad * vigour
    begun = np.concatenate([[0.0], rolled[:-1]])  # by the stance before
    return (
        strides.swing(gait, 0.00, 0.46, _PITCH, toe_down - begun),
        strides.swing(gait, 0.32, 0.92, _PITCH, -toe_down - toe_up),
        strides.swing(gait, 0.80, 1.00, _PITCH, toe_up),
        strides.stance(gait, _PITCH, rolled),
    )


def _roll_and_yaw(strides: Strides, gait: Gait, vigour: Floats) -> tuple[Ramps, ...]:
    inversion = gait.inversion_rad * vigour
    return (
        strides.swing(gait, 0.05, 0.45, _ROLL, inversion),
        strides.swing(gait, 0.45, 0.95, _ROLL, -inversion),
        strides.swing(gait, 0.15, 0.90, _YAW, -np.diff(strides.heading)),
    )


def _along(axis: int, rise: Floats) -> Floats:
    values = np.zeros((len(rise), 3))
    values[:, axis] = rise
    return values
