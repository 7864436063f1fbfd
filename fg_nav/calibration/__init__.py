"""What a recording tells about its own sensor and mounting. Knows nothing of estimators."""

from fg_nav.calibration.rolling_lever import RollingLever, RollingLeverParameters, rolling_lever

__all__ = ["RollingLever", "RollingLeverParameters", "rolling_lever"]
