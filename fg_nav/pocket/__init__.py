"""Sensor in a trouser pocket: no stance to lean on, so orientation and gyro bias come from gravity and from the field.

`estimate_pocket` is the filter of Munoz Diaz et al. (2017) in full, by default with its misprints corrected.
`smooth_pocket` (all of a recording) and `OnlinePocket` (as it comes) are a graph with a local field as a variable.
"""

from fg_nav.pocket.ekf import estimate_pocket
from fg_nav.pocket.graph_parameters import PocketGraphParameters
from fg_nav.pocket.online import OnlinePocket, PocketEstimate, follow_pocket
from fg_nav.pocket.parameters import PocketParameters
from fg_nav.pocket.presets import PRESETS, pocket_parameters
from fg_nav.pocket.smoother import smooth_pocket
from fg_nav.pocket.start import PocketStart, compass_start, level_start
from fg_nav.pocket.track import PocketTrack

__all__ = [
    "PRESETS",
    "OnlinePocket",
    "PocketEstimate",
    "PocketGraphParameters",
    "PocketParameters",
    "PocketStart",
    "PocketTrack",
    "compass_start",
    "estimate_pocket",
    "follow_pocket",
    "level_start",
    "pocket_parameters",
    "smooth_pocket",
]
