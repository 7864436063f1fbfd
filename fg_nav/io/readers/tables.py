"""One table a sensor: a folder or archive with a table of the accelerometer, one of the gyroscope, one of the field.

Which is which say the names of the columns, `wx`; else their unit, `X [dps]`; else the name of the file, `X_GYRO.txt`,
`acc_walking_shin.csv`. What is left of these names is one for the sensors of a session: of several the user says which.
Tables are brought onto the gyroscope's clock (`fg_nav.io.streams`), then units are judged as those of one table.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.choice import Asker, choose_clock, find_triads
from fg_nav.columns.headers import Meaning, find_kinds_in, read_header, split_axis
from fg_nav.columns.mapping import Channel, ColumnMap
from fg_nav.columns.samples import convert_samples
from fg_nav.columns.units import find_factor
from fg_nav.errors import FgNavError, FormatError
from fg_nav.io.choice import choose_sensor
from fg_nav.io.content import Content, read_content
from fg_nav.io.readers import table
from fg_nav.io.streams import NAMES, Sensor, Stream, join_streams
from fg_nav.recording import RawRecording, Recording
from fg_nav.samples.plausibility import find_mag_unit, find_time_unit, median_period_s

_MIN_NUMBERS = 3
_SENSOR = re.compile(
    r"[_ .-]*(accelerometers?|accelerations?|accel|acce|acc|gyroscopes?|gyros?|gyr|magnetometers?|magnet|magn|mag)"
    r"(?![a-z])",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Single:
    """A table of one sensor: which, its columns and their clock, and what is left of its name without the sensor's."""

    what: Sensor
    content: Content
    table: table.Table
    axes: Channel
    clock: Channel
    session: str


def recognizes(content: Content) -> bool:
    """Whether right in a folder or archive are tables of an accelerometer and of a gyroscope, and none of both."""
    found = {single.what for single in _list_singles(content)}
    return {"acc", "gyr"} <= found and not any(table.recognizes(part) for part in content.parts() if not part.members)


def read(content: Content) -> RawRecording:
    """Read the tables of a session.

    Raises `FormatError` if a sensor is not there or twice, a unit cannot be judged, or it is not said which of several
    sessions to take.
    """
    sessions: dict[str, dict[Sensor, Single]] = {}
    for single in _list_singles(content):
        of_session = sessions.setdefault(single.session, {})
        if single.what in of_session:
            both = f"{of_session[single.what].content.path.name}, {single.content.path.name}"
            raise FormatError(
                f"{content.path.name} holds two tables of the {NAMES[single.what]} ({both}): give a folder with one."
            )
        of_session[single.what] = single
    whole = {name: own for name, own in sessions.items() if {"acc", "gyr"} <= own.keys()}
    chosen = choose_sensor(list(whole or sessions), content.sensor, content.path)
    return _join(content, (whole or sessions)[chosen])


def _join(content: Content, singles: Mapping[Sensor, Single]) -> RawRecording:
    streams = [read_stream(singles[what]) for what in NAMES if what in singles]
    channels = {
        stream.what: replace(singles[stream.what].axes, positions=tuple(range(1 + 3 * k, 4 + 3 * k)))
        for k, stream in enumerate(streams)
    }
    raw = join_streams(streams, content.path, "tables", ["one table a sensor"])
    field = [] if raw.mag is None else [raw.mag]
    field_in_uT = Channel((7, 8, 9), ("mag",), "uT")
    columns = ColumnMap(channels["acc"], channels["gyr"], field_in_uT if field else None, Channel((0,), ("t",), "s"))
    samples = convert_samples(np.column_stack([raw.t, raw.acc, raw.gyr, *field]), columns, None, _asker(content))
    notes = (*raw.provenance.notes, *samples.notes)
    return replace(
        raw, acc=samples.acc, gyr=samples.gyr, mag=samples.mag, provenance=replace(raw.provenance, notes=notes)
    )


def read_stream(single: Single) -> Stream:
    """Read a table in its unit, of a magnetometer in uT: NaN where its unit is arbitrary."""
    values, row = single.table.read([*single.clock.positions, *single.axes.positions])
    clock, xyz = np.split(values, [len(single.clock.positions)], axis=1)
    if single.what == "mag":
        factor = find_factor("mag", single.axes.unit or find_mag_unit(xyz) or "")
        xyz = xyz * (np.nan if factor is None else factor)
    return Stream(single.what, _read_clock(single, clock), xyz, row, single.content.path.name)


def _asker(content: Content) -> Asker:
    name = content.path.name
    return Asker(name, f"fg-nav inspect {shlex.quote(str(content.path))} --columns", works=lambda words: False)


def _read_clock(single: Single, clock: Floats) -> Floats:
    """Stamps (N,) s of a table."""
    t, unit = single.clock.add(clock)[:, 0], single.clock.unit
    if unit is None or find_factor("time", unit) is None:
        unit = find_time_unit(median_period_s(t))
    if unit is None:
        raise FormatError(
            f"{single.content.path.name}: column '{single.clock.names[0]}' names no unit, and its steps show none: "
            f"write it in brackets behind the name, [ms]."
        )
    return np.asarray(t * (find_factor("time", unit) or np.nan))


def _list_singles(content: Content) -> list[Single]:
    files = [part for part in content.parts() if not part.members] if content.members else []
    return [single for file in files if (single := find_single(file)) is not None]


def find_single(content: Content) -> Single | None:
    """Find what a table of one sensor holds; None where it is none, or has another's gravity removed."""
    try:
        opened = table.open_table(content, _MIN_NUMBERS) if content.lines else None
    except FormatError:
        return None
    if opened is None or not opened.has_header:
        return None
    names, file = opened.names, content.path.name.split(".")[0]
    meanings: list[tuple[int, Meaning]] = [(k, m) for k, name in enumerate(names) if (m := read_header(name))]
    triads = {kind: found[0] for kind in NAMES if (found := find_triads(kind, meanings, names))}
    kinds = find_kinds_in(file)
    if not triads and len(kinds & NAMES.keys()) == 1:
        axes = [(k, axis) for k, name in enumerate(names) if (axis := split_axis(name)) in ("x", "y", "z")]
        if sorted(axis for _, axis in axes) == ["x", "y", "z"]:
            position = tuple(k for k, _ in sorted(axes, key=lambda one: one[1]))
            triads = {kind: Channel(position, tuple(names[k] for k in position)) for kind in NAMES if kind in kinds}
    clock = choose_clock(meanings, names)
    if len(triads) != 1 or clock is None or "no gravity" in kinds:
        return None
    ((what, channel),) = triads.items()
    return Single(what, content, opened, channel, clock, _SENSOR.sub("", file, count=1).strip("_ .-") or "session")


def refuse_singles(paths: Sequence[Path]) -> None:
    """Raise `FormatError` for files that are the tables of one recording, a sensor each, and say how to give them."""
    try:
        explained = explain_singles([read_content(path) for path in paths])
    except FormatError:
        return  # said of each by itself
    if explained is not None:
        raise FormatError(explained)


def explain_singles(contents: Sequence[Content]) -> str | None:
    """Say how tables of one sensor each make a recording; None where they are none."""
    singles = [find_single(content) for content in contents]
    if not singles or None in singles:
        return None
    names = " and ".join(single.content.path.name for single in singles if single)
    what = " and ".join(dict.fromkeys(f"the {NAMES[single.what]}" for single in singles if single))
    folder = contents[0].path.parent
    holds = f"holds {what} alone" if len(singles) == 1 else f"hold {what} in tables of their own"
    words = f"{names} {holds}: put the tables of one recording into a folder of their own, and give that"
    if all(content.path.parent == folder and content.fetch is None for content in contents) and _is_recording(folder):
        return f"{words}, as fg-nav inspect {shlex.quote(str(folder))}."
    return f"{words}."


def _is_recording(folder: Path) -> bool:
    try:
        inside = read_content(folder)
        return recognizes(inside) and bool(Recording.from_raw(read(inside)))
    except FgNavError:
        return False
