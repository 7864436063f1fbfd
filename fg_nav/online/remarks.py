"""What is said of the samples of a stream that are left out or bridged, and of its stamps that are changed."""

from __future__ import annotations

from fg_nav.recording import MAX_GAP_S

UNKNOWN_GAP_S = 60.0
"""A gap of unknown length is taken for so long: a sensor is switched off and on, or starts again, in less. The heading
is lost in it."""

REMARKS = {
    "missing": "samples are missing (empty, NaN or out of any range) and left out",
    "gyr": "samples of the gyroscope are far off what those around allow, and not used",
    "acc": "samples of the accelerometer are far off what those around allow, and not used",
    "mag": "samples of the magnetometer are far off what those around allow, and not used",
    "repeated": "stamps repeat the one before, and their samples are left out",
    "backward": "stamps are before the last one, and their samples are left out",
    "ahead": "stamps are far ahead of those around them, and their samples are left out",
    "restart": "the clock of the sensor restarted with nothing missing, and its stamps are shifted to go on",
    "rebooted": f"the clock of the sensor restarted, after a time unknown: a gap of {UNKNOWN_GAP_S:g} s is assumed",
    "gap": f"there is a gap of more than {MAX_GAP_S:g} s: the track goes on with larger sigmas",
    "set": f"the clock of the sensor was set by more than a day: a gap of {UNKNOWN_GAP_S:g} s is assumed",
    "known": "samples are in the checkpoint already and left out",
    "late": "samples that the checkpoint does not hold come before its last one, and are left out",
}
"""For each kind; what happens to samples is said the first time, what happens to stamps each time."""
