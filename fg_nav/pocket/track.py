"""What a pass of the pocket's filter leaves behind."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.frames import yaw_rotation


@dataclass(frozen=True)
class PocketTrack:
    """Orientation and bias at the recording's rate, each sample after its own updates.

    Attributes
    ----------
    t : (N,) s.
    nav_R_body : (N, 3, 3).
    gyro_bias : (N, 3) rad/s, body.
    sigma : (N, 6) standard deviations of the rotation in nav about east, north and up, rad, and of the bias, rad/s.
    covariance_sample : (M,) samples, one a second, whose ...
    covariance : (M, 6, 6) is kept whole, in the order of `sigma`.
    gravity_nis, field_nis : (N,) normalised innovations squared, of two each; NaN where not used.
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
    def gravity_used(self) -> Bools:
        """(N,) True where the absolute gravity update was used (AGU)."""
        return np.asarray(np.isfinite(self.gravity_nis))

    @property
    def field_used(self) -> Bools:
        """(N,) True where the differential magnetic field update was used (DMFU)."""
        return np.asarray(np.isfinite(self.field_nis))

    def turned(self, clockwise: float) -> PocketTrack:
        """Turn all of it about up, rad clockwise; the sigmas are those of the axes that east and north become."""
        return replace(self, nav_R_body=yaw_rotation(-clockwise) @ self.nav_R_body)

    def __len__(self) -> int:
        return len(self.t)
