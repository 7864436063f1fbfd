"""What a recording tells about its own sensor and mounting. Knows nothing of estimators."""

from fg_nav.calibration.ellipse import Ellipse, EllipseParameters, ellipse_of_walk, fitted_ellipse
from fg_nav.calibration.ellipsoid import EllipsoidParameters, fitted_ellipsoid
from fg_nav.calibration.rolling_lever import RollingLever, RollingLeverParameters, rolling_lever
from fg_nav.calibration.unit_sphere import unit_sphere

__all__ = [
    "Ellipse",
    "EllipseParameters",
    "EllipsoidParameters",
    "RollingLever",
    "RollingLeverParameters",
    "ellipse_of_walk",
    "fitted_ellipse",
    "fitted_ellipsoid",
    "rolling_lever",
    "unit_sphere",
]
