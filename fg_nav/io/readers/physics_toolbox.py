"""Physics Toolbox Sensor Suite (Vieyra Software), Android: a row whenever any sensor has a new sample.

============== ================================================
`time`         s since the start
`gFx gFy gFz`  specific force, g
`ax ay az`     m/s^2, **without gravity**
`wx wy wz`     rad/s
`Bx By Bz`     uT
============== ================================================

The first line is often empty, and each ends in a separator. In a row only one sensor is new, the others hold their last
sample, 0 before the first: what changed is taken, each sensor at its own times.
"""

from __future__ import annotations

import numpy as np

from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.content import Content
from fg_nav.io.delimited import Header, find_header
from fg_nav.io.streams import Sensor, Stream, join_streams, keep_changes
from fg_nav.io.text_columns import scale_values
from fg_nav.recording import RawRecording

_SENSORS: tuple[tuple[Sensor, str, float], ...] = (("acc", "gF", GRAVITY_M_S2), ("gyr", "w", 1.0), ("mag", "B", 1.0))


def recognizes(content: Content) -> bool:
    """Whether a header has `time` and the axes of a sensor, in g or at the end of each line a separator."""
    header = _find_header(content)
    if header is None:
        return False
    return "gFx" in header or (not header.names[-1] and any(f"{name}x" in header for _, name, _ in _SENSORS))


def _find_header(content: Content) -> Header | None:
    return find_header(content, lambda names: "".join(names[:1]).lower() == "time" and not _AXES.isdisjoint(names))


_AXES = {"gFx", "ax", "wx", "Bx"}


@np.errstate(over="ignore", invalid="ignore")  # of numbers that a damaged file may hold
def read(content: Content) -> RawRecording:
    """Read a recording.

    Raises `FormatError` if acceleration with gravity or rotation are absent, or a field is no number.
    """
    path, header = content.path, _find_header(content)
    if header is None:
        raise FormatError(f"{path.name} has no header with 'time' and gFx, wx or Bx: record it again.")
    if "gFx" not in header and "ax" in header:
        raise FormatError(
            f"{path.name} holds ax, ay, az, from which gravity has been removed: record the g-force (gFx ..) along."
        )
    streams = []
    for what, name, unit in _SENSORS:
        if f"{name}x" in header:
            values, row = header.read(content, [header.names[0], *(f"{name}{axis}" for axis in "xyz")])
            stream = Stream(what, values[:, 0], scale_values(values[:, 1:], unit), row, name)
            streams.append(keep_changes(stream))
    return join_streams(streams, path, "physics-toolbox")
