"""Which columns of a table are stamps, force, rate and field, as the user says it (`--columns`).

    time=ts[ms],acc=ax:ay:az[g],gyr=gx:gy:gz[deg/s],mag=mx:my:mz[G]     columns by name, or by number from 1
    t,ax,ay,az,gx,gy,gz                                                 all fields in order, - for one not used

A unit in brackets is of all columns of its quantity; with the list, units stand in a list of their own. Without a unit
counts that of the column's name, if it has one. Names are found without regard to case, and without their units. What
a mapping leaves out is what the names of the other columns say (`fg_nav.columns.choice`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.columns.headers import read_header
from fg_nav.columns.units import KNOWN_UNITS, Quantity, find_factor, find_quantity
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
        """Return the columns by quantity, looked up in the `names` of a table from `source`.

        Raises `FormatError` if one is not there, or two of the names are the same column.
        """
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

    Raises `FormatError` if a quantity is doubled or of another number of columns, or a unit is not known.
    """
    if "=" not in words:
        return _parse_list(words, units)
    if units is not None:
        raise FormatError(
            "--units is for --columns that list all fields: write the units in brackets, acc=ax:ay:az[g]."
        )
    starts = list(_PART.finditer(words))
    if not starts or words[: starts[0].start()].strip():
        raise FormatError(f"--columns '{words}' is no mapping: write it as {EXAMPLE}.")
    columns, unit_of = dict[Quantity, tuple[str, ...]](), dict[Quantity, str]()
    for start, after in zip(starts, [*starts[1:], None], strict=True):
        quantity = next(known for known in QUANTITIES if known == start[1].lower())
        if quantity in columns:
            raise FormatError(f"--columns names {quantity} twice: name the columns of one sensor.")
        part = words[start.end() : after.start() if after else None]
        bracketed = re.match(r"^(.*?)\s*\[([^\[\]]*)\]\s*$", part, re.DOTALL)
        names = bracketed[1] if bracketed else part
        columns[quantity] = tuple(name.strip() for name in names.split(":"))
        if len(columns[quantity]) != len(QUANTITIES[quantity]) or not all(columns[quantity]):
            count = "one column" if len(QUANTITIES[quantity]) == 1 else "three columns with : between"
            raise FormatError(
                f"--columns: {quantity} needs {count}, and '{names.strip()}' is not: write it as {EXAMPLE}."
            )
        if bracketed:
            if find_factor(quantity, bracketed[2]) is None:
                raise FormatError(
                    f"--columns: there is no unit '{bracketed[2]}' of {quantity}: choose one of "
                    f"{KNOWN_UNITS[quantity]}."
                )
            unit_of[quantity] = bracketed[2]
    return Columns(columns, unit_of)


def _parse_list(words: str, units: str | None) -> Columns:
    given = [word.strip() for word in words.split(",")]
    names = [SHORT.get(word, word) for word in given]
    known = ",".join(SHORT)
    for word, name in zip(given, names, strict=True):
        if name not in (*CANONICAL, PASSED_OVER):
            raise FormatError(
                f"--columns has no '{word}': name those of a row, of {known}, and - for another, or write it as "
                f"{EXAMPLE}."
            )
        if name != PASSED_OVER and names.count(name) > 1:
            raise FormatError(f"--columns names '{word}' twice: one field is one quantity.")
    has_mag = not set(MAG).isdisjoint(names)
    optional = (*TIME, *PRESSURE, *(() if has_mag else MAG))
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


def parse_units(words: str | None) -> dict[Quantity, str]:
    """Return the unit of each quantity from a list ("ms, g, deg/s"); raises `FormatError` if unknown or doubled."""
    units = dict[Quantity, str]()
    for word in (word.strip() for word in (words or "").split(",") if word.strip()):
        quantity = find_quantity(word)
        if quantity is None:
            raise FormatError(f"there is no unit '{word}': choose of {', '.join(KNOWN_UNITS.values())}.")
        if quantity in units:
            raise FormatError(f"there are two units of one quantity, '{units[quantity]}' and '{word}': give one.")
        units[quantity] = word
    return units


def _find_name(word: str, names: Sequence[str], source: str) -> int:
    """Return the index of the column given by its name, or by its number from 1."""
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
