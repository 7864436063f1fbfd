"""What a pass of a filter leaves behind: its path for the user, its tape for the way back."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.ekf.covariance import SIZE
from fg_nav.ekf.update import ROW


class Track(NamedTuple):
    """The path, and what is kept of the footfalls.

    Path `position`, `velocity` (N, 3), `nav_R_body` (N, 3, 3) and `nis` (N,) of the velocity, NaN where it was not
    corrected; at one sample a footfall `gyro_bias` (K, 3), `covariance` (K, 15, 15), and the standardised `innovation`
    (K, 4) of compass, tilt and course, NaN where it was not used, and of the compass by which it was tested.
    """

    position: Floats
    velocity: Floats
    nav_R_body: Floats
    nis: Floats
    gyro_bias: Floats
    covariance: Floats
    innovation: Floats


class Tape(NamedTuple):
    """What the way back needs besides: 50 MB a million samples, and 400 MB a million of them in stance.

    `bias` (N, 6) of gyroscope (rad/s) and accelerometer (m/s^2) with which a sample was taken; the traces
    (`fg_nav.ekf.update`) of all corrections in their order: of the velocity `stance` (S, 3, 17) at the samples in
    stance from the start on, and of the attitude `footfall` (K, 3, 32) with s = 0 where nothing was corrected.
    """

    bias: Floats
    stance: Floats
    footfall: Floats


def blank_track(samples: int, footfalls: int) -> Track:
    """Track that is still to be written."""
    return Track(
        np.empty((samples, 3)),
        np.empty((samples, 3)),
        np.empty((samples, 3, 3)),
        np.full(samples, np.nan),
        np.empty((footfalls, 3)),
        np.empty((footfalls, SIZE, SIZE)),
        np.full((footfalls, 4), np.nan),
    )


def blank_tape(samples: int, in_stance: int, footfalls: int, taping: bool) -> Tape:
    """Tape that is still to be written; without `taping` one row, written over and over."""
    n, stood = (samples, in_stance) if taping else (1, 1)
    return Tape(np.zeros((n, 6)), np.empty((stood, 3, ROW)), np.zeros((footfalls, 3, ROW + SIZE)))
