"""phyphox (RWTH Aachen): CSV of a phone's sensors, one table a sensor, in a folder, a zip archive, or one file.

========================================= =================================================================
`"Time (s)"`                              s since the start of the experiment, for each sensor its own
`Acceleration x (m/s^2)`                  specific force; phyphox turns the iPhone's sign, so up is + on both
`Linear Acceleration x (m/s^2)`           without gravity: of no use here
`Gyroscope x (rad/s)`                     rad/s
`Magnetic field x (µT)`                   uT
`Pressure (hPa)`                          of the air, hPa
`X (m/s^2)`, `X (rad/s)`, `X (µT)`        newer header: the unit says the sensor, the name of the file "Linear"
`meta/device.csv`, `meta/time.csv`        phone and app; when the experiment was started and paused
========================================= =================================================================

Fields are separated by comma, semicolon or tab, with a decimal point or comma, as the user chose; short columns end in
NaN. Pauses are left out of the time of the experiment: here they are put back, as gaps.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.units import find_factor, find_quantity
from fg_nav.errors import FormatError
from fg_nav.io.content import Content
from fg_nav.io.delimited import Header, find_header, guess_separator, has_rows, split_line
from fg_nav.io.streams import NAMES, Sensor, Stream, join_streams
from fg_nav.io.text_columns import scale_values
from fg_nav.recording import RawRecording

_TIME = re.compile(r"Time \((\w+)\)")
_Column = Literal["acc", "gyr", "mag", "linear", "other"]
_SENSORS: dict[str, _Column] = {
    "Acceleration": "acc", "Accelerometer": "acc", "Linear Acceleration": "linear", "Linear Accelerometer": "linear",
    "Gyroscope": "gyr", "Magnetic field": "mag", "Magnetometer": "mag",
}  # fmt: skip
_PRESSURE = re.compile(r"(?:Pressure|P) ?\((\w+)\)")
_COLUMN = re.compile(rf"(?:({'|'.join(_SENSORS)}) ([xyz])|([XYZ])) ?\((.+)\)")

_LATE_S = 1.0  # A sensor delivers its last samples within this time of the end.


def recognizes(content: Content) -> bool:
    """Whether it is a table with a time and a sensor of phyphox, or a folder or archive right in which one is."""
    return any(_find_columns(table) for table in _tables(content))


@np.errstate(over="ignore", invalid="ignore")  # of numbers that a damaged file may hold
def read(content: Content) -> RawRecording:
    """Read an experiment.

    Raises `FormatError` if accelerometer with gravity or gyroscope are absent, a unit is not known, a field is no
    number, or the tables are of several experiments.
    """
    path, notes = content.path, _describe_device(content)
    streams: dict[Sensor, Stream] = {}
    linear = False
    for table in _tables(content):
        for stream in _read_table(table):
            if stream is None:
                linear = True
            elif stream.what in streams:
                raise FormatError(
                    f"{path.name} holds two tables of the {NAMES[stream.what]} ({streams[stream.what].source}, "
                    f"{stream.source}): give a folder with those of one experiment."
                )
            else:
                streams[stream.what] = stream
    if linear and "acc" not in streams:
        raise FormatError(
            f"{path.name} holds linear acceleration only, from which gravity has been removed: "
            f"record 'Acceleration (with g)' and the gyroscope."
        )
    if len(streams) == 1 and not content.members:
        name = NAMES[next(iter(streams))]
        raise FormatError(f"{path.name} holds the {name} only: give the folder or zip with the files of all sensors.")
    events = _read_events(content)
    joined = [_put_pauses_back(stream, events, notes) for stream in streams.values()]
    return join_streams(joined, path, "phyphox", notes)


def _tables(content: Content) -> list[Content]:
    """The file itself, or those right in a folder or archive."""
    return [table for place, table in content.members.items() if "/" not in place] if content.members else [content]


def _find_columns(table: Content) -> Header | None:
    """Header of a table of phyphox: a time first, then a sensor's axes."""
    header = find_header(table, _is_header)
    return header if header is not None and header.line == 0 else None


def _is_header(names: list[str]) -> bool:
    is_sensor = len(names) > 3 and any(map(_COLUMN.fullmatch, names[1:]))
    return bool(names and _TIME.fullmatch(names[0])) and (is_sensor or any(map(_PRESSURE.fullmatch, names[1:])))


def _read_table(table: Content) -> Iterator[Stream | None]:
    """Streams of a table; None for one from which gravity has been removed."""
    header = _find_columns(table)
    if header is None or not has_rows(table):
        return
    groups: dict[_Column, list[tuple[str, str, str]]] = {}
    for name in header.names:
        match = _COLUMN.fullmatch(name)
        if match:
            axis = (match[2] or match[3]).lower()
            groups.setdefault(_find_sensor(match[1], match[4], table), []).append((axis, name, match[4]))
    for name in header.names:
        match = _PRESSURE.fullmatch(name)
        if match and find_factor("pressure", match[1]):
            yield _read_stream(table, header, "pressure", [("", name, match[1])])
    for what, columns in groups.items():
        if what == "linear":
            yield None
        elif what != "other" and [axis for axis, _, _ in sorted(columns)] == ["x", "y", "z"]:
            yield _read_stream(table, header, what, sorted(columns))


def _find_sensor(word: str | None, unit: str, table: Content) -> _Column:
    """Sensor of a column by its word, or by its unit and the name of the file in the newer header."""
    if word is not None:
        return _SENSORS[word]
    quantity = find_quantity(unit)
    if quantity == "acc" and "linear" in table.path.name.lower():
        return "linear"
    return "other" if quantity is None or quantity == "time" or quantity == "pressure" else quantity


def _read_stream(table: Content, header: Header, what: Sensor, columns: list[tuple[str, str, str]]) -> Stream:
    clock = header.names[0]
    match = _TIME.fullmatch(clock)
    factors = [find_factor("time", match[1] if match else "s"), *(find_factor(what, unit) for _, _, unit in columns)]
    if None in factors:
        raise FormatError(f"{table.path.name} has a unit that is not known in '{columns[0][1]}': export it again.")
    values, row = header.read(table, [clock, *(name for _, name, _ in columns)])
    values = scale_values(values, np.array(factors, dtype=np.float64))
    return Stream(what, values[:, 0], values[:, 1:], row, table.path.name)


def _read_meta(content: Content, name: str) -> list[list[str]]:
    """Rows of a table in `meta/`, below its header."""
    table = content.members.get(f"meta/{name}")
    return [split_line(line, guess_separator(line)) for line in table.lines[1:]] if table else []


def _describe_device(content: Content) -> list[str]:
    said = {row[0]: row[1] for row in _read_meta(content, "device.csv") if len(row) > 1}
    model = " ".join(said[key] for key in ("deviceBrand", "deviceModel") if said.get(key))
    return [f"recorded by phyphox {said.get('version', '')} on {model}"] if model else []


def _read_events(content: Content) -> list[tuple[str, float, float]]:
    """Starts and pauses: what, s of the experiment, s of the system's clock."""
    events = []
    for row in _read_meta(content, "time.csv"):
        try:
            events.append((row[0], float(row[1].replace(",", ".")), float(row[2].replace(",", "."))))
        except (ValueError, IndexError):
            return []
    return events


def _put_pauses_back(stream: Stream, events: list[tuple[str, float, float]], notes: list[str]) -> Stream:
    """Stamps as if the experiment's clock had gone on in its pauses."""
    if not events:
        return stream
    last = events[-1][1] if events[-1][0] == "PAUSE" else np.inf
    end = max(stream.t[np.isfinite(stream.t)].tolist(), default=0.0)
    if end > last + _LATE_S:
        raise FormatError(
            f"{stream.source} lasts {end:.1f} s, but meta/time.csv says {last:.1f} s: give the files of one experiment."
        )
    t: Floats = np.asarray(stream.t, dtype=np.float64).copy()
    for at, pause in _list_pauses(events):
        t[stream.t > at] += pause
        words = f"paused for {pause:.1f} s at {at:.1f} s: a gap"
        notes.extend([words] if words not in notes else [])
    return replace(stream, t=t)


def _list_pauses(events: list[tuple[str, float, float]]) -> list[tuple[float, float]]:
    """Pauses: when in the experiment, s, and how long, s."""
    pairs = [(after[1], after[2] - before[2]) for before, after in pairwise(events) if before[0] == "PAUSE"]
    return [(at, pause) for at, pause in pairs if 0.0 < pause < 1e6]


def put_pauses_back(content: Content, t: Floats) -> Floats:
    """Stamps (N,) s of another table of an experiment, as if its clock had gone on in its pauses."""
    pauses = _list_pauses(_read_events(content))
    return np.asarray(t + sum((np.where(t > at, pause, 0.0) for at, pause in pauses), np.zeros(len(t))))
