"""Xsens MT Manager: text of an MTi, MTx or MTw (Awinda), one file a sensor, below lines that begin with `//`.

=================================== ==========================================================================
`Acc_X` ...                         m/s^2
`Gyr_X` ...                         rad/s
`Mag_X` ...                         of the local field, which is 1, taken for 48 uT
`SampleTimeFine`                    0.1 ms, begins again at 864 000 000; the time, where the exporter filled it
`PacketCounter`, `Counter` (old)    begins again at 65 536; the time over the rate, where there is no other
`Update Rate: 100.0Hz`              in a line above the table; `Sample rate` in old files, in many of 2019 on none
=================================== ==========================================================================

Fields are separated by tab, comma, semicolon or a blank, as the user chose, and may be empty. A packet that was lost on
the air is missing from the counter, and so becomes a gap.
"""

from __future__ import annotations

import re

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import FormatError
from fg_nav.io.content import Content
from fg_nav.io.counters import PACKETS_16_BIT, TICKS_32_BIT, continue_counter
from fg_nav.io.delimited import Header, find_header, split_line
from fg_nav.io.readers.xsens_columns import ACC, GYR, MAG, find_inertial, scale_local_field
from fg_nav.recording import Provenance, RawRecording
from fg_nav.text import format_count

_COUNTERS = ("PacketCounter", "Counter")
_FINE = "SampleTimeFine"
_TICKS_A_DAY = 864_000_000.0
_TICK_S = 1e-4

_OWN = frozenset({"Roll", "Pitch", "Yaw", "Quat_q0", "Quat_w", "Mat[1][1]", "VelInc_X", "OriInc_q0", "OriInc_w"})
"""Columns that no DOT has: its angles are `Euler_X`, its quaternions `Quat_W`."""

_RATE = re.compile(r"(?:update|sample|sampling|output)\s+rate\s*:\s*([0-9.]+)\s*hz", re.IGNORECASE)


def recognizes(content: Content) -> bool:
    """Whether a table with a packet counter stands below lines that begin with `//`, or without a clock or commas.

    Other such tables are those of a DOT, but where columns are named as MT Manager alone does.
    """
    header = _find_header(content)
    if header is None or any("DeviceTag" in line for line in content.lines[: header.line]):
        return False
    named = not _OWN.isdisjoint(header.names)
    return content.lines[0].startswith("//") or named or header.separator != "," or not _has_clock(header, content)


def _has_clock(header: Header, content: Content) -> bool:
    """Whether the sensor's time is in the first row."""
    row = split_line(content.lines[header.line + 1], header.separator) if header.line + 1 < len(content.lines) else []
    position = header.names.index(_FINE) if _FINE in header else len(row)
    return position < len(row) and row[position].lower() not in ("", "nan")


def read(content: Content) -> RawRecording:
    """Read an export of MT Manager.

    Raises `FormatError` if there is no accelerometer, gyroscope or rate, or a field is no number.
    """
    path, header = content.path, _find_header(content)
    if header is None:
        raise FormatError(f"{path.name} has no header with PacketCounter: export it again from MT Manager.")
    inertial = find_inertial(header, path)
    clocks = [name for name in (_FINE, *_COUNTERS) if name in header]
    magnetic = MAG if set(MAG) <= set(header.names) else ()
    table, row = header.read(content, [*clocks, *inertial.acc, *inertial.gyr, *magnetic])
    ends = np.cumsum([len(clocks), 3, len(inertial.gyr)])
    clock, acc, gyr, mag = np.split(table, ends, axis=1)
    t, notes = _make_time(dict(zip(clocks, clock.T, strict=True)), len(table), content)
    acc, gyr, remarks = inertial.to_samples(acc, gyr, t)
    field, said = scale_local_field(mag, gyr)
    return RawRecording(
        t=t,
        acc=acc,
        gyr=gyr,
        mag=field,
        row=row,
        provenance=Provenance(path=path, format="xsens", notes=(*notes, *remarks, *said)),
    )


def _find_header(content: Content) -> Header | None:
    sensors = {*ACC, *GYR, *MAG, "FreeAcc_X", "Mat[1][1]", "Quat_q0", "Quat_w", "Roll", "VelInc_X"}
    counters = set(_COUNTERS)
    commented = bool(content.lines) and content.lines[0].startswith("//")
    return find_header(
        content, lambda names: not sensors.isdisjoint(names) and (commented or not counters.isdisjoint(names))
    )


def _make_time(clocks: dict[str, Floats], count: int, content: Content) -> tuple[Floats, tuple[str, ...]]:
    """Make the time (N,) s from the best clock of the file, and say which."""
    fine = clocks.get(_FINE)
    if fine is not None and np.isfinite(fine).mean() > 0.5 and np.nanmax(fine) > np.nanmin(fine):
        ticks, rounds = continue_counter(fine, _TICKS_A_DAY if np.nanmax(fine) < _TICKS_A_DAY else TICKS_32_BIT)
        return ticks * _TICK_S, _note_rounds("SampleTimeFine", rounds)
    rate_hz = _find_rate_hz(content)
    packets = next((clocks[name] for name in _COUNTERS if name in clocks and np.isfinite(clocks[name]).any()), None)
    if packets is None:
        return np.arange(count) / rate_hz, (f"there is no clock: time is the row number at {rate_hz:g} Hz",)
    packets, rounds = continue_counter(packets, PACKETS_16_BIT)
    words = f"time is the packet counter at {rate_hz:g} Hz"
    return (packets - packets[np.isfinite(packets)][0]) / rate_hz, (words, *_note_rounds("the packet counter", rounds))


def _note_rounds(what: str, rounds: int) -> tuple[str, ...]:
    return (f"{what} began again at its end {format_count(rounds, 'time')}: set on",) if rounds else ()


def _find_rate_hz(content: Content) -> float:
    if content.rate_hz is not None:
        return content.rate_hz
    said = next((match for match in map(_RATE.search, content.lines[:60]) if match), None)
    if said and 1.0 <= float(said[1]) <= 1e4:
        return float(said[1])
    raise FormatError(
        f"{content.path.name} holds packet numbers but neither time nor rate: give the rate it was recorded at in Hz, "
        f"such as `--rate 100`."
    )
