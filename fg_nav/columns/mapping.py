"""Which columns of a table are stamps, force, rate and field: by their names, and as the user says (`--columns`).

    time=ts[ms],acc=ax:ay:az[g],gyr=gx:gy:gz[deg/s],mag=mx:my:mz[G]     columns by name, or by number from 1
    t,ax,ay,az,gx,gy,gz                                                 all fields in order, - for one not used

What a mapping leaves out, or all without one, is what the names say (`fg_nav.columns.headers`). One accelerometer, one
gyroscope and at most one magnetometer are taken; where the names leave a choice, it is the user's (docs/formats.md).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.headers import (
    KNOWN_UNITS,
    RAW,
    Kind,
    Meaning,
    Quantity,
    find_factor,
    find_quantity,
    find_unit_kind,
    read_header,
)
from fg_nav.errors import FormatError

TIME = ("time_s",)
ACC = ("acc_x_m_s2", "acc_y_m_s2", "acc_z_m_s2")
GYR = ("gyr_x_rad_s", "gyr_y_rad_s", "gyr_z_rad_s")
MAG = ("mag_x_uT", "mag_y_uT", "mag_z_uT")
PRESSURE = ("pressure_pa",)
CANONICAL = TIME + ACC + GYR + MAG + PRESSURE  # Names of the columns of a sample.

QUANTITIES: Mapping[Quantity, tuple[str, ...]] = {
    "time": TIME, "acc": ACC, "gyr": GYR, "mag": MAG, "pressure": PRESSURE,
}  # fmt: skip

SHORT = dict(zip(("t", "ax", "ay", "az", "gx", "gy", "gz", "mx", "my", "mz", "p"), CANONICAL, strict=True))
"""Names of the list for the command line."""

PASSED_OVER = "-"  # In place of the name of a column that is not used.

EXAMPLE = "time=t[ms],acc=ax:ay:az[g],gyr=gx:gy:gz[deg/s]"

_PART = re.compile(r"(?:^|,)\s*(time|acc|gyr|mag|pressure)\s*=", re.IGNORECASE)


@dataclass(frozen=True)
class Channel:
    """The columns of one quantity: where they stand, counted from 0, their names, and their unit if known.

    With more `factors` than one there are as many groups of columns, which are added, each times its factor.
    """

    positions: tuple[int, ...]
    names: tuple[str, ...]
    unit: str | None = None
    factors: tuple[float, ...] = (1.0,)

    def add(self, values: Floats) -> Floats:
        """Values (N, K) of the columns become those of the quantity, (N, 1) or (N, 3)."""
        if self.factors == (1.0,):
            return values
        parts = np.split(values, len(self.factors), axis=1)
        return np.asarray(sum(part * factor for part, factor in zip(parts, self.factors, strict=True)))


@dataclass(frozen=True)
class ColumnMap:
    """Where the quantities of a sample stand in a table; without `time` a counter, or the rows, count by a rate."""

    acc: Channel
    gyr: Channel
    mag: Channel | None = None
    time: Channel | None = None
    counter: Channel | None = None
    notes: tuple[str, ...] = ()
    pressure: Channel | None = None


@dataclass(frozen=True)
class Columns:
    """What the user says of columns."""

    words: Mapping[Quantity, tuple[str, ...]]  # for each quantity the names of its columns, or their numbers from 1
    units: Mapping[Quantity, str]  # the word of the unit, for those that have one
    width: int | None = None  # number of fields of a row, where all are listed; else None

    def find(self, names: Sequence[str], source: str) -> dict[Quantity, Channel]:
        """Return the columns by quantity, looked up in the `names` of a table from `source`."""
        if self.width is not None and self.width != len(names):
            raise FormatError(
                f"--columns lists {self.width} fields and {source} has {len(names)} columns: list each, with - for one "
                f"that is not used."
            )
        places = {
            quantity: tuple(_find_name(word, names, source) for word in words) for quantity, words in self.words.items()
        }
        used = [position for positions in places.values() for position in positions]
        double = next((position for position in used if used.count(position) > 1), None)
        if double is not None:
            raise FormatError(f"--columns names column '{names[double]}' twice: one column is one quantity.")
        found = dict[Quantity, Channel]()
        for quantity, positions in places.items():
            own = tuple(names[position] for position in positions)
            said = {meaning.unit for meaning in map(read_header, own) if meaning and meaning.unit}
            units = [unit for unit in said if find_factor(quantity, unit)]
            unit = self.units.get(quantity) or (units[0] if len(units) == 1 else None)
            found[quantity] = Channel(positions, own, unit)
        return found


def parse_columns(words: str, units: str | None = None) -> Columns:
    """Return columns and units as given by the user: a mapping, or a list of quantities with its `units`.

    >>> parse_columns("acc=2:3:4[g],gyr=5:6:7[deg/s]").units
    {'acc': 'g', 'gyr': 'deg/s'}
    """
    if "=" not in words:
        return _parse_list(words, units)
    if units is not None:
        raise FormatError(
            "--units is for --columns that list all fields: write the units in brackets, acc=ax:ay:az[g]."
        )
    before, *parts = _PART.split(words)
    if before.strip() or not parts:
        raise FormatError(f"--columns '{words}' is no mapping: write it as {EXAMPLE}.")
    columns, unit_of = dict[Quantity, tuple[str, ...]](), dict[Quantity, str]()
    for name, part in zip(parts[::2], parts[1::2], strict=True):
        quantity = next(known for known in QUANTITIES if known == name.lower())
        bracketed = re.match(r"^(.*?)\s*\[([^\[\]]*)\]\s*$", part, re.DOTALL)
        own = tuple(word.strip() for word in (bracketed[1] if bracketed else part).split(":"))
        if quantity in columns or len(own) != len(QUANTITIES[quantity]) or not all(own):
            count = "one column" if len(QUANTITIES[quantity]) == 1 else "three columns with : between"
            raise FormatError(f"--columns: {quantity} needs {count}, once: write it as {EXAMPLE}.")
        columns[quantity] = own
        if bracketed:
            unit_of[quantity] = check_unit(quantity, bracketed[2])
    return Columns(columns, unit_of)


def _parse_list(words: str, units: str | None) -> Columns:
    given, known = [word.strip() for word in words.split(",")], ",".join(SHORT)
    names = [SHORT.get(word, word) for word in given]
    for word, name in zip(given, names, strict=True):
        if name not in (*CANONICAL, PASSED_OVER) or (name != PASSED_OVER and names.count(name) > 1):
            raise FormatError(
                f"--columns has '{word}' twice, or it is none of {known}: name each field of a row, - for another, or "
                f"write it as {EXAMPLE}."
            )
    optional = (*TIME, *PRESSURE, *(MAG if set(MAG).isdisjoint(names) else ()))
    missing = [short for short, name in SHORT.items() if name not in (*names, *optional)]
    if missing:
        raise FormatError(
            f"--columns lacks {','.join(missing)}: of {known} only p, and mx,my,mz together, may be left out."
        )
    places = {
        quantity: tuple(str(names.index(name) + 1) for name in wanted)
        for quantity, wanted in QUANTITIES.items()
        if wanted[0] in names
    }
    return Columns(places, parse_units(units), width=len(names))


def check_unit(quantity: Quantity, word: str) -> str:
    """Return the word of a unit; raises `FormatError` if it is none of the quantity."""
    if find_factor(quantity, word) is None:
        raise FormatError(f"there is no unit '{word}' of {quantity}: choose one of {KNOWN_UNITS[quantity]}.")
    return word


def parse_units(words: str | None) -> dict[Quantity, str]:
    """Return the unit of each quantity from a list ("ms, g, deg/s"); raises `FormatError` if unknown or doubled."""
    units = dict[Quantity, str]()
    for word in (word.strip() for word in (words or "").split(",") if word.strip()):
        quantity = find_quantity(word)
        if quantity is None or quantity in units:
            known = ", ".join(KNOWN_UNITS.values())
            raise FormatError(f"'{word}' is no unit, or there are two units of its quantity: choose of {known}.")
        units[quantity] = word
    return units


def _find_name(word: str, names: Sequence[str], source: str) -> int:
    """Return the index of the column given by its name, in any case and without its unit, or by its number from 1."""
    without_unit = re.compile(r"\s*[(\[][^()\[\]]*[)\]]\s*$")
    for simplify in (str, lambda name: without_unit.sub("", name).strip().casefold()):
        found = [position for position, name in enumerate(names) if simplify(name) == simplify(word)]
        if len(found) > 1:
            raise FormatError(f"{source} has {len(found)} columns '{word}': give its number, from 1, in --columns.")
        if found:
            return found[0]
    if word.isascii() and word.isdigit() and 1 <= int(word) <= len(names):
        return int(word) - 1
    raise FormatError(f"{source} has no column '{word}' of --columns: it has {shorten_names(names)}.")


def shorten_names(names: Sequence[str], most: int = 24) -> str:
    """Names for a message; of many, the first."""
    listed = ", ".join(f"'{name[:40]}'" for name in names[:most])
    return f"{listed} and {len(names) - most} more" if len(names) > most else listed


# By names

_LONG = {"acc": "acceleration", "gyr": "angular rate", "mag": "magnetic field"}
_AXES = (("x", "y", "z"), ("0", "1", "2"), ("1", "2", "3"))

_ROS_RATE = re.compile(r"angular[\W_]*velocity", re.IGNORECASE)  # Beside it, linear acceleration has gravity: ROS.

_CLOCKS = (  # Words of clocks, the best first: a message's own stamp, the sensor's; others; what came late.
    {"header"}, {"sensor", "device", "chip", "imu"}, set[str](),
    {"phone", "host", "pc", "system", "log", "logging", "received", "arrival", "recorder", "server"},
    {"gps", "gnss", "tow", "itow"}, {"date", "datum", "fecha"},
)  # fmt: skip

_NO_PRESSURE = frozenset({  # Words of what a barometer has besides, and of pressures of something else than air.
    *("altitude", "alt", "height", "relative", "sea", "temp", "temperature", "foot", "heel", "toe", "insole", "sole"),
    *("time", "covariance", "variance", "var", "sigma", "std", "accuracy", "status", "valid", "delta", "tyre", "tire"),
})  # fmt: skip

Meanings: TypeAlias = Sequence[tuple[int, Meaning]]

NONE: Mapping[Quantity, Channel] = MappingProxyType({})


@dataclass(frozen=True)
class Hints:
    """What to type: `name` of the table, `command` before a mapping, how a `rate` and a `sensor` are given."""

    name: str
    command: str
    rate: str = "--rate 100"
    sensor: str = ", or give a word of their names with --sensor"

    def ask(self, words: str, mapping: str, otherwise: str = "") -> FormatError:
        """Return the error that says what a table leaves open, and what to type: capitals are for the user to fill."""
        return FormatError(f'{self.name}{words}, as {self.command} "{mapping}"{otherwise}.')


def choose_columns(
    names: Sequence[str], hints: Hints, sensor: str | None = None, given: Columns | None = None, has_rate: bool = False
) -> ColumnMap:
    """Return the columns of time, acc, gyr, mag and pressure by name; `sensor` selects, by a part of the name.

    Columns `given` by the user prevail; only a missing time is added (not with a rate), or all without acc or gyr.
    """
    known = NONE if given is None else given.find(names, hints.name)
    is_listed = given is not None and given.width is not None
    used = {position for channel in known.values() for position in channel.positions}
    meanings = [(k, meaning) for k, name in enumerate(names) if k not in used and (meaning := read_header(name))]
    of_sensor = [(k, m) for k, m in meanings if m.kind in ("time", "counter") or has_word(names[k], sensor)]
    kinds = {meaning.kind for _, meaning in of_sensor}
    if "gyr" in kinds and not kinds.isdisjoint({"acc", "gravity", "no gravity"}):
        meanings = of_sensor
    is_ros = any(_ROS_RATE.search(name) for name in names)
    if is_ros and not any(meaning.kind in ("acc", "gravity") for _, meaning in meanings):
        meanings = [(k, replace(m, kind="acc") if m.kind == "no gravity" else m) for k, m in meanings]
    if is_listed or {"acc", "gyr"} <= known.keys():
        time = known.get("time")
        if time is None and not is_listed and not has_rate:
            time = choose_clock(meanings, names, hints)
        return ColumnMap(known["acc"], known["gyr"], known.get("mag"), time, pressure=known.get("pressure"))
    found: dict[Quantity, Channel | None] = {
        kind: known.get(kind) or _choose_triad(kind, meanings, names, hints, known) for kind in ("acc", "gyr", "mag")
    }
    acc, gyr = found["acc"], found["gyr"]
    free, gravity = (find_triads(kind, meanings, names) for kind in ("no gravity", "gravity"))
    if acc is None and free and gravity:  # their sum, which Apple gives in g and with the sign turned
        positions, both = free[0].positions + gravity[0].positions, free[0].names + gravity[0].names
        sign = -1.0 if any("user" in m.stem.split() for p, m in meanings if p in free[0].positions) else 1.0
        acc = Channel(positions, both, free[0].unit or gravity[0].unit, (sign, sign))
    if acc is None or gyr is None:
        raise _ask_missing("acc" if acc is None else "gyr", meanings, names, hints)
    time = known.get("time") or choose_clock(meanings, names, hints)
    counters = [k for k, meaning in meanings if meaning.kind == "counter"] if time is None else []
    counter = Channel((counters[0],), (names[counters[0]],)) if counters else None
    some = [names[k] for k, meaning in meanings if meaning.kind == "mag" and meaning.axis and found["mag"] is None]
    notes = (f"the magnetometer has not all three axes, only {shorten_names(some)}: left out",) if some else ()
    air = known.get("pressure") or find_pressure(names, sensor)
    return ColumnMap(acc, gyr, found["mag"], time, counter, notes, air)


def has_word(name: str, word: str | None) -> bool:
    """Whether the name of a column, without its unit, has a word in it; a single letter by itself, as in L_acc_x."""
    plain = re.sub(r"[(\[].*", "", name).casefold()
    return word is None or word.casefold() in (plain if len(word) > 1 else re.split(r"[^a-z0-9]+", plain))


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


def write_mapping(columns: ColumnMap, **units: str) -> str:
    """Write the mapping that names these columns, with `units` for those that have none; a sum has no mapping."""
    parts = list[str]()
    for quantity in QUANTITIES:
        channel: Channel | None = getattr(columns, quantity)
        if channel is not None and len(channel.factors) == 1:
            plain = all(re.fullmatch(r"[^:,=\"\[\]$`\\]+", name) and re.search(r"\D", name) for name in channel.names)
            words = channel.names if plain else tuple(str(position + 1) for position in channel.positions)
            unit = channel.unit or units.get(quantity)
            parts.append(f"{quantity}={':'.join(words)}" + (f"[{unit}]" if unit else ""))
    return ",".join(parts)


def _choose_triad(
    kind: Quantity, meanings: Meanings, names: Sequence[str], hints: Hints, known: Mapping[Quantity, Channel]
) -> Channel | None:
    """Return the x, y, z columns of a kind, calibrated before raw, named before by unit; None if there are none."""
    triads = find_triads(kind, meanings, names)
    if not any(meaning.kind == kind and meaning.axis for _, meaning in meanings):
        triads = find_three_by_unit(kind, names, known)
    # preferred: calibrated, then named rather than found by unit, then with gravity included
    meant = {triad: [meaning for k, meaning in meanings if k in triad.positions] for triad in triads}
    sure = [triad for triad in triads if not any(RAW & set(meaning.stem.split()) for meaning in meant[triad])]
    named = [triad for triad in sure if not any(meaning.by_unit for meaning in meant[triad])]
    whole = [triad for triad in named if any("whole" in meaning.stem.split() for meaning in meant[triad])]
    triads = whole or named or sure or triads
    said = [(m.stem, m.axis) for _, m in meanings if m.kind == kind and m.axis]
    doubled = [names[k] for k, m in meanings if m.kind == kind and said.count((m.stem, m.axis)) > 1]
    if len(triads) > 1 or (doubled and not triads):
        candidates = doubled or [name for triad in triads for name in triad.names]
        words = f" has more than one {_LONG[kind]} ({shorten_names(candidates, 12)}): say which"
        raise hints.ask(words, f"{kind}=NAME:NAME:NAME", hints.sensor)
    return triads[0] if triads else None


def find_triads(kind: Kind, meanings: Meanings, names: Sequence[str]) -> list[Channel]:
    """Return the x, y, z columns of each sensor of a kind that has every axis exactly once."""
    found = list[Channel]()
    own = [(k, meaning) for k, meaning in meanings if meaning.kind == kind]
    for stem in dict.fromkeys(meaning.stem for _, meaning in own):
        for axes in _AXES:
            places = [[k for k, m in own if (m.stem, m.axis) == (stem, axis)] for axis in axes]
            if all(len(place) == 1 for place in places):
                positions = tuple(place[0] for place in places)
                units = {m.unit for k, m in own if k in positions and m.unit}
                unit = units.pop() if len(units) == 1 else None
                found.append(Channel(positions, tuple(names[k] for k in positions), unit))
                break
    return found


def find_three_by_unit(kind: Quantity, names: Sequence[str], known: Mapping[Quantity, Channel] = NONE) -> list[Channel]:
    """Find the only three columns with a unit of a quantity, such as roll, pitch and yaw rate: x, y and z in order."""
    used = {position for channel in known.values() for position in channel.positions}
    found = [(k, *find_unit_kind(name)) for k, name in enumerate(names) if k not in used]
    own, units = [k for k, what, _ in found if what == kind], {unit for _, what, unit in found if what == kind}
    if len(own) != 3 or len(units) != 1 or kind not in ("acc", "gyr"):
        return []
    return [Channel(tuple(own), tuple(names[k] for k in own), units.pop())]


def choose_clock(meanings: Meanings, names: Sequence[str], hints: Hints | None = None) -> Channel | None:
    """Return the column of the best clock by name, or two to be added (seconds and fraction); None if there is none.

    Of several equals the first is taken; with `hints`, which word the error, `FormatError` is raised instead.
    """
    own = [(k, meaning) for k, meaning in meanings if meaning.kind == "time"]
    if not own:
        return None
    ranks = [
        next((rank for rank in (0, 1, 5, 4, 3) if not _CLOCKS[rank].isdisjoint(meaning.stem.split())), 2)
        + 10 * meaning.by_unit
        for _, meaning in own
    ]
    own = [one for one, rank in zip(own, ranks, strict=True) if rank == min(ranks)]
    if len(own) == 2 and {own[0][1].unit, own[1][1].unit} in ({"s", "ns"}, {"s", "us"}, {"s", "ms"}):
        (whole, _), (part, finer) = sorted(own, key=lambda one: one[1].unit != "s")
        return Channel(
            (whole, part), (names[whole], names[part]), "s", (1.0, find_factor("time", finer.unit or "") or 0.0)
        )
    channels = [Channel((k,), (names[k],), meaning.unit) for k, meaning in own]
    if len(channels) > 1 and hints is not None:
        words = f" has more than one time ({shorten_names([names[k] for k, _ in own])}): say which"
        raise hints.ask(words, "time=NAME")
    return channels[0]


def _ask_missing(missing: Quantity, meanings: Meanings, names: Sequence[str], hints: Hints) -> FormatError:
    """Return the error that names the quantity that is missing, and the columns that are there."""
    removed = [names[at] for at, meaning in meanings if meaning.kind == "no gravity"]
    if missing == "acc" and removed:
        return FormatError(
            f"{hints.name} holds acceleration without gravity ({shorten_names(removed, 3)}), of which no path can be "
            f"had: export the accelerometer's own readings, or gravity in columns of its own."
        )
    some = [names[position] for position, meaning in meanings if meaning.kind == missing]
    what = f"has not all three axes of {_LONG[missing]}, only {shorten_names(some)}"
    if not some:
        what = f"has no column for {_LONG[missing]} among {shorten_names(names, 12)}"
    return hints.ask(f" {what}: name the columns", f"{missing}=NAME:NAME:NAME[UNIT]")
