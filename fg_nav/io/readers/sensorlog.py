"""SensorLog (Bernd Thomas), iPhone: one table of all sensors, a row a sample, `accelerometerAccelerationX(G)` ...

======================================== ====================================================================
`accelerometerAcceleration`              g, **with Apple's sign**: specific force is -9.80665 times this
`motionUserAcceleration`, `motionGravity` the same split in two, g; used where the first is absent
`motionRotationRate`, `gyroRotation`     rad/s, the first without the bias
`motionMagneticField`, `magnetometer`    uT, the first without the phone's own field; 0 until it is calibrated
`...Timestamp_sinceReboot(s)`            s, of each sensor its own
======================================== ====================================================================

`loggingTime(txt)` is when the row was written, and jitters. Rows repeat a sensor's sample until there is a new one.
"""

from __future__ import annotations

import re

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.content import Content
from fg_nav.io.delimited import Header, find_header
from fg_nav.io.readers.sensor_logger import UNCALIBRATED_FIELD
from fg_nav.io.streams import Sensor, Stream, join_streams
from fg_nav.io.text_columns import scale_values
from fg_nav.recording import RawRecording

_ACC = ("accelerometerAcceleration", "accelerometer")
_MOTION = "motion"


def recognizes(content: Content) -> bool:
    """Whether a header has the stamps of a sensor since the phone's start."""
    return _find_header(content) is not None


def _find_header(content: Content) -> Header | None:
    return find_header(content, lambda names: any("Timestamp_sinceReboot" in name for name in names))


@np.errstate(over="ignore", invalid="ignore")  # of numbers that a damaged file may hold
def read(content: Content) -> RawRecording:
    """Read a recording.

    Raises `FormatError` if acceleration with gravity or rotation are absent, or a field is no number.
    """
    header, notes = _find_header(content), []
    if header is None:
        raise FormatError(
            f"{content.path.name} has no column of stamps '..Timestamp_sinceReboot(s)': log it as CSV again."
        )
    table = _Table(content, header)
    gyr = table.read("gyr", "motionRotationRate", "motion")
    if gyr is None:
        gyr = table.read("gyr", "gyroRotation", "gyro")
        notes += ["the gyroscope is as measured: its bias is still in it"] if gyr is not None else []
    mag = table.read("mag", "motionMagneticField", "motion")
    if mag is None or not mag.xyz.any():
        mag = table.read("mag", "magnetometer", "magnetometer")
        notes += [UNCALIBRATED_FIELD] if mag is not None else []
    streams = [table.read_force(notes), gyr, mag]
    return join_streams([stream for stream in streams if stream is not None], content.path, "sensorlog", notes)


class _Table:
    """Columns of a file by the words before their unit."""

    def __init__(self, content: Content, header: Header) -> None:
        self.content, self.header = content, header
        self.names = {re.sub(r"\(.*\)$", "", name): name for name in header.names}

    def read(self, what: Sensor, quantity: str, clock: str, *others: str) -> Stream | None:
        """Read a sensor on its clock, as the sum of quantities; None where one of them is absent."""
        wanted = [f"{clock}Timestamp_sinceReboot", *(f"{name}{axis}" for name in (quantity, *others) for axis in "XYZ")]
        if not set(wanted) <= self.names.keys():
            return None
        values, row = self.header.read(self.content, [self.names[name] for name in wanted])
        xyz: Floats = values[:, 1:].reshape(len(values), -1, 3).sum(axis=1)
        new = np.concatenate(([True], np.diff(values[:, 0]) != 0))
        return Stream(what, values[new, 0], xyz[new], row[new], quantity)

    def read_force(self, notes: list[str]) -> Stream | None:
        """Read specific force."""
        stream, words = self.read("acc", *_ACC), "accelerometerAcceleration"
        if stream is None:
            stream = self.read("acc", "motionUserAcceleration", _MOTION, "motionGravity")
            words = "(motionUserAcceleration + motionGravity)"
        if stream is None:
            if "motionUserAccelerationX" in self.names:
                raise FormatError(
                    f"{self.content.path.name} holds motionUserAcceleration, from which gravity has been removed: "
                    f"log accelerometerAcceleration or motionGravity along."
                )
            return None
        notes.append(f"specific force is -9.80665 * {words}, as an iPhone has the sign turned")
        return Stream("acc", stream.t, scale_values(stream.xyz, -GRAVITY_M_S2), stream.row, stream.source)
