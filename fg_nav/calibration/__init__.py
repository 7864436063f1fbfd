"""What a recording shows of its own sensor and mounting. Imports no estimator.

In order: all at once and its file (`of_recording`); the magnetometer, turned over (`ellipsoid`), on a loop
(`ellipse_fit`), on a walk (`walk`), and by the walk that is navigated itself (`walk_field`); the sensor at rest
(`at_rest`); its noise (`allan`).
"""
