"""HyperIMU (HIMU, ianovir), Android: lines that begin with `@`, then columns named after the phone's chips.

Columns are `<chip or sensor>.x`, m/s^2, rad/s and uT; `timestamp` is in ms since 1970 where the user wanted one. Else
there is only `Sampling Time: 50ms` or `Sampling Rate: 100ms` in the second line, which the phone keeps to a few
milliseconds: the time is then the row number over it, unless the rate is given.
"""

from __future__ import annotations

import re

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import FormatError
from fg_nav.io.content import Content
from fg_nav.io.delimited import Header, find_header
from fg_nav.io.streams import Sensor, Stream, join_streams
from fg_nav.recording import RawRecording

_NAME = re.compile(r"HyperIMU|HIMU|ianovir", re.IGNORECASE)
_AXIS = re.compile(r"(.+)\.([xyz])")
_STEP = re.compile(r"Sampling (?:Time|Rate)\s*:\s*(\d+(?:\.\d+)?)\s*ms", re.IGNORECASE)
_REMOVED = re.compile(r"linear|gravity|rotation|orient|uncal", re.IGNORECASE)
_CHIPS: dict[Sensor, re.Pattern[str]] = {
    "gyr": re.compile(r"gyro|L3G|BMG", re.IGNORECASE),
    "mag": re.compile(r"magn|compass|AK0|AK8|YAS|HMC|MMC|BMM", re.IGNORECASE),
    "acc": re.compile(r"acc|LIS[23]|BMA|KX|ADXL|MMA", re.IGNORECASE),
}
"""Words for a sensor, and the beginnings of the names of chips that are nothing else."""


def recognizes(content: Content) -> bool:
    """Whether the first line is that of HyperIMU."""
    first = content.lines[0] if content.lines else ""
    return first.startswith("@") and bool(_NAME.search(first))


def read(content: Content) -> RawRecording:
    """Read a recording.

    Raises `FormatError` if accelerometer, gyroscope, time and rate are absent, or a field is no number.
    """
    path = content.path
    header = find_header(content, lambda names: any(map(_AXIS.fullmatch, names)))
    if header is None:
        raise FormatError(f"{path.name} has no columns of a sensor with axes .x, .y and .z: record it again.")
    notes: list[str] = []
    found = _find_sensors(header)
    if "acc" not in found and any("linear" in name.lower() for name in header.names):
        raise FormatError(
            f"{path.name} holds linear acceleration, from which gravity has been removed: record acceleration along."
        )
    step_s = None if "timestamp" in header else _find_step_s(content, notes)
    return join_streams(
        [_read(content, header, what, name, step_s) for what, name in found.items()], path, "hyperimu", notes
    )


def _find_sensors(header: Header) -> dict[Sensor, str]:
    """Name of each sensor's columns before the axis; the first of several."""
    found: dict[Sensor, str] = {}
    for name in header.names:
        match = _AXIS.fullmatch(name)
        if match and not _REMOVED.search(match[1]):
            what = next((what for what, words in _CHIPS.items() if words.search(match[1])), None)
            if what is not None:
                found.setdefault(what, match[1])
    return found


def _read(content: Content, header: Header, what: Sensor, name: str, step_s: float | None) -> Stream:
    axes = [f"{name}.{axis}" for axis in "xyz"]
    if step_s is not None:
        values, row = header.read(content, axes)
        return Stream(what, (row - header.line - 2).astype(np.float64) * step_s, values, row, name)
    values, row = header.read(content, ["timestamp", *axes])
    stamps = header.read_integers(content, "timestamp", row)
    t: Floats | Ints = values[:, 0] * 1e-3 if stamps is None else stamps * 1_000_000
    return Stream(what, t, np.ascontiguousarray(values[:, 1:]), row, name)


def _find_step_s(content: Content, notes: list[str]) -> float:
    if content.rate_hz is not None:
        return 1.0 / content.rate_hz
    said = next((match for match in map(_STEP.search, content.lines[:5]) if match), None)
    if said is None or not 0.1 <= float(said[1]) <= 1e4:
        raise FormatError(
            f"{content.path.name} has neither a column 'timestamp' nor a rate: give the rate it was recorded at in Hz, "
            f"such as `--rate 50`."
        )
    notes.append(
        f"there is no clock: time is the row number at the nominal {said[1]} ms, which phones exceed by some ms"
    )
    return 1e-3 * float(said[1])
