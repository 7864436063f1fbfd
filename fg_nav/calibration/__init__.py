"""Errors of a recording's own sensor and mounting. Imports no estimator.

All at once and their file (`of_recording`); the magnetometer turned over and on a loop (`ellipsoid`), on a walk
(`walk`, with `walk_model`); gyroscope and accelerometer (`inertial`).
"""
