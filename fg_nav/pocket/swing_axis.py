"""How the sensor sits on the thigh, and the thigh's flexion: no mounting is assumed.

A walking thigh turns about one axis more than about all others, that from hip to hip. In the body

    left     the first principal axis of the slow rate, made level in the mean
    up       the mean direction of up while the leg swings
    forward  left x up

and flexion is the angle by which the knee is ahead of that mean,

    flexion = atan2(up_now . forward, up_now . up),     its rate = -rate . left,

up_now being the third row of nav_R_body. Left and right are told apart by the gait: a leg swings forward off the ground
in less time than it is carried back on it, so the slow rate of flexion is skewed to flexing. Over both walks of real
thighs (`qmt_fullbody`) it is so by 0.22, in 5 s of them by 0 to 0.44; simulated legs have 0.21 to 0.25. Somebody who
walks backward is taken to walk forward.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d

from fg_nav.arrays import Bools, Floats
from fg_nav.detection.mount import remove_fast
from fg_nav.errors import EstimationError
from fg_nav.pocket.track import PocketTrack
from fg_nav.recording import Recording

SWINGING_DEG_S = 60.0
"""A thigh that turns faster than this is on its way; one that stands or sits is not."""

LEAST_SHARE = 0.5
"""The principal axis has so much of the power of the rate (evenly spread: a third), or there is no swing in it."""

GAIT_HZ = 4.0
"""Front and back are told by what is slower than this: three a stride, and nothing of the footfalls."""

UPRIGHT_DEG = 45.0
"""A thigh farther off its mean is that of one who sits down or gets up, which tells nothing of front and back."""

LEAST_SKEW = 0.1
"""A skewness below this does not tell forward from backward."""


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
        """Whether the gait tells forward from backward."""
        return self.skewness > LEAST_SKEW


def thigh_swing(recording: Recording, track: PocketTrack) -> ThighSwing:
    """Find the axes of the thigh, and its flexion.

    Raises
    ------
    EstimationError
        If the sensor hardly turns, or about no axis in particular.
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
    left = _principal_axis(rate[swinging], up)
    flexion = _flexion(up_now, left, up)
    upright = _about(swinging, recording.period_s) & (np.abs(flexion) < np.radians(UPRIGHT_DEG))
    skewness = _skewness(-remove_fast(rate @ left, recording.period_s, GAIT_HZ)[upright])
    if skewness < 0:
        left, flexion = -left, -flexion
    return ThighSwing(left, up, up_now, flexion, abs(skewness), _slipped_deg(rate[swinging], up))


def _about(flags: Bools, period_s: float) -> Bools:
    """(N,) True within half a second of a flag: the turning back of a swing too."""
    return np.asarray(maximum_filter1d(flags, 2 * round(0.5 / period_s) + 1))


def _flexion(up_now: Floats, left: Floats, up: Floats) -> Floats:
    return np.asarray(np.unwrap(np.arctan2(up_now @ np.cross(left, up), up_now @ up)))


def _principal_axis(rate: Floats, up: Floats) -> Floats:
    """Axis (3,) about which most of the `rate` (M, 3) is, made level."""
    share, axis = _principal(rate)
    axis = axis - (axis @ up) * up
    if share < LEAST_SHARE or np.linalg.norm(axis) < 0.5:
        raise EstimationError(
            "the sensor turns about no level axis in particular, as a thigh does in walking: "
            "is it in a trouser pocket, and held there?"
        )
    return _unit(axis)


def _principal(rate: Floats) -> tuple[float, Floats]:
    """Axis (3,) about which most of the `rate` (M, 3) is, and how much of its power that is."""
    power, axes = np.linalg.eigh(rate.T @ rate)
    return float(power[2] / power.sum()), axes[:, 2]


def _slipped_deg(rate: Floats, up: Floats) -> float:
    """Angle between the axes of the first and the second half of the swinging."""
    halves = (rate[: len(rate) // 2], rate[len(rate) // 2 :])
    one, other = (_principal(half)[1] for half in halves)
    axes = [_unit(axis - (axis @ up) * up) for axis in (one, other)]
    return float(np.degrees(np.arccos(min(abs(float(axes[0] @ axes[1])), 1.0))))


def _skewness(values: Floats) -> float:
    return float((values**3).mean() / (values**2).mean() ** 1.5) if values.any() else 0.0


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))
