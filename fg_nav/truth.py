"""What is known of a walk from elsewhere: its true path or footprints to measure errors with, position fixes to use."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats, Ints


@dataclass(frozen=True)
class TrajectoryTruth:
    """True path of the sensor. `t` (M,) s, `position` (M, 3) m, `nav_R_body` (M, 3, 3) or None, z up.

    Examples
    --------
    >>> truth = fg_nav.read_truth("truth.tum")
    >>> truth.position.shape == (len(truth.t), 3)
    True
    """

    t: Floats
    position: Floats
    nav_R_body: Floats | None = None


@dataclass(frozen=True)
class FootprintTruth:
    """Surveyed footprints. `stride` (M,) counts strides (0 = the start), `xy` (M, 2) m, seen from above.

    Azimuth and origin are unknown. `t` (M,) s is an instant within each stance where it is known; without it footprints
    are matched by stride number. `stride_count` is the number of strides of the whole walk where it is known.

    Examples
    --------
    >>> import numpy as np
    >>> truth = fg_nav.FootprintTruth(stride=np.array([0, 6, 12]), xy=np.array([[0.0, 0.0], [3.1, 4.2], [8.0, 9.1]]))
    >>> fg_nav.navigate("walk.csv", "inertial", truth=truth).metrics.points
    3
    """

    stride: Ints
    xy: Floats
    stride_count: int | None = None
    t: Floats | None = None


Truth = TrajectoryTruth | FootprintTruth


@dataclass(frozen=True)
class Fix:
    """A position known at an instant of the walk: at a surveyed point, or by a receiver.

    In the walk's own navigation frame, m, from where the sensor stood in the first stance: subtract a plan's
    coordinates of the start.

    Attributes
    ----------
    time_s : s, in the recording's own time.
    position : (3,) m, x east, y north, z up from the start; z does not count where `vertical_sigma_m` is infinite.
    horizontal_sigma_m : of x, and of y.
    vertical_sigma_m : of z; infinite where the height is not known.

    Examples
    --------
    >>> fixes = [fg_nav.Fix(time_s=18.0, position=np.array([10.3, 7.7, 0.0]), horizontal_sigma_m=0.1)]
    >>> result = fg_nav.navigate("walk.csv", fixes=fixes)
    >>> bool(result.stances.position_sigma[-1, 0] < 1.0)
    True
    """

    time_s: float
    position: Floats
    horizontal_sigma_m: float
    vertical_sigma_m: float = np.inf
