"""Which columns of a table are stamps, force, rate and field, by their names alone (`fg_nav.columns.headers`).

The three axes of a sensor share the words of their names. One accelerometer, one gyroscope and at most one magnetometer
are taken; calibrated ones before raw ones. Where names leave a choice, it is the user's.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from fg_nav.columns.headers import Kind, Meaning, read_header
from fg_nav.columns.mapping import Channel, ColumnMap, shorten_names
from fg_nav.columns.units import find_factor
from fg_nav.errors import FormatError

_LONG = {"acc": "acceleration", "gyr": "angular rate", "mag": "magnetic field"}

_AXES = (("x", "y", "z"), ("0", "1", "2"), ("1", "2", "3"))

_ROS_RATE = re.compile(r"angular[\W_]*velocity", re.IGNORECASE)
"""Next to it, linear acceleration is that of a ROS message, which has gravity in it."""


@dataclass(frozen=True)
class Asker:
    """Who asks the user: `name` of the table, `command` before a mapping, how a `rate` and a `sensor` are given."""

    name: str
    command: str
    rate: str = "--rate 100"
    sensor: str = ", or give a word of their names with --sensor"

    def ask(self, mapping: str) -> str:
        """Return what to type with this mapping."""
        return f'{self.command} "{mapping}"'


def choose_columns(names: Sequence[str], asker: Asker, sensor: str | None = None) -> ColumnMap:
    """Choose the columns of a table by their names; of those of several sensors the ones with `sensor` in their names.

    Raises `FormatError` if the names of acceleration or rate are missing, or leave a choice.
    """
    meanings = [(position, meaning) for position, name in enumerate(names) if (meaning := read_header(name))]
    if sensor is not None:
        word = sensor.casefold()
        meanings = [
            (position, meaning)
            for position, meaning in meanings
            if meaning.kind in ("time", "counter") or word in meaning.stem or word in names[position].casefold()
        ]
    is_ros = any(_ROS_RATE.search(name) for name in names)
    if is_ros and not any(meaning.kind == "acc" for _, meaning in meanings):
        meanings = [(position, _as_acc(meaning)) for position, meaning in meanings]
    found = {kind: _choose_triad(kind, meanings, names, asker) for kind in ("acc", "gyr", "mag")}
    acc, gyr = found["acc"], found["gyr"]
    if acc is None or gyr is None:
        raise FormatError(_say_missing(acc, gyr, meanings, names, asker))
    time, counter = _choose_single("time", meanings, names, asker), _choose_single("counter", meanings, names, asker)
    return ColumnMap(
        acc, gyr, found["mag"], time, counter if time is None else None, pressure=find_pressure(names, sensor)
    )


def find_pressure(names: Sequence[str], sensor: str | None = None) -> Channel | None:
    """Find the pressure of the air among columns, of several with `sensor` in its name or the first; None if none.

    >>> find_pressure(["time_s", "Pressure (hPa)"]).unit
    'hPa'
    """
    found = list[Channel]()
    for position, name in enumerate(names):
        words = re.findall(r"[a-z]+", name.lower())
        if any("press" in word or word.startswith("baro") for word in words) and _NO_PRESSURE.isdisjoint(words):
            unit = next((word for word in words[::-1] if find_factor("pressure", word)), None)
            found.append(Channel((position,), (name,), re.findall(unit, name, re.IGNORECASE)[-1] if unit else None))
    of_sensor = [one for one in found if sensor is not None and sensor.casefold() in one.names[0].casefold()]
    return next(iter(of_sensor or found), None)


_NO_PRESSURE = frozenset({
    *("altitude", "alt", "height", "relative", "sea", "temp", "temperature", "foot", "heel", "toe", "insole", "sole"),
    *("time", "covariance", "variance", "var", "sigma", "std", "accuracy", "status", "valid", "delta", "tyre", "tire"),
})  # fmt: skip
"""Words of what a barometer has besides, and of pressures of something else than air."""


def names_sensor(names: Sequence[str]) -> bool:
    """Whether some of the names are those of an accelerometer or a gyroscope."""
    kinds = {meaning.kind for meaning in map(read_header, names) if meaning and meaning.axis}
    return not kinds.isdisjoint({"acc", "gyr", "no gravity"})


def write_mapping(columns: ColumnMap, **units: str) -> str:
    """Write the mapping that names these columns, with units for those that have none."""
    channels = {"time": columns.time, "acc": columns.acc, "gyr": columns.gyr, "mag": columns.mag}
    channels["pressure"] = columns.pressure
    return ",".join(
        f"{quantity}={_write_channel(channel, channel.unit or units.get(quantity))}"
        for quantity, channel in channels.items()
        if channel is not None
    )


def _write_channel(channel: Channel, unit: str | None) -> str:
    plain = all(re.fullmatch(r"[^:,=\"\[\]$`\\]*[^:,=\"\[\]$`\\\d][^:,=\"\[\]$`\\]*", name) for name in channel.names)
    words = channel.names if plain else tuple(str(position + 1) for position in channel.positions)
    return ":".join(words) + (f"[{unit}]" if unit else "")


def _as_acc(meaning: Meaning) -> Meaning:
    return replace(meaning, kind="acc") if meaning.kind == "no gravity" else meaning


Meanings = Sequence[tuple[int, Meaning]]


def _choose_triad(kind: Kind, meanings: Meanings, names: Sequence[str], asker: Asker) -> Channel | None:
    """Choose the three columns of a kind; None if there are none."""
    triads = [triad for stem in _stems(kind, meanings) if (triad := _find_triad(kind, stem, meanings, names))]
    sure = [triad for triad in triads if not any(m.is_unsure for p, m in meanings if p in triad.positions)]
    triads = sure or triads
    doubled = _find_doubled(kind, meanings, names)
    if len(triads) > 1 or (doubled and not triads):
        candidates = doubled or [name for triad in triads for name in triad.names]
        raise FormatError(
            f"{asker.name} has more than one {_LONG[kind]} ({shorten_names(candidates, 12)}): say which, as "
            f"{asker.ask(_write_example(meanings, names))}{asker.sensor}."
        )
    return triads[0] if triads else None


def _stems(kind: Kind, meanings: Meanings) -> list[str]:
    return list(dict.fromkeys(meaning.stem for _, meaning in meanings if meaning.kind == kind))


def _find_triad(kind: Kind, stem: str, meanings: Meanings, names: Sequence[str]) -> Channel | None:
    """Find the columns of the three axes of one sensor; None if one is missing or doubled."""
    own = [(position, meaning) for position, meaning in meanings if (meaning.kind, meaning.stem) == (kind, stem)]
    for axes in _AXES:
        places = [[position for position, meaning in own if meaning.axis == axis] for axis in axes]
        if all(len(place) == 1 for place in places):
            positions = tuple(place[0] for place in places)
            units = {meaning.unit for position, meaning in own if position in positions and meaning.unit}
            unit = units.pop() if len(units) == 1 else None
            return Channel(positions, tuple(names[position] for position in positions), unit)
    return None


def _find_doubled(kind: Kind, meanings: Meanings, names: Sequence[str]) -> list[str]:
    """Names that mean the same axis of the same sensor."""
    said = [(m.stem, m.axis) for _, m in meanings if m.kind == kind and m.axis]
    return [names[p] for p, m in meanings if m.kind == kind and said.count((m.stem, m.axis)) > 1]


def _choose_single(kind: Kind, meanings: Meanings, names: Sequence[str], asker: Asker) -> Channel | None:
    own = [(position, meaning) for position, meaning in meanings if meaning.kind == kind]
    own = [one for one in own if "header" in one[1].stem.split()] or own  # a message's own stamp before the recorder's
    if len(own) > 1 and kind == "time":
        listed = shorten_names([names[position] for position, _ in own])
        example = asker.ask(_write_example(meanings, names, own[0][0]))
        raise FormatError(f"{asker.name} has more than one time ({listed}): say which, as {example}.")
    return Channel((own[0][0],), (names[own[0][0]],), own[0][1].unit) if own else None


def _say_missing(
    acc: Channel | None, gyr: Channel | None, meanings: Meanings, names: Sequence[str], asker: Asker
) -> str:
    """Say which columns are missing, and next to what."""
    missing = "acc" if acc is None else "gyr"
    if acc is None and any(meaning.kind == "no gravity" for _, meaning in meanings):
        removed = shorten_names([names[at] for at, meaning in meanings if meaning.kind == "no gravity"], 3)
        return (
            f"{asker.name} holds acceleration without gravity ({removed}), of which no path can be had: "
            f"export the accelerometer's own readings, with gravity in them."
        )
    some = [names[position] for position, meaning in meanings if meaning.kind == missing]
    if some:
        return (
            f"{asker.name} has not all three axes of {_LONG[missing]}, only {shorten_names(some)}: name the columns, "
            f"as {asker.ask(_write_example(meanings, names))}."
        )
    return (
        f"{asker.name} has no column for {_LONG[missing]} among {shorten_names(names, 12)}: name the columns, as "
        f"{asker.ask(_write_example(meanings, names))}."
    )


def _write_example(meanings: Meanings, names: Sequence[str], time: int | None = None) -> str:
    """Write a mapping with what is known of the columns."""
    words = []
    single = time if time is not None else next((p for p, meaning in meanings if meaning.kind == "time"), None)
    if single is not None:
        said = next(meaning.unit for position, meaning in meanings if position == single)
        known = said if said and find_factor("time", said) else "s"
        words.append(f"time={_write_channel(Channel((single,), (names[single],)), known)}")
    wanted: tuple[tuple[Kind, str, str], ...] = (("acc", "a", "m/s^2"), ("gyr", "g", "deg/s"))
    for kind, letter, unit in wanted:
        triads = [t for stem in _stems(kind, meanings) if (t := _find_triad(kind, stem, meanings, names))]
        triad = triads[0] if triads else Channel((0,), tuple(f"{letter}{axis}" for axis in "xyz"))
        words.append(f"{kind}={_write_channel(triad, triad.unit or unit)}")
    return ",".join(words)
