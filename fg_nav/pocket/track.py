"""Where the estimation of orientation starts in a pocket, and the track that it returns.

Start (MD 2.1, Figure 1): the mean specific force of the first second levels the sensor; biases are zero. MD sets the
yaw to zero, so that all headings are relative to it; here the heading of the body's x axis is given, zero by default,
or that of the magnetometer over the same second. Motion meanwhile is added to the sigma of the tilt.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.detection.rest import MIN_FORCE_M_S2
from fg_nav.errors import EstimationError
from fg_nav.frames import level_attitude, yaw_rotation
from fg_nav.magnetic.footfall_field import compute_field_heading, compute_true_heading
from fg_nav.pocket.parameters import PocketParameters
from fg_nav.recording import Recording

GAUGE_SIGMA = 1e-4  # Sigma of a heading that is zero by definition, rad: small, but it keeps P invertible.
STILL_S = 1.0  # The attitude at the start is levelled by the mean over this, s (MD 2.1).
TILT_SIGMA_DEG = 0.5  # Tilt after levelling at rest, deg: a MEMS accelerometer's bias. Not printed.
COMPASS_SIGMA_DEG = 10.0  # A compass is off by so much (one sigma) outdoors near houses and cars.
STORED_EVERY_S = 1.0  # The whole covariance is stored so often: 40 minutes of it are 0.7 MB.


@dataclass(frozen=True)
class PocketStart:
    """Attitude `nav_R_body` (3, 3) at the first sample, and its sigmas, rad."""

    nav_R_body: Floats
    tilt_sigma: float
    heading_sigma: float = GAUGE_SIGMA


@dataclass(frozen=True)
class PocketTrack:
    """Orientation and bias at the recording's rate, each sample after its own updates.

    Attributes
    ----------
    t : (N,) s.
    nav_R_body : (N, 3, 3).
    gyro_bias : (N, 3) rad/s, body.
    sigma : (N, 6) standard deviations of the rotation in nav about east, north and up, rad, and of the bias, rad/s.
    covariance_sample : (M,) samples, one a second, of which ...
    covariance : (M, 6, 6) is stored, in the order of `sigma`.
    gravity_nis, field_nis : (N,) normalized innovations squared, of two each; NaN where not used.
    """

    t: Floats
    nav_R_body: Floats
    gyro_bias: Floats
    sigma: Floats
    covariance_sample: Ints
    covariance: Floats
    gravity_nis: Floats
    field_nis: Floats

    @property
    def field_used(self) -> Bools:
        """(N,) True where the differential magnetic field update was used (DMFU)."""
        return np.asarray(np.isfinite(self.field_nis))

    def rotate(self, clockwise: float) -> PocketTrack:
        """Return it rotated about up, rad clockwise; the sigmas are those of the axes that east and north become."""
        return replace(self, nav_R_body=yaw_rotation(-clockwise) @ self.nav_R_body)

    def __len__(self) -> int:
        return len(self.t)


def level_start(recording: Recording, heading: float = 0.0, heading_sigma: float = GAUGE_SIGMA) -> PocketStart:
    """Start level, with a heading of the body's x axis in rad clockwise from north.

    Where the x axis is vertical its heading has no meaning (`fg_nav.frames.level_attitude`).

    Raises `EstimationError` if the specific force vanishes.
    """
    acc = recording.acc[_first_second(recording)]
    force = acc.mean(axis=0)
    strength = float(np.linalg.norm(force))
    if strength < MIN_FORCE_M_S2:
        raise EstimationError(
            f"the mean specific force of the first {STILL_S:g} s is {strength:.2f} m/s^2, so there is no "
            "up: accelerations must include gravity."
        )
    moved = float(np.linalg.norm(acc.std(axis=0))) / strength
    return PocketStart(
        level_attitude(force, heading), float(np.hypot(np.radians(TILT_SIGMA_DEG), moved)), heading_sigma
    )


def compass_start(recording: Recording, declination: float = 0.0) -> PocketStart:
    """Start level, with the heading of the first second's field; `declination` rad, east positive.

    Raises `EstimationError` if the specific force vanishes, or there is no magnetometer in the first second.
    """
    start = level_start(recording)
    mag = None if recording.mag is None else recording.mag[_first_second(recording)]
    if mag is None or not np.isfinite(mag).all(axis=1).any():
        raise EstimationError(f"there is no magnetometer in the first {STILL_S:g} s to begin with: give the heading.")
    east, north, up = start.nav_R_body @ np.nanmean(mag, axis=0)
    # levelled with heading 0 the body's x axis points north, that is ahead; left of it is west
    heading = compute_field_heading(np.array([north, -east, up]))
    return level_start(
        recording, float(compute_true_heading(heading, declination)), float(np.radians(COMPASS_SIGMA_DEG))
    )


def estimate_field_noise_uT(recording: Recording) -> float:
    """White error of the magnetometer, uT an axis and sample, from the quietest tenth of the seconds.

    By second differences, of variance 6 sigma^2, in which a thigh that swings leaves 0.1 uT or less at 100 Hz where it
    turns back. It is never below that of MD Table 2.
    """
    least_uT = PocketParameters().mag_sigma_uT
    mag = np.zeros((0, 3)) if recording.mag is None else recording.mag[np.isfinite(recording.mag).all(axis=1)]
    second = np.diff(mag, n=2, axis=0)
    rate = len(mag) / (recording.t[-1] - recording.t[0])
    blocks = np.array_split(second, max(int(len(second) / max(rate, 4.0)), 1))
    scatter = [float(np.sqrt((block**2).mean() / 6.0)) for block in blocks if len(block) > 1]
    return max(float(np.percentile(scatter, 10)), least_uT) if scatter else least_uT


def _first_second(recording: Recording) -> slice:
    return slice(0, int(np.searchsorted(recording.t, recording.t[0] + STILL_S)))
