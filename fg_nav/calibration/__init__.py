"""Errors of a recording's own sensor and mounting. Imports no estimator.

All at once and their file (`of_recording`); the magnetometer turned over (`ellipsoid`), on a loop (`ellipse`), on a
walk (`walk`, with `walk_model` and `walk_fit`); gyroscope and accelerometer (`inertial`); noise at rest (`allan`).
"""
