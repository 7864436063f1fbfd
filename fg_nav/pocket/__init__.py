"""Sensor in a trouser pocket: no stance to use, so orientation and gyro bias come from gravity and the magnetic field.

`estimate_pocket` is the filter of Munoz Diaz et al. (2017) in full, with its misprints corrected.
`smooth_pocket` (all of a recording) and `OnlinePocket` (a stream) are an iterated Kalman smoother with the local field
in its state. `fg_nav.pocket.navigate` adds steps and dead reckoning.
"""

from fg_nav.pocket.filter import PocketParameters, estimate_pocket
from fg_nav.pocket.iterated_smoother import PocketSmootherParameters, smooth_pocket
from fg_nav.pocket.online import OnlinePocket, PocketEstimate
from fg_nav.pocket.track import PocketStart, PocketTrack, compass_start, level_start

__all__ = [
    "OnlinePocket",
    "PocketEstimate",
    "PocketParameters",
    "PocketSmootherParameters",
    "PocketStart",
    "PocketTrack",
    "compass_start",
    "estimate_pocket",
    "level_start",
    "smooth_pocket",
]
