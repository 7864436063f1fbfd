"""A position fix: a surveyed point, or a receiver's position, in the navigation frame.

The residual is that of gtsam's own `GPSFactor`, on the axes of the navigation frame,

    e = p - fix,    de/dpose = [0, nav_R_body].

A fix that is known in the plane only has an infinite sigma upwards, and says nothing of the height.

Errors of a receiver persist for many seconds. Fixes are taken as independent here: take one each ten seconds or so,
or enlarge sigma by the square root of how many share an error. Where some are plainly wrong (between houses) wrap the
noise in `gtsam.noiseModel.Robust`.
"""

import gtsam
import numpy as np

from .guarded import Array


def position_fix_noise(horizontal_sigma: float, vertical_sigma: float = np.inf) -> gtsam.noiseModel.Diagonal:
    """Noise of a fix, m: each horizontal axis, and the vertical one; that of a planar fix is infinite."""
    sigmas = np.array([horizontal_sigma, horizontal_sigma, vertical_sigma])
    if not (sigmas > 0.0).all():
        raise ValueError("position fix: the sigmas must be above zero.")
    return gtsam.noiseModel.Diagonal.Precisions(sigmas**-2.0)


def position_fix_factor(pose_key: int, nav_position: Array, noise: gtsam.noiseModel.Base) -> gtsam.GPSFactor:
    """Tie a pose to a fix.

    Parameters
    ----------
    pose_key
        Key of nav_T_body (Pose3).
    nav_position : (3,) m
        The fix; with a planar noise its height does not count.
    noise
        Of dimension 3, m, on nav's axes; see `position_fix_noise`.
    """
    return gtsam.GPSFactor(pose_key, np.asarray(nav_position, dtype=np.float64), noise)
