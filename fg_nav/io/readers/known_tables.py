"""One table of all sensors on one clock: columns, clock and unit of each sensor as its maker writes them.

SensorConnect (LORD/MicroStrain) names channels behind the sensor, `inertial-6253.76535:scaledAccelX`; those of a
filter in the sensor have `:valid` behind them. APDM exports all Opals of a session: *format 7* has three header rows,
`Format=7,5718,,,Lumbar,...` with number and name of each sensor above its columns, `Time,Accelerometer,,,...` and the
axes; the other has keys, then `Time,Lumbar/Acceleration/X,...`, then a row of units. Consensys of Shimmer has a row of
names, `Shimmer_40AC_Accel_LN_X_CAL`, and one of units; `LN` is of low noise and in the gyroscope's frame, `WR` of wide
range and another chip.

In units of the local field one is taken for that of most of Europe and North America: a path uses the direction and its
changes, not the strength.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.headers import GAUSS_UT, find_factor, find_scale, read_header
from fg_nav.columns.samples import SI_UNITS
from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io.beside import read_footprint_mat
from fg_nav.io.content import Content, choose_sensor, read_content, split_fields
from fg_nav.io.readers import table as any_table
from fg_nav.io.streams import NAMES, Sensor, continue_counter, drop_held
from fg_nav.io.tables import TextTable, find_column, find_header
from fg_nav.recording import Provenance, RawRecording
from fg_nav.samples.plausibility import find_median_strength, is_field_on_earth
from fg_nav.truth import FootprintTruth

LOCAL_FIELD = np.nan  # As a unit: that of the local field, as arbitrary ones are.
_LOCAL_FIELD_UT = 48.0  # One unit of the local field: 25 to 65 uT on Earth, 48 in most of Europe and North America.


class Axes(NamedTuple):
    """Columns of a sensor, and their unit in m/s^2, rad/s or uT, one or one an axis."""

    names: Sequence[str]
    unit: float | Floats = 1.0


Sources = Mapping[Sensor, Sequence[tuple[str, float]]]  # Of a sensor the names of its columns, axes as {}, and a unit.


def find_sensors(table: TextTable, sources: Sources) -> dict[Sensor, Axes]:
    """Return the first source of each sensor of which a column is there; a magnetometer without its x is left out."""
    found = dict[Sensor, Axes]()
    for what, known in sources.items():
        axes = [Axes([name.format(axis) for axis in "XYZ"], unit) for name, unit in known]
        there = [one for one in axes if not set(one.names[: 1 if what == "mag" else 3]).isdisjoint(table.names)]
        if there or what != "mag":
            found[what] = (there or axes)[0]
    return found


def read_sensors(
    table: TextTable, clocks: Sequence[str], sensors: Mapping[Sensor, Axes]
) -> tuple[Floats, dict[Sensor, Floats], Ints]:
    """Return columns of `clocks` (N, K) as they are, samples of each sensor in SI or uT, and lines (N,)."""
    names = [*clocks, *(name for axes in sensors.values() for name in axes.names)]
    values, row = table.read([find_column(name, table.names, table.content.path) for name in names])
    ends = np.cumsum([len(clocks), *(len(axes.names) for axes in sensors.values())])
    clock, *parts = np.split(values, ends[:-1], axis=1)
    units = [axes.unit if np.isfinite(axes.unit).all() else 1.0 for axes in sensors.values()]
    samples = {what: xyz * unit for what, xyz, unit in zip(sensors, parts, units, strict=True)}
    return clock, samples, row


def pack_samples(
    content: Content, format: str, t: Floats, samples: dict[Sensor, Floats], sensors: Mapping[Sensor, Axes], row: Ints,
    notes: Sequence[str] = (), truth: FootprintTruth | None = None,
) -> RawRecording:  # fmt: skip
    """Return the recording of what `read_sensors` gave, with stamps (N,) s; held samples of the field are NaN."""
    mag, gyr, remarks = samples.get("mag"), np.ascontiguousarray(samples["gyr"]), list(notes)
    if mag is not None and np.isnan(sensors["mag"].unit).all():
        median = find_median_strength(mag)
        said = f"the magnetometer is in units of the local field (median {median:.2f})"
        if is_field_on_earth(_LOCAL_FIELD_UT * median):
            mag = mag * _LOCAL_FIELD_UT
            remarks.append(f"{said}: 1 is taken for {_LOCAL_FIELD_UT:.0f} uT")
        else:
            mag = None
            remarks.append(f"{said}, of which it is none: left out")
    mag = None if mag is None else drop_held(mag, gyr)
    return RawRecording(t, samples["acc"], gyr, row, mag, truth, Provenance(content.path, format, tuple(remarks)))


# LORD/MicroStrain SensorConnect: raw channels before those a filter has touched

_SENSORCONNECT: Sources = {
    "acc": (("scaledAccel{}", GRAVITY_M_S2), ("estCompensatedAccel{}", 1.0)),
    "gyr": (("scaledGyro{}", 1.0), ("estAngularRate{}", 1.0)),
    "mag": (("scaledMag{}", GAUSS_UT),),
}
_CHANNEL = re.compile(r"(scaledAccel|scaledGyro|estCompensatedAccel|estAngularRate|estLinearAccel)[XYZ]$")


def find_sensorconnect(content: Content) -> TextTable | None:
    """Table with SensorConnect's channel names; newer exports put lines about the session before it."""
    return find_header(content, lambda names: any(map(_CHANNEL.search, names)))


def read_sensorconnect(content: Content) -> RawRecording:
    """Read a SensorConnect CSV, with the surveyed footprints next to it, in a MATLAB file of the same name."""
    path, full = content.path, find_sensorconnect(content) or TextTable(content, content.fields())
    table = replace(full, names=[name.split(":", 1)[1] if ":" in name else name for name in full.names])
    sensors = find_sensors(table, _SENSORCONNECT)
    axes = [(what, axis, f"{name}:valid") for what, own in sensors.items() for axis, name in enumerate(own.names)]
    flagged = [one for one in axes if one[2] in table and one[0] != "mag"]
    values, samples, row = read_sensors(table, ["Time", *(flag for _, _, flag in flagged)], sensors)
    inertial = ~np.isnan(np.hstack([samples["acc"], samples["gyr"]])).all(axis=1)
    values, row, samples = values[inertial], row[inertial], {what: xyz[inertial] for what, xyz in samples.items()}
    # what is not valid is no sample
    for flag, (what, axis, _) in zip(values[:, 1:].T, flagged, strict=True):
        samples[what][flag != 1.0, axis] = np.nan
    # footprints
    truth, notes, beside = None, tuple[str, ...](), path.with_suffix(".mat")
    if beside != path and beside.is_file():
        try:
            truth = read_footprint_mat(read_content(beside))
        except FormatError as error:
            notes = (f"the file next to it gave no truth: {error}",)
    return pack_samples(content, "sensorconnect", values[:, 0], samples, sensors, row, notes, truth)


# OpenShoe. "PC time" is that of the logging computer, s; "rate" is estimated from packet to packet, Hz.

_COLUMNS = (
    *("header", "acc X", "acc Y", "acc Z", "gyr X", "gyr Y", "gyr Z", "ticks", "checksum", "row number"),
    *("PC time 1", "PC time 2", "PC time 3", "rate", "mag X", "mag Y", "mag Z"),
)
_OPENSHOE: Sources = {"acc": (("acc {}", GRAVITY_M_S2),), "gyr": (("gyr {}", 1.0),), "mag": (("mag {}", GAUSS_UT),)}

_PACKET_DELAY_S = 0.05  # Packets come up to 15 ms late; a step of the PC's clock within this shows no lost sample.
_MAX_PAUSE_S = 1e4  # A clock that shows more was set.
_SET_HZ, _SET_SHARE = 5.0, 0.005  # Sensors are set to multiples of this rate; the median estimate is as near to it.


def _split_first(content: Content) -> list[str]:
    """Fields of the first line that is not empty."""
    return next((line.split() for line in content.lines if line.strip()), [])


def is_openshoe(content: Content) -> bool:
    """Whether the first line that is not empty begins with the packet header."""
    return [word.lower() for word in _split_first(content)[:1]] == ["0xcb"]


def read_openshoe(content: Content) -> RawRecording:
    """Read an OpenShoe recording: the sensor samples evenly, so time is the row number over the nominal rate.

    Row numbers that restart are continued by the time elapsed on the logging PC, or by one if that is within its packet
    delays; where that clock shows no time between, they are left unchanged.
    """
    path, width = content.path, len(_split_first(content))
    if width != len(_COLUMNS):
        raise FormatError(
            f"{path.name}: the first row has {width} columns, not {len(_COLUMNS)}: copy the recording again."
        )
    table = TextTable(content, _COLUMNS, first_line=1, separator=r"\s+")
    sensors = find_sensors(table, _OPENSHOE)
    clock, samples, row = read_sensors(table, ["row number", "PC time 1", "rate"], sensors)
    number, pc_s, rates = clock.T
    # nominal rate
    usable = rates[(rates >= 1.0) & (rates <= 1e5)]
    if not usable.size:
        raise FormatError(f"{path.name} holds no sample rate in column 14: export the recording as canonical CSV.")
    rate_hz = float(np.median(usable))
    nominal_hz = _SET_HZ * round(rate_hz / _SET_HZ)
    rate_hz = nominal_hz if abs(nominal_hz - rate_hz) <= _SET_SHARE * rate_hz else rate_hz
    # row numbers that begin again
    notes = []
    for at in (np.flatnonzero(np.diff(number) < 0) + 1).tolist():
        passed_s = float(pc_s[at]) - float(pc_s[at - 1])
        if 0.0 < passed_s < _MAX_PAUSE_S:
            steps = 1.0 if passed_s <= _PACKET_DELAY_S else round(passed_s * rate_hz)
            number[at:] += number[at - 1] + steps - number[at]
            words = "nothing is missing there" if steps == 1.0 else f"{passed_s:.2f} s later"
            notes.append(f"the row numbers begin again in row {row[at]}: by the computer's clock {words}")
    return pack_samples(content, "openshoe", number * (1.0 / rate_hz), samples, sensors, row, notes)


# YEI 3-Space

_YEI: Sources = {
    "acc": (("CorrectedAccel{}", GRAVITY_M_S2), ("RawAccel{}", GRAVITY_M_S2)),
    "gyr": (("CorrectedGyro{}", 1.0), ("RawGyro{}", 1.0)),
    "mag": (("CorrectedCompass{}", GAUSS_UT), ("RawCompass{}", GAUSS_UT)),
}


def find_yei(content: Content) -> TextTable | None:
    """Table below a comment with the names of its columns, `# Data format: "%int(ChipTimeUS),%float(RawGyroX),...`."""
    first = content.lines[0].lstrip() if content.lines else ""
    names = re.findall(r"%\w+\(([^)]*)\)", first) if first.startswith("#") and "Data format" in first else []
    return TextTable(content, names) if names else None


def read_yei(content: Content) -> RawRecording:
    """Read a log of the 3-Space software."""
    table = find_yei(content) or TextTable(content, [])
    sensors = find_sensors(table, _YEI)
    clock, samples, row = read_sensors(table, ["ChipTimeUS"], sensors)
    ticks, notes = continue_counter(clock[:, 0], 2.0**32, "ChipTimeUS")
    return pack_samples(content, "yei", ticks * 1e-6, samples, sensors, row, notes)


# VectorNav


def is_vectornav(content: Content) -> bool:
    """Whether the first line has VectorNav's time since startup, or its names below `IMU::`."""
    names = [name for name in content.fields() if re.match(r"(Time::)?TimeStartup\b|IMU::", name)]
    return any("TimeStartup" in name or read_header(name) for name in names)


read_vectornav = partial(any_table.read, format="vectornav")


# APDM

_QUANTITIES: dict[str, Sensor] = {
    "accelerometer": "acc", "acceleration": "acc", "gyroscope": "gyr", "angular velocity": "gyr",
    "magnetometer": "mag", "magnetic field": "mag",
}  # fmt: skip
_PATH = re.compile(r"^(?:(.*)/)?([^/]+)/([XYZ])$")


def find_apdm(content: Content) -> tuple[TextTable, Sequence[str]] | None:
    """Table of which paths are the names, `Left Foot/Acceleration/X`, and the units of its first columns, if said."""
    if "".join(content.lines[:1]).lstrip('"').startswith("Format="):
        return _name_by_rows(content), ["us"]

    def is_header(names: list[str]) -> bool:
        is_timed = bool(names) and names[0].lower().startswith("time")
        return is_timed and any(match and match[2].lower() in _QUANTITIES for match in map(_PATH.match, names))

    table = find_header(content, is_header)
    units = [] if table is None else content.fields(table.first_line - 1)
    has_units = bool(units) and find_factor("time", units[0]) is not None
    if table is None:
        return None
    return replace(table, first_line=table.first_line + has_units), units if has_units else []


def _name_by_rows(content: Content) -> TextTable:
    """Table of which the names are made of the three header rows of format 7."""
    rows = [content.fields(line) for line in range(3)]
    width = max(map(len, rows))
    names, groups, axes = ([*fields, *[""] * (width - len(fields))] for fields in rows)
    starts = [k for k in range(1, width) if groups[k].lower() == "accelerometer"]
    paths, block, group = ["Time"], "", ""
    for k in range(1, width):
        group = groups[k] or group
        if k in starts:  # of the next sensor: its name stands above, or its number alone
            above = [name for name in names[k : next((start for start in starts if start > k), width)] if name]
            words = [name for name in above if not name.isdigit()]
            block = " ".join(words or above) or f"sensor in column {k + 1}"
        paths.append(f"{block}/{group}/{axes[k]}")
    return TextTable(content, paths, first_line=4)


def read_apdm(content: Content) -> RawRecording:
    """Read one sensor of an export."""
    path = content.path
    table, said = find_apdm(content) or (TextTable(content, content.fields()), list[str]())
    units, groups = [*said, *[""] * len(table.names)], dict[str, dict[Sensor, str]]()
    for match in filter(None, map(_PATH.match, table.names)):
        what = _QUANTITIES.get(match[2].lower())
        if what is not None:
            groups.setdefault(match[1] or "", {})[what] = match[2]
    sensor = choose_sensor(list(groups), content.sensor, path)
    sensors = dict[Sensor, Axes]()
    for what in ("acc", "gyr", *(("mag",) if "mag" in groups[sensor] else ())):
        group = f"{sensor}/{groups[sensor].get(what, NAMES[what])}".lstrip("/")
        names = [f"{group}/{axis}" for axis in "XYZ"]
        places = [find_column(name, table.names, path) for name in names]
        scales = [find_scale(what, units[k] or SI_UNITS[what], table.names[k], path.name) for k in places]
        sensors[what] = Axes(names, np.array(scales))
    clock, samples, row = read_sensors(table, [table.names[0]], sensors)
    t = clock[:, 0] * find_scale("time", units[0] or "s", "Time", path.name)
    return pack_samples(content, "apdm", t, samples, sensors, row, [f"the sensor is '{sensor}'"])


# Shimmer

_NAME = re.compile(
    r"^(?P<device>.*?)_?(?P<what>Accel_LN|Accel_WR|Accel|Gyro|Mag)_(?P<axis>[XYZ])_CAL$|"
    r"^(?P<clock_device>.*?)_?(?P<clock>Timestamp(?:Sync)?(?:_(?:Sync)?(?:Unix|FormattedUnix))?)_CAL$"
)
_LOW_NOISE, _WIDE = "{device}Accel_LN_{{}}_CAL", "{device}Accel_WR_{{}}_CAL"
_SHIMMER: Mapping[Sensor, tuple[str, ...]] = {
    "acc": (_LOW_NOISE, "{device}Accel_{{}}_CAL", _WIDE),
    "gyr": ("{device}Gyro_{{}}_CAL",),
    "mag": ("{device}Mag_{{}}_CAL",),
}


def find_shimmer(content: Content) -> TextTable | None:
    """Table with names as Consensys gives them, in the first lines: at the top, or below the separator."""
    table = find_header(content, lambda names: any(match and match["what"] for match in map(_NAME.match, names)))
    return table if table is not None and table.line <= 3 else None


def read_shimmer(content: Content) -> RawRecording:
    """Read one device of an export of Consensys."""
    path, table = content.path, find_shimmer(content) or TextTable(content, content.fields())
    # the row of units below the names, which some exports leave out
    below = content.lines[table.line + 1 : table.line + 2]
    units = [field for line in below for field in split_fields(line, table.separator)]
    if any(find_factor("acc", field) for field in units):
        table = replace(table, first_line=table.first_line + 1)
    else:
        units = []
    matches = [match for match in map(_NAME.match, table.names) if match]
    devices = list(dict.fromkeys(match["device"] for match in matches if match["what"]))
    device = choose_sensor(devices, content.sensor, path)
    prefix = f"{device}_" if device else ""
    # columns, of the accelerometers that of low noise, and their units
    sources: Sources = {what: [(name.format(device=prefix), 1.0) for name in names] for what, names in _SHIMMER.items()}
    sensors = find_sensors(table, sources)
    for what, axes in sensors.items():
        said = {units[k] for k in (find_column(name, table.names, path) for name in axes.names) if k < len(units)}
        if len(said) != 1:
            raise FormatError(f"{path.name}: '{axes.names[0]}' has no one unit for its axes below it: export it again.")
        sensors[what] = axes._replace(unit=find_scale(what, said.pop(), axes.names[0], path.name))
    # the clock of the device, or of the session where it has none of its own; numbers before text
    clocks = [(match.string, match["clock_device"], match["clock"]) for match in matches if match["clock"]]
    own = [one for one in clocks if one[1] == device] or clocks
    if not own:
        raise FormatError(f"{path.name} has no column Timestamp_Unix_CAL: export it again with it.")
    clock, _, kind = min(own, key=lambda one: ("Formatted" in one[2], "Unix" not in one[2]))
    place = table.names.index(clock)
    # samples, and not the rows of other devices alone
    values, samples, row = read_sensors(table, [clock], sensors)
    there = ~np.isnan(np.hstack(list(samples.values()))).all(axis=1)
    row, samples = row[there], {what: xyz[there] for what, xyz in samples.items()}
    unit = find_factor("time", units[place]) if place < len(units) else None
    t = values[there, 0] * (1.0 if "Formatted" in kind else unit or 1e-3)
    # remarks
    wide, notes = _WIDE.format(device=prefix).format("X"), list[str]()
    if sensors["acc"].names[0] == wide:
        notes = ["the accelerometer is that of wide range (WR): the file has no other"]
    elif wide in table:
        notes = ["of two accelerometers the one of low noise (LN) is taken: it is in the gyroscope's frame"]
    return pack_samples(content, "shimmer", t, samples, sensors, row, notes)
