"""MbientLab MetaWear: CSV of MetaBase and MetaHub, one file a sensor of each session.

`epoch (ms)` (older: `epoc`) is whole ms since 1970, `elapsed (s)` the time since the first row of the file; the clock
is the first epoch and what elapsed since. Each file has a clock and a rate of its own; they are brought onto one
(`fg_nav.io.streams`). Columns are `x-axis (g)`, `(deg/s)` or `(T)`: the unit says which sensor it is. Only the file's
name says that an acceleration is linear, which is without gravity, or gravity alone: these are left out.

`<name>_<time>_<device>_Accelerometer_12.500Hz_1.4.4.csv`: what stands before the sensor is one for all of a session.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from fg_nav.columns.units import find_factor, find_quantity
from fg_nav.errors import FormatError
from fg_nav.io.choice import choose_sensor
from fg_nav.io.content import Content
from fg_nav.io.streams import NAMES, Sensor, Stream, join_streams
from fg_nav.io.text_columns import find_column, read_table, scale_values
from fg_nav.recording import RawRecording

_EPOCH = ("epoch (ms)", "epoc (ms)")
_ELAPSED = "elapsed (s)"
_LATEST = (9e12, 3e9)
"""Of the clocks, ms and s: later ones are damaged, and too large in ns for a whole number of 64 bits."""

_AXIS = re.compile(r"^([xyz])-axis \((.+)\)$")
_SENSOR = re.compile(r"[_ -]*(accelerometer|gyroscope|magnetometer)", re.IGNORECASE)
_FUSED = re.compile(r"linear|gravity|euler|quaternion|fusion", re.IGNORECASE)


def recognizes(content: Content) -> bool:
    """Whether it is a file of a session, or a folder or archive right with such files."""
    return bool(_find_files(content))


def read(content: Content) -> RawRecording:
    """Read a session.

    Raises `FormatError` if accelerometer or gyroscope is absent, a column is missing or damaged, or it is not said
    which of several sessions to take.
    """
    sessions = _sort_sessions(_find_files(content))
    if not sessions:
        raise FormatError(f"{content.path.name} holds no file of a MetaWear: export the session again.")
    session = choose_sensor(list(sessions), content.sensor, content.path, "sessions")
    files = sessions[session]
    if not content.members:
        raise _ask_for_the_rest(content, next(iter(files)))
    streams = [_read_stream(files[what], what) for what in NAMES if what in files]
    notes = (f"the session is '{session}'",) if len(sessions) > 1 else ()
    return join_streams(streams, content.path, "metawear", notes)


def _find_files(content: Content) -> list[Content]:
    """Files with the columns of a sensor, right in a folder or archive; or the file itself."""
    files = content.parts() if content.members else [content]
    return [file for file in files if not file.members and _find_sensor(file) is not None]


def _find_sensor(file: Content) -> Sensor | None:
    """Which sensor a file is of, by the unit of its axes; None for those of a filter and of others."""
    header = file.fields()
    units = {match[2] for match in map(_AXIS.match, header) if match}
    if _ELAPSED not in header or len(units) != 1 or _FUSED.search(file.path.name):
        return None
    quantity = find_quantity(units.pop())
    return None if quantity == "time" else quantity


def _sort_sessions(files: Sequence[Content]) -> Mapping[str, dict[Sensor, Content]]:
    """Files of each session by their sensor."""
    sessions: dict[str, dict[Sensor, Content]] = {}
    for file in files:
        what = _find_sensor(file)
        if what is not None:
            session = _SENSOR.split(file.path.name)[0] or "session"
            sessions.setdefault(session if _SENSOR.search(file.path.name) else "session", {})[what] = file
    return sessions


def _ask_for_the_rest(content: Content, what: Sensor) -> FormatError:
    """Say which file is needed besides, by its name if it lies beside."""
    path, other = content.path, NAMES["gyr" if what == "acc" else "acc"]
    session = _SENSOR.split(path.name)[0]
    beside = sorted(path.parent.glob("*")) if content.fetch is None and path.is_file() else []
    names = [file.name for file in beside if file.name.startswith(session) and other in file.name.lower()]
    missing = f"'{names[0]}'" if len(names) == 1 else f"the file of the {other}"
    return FormatError(
        f"{path.name} holds the {NAMES[what]} alone: put {missing} of the same session beside it, and give the folder, "
        f"or a zip of both."
    )


def _read_stream(file: Content, what: Sensor) -> Stream:
    """Samples of a file with their stamps in whole ns."""
    header, path = file.fields(), file.path
    epoch = next((name for name in _EPOCH if name in header), _EPOCH[0])
    axes = [next((name for name in header if name.startswith(f"{axis}-axis")), f"{axis}-axis") for axis in "xyz"]
    wanted = [find_column(name, header, path) for name in (epoch, _ELAPSED, *axes)]
    table, row = read_table(file, header, wanted, first_line=2)
    factor = find_factor(what, axes[0].split("(", 1)[1].rstrip(")"))
    whole = (np.abs(table[:, :2]) < _LATEST).all(axis=1)
    table, row = table[whole], row[whole]
    if not len(row) or factor is None:
        raise FormatError(f"{path.name} has no row with both clocks: export it again.")
    t = np.rint(table[0, 0] * 1e6).astype(np.int64) + np.rint(table[:, 1] * 1e9 - table[0, 1] * 1e9).astype(np.int64)
    return Stream(what, t, scale_values(table[:, 2:], factor), row, path.name)
