"""What a recording shows of its own sensor and mounting. Imports no estimator.

In order: all at once and its file; the magnetometer, turned over, on a loop, on a walk; the sensor at rest; its noise.
"""

from fg_nav.calibration.at_rest import AccelerometerCalibration
from fg_nav.calibration.ellipse import Ellipse
from fg_nav.calibration.ellipse_fit import calibrate_on_loop
from fg_nav.calibration.ellipsoid import fit_ellipsoid, fit_unit_sphere
from fg_nav.calibration.magnetometer import MagnetometerCalibration, circular_sd_deg, correct_field
from fg_nav.calibration.of_recording import METHODS, Calibration, calibrate, read_calibration, write_calibration
from fg_nav.calibration.stride_readings import StrideReadings, read_strides
from fg_nav.calibration.walk import (
    Spread,
    WalkCalibrationParameters,
    calibrate_on_walk,
    find_level_iron,
    measure_spread,
)

__all__ = [
    "METHODS",
    "AccelerometerCalibration",
    "Calibration",
    "Ellipse",
    "MagnetometerCalibration",
    "Spread",
    "StrideReadings",
    "WalkCalibrationParameters",
    "calibrate",
    "calibrate_on_loop",
    "calibrate_on_walk",
    "circular_sd_deg",
    "correct_field",
    "find_level_iron",
    "fit_ellipsoid",
    "fit_unit_sphere",
    "measure_spread",
    "read_calibration",
    "read_strides",
    "write_calibration",
]
