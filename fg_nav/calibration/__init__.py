"""What a recording tells about its own sensor and mounting. Knows nothing of estimators.

In order: all at once and its file; the magnetometer, turned over, on a loop, on a walk; the sensor at rest; its noise;
where it sits on the shoe.
"""

from fg_nav.calibration.allan import AllanCurve, NoiseFit, NoisePart, allan_curve, fit_noise
from fg_nav.calibration.at_rest import (
    AccelerometerCalibration,
    GyroscopeCalibration,
    RecordingNoise,
    SensorNoise,
    accelerometer_at_rest,
    gyroscope_at_rest,
    recording_noise,
)
from fg_nav.calibration.ellipse import Ellipse
from fg_nav.calibration.ellipse_fit import ellipse_of_walk, fitted_ellipse
from fg_nav.calibration.ellipsoid import fitted_ellipsoid, unit_sphere
from fg_nav.calibration.file import Calibration, read_calibration, write_calibration
from fg_nav.calibration.magnetometer import MagnetometerCalibration, circular_sd_deg, corrected_field
from fg_nav.calibration.of_recording import METHODS, Effect, Found, calibrate
from fg_nav.calibration.rolling_lever import RollingLever, estimate_lever
from fg_nav.calibration.walk import (
    Spread,
    WalkCalibrationParameters,
    calibrate_on_walk,
    level_iron,
    spread_out_of_sample,
)

__all__ = [
    "METHODS",
    "AccelerometerCalibration",
    "AllanCurve",
    "Calibration",
    "Effect",
    "Ellipse",
    "Found",
    "GyroscopeCalibration",
    "MagnetometerCalibration",
    "NoiseFit",
    "NoisePart",
    "RecordingNoise",
    "RollingLever",
    "SensorNoise",
    "Spread",
    "WalkCalibrationParameters",
    "accelerometer_at_rest",
    "allan_curve",
    "calibrate",
    "calibrate_on_walk",
    "circular_sd_deg",
    "corrected_field",
    "ellipse_of_walk",
    "estimate_lever",
    "fit_noise",
    "fitted_ellipse",
    "fitted_ellipsoid",
    "gyroscope_at_rest",
    "level_iron",
    "read_calibration",
    "recording_noise",
    "spread_out_of_sample",
    "unit_sphere",
    "write_calibration",
]
