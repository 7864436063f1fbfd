"""x-io sensors (NGIMU, x-IMU3): CSV whose header carries the units, `Gyroscope X (deg/s)`: a table as any.

The x-IMU3 writes a folder: `Inertial.csv` has force and rate, `Magnetometer.csv` the field at a rate of its own. A
magnetometer in arbitrary units (`a.u.`) is left out, with a note.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from fg_nav.errors import FormatError
from fg_nav.io.content import Content
from fg_nav.io.readers import table
from fg_nav.io.readers.tables import find_single, read_stream
from fg_nav.io.streams import Stream, join_streams
from fg_nav.recording import RawRecording

_AXIS = re.compile(r"(gyroscope|accelerometer|magnetometer)\s+[xyz]\b", re.IGNORECASE)


def recognizes(content: Content) -> bool:
    """Whether the first line names a gyroscope or accelerometer axis as x-io does; a folder or archive, both parts."""
    if content.members:
        return None not in _find_parts(content)
    return not _name_sensors(content).isdisjoint({"gyroscope", "accelerometer"})


def _name_sensors(content: Content) -> set[str]:
    return {match[1].lower() for match in map(_AXIS.match, content.fields()) if match}


def read(content: Content) -> RawRecording:
    """Read an x-io CSV, or the folder of an x-IMU3.

    Raises `FormatError` if a column is missing or doubled, has no known unit, or a field is no number.
    """
    if not content.members:
        return table.read(content, "xio")
    inertial, magnetic = _find_parts(content)
    field = None if magnetic is None else find_single(magnetic)
    if inertial is None or magnetic is None or field is None:
        raise FormatError(f"{content.path.name} has no Inertial.csv beside Magnetometer.csv: give the one that it has.")
    raw, mag = table.read(inertial, "xio"), read_stream(field)
    if np.isnan(mag.xyz).all():
        notes = (f"{magnetic.path.name} is in arbitrary units and was left out",)
        return replace(raw, provenance=replace(raw.provenance, path=content.path, notes=notes))
    name = inertial.path.name
    streams = [Stream("acc", raw.t, raw.acc, raw.row, name), Stream("gyr", raw.t, raw.gyr, raw.row, name), mag]
    return join_streams(streams, content.path, "xio")


def _find_parts(content: Content) -> tuple[Content | None, Content | None]:
    """Files right in a folder or archive with force and rate, and with the field; None where there is not one."""
    found: dict[frozenset[str], list[Content]] = {}
    for file in content.parts():
        found.setdefault(frozenset(_name_sensors(file)), []).append(file)
    kinds = frozenset({"gyroscope", "accelerometer"}), frozenset({"magnetometer"})
    inertial, magnetic = (found[kind][0] if len(found.get(kind, ())) == 1 else None for kind in kinds)
    return inertial, magnetic
