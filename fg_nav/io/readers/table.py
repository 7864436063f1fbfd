"""Any table of samples by the names of its columns; a folder or archive with one table a sensor (docs/formats.md).

`Content.columns` is what `--columns` maps, `Content.rate_hz` the rate of a table without stamps, `Content.sensor` which
of several sensors. Tables of one sensor are brought onto the gyroscope's clock (`fg_nav.io.streams`), then units are
judged as those of one table.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.columns.headers import Meaning, Quantity, find_factor, find_kinds_in, read_header, split_axis, split_words
from fg_nav.columns.mapping import (
    ACC,
    GYR,
    TIME,
    Channel,
    ColumnMap,
    Hints,
    choose_clock,
    choose_columns,
    find_three_by_unit,
    find_triads,
    has_word,
)
from fg_nav.columns.samples import convert_samples, list_positions
from fg_nav.errors import FormatError
from fg_nav.io.content import Content, choose_sensor, read_content
from fg_nav.io.streams import NAMES, Sensor, Stream, drop_held, join_streams
from fg_nav.io.tables import MIN_NUMBERS, Table, open_table
from fg_nav.recording import Provenance, RawRecording
from fg_nav.samples.plausibility import find_mag_unit, find_time_unit, median_period_s

MAX_SENSORS, MIN_ROWS = 20, 20  # Of a column that names sensors: its values, and the rows that each of them has.
SENSOR_WORD = re.compile(r"sensor|dev|imu|foot|side|node|addr|mac|body|segment|limb", re.IGNORECASE)

_ALTERNATING = 0.1  # Share of rows at which a column changes that names their sensor; a label of an act changes seldom.
_APART, MAX_ALTERNATING = 0.25, 4  # Rows of one sensor change by less than this of what rows of two do, median.
_MIN_NUMBERS = 3  # Columns of numbers in a table of one sensor.
_SENSOR = re.compile(
    r"[_ .-]*(accelerometers?|accelerations?|accel|acce|acc|gyroscopes?|gyros?|gyr|magnetometers?|magnet|magn|mag)"
    r"(?![a-z])",
    re.IGNORECASE,
)


def recognizes(content: Content) -> bool:
    """Whether a table names an accelerometer's and a gyroscope's axes."""
    try:
        table = open_table(content)
    except FormatError:
        return False
    if table is None or not table.has_header:
        return False
    # sensors whose axes are named, or three of whose columns share their unit
    kinds: set[str] = {meaning.kind for meaning in map(read_header, table.names) if meaning and meaning.axis}
    by_unit: tuple[Quantity, ...] = ("acc", "gyr")
    kinds |= {kind for kind in by_unit if kind not in kinds and find_three_by_unit(kind, table.names)}
    return "gyr" in kinds and not kinds.isdisjoint({"acc", "no gravity", "gravity"})


def read(content: Content, format: str = "table") -> RawRecording:
    """Read a table by the names of its columns, or as the user maps them."""
    path, table = content.path, open_table(content)
    if table is None:
        if content.lines and sum(bool(line.strip()) for line in content.lines) == 1:
            raise FormatError(f"{path.name} has a header but no samples: record or export it again.")
        raise FormatError(f"{path.name} is no table of numbers: export it as CSV with a header.")
    columns = choose(content, table)
    values, row = table.read(list_positions(columns))
    # of several sensors the rows of one, the oldest first
    own, notes = _find_rows(content, table, columns, values, row)
    clock = _find_clock(columns, values[own])
    if clock is not None and np.count_nonzero(np.diff(clock) < 0) > 0.9 * len(clock):
        own, notes = own[::-1], [*notes, "the rows are newest first: turned round"]
    values, row = values[own], row[own]
    # units
    samples = convert_samples(values, columns, content.rate_hz, make_hints(content))
    mag, air = samples.mag, samples.pressure
    if not set(TIME + ACC + GYR) <= set(table.names):  # of another program, which may hold samples
        mag = None if mag is None else drop_held(mag, samples.gyr)
        air = None if air is None else drop_held(air[:, None], samples.gyr)[:, 0]
    provenance = Provenance(path, format, (*notes, *samples.notes))
    return RawRecording(samples.t, samples.acc, samples.gyr, row, mag, provenance=provenance, pressure=air)


def choose(content: Content, table: Table) -> ColumnMap:
    """Choose the columns of a table by their names, or as the user maps them."""
    hints = make_hints(content)
    if not table.has_header and content.columns is None:
        width, (no_clock, usual) = len(table.names), ("acc=1:2:3[UNIT],gyr=4:5:6[UNIT]", "time=1,acc=2:3:4,gyr=5:6:7")
        mapping = no_clock if width == MIN_NUMBERS else usual + ",mag=8:9:10" * (width > 9)  # in the usual order
        raise hints.ask(f" has {width} columns and no header: say which is what by number from 1", mapping)
    return choose_columns(table.names, hints, content.sensor, content.columns, content.rate_hz is not None)


def make_hints(content: Content) -> Hints:
    """Return what to type for a table."""
    return Hints(content.path.name, f"fg-nav inspect {shlex.quote(str(content.path))} --columns")


def _find_clock(columns: ColumnMap, values: Floats) -> Floats | None:
    """Stamps or counter (N,) in the unit of the table; None without."""
    channel = columns.time or columns.counter
    return None if channel is None else channel.add(values[:, : len(channel.positions)])[:, 0]


def _find_rows(content: Content, table: Table, columns: ColumnMap, values: Floats, row: Ints) -> tuple[Ints, list[str]]:
    """Return the row indices of the chosen sensor, all if there is only one, and notes on the choice."""
    # a column names the sensors if stamps that repeat or step back overall rise within each of its few values, or if
    # its name says so and it changes from row to row
    names, everything = table.names, np.arange(len(values))
    clock, used = _find_clock(columns, values), set(list_positions(columns))
    stuck = 0.0 if clock is None else float(np.mean(np.diff(clock) <= 0))
    for position in range(len(names)):
        called = bool(SENSOR_WORD.search(names[position]))
        if position in used or not (called or stuck > 0) or (not called and read_header(names[position]) is not None):
            continue
        words = table.read_words(position, row)
        found = [word for word in dict.fromkeys(words.tolist()) if word is not None]
        groups = [np.flatnonzero(words == word) for word in found[: MAX_SENSORS + 1]]
        if not 2 <= len(groups) <= MAX_SENSORS or min(map(len, groups)) < MIN_ROWS:
            continue
        changes = float(np.mean(words[1:] != words[:-1]))
        inside = 0.0 if clock is None else max(float(np.mean(np.diff(clock[group]) <= 0)) for group in groups)
        if (stuck > 0 and inside < 0.25 * stuck) or (called and changes > _ALTERNATING and inside <= stuck):
            sensors = [str(word) for word in found]
            chosen = choose_sensor(sensors, content.sensor, content.path)
            return groups[sensors.index(chosen)], [f"of {len(found)} sensors: {chosen}"]
    count = _count_alternating(values[:, -3 * (2 + (columns.mag is not None)) :][:, :3])
    if count > 1:
        numbers = [str(k + 1) for k in range(count)]
        chosen = choose_sensor(numbers, content.sensor, content.path, "sensors in alternating rows")
        note = f"of {count} sensors in alternating rows: the one in row {chosen}"
        return everything[int(chosen) - 1 :: count], [note]
    if content.sensor is not None and not any(has_word(name, content.sensor) for name in names):
        raise FormatError(
            f"{content.path.name} holds one sensor, and nothing in it is called '{content.sensor}': leave --sensor out."
        )
    return everything, []


def _count_alternating(acc: Floats) -> int:
    """Count the sensors whose rows (N, 3) come in turn: as many apart they change by far less than side by side."""
    acc = acc[np.isfinite(acc).all(axis=1)]
    if len(acc) < MIN_ROWS * MAX_ALTERNATING:
        return 1
    apart = [float(np.median(np.linalg.norm(acc[k:] - acc[:-k], axis=1))) for k in range(1, MAX_ALTERNATING + 1)]
    found = (k + 1 for k in range(1, MAX_ALTERNATING) if apart[k] < _APART * min(apart[:k]))
    return next(found, 1)


# One table a sensor.


@dataclass(frozen=True)
class SensorTable:
    """A table of one sensor: which, its columns and their clock, and what is left of its name without the sensor's."""

    what: Sensor
    content: Content
    table: Table
    axes: Channel
    clock: Channel
    session: str

    def read(self) -> Stream:
        """Read the table in its unit, of a magnetometer in uT: NaN where its unit is arbitrary."""
        name, unit = self.content.path.name, self.clock.unit
        values, row = self.table.read([*self.clock.positions, *self.axes.positions])
        clock, xyz = np.split(values, [len(self.clock.positions)], axis=1)
        if self.what == "mag":
            factor = find_factor("mag", self.axes.unit or find_mag_unit(xyz) or "")
            xyz = xyz * (np.nan if factor is None else factor)
        t = self.clock.add(clock)[:, 0]
        if unit is None or find_factor("time", unit) is None:
            unit = find_time_unit(median_period_s(t))
        if unit is None:
            raise FormatError(
                f"{name}: column '{self.clock.names[0]}' names no unit, and its steps show none: write it in brackets "
                f"behind the name, [ms]."
            )
        return Stream(self.what, np.asarray(t * (find_factor("time", unit) or np.nan)), xyz, row, name)


def find_sensor_table(content: Content) -> SensorTable | None:
    """Return quantity, columns and session of a one-sensor table; None if it is none, or its gravity is removed."""
    try:
        table = open_table(content, _MIN_NUMBERS) if content.lines else None
    except FormatError:
        return None
    if table is None or not table.has_header:
        return None
    names, file = table.names, content.path.name.split(".")[0]
    meanings: list[tuple[int, Meaning]] = [(k, m) for k, name in enumerate(names) if (m := read_header(name))]
    triads = {kind: found[0] for kind in NAMES if (found := find_triads(kind, meanings, names))}
    kinds = find_kinds_in(file)
    if not triads and len(kinds & NAMES.keys()) == 1:
        axes = [
            (axis, k) for k, name in enumerate(names) if (axis := split_axis(split_words(name))[1]) in ("x", "y", "z")
        ]
        if sorted(axis for axis, _ in axes) == ["x", "y", "z"]:
            position = tuple(k for _, k in sorted(axes))
            triads = {kind: Channel(position, tuple(names[k] for k in position)) for kind in NAMES if kind in kinds}
    clock = choose_clock(meanings, names)
    if len(triads) != 1 or clock is None or "no gravity" in kinds:
        return None
    ((what, channel),) = triads.items()
    return SensorTable(what, content, table, channel, clock, _SENSOR.sub("", file, count=1).strip("_ .-") or "session")


def _list_sensor_tables(content: Content) -> list[SensorTable]:
    files = content.files() if content.members else []
    return [single for file in files if (single := find_sensor_table(file)) is not None]


def are_sensor_tables(content: Content) -> bool:
    """Whether right in a folder or archive are tables of an accelerometer and of a gyroscope, and none of both."""
    found = {single.what for single in _list_sensor_tables(content)}
    return {"acc", "gyr"} <= found and not any(map(recognizes, content.files()))


def read_sensor_tables(content: Content) -> RawRecording:
    """Read the tables of a session, one a sensor."""
    sessions: dict[str, list[SensorTable]] = {}
    for single in _list_sensor_tables(content):
        sessions.setdefault(single.session, []).append(single)
    whole = {name: own for name, own in sessions.items() if {"acc", "gyr"} <= {one.what for one in own}} or sessions
    singles = whole[choose_sensor(list(whole), content.sensor, content.path)]
    in_order = sorted(singles, key=lambda one: list(NAMES).index(one.what))
    raw = join_streams([one.read() for one in in_order], content.path, "tables", ["one table a sensor"])
    # units, as of one table
    acc, gyr = (replace(one.axes, positions=(k, k + 1, k + 2)) for one, k in zip(in_order, (1, 4), strict=False))
    mag = None if raw.mag is None else Channel((7, 8, 9), ("mag",), "uT")
    table = np.column_stack([raw.t, raw.acc, raw.gyr, *([] if raw.mag is None else [raw.mag])])
    columns, hints = ColumnMap(acc, gyr, mag, Channel((0,), ("t",), "s")), make_hints(content)
    samples = convert_samples(table, columns, None, hints)
    provenance = replace(raw.provenance, notes=(*raw.provenance.notes, *samples.notes))
    return replace(raw, acc=samples.acc, gyr=samples.gyr, mag=samples.mag, provenance=provenance)


def refuse_sensor_tables(paths: Sequence[Path]) -> None:
    """Raise `FormatError` for files that are the tables of one recording, a sensor each, and say how to give them."""
    try:
        explained = explain_sensor_tables([read_content(path) for path in paths])
    except FormatError:
        return  # said of each by itself
    if explained is not None:
        raise FormatError(explained)


def explain_sensor_tables(contents: Sequence[Content]) -> str | None:
    """Return a sentence on how one-sensor tables make a recording together; None if they are none."""
    singles = [single for content in contents if (single := find_sensor_table(content)) is not None]
    if not singles or len(singles) < len(contents):
        return None
    names = " and ".join(single.content.path.name for single in singles)
    what = " and ".join(dict.fromkeys(f"the {NAMES[single.what]}" for single in singles))
    holds = f"holds {what} alone" if len(singles) == 1 else f"hold {what} in tables of their own"
    return (
        f"{names} {holds}: put the tables of one recording into a folder of their own, and give that, as fg-nav "
        f"inspect FOLDER."
    )
