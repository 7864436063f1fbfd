"""Sensor Logger (Kelvin Choi): a table a sensor in a folder or zip archive, `time,seconds_elapsed,z,y,x`.

============================= ===================================================== ===================================
table                         on Android, or standardised                           on an iPhone
============================= ===================================================== ===================================
`TotalAcceleration`           specific force, m/s^2                                 absent
`Accelerometer`               without gravity, m/s^2                                the same with the sign turned
`Gravity`                     m/s^2, up is +                                        the same with the sign turned
`AccelerometerUncalibrated`   specific force, m/s^2                                 g, with the sign turned
`Gyroscope`, `..Uncalibrated` rad/s                                                 rad/s
`Magnetometer`, `..`          uT                                                    uT
`Barometer`                   `pressure` hPa, `relativeAltitude`                    the same
============================= ===================================================== ===================================

`time` is in whole ns since 1970. `Metadata.csv` names the platform and whether units and signs were standardised, to
those of Android. Where it is absent, an uncalibrated accelerometer that reads 1 at rest is that of an iPhone. The sign
cannot be told from motion: mirrored forces fit a mirrored world. Source: UNITS.md, COORDINATES.md, CROSSPLATFORM.md
of tszheichoi/awesome-sensor-logger.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.content import Content
from fg_nav.io.delimited import find_header, has_rows
from fg_nav.io.streams import Sensor, Stream, interpolate_rows, join_streams
from fg_nav.io.text_columns import scale_values
from fg_nav.recording import RawRecording
from fg_nav.samples.plausibility import measure_rest_acc

_WHAT: dict[str, Sensor] = {
    "totalacceleration": "acc", "accelerometer": "acc", "gravity": "acc", "accelerometeruncalibrated": "acc",
    "gyroscope": "gyr", "gyroscopeuncalibrated": "gyr", "magnetometer": "mag", "magnetometeruncalibrated": "mag",
    "barometer": "pressure",
}  # fmt: skip
"""Tables that are read, by the name of the file in lower case."""

_YES = ("true", "1", "yes", "on")

UNCALIBRATED_FIELD = "the magnetometer is uncalibrated: the field of the phone is still in it"

HPA = 100.0  # Pa.
_MAX_FORCE_IN_G = 3.0  # A sensor at rest reads 1 in g, and 9.8 in m/s^2.


def recognizes(content: Content) -> bool:
    """Whether it is a table with `time`, `seconds_elapsed` and axes, or a folder or archive right in which one is."""
    return bool(_find_tables(content))


@np.errstate(over="ignore", invalid="ignore")  # of numbers that a damaged file may hold
def read(content: Content) -> RawRecording:
    """Read a recording.

    Raises `FormatError` if accelerometer with gravity or gyroscope are absent, the platform cannot be known where the
    sign depends on it, or a field is no number.
    """
    path, tables = content.path, _find_tables(content)
    metadata = _read_metadata(content)
    notes: list[str] = []
    if not content.members:
        raise FormatError(f"{path.name} is one sensor of Sensor Logger: give the folder or zip with all of them.")
    streams = {name: _read_stream(name, table) for name, table in tables.items()}
    chosen = [_find_force(streams, metadata, content, notes), *_find_others(streams, notes)]
    device = metadata.get("device name", "")
    if device:
        notes.insert(0, f"recorded by Sensor Logger {metadata.get('appversion', '')} on {device}")
    return join_streams([stream for stream in chosen if stream is not None], path, "sensor-logger", notes)


def _find_tables(content: Content) -> dict[str, Content]:
    """Tables of sensors right in a folder or archive, or the file itself, by their name in lower case."""
    files: Iterable[tuple[str, Content]] = content.members.items() or [(content.path.name, content)]
    named = {place.lower().split(".")[0]: table for place, table in files if "/" not in place}
    return {name: table for name, table in named.items() if name in _WHAT and _is_table(table) and has_rows(table)}


def find_begin(content: Content) -> float:
    """`seconds_elapsed` of the first sample, which is time 0 of the recording; 0 without such tables."""
    first = []
    for table in _find_tables(content).values():
        header = find_header(table, lambda names: "seconds_elapsed" in names)
        assert header is not None, "recognized by it"
        first.append(float(header.read(table, ["seconds_elapsed"])[0][0, 0]))
    return min(first, default=0.0)


def _is_table(table: Content) -> bool:
    fields = set(table.fields())
    return {"time", "seconds_elapsed"} <= fields and ({"x", "y", "z"} <= fields or "pressure" in fields)


def _read_metadata(content: Content) -> dict[str, str]:
    """First row of `Metadata.csv` by the names of its columns, in lower case."""
    table = next((table for place, table in content.members.items() if place.lower() == "metadata.csv"), None)
    if table is None or len(table.lines) < 2:
        return {}
    return {name.lower(): value for name, value in zip(table.fields(0), table.fields(1), strict=False)}


def _read_stream(name: str, table: Content) -> Stream:
    header = find_header(table, lambda names: "seconds_elapsed" in names)
    assert header is not None, "recognized by it"
    is_air = _WHAT[name] == "pressure"
    values, row = header.read(table, ["time", *(["pressure"] if is_air else "xyz")])
    stamps = header.read_integers(table, "time", row)
    if stamps is None:
        whole = np.abs(values[:, 0]) < 2.0**63
        values, row = values[whole], row[whole]
        stamps = np.rint(values[:, 0]).astype(np.int64)
    return Stream(_WHAT[name], stamps, values[:, 1:] * (HPA if is_air else 1.0), row, table.path.name)


def _find_force(
    streams: dict[str, Stream], metadata: dict[str, str], content: Content, notes: list[str]
) -> Stream | None:
    """Specific force, m/s^2: measured in whole, or without gravity and gravity again."""
    if "totalacceleration" in streams:
        notes.append("specific force is TotalAcceleration")
        return streams["totalacceleration"]
    raw = streams.get("accelerometeruncalibrated")
    in_g = raw is not None and _rest(raw) < _MAX_FORCE_IN_G
    if {"accelerometer", "gravity"} <= streams.keys():
        linear, gravity = streams["accelerometer"], streams["gravity"]
        whole = replace(linear, xyz=linear.xyz + interpolate_rows(gravity, linear.t))
        sign = _sign_by(whole, raw, in_g) if raw is not None else _sign_said(metadata, content)
        notes.append(f"specific force is {'-' if sign < 0 else ''}(Accelerometer + Gravity)" + _of_phone(sign))
        return replace(whole, xyz=sign * whole.xyz)
    if raw is not None:
        notes.append(f"specific force is {'-9.80665 * ' if in_g else ''}AccelerometerUncalibrated" + _of_phone(-in_g))
        return replace(raw, xyz=scale_values(raw.xyz, -GRAVITY_M_S2)) if in_g else raw
    if "accelerometer" in streams:
        raise FormatError(
            f"{content.path.name} holds Accelerometer.csv, from which gravity has been removed, and no Gravity.csv, "
            f"TotalAcceleration.csv or AccelerometerUncalibrated.csv: record one of these along."
        )
    return None


def _of_phone(sign: float) -> str:
    return ", as an iPhone has the sign turned" if sign < 0 else ""


def _rest(stream: Stream) -> float:
    """Size of the acceleration in the stillest moments, in the unit of the file; NaN without any."""
    return measure_rest_acc(stream.xyz, float(np.median(np.diff(stream.t))) * 1e-9 if len(stream.t) > 1 else np.nan)


def _sign_by(whole: Stream, raw: Stream, in_g: bool) -> float:
    """Sign that makes specific force of the sum, from what the uncalibrated accelerometer has along it."""
    along = np.nansum(whole.xyz * interpolate_rows(raw, whole.t))
    return float(np.sign(along) * (-1.0 if in_g else 1.0)) or 1.0


def _sign_said(metadata: dict[str, str], content: Content) -> float:
    """Sign that makes specific force of the sum, from what `Metadata.csv` says."""
    platform = metadata.get("platform", "").lower()
    if platform not in ("ios", "android"):
        raise FormatError(
            f"{content.path.name} does not say whether it is of an iPhone or of an Android phone, whose signs differ: "
            f"add the Metadata.csv of the recording (a column 'platform' with ios or android)."
        )
    standardised = metadata.get("standardisation", metadata.get("standardization", "")).lower() in _YES
    return -1.0 if platform == "ios" and not standardised else 1.0


def _find_others(streams: dict[str, Stream], notes: list[str]) -> list[Stream | None]:
    """Gyroscope and magnetometer, calibrated before uncalibrated, and barometer."""
    gyr, mag = streams.get("gyroscope"), streams.get("magnetometer")
    if gyr is None and "gyroscopeuncalibrated" in streams:
        gyr = streams["gyroscopeuncalibrated"]
        notes.append("the gyroscope is uncalibrated: its bias is still in it")
    if mag is None and "magnetometeruncalibrated" in streams:
        mag = streams["magnetometeruncalibrated"]
        notes.append(UNCALIBRATED_FIELD)
    return [gyr, mag, streams.get("barometer")]
