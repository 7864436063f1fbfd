"""What the name of a column says: `Acc X [g]`, `gyro_x (deg/s)`, `angular_velocity.x`, `mag_z_uT`, `ax`, `Time (ms)`.

A name is taken apart into words at blanks, signs and capitals. A unit stands in brackets or at its end, an axis is a
word of its own or the last letter, and what is left says the quantity; where it says none, the unit does. Acceleration
without gravity (linear, user, free) and gravity alone are kinds of their own, which make a specific force together.
Names of what is computed of samples, a covariance, say nothing.

Unit words are compared without case, blanks, brackets, dots and typography: `m/s²`, `m/s^2`, `m/(s^2)` and
`meters/second^2` are one. Bytes that an editor has mangled are read where one unit is left that they can have been. A
magnetometer in arbitrary units has a direction and no strength: NaN.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np

from fg_nav.errors import FormatError
from fg_nav.frames import GRAVITY_M_S2

Quantity = Literal["time", "acc", "gyr", "mag", "pressure"]
"""Stamps, specific force, angular rate, magnetic flux density, pressure of the air."""

_DEGREE = np.pi / 180.0
_ARBITRARY = dict.fromkeys(("au", "arb", "arbu", "arbitrary", "normalized", "localflux"), np.nan)

GAUSS_UT = 100.0  # One gauss in uT.

_FACTORS: Mapping[Quantity, Mapping[str, float]] = MappingProxyType({
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "\ufffds": 1e-6, "ns": 1e-9, "min": 60.0},
    "acc": {
        "m/s2": 1.0, "m/s/s": 1.0, "ms2": 1.0, "ms-2": 1.0, "m/s\ufffd": 1.0, "cm/s2": 1e-2, "mm/s2": 1e-3,
        "g": GRAVITY_M_S2, "mg": 1e-3 * GRAVITY_M_S2, "ug": 1e-6 * GRAVITY_M_S2,
    },
    "gyr": {
        "rad/s": 1.0, "rads-1": 1.0, "rads": 1.0, "mrad/s": 1e-3, "deg/s": _DEGREE, "degs-1": _DEGREE,
        "\ufffd/s": _DEGREE, "dps": _DEGREE, "mdeg/s": 1e-3 * _DEGREE, "mdps": 1e-3 * _DEGREE, "rpm": np.pi / 30.0,
    },
    "mag": {
        "ut": 1.0, "\ufffdt": 1.0, "nt": 1e-3, "mt": 1e3, "t": 1e6, "g": GAUSS_UT, "gauss": GAUSS_UT, "gs": GAUSS_UT,
        "mg": 1e-3 * GAUSS_UT, "mgauss": 1e-3 * GAUSS_UT, "ug": 1e-6 * GAUSS_UT, **_ARBITRARY,
    },
    "pressure": {"pa": 1.0, "hpa": 100.0, "kpa": 1e3, "mbar": 100.0, "mb": 100.0, "bar": 1e5},
})  # fmt: skip

KNOWN_UNITS: Mapping[Quantity, str] = MappingProxyType({  # The usual words of each quantity, for messages.
    "time": "s, ms, us, ns", "acc": "m/s^2, g, mg", "gyr": "deg/s, rad/s, mdeg/s", "mag": "uT, nT, mT, T, G, mG",
    "pressure": "Pa, hPa, kPa, mbar",
})  # fmt: skip

_COUNTED = re.compile(r"^\s*(\d+(?:\.\d*)?(?:e-?\d+)?)(?:/(\d+(?:\.\d*)?))?\s*\*?\s*([^\d\s].*)$", re.IGNORECASE)

_MANGLED = (("ï¿½", "\ufffd"), ("Î¼", "μ"), ("Â", ""), ("º", "°"), ("˚", "°"))  # UTF-8 read as Latin-1; circles.

_LONG_WORDS = (
    *(("micro", "u"), ("milli", "m"), ("nano", "n"), ("centi", "c"), ("minutes?|mins", "min")),
    *(("seconds?|secs?", "s"), ("degrees?|°", "deg"), ("radians?", "rad"), ("met(?:er|re)s?", "m")),
    *(("teslas?", "t"), ("per", "/"), ("squared?", "2"), ("−", "-")),
)


def find_factor(quantity: Quantity, word: str) -> float | None:
    """Return the factor from a unit to s, m/s^2, rad/s, uT or Pa; NaN if the unit is arbitrary, None if unknown.

    A number before the unit is the size of one count, as in data sheets: `0.061 mg`, `1/16.4 deg/s`.

    >>> find_factor("acc", "(m/s²)"), find_factor("mag", "mG"), find_factor("acc", "1/4 m/s2"), find_factor("gyr", "mi")
    (1.0, 0.1, 0.25, None)
    """
    counted = _COUNTED.match(word)
    unit = _FACTORS[quantity].get(_simplify(counted[3] if counted else word))
    if unit is None or not counted:
        return unit
    scale = float(counted[1]) / float(counted[2] or 1.0) if float(counted[2] or 1.0) else 0.0
    return unit * scale if 0.0 < scale < np.inf else None


def find_scale(quantity: Quantity, unit: str, name: str, source: str) -> float:
    """Return the factor from the unit of the column `name`, as `find_factor`; raises `FormatError` if it is unknown."""
    factor = find_factor(quantity, unit)
    if factor is None:
        known = f"write one of {KNOWN_UNITS[quantity]}"
        raise FormatError(f"{source}: column '{name}' has the unit '{unit}', which is not known: {known}.")
    return factor


def find_quantity(word: str) -> Quantity | None:
    """Return what a unit is a unit of; `g` and `mg` are those of acceleration, `G` and `mG` those of a field."""
    found: list[Quantity] = [quantity for quantity in _FACTORS if find_factor(quantity, word) is not None]
    if len(found) > 1:
        return "mag" if word.strip().endswith("G") else "acc"
    return found[0] if found else None


_NO_TIMES = frozenset(  # Units that are certainly none of time.
    {"deg", "rad", "degc", "c", "degf", "k", "f", "v", "mv", "a", "ma", "%", "pa", "hpa", "m", "mm", "cm", "km", "m/s"}
)


def _simplify(word: str) -> str:
    for mangled, sign in _MANGLED:
        word = word.replace(mangled, sign)
    plain = unicodedata.normalize("NFKC", word).lower().replace("μ", "u")
    plain = re.sub(r"[\s^()\[\].*·_]", "", plain)
    for long, short in _LONG_WORDS:
        plain = re.sub(long, short, plain)
    return plain


# Names

Kind = Literal["time", "acc", "gyr", "mag", "counter", "no gravity", "gravity", "pressure"]

_QUANTITIES: dict[Kind, Quantity] = {  # Whose units a kind has.
    "time": "time", "counter": "time", "acc": "acc", "no gravity": "acc", "gravity": "acc", "gyr": "gyr", "mag": "mag",
    "pressure": "pressure",
}  # fmt: skip

_WORDS: dict[Kind, frozenset[str]] = {
    "time": frozenset({
        *("time", "times", "timestamp", "timestamps", "stamp", "stamps", "epoch", "epoc", "utc", "datetime", "ts"),
        *("tow", "ticks", "filetime", "elapsed", "itow", "clock", "zeit", "temps", "tiempo", "tempo", "tijd"),
        *("date", "datum", "fecha"),
    }),
    "acc": frozenset({"acc", "acce", "accl", "gforce", "accelero"}),
    "gyr": frozenset({"gyr", "omega", "angvel", "angrate", "angularrate", "rotationrate", "rotrate", "ω"}),
    "mag": frozenset({"mag", "magn", "compass", "bfield", "kompass"}),
    "counter": frozenset({"sample", "samples", "counter", "count", "packet", "seq", "index", "frame", "row", "idx"}),
}  # fmt: skip

_STEMS: tuple[tuple[str, Kind], ...] = (  # Beginnings of words, of other languages too, without their accents.
    *(("accel", "acc"), ("beschleun", "acc"), ("aceler", "acc"), ("versnell", "acc"), ("gyro", "gyr"), ("giro", "gyr")),
    *(("angularvel", "gyr"), ("winkelgeschw", "gyr"), ("drehr", "gyr"), ("drehg", "gyr"), ("hoeksnel", "gyr")),
    *(("magnet", "mag"), ("zeit", "time"), ("timest", "time"), ("horodat", "time")),
)

_PAIRS: dict[tuple[str, str], str] = {
    **{(a, b): "angvel" for a in ("angular", "ang", "turn", "rotation", "rot", "rotational")
       for b in ("velocity", "vel", "rate", "speed", "v")},
    ("vitesse", "angulaire"): "angvel", ("velocidad", "angular"): "angvel", ("velocita", "angolare"): "angvel",
    ("specific", "force"): "acc", ("g", "force"): "gforce", ("g", "f"): "gforce", ("packet", "counter"): "packet",
    ("sample", "counter"): "sample", ("including", "gravity"): "whole", ("with", "gravity"): "whole",
    ("without", "gravity"): "linear", ("no", "gravity"): "linear",
}  # fmt: skip

_LETTERS: dict[str, Kind] = {"a": "acc", "g": "gyr", "w": "gyr", "ω": "gyr", "m": "mag", "b": "mag"}  # Before an axis.
_ALONE: dict[str, Kind] = {"t": "time", "n": "counter", "i": "counter"}  # As a whole name.

_TIME_UNITS = {word: unit for unit, words in {  # Words for time that are its unit too.
    "s": "s sec secs second seconds", "ms": "ms msec msecs millis milliseconds",
    "us": "us usec usecs micros microseconds", "ns": "ns nsec nsecs nanosec nanosecs nanos nanoseconds",
}.items() for word in words.split()}  # fmt: skip

_NO_GRAVITY = frozenset({"linear", "lin", "user", "free", "dynamic", "nograv"})
_SATELLITES = frozenset({"gps", "gnss", "date", "datum", "fecha"})  # Words of clocks that say nothing of other columns.

_NOTHING = frozenset({
    *("covariance", "cov", "variance", "var", "bias", "sigma", "std", "accuracy", "valid", "status", "rms", "norm"),
    *("temp", "temperature", "pressure", "orientation", "quat", "quaternion", "euler", "heading", "angle", "angles"),
    *("roll", "pitch", "yaw", "delta", "magnitude", "absolute", "abs", "total", "position", "velocity", "jerk"),
    *("world", "earth", "global", "enu", "ned", "zone", "clip", "zupt", "zero", "label", "truth", "gt", "ref"),
    *_SATELLITES,
})  # fmt: skip

_RATES = frozenset({"roll", "pitch", "yaw", "velocity", "euler"})  # Of which angular rates are called.
RAW = frozenset({"uncal", "uncalibrated", "raw", "uncomp", "uncompensated"})  # Used where there are no others.

_BRACKETS = re.compile(r"^(.*?)\s*[(\[{<]\s*(.*?)\s*[)\]}>]\s*$", re.DOTALL)
_PIECES = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+|\d+")


@dataclass(frozen=True)
class Meaning:
    """What a header says of its column."""

    kind: Kind  # what the column measures
    axis: str  # x, y, z or, where axes are numbered, 0 to 3; empty where there is none
    unit: str | None  # the word for its unit, known or not; None where there is none
    stem: str  # the words without axis and unit: the same for the three axes of a sensor
    by_unit: bool = field(default=False, repr=False)  # whether the unit alone says the kind


def read_header(name: str) -> Meaning | None:
    """Return quantity, axis and unit of a column from its name; None if it is not used here.

    >>> read_header("Gyro_X (deg/s)")
    Meaning(kind='gyr', axis='x', unit='deg/s', stem='gyro')
    >>> read_header("temperature") is None
    True
    """
    for stem, unit, is_certain in _readings(name):
        words, axis = split_axis(split_words(stem))
        kind, said = _find_kind(words, axis), None if unit is None else find_quantity(unit)
        known = kind is not None and unit is not None and find_factor(_QUANTITIES[kind], unit) is not None
        plain = "" if unit is None else _simplify(unit).replace("\ufffd", "deg")
        if kind == "time" and (said not in ("time", None) or plain in _NO_TIMES):
            continue
        if kind is not None and (known or (is_certain and said in (None, "time"))):
            if kind == "time" and unit is None:
                unit = next((_TIME_UNITS[word] for word in words if word in _TIME_UNITS), None)
            return Meaning(kind, axis, "g" if unit is None and "gforce" in words else unit, " ".join(words))
        if is_certain and not axis and words and words[-1][-1:] in ("x", "y", "z"):  # RotRatex
            words, axis = [*words[:-1], words[-1][:-1]], words[-1][-1]
        by_unit = _find_kind_of_unit(words, axis, said, is_certain) if unit is not None else None
        if by_unit is not None:
            return Meaning(by_unit, axis, unit, " ".join(words), by_unit=True)
    return None


def _find_kind_of_unit(words: list[str], axis: str, quantity: Quantity | None, in_brackets: bool) -> Kind | None:
    """Return the kind of a column by the quantity of its unit, where the name has none and no word of it is against."""
    against = _NOTHING - {"velocity"} if quantity == "gyr" else _NOTHING  # an angular velocity is a rate
    if quantity is None or not (in_brackets or quantity == "gyr") or not against.isdisjoint(words):
        return None
    if bool(axis) == (quantity == "time"):
        return None
    if quantity != "acc":
        return quantity
    return "no gravity" if not _NO_GRAVITY.isdisjoint(words) else "gravity" if "gravity" in words else "acc"


def find_unit_kind(name: str) -> tuple[Quantity | None, str]:
    """Return of what the unit in brackets behind a name is one, and the unit; None where it is a statistic's."""
    bracketed = _BRACKETS.match(name)
    if bracketed is None or not (_NOTHING - _RATES).isdisjoint(split_words(bracketed[1])):
        return None, ""
    return find_quantity(bracketed[2]), bracketed[2]


def find_kinds_in(name: str) -> set[Kind]:
    """Return what the words of a name, such as a file's, name."""
    words = split_words(name)
    return _kinds_of(words) | ({"no gravity"} if not (_NO_GRAVITY | {"gravity"}).isdisjoint(words) else set())


def _readings(name: str) -> Iterator[tuple[str, str | None, bool]]:
    """Yield splits of a name into (rest, unit or None, whether the unit may be unknown), the likeliest first."""
    bracketed = _BRACKETS.match(name)
    if bracketed and bracketed[1] and not re.fullmatch(r"[xyzXYZ0-3]", bracketed[2]):
        yield bracketed[1], bracketed[2], True
        return
    parts = re.split(r"[\s_,;]+", name.strip())
    for count in (3, 2, 1):
        head, tail = parts[:-count], parts[-count:]
        if head:
            yield " ".join(head), "/".join(tail), False
            yield " ".join(head), "".join(tail), False
    yield name, None, True


def split_words(name: str) -> list[str]:
    """Return the words of a name in lower case, pairs with one meaning joined."""
    words: list[str] = []
    name = re.sub(r"(?<=[A-Z])([xyz])(?![a-z])", r" \1", name)  # ACCx
    plain = "".join(c for c in unicodedata.normalize("NFD", name) if not unicodedata.combining(c))
    for word in map(str.lower, _PIECES.findall(plain)):
        head, has_axis = word[:-1], word[-1] in "xyz"  # accx, ax
        if has_axis and head in _LETTERS:
            words += [_LETTERS[head], word[-1]]
        elif has_axis and (head in ("f", "gravity") or _kinds_of([head])):
            words += [head, word[-1]]
        else:
            words.append(word)
    joined: list[str] = []
    for word in words:
        if joined and (joined[-1], word) in _PAIRS:
            joined[-1] = _PAIRS[joined[-1], word]
        else:
            joined.append(word)
    return joined


def split_axis(words: list[str]) -> tuple[list[str], str]:
    """Take the axis out of the words: the only x, y or z, else a number from 0 to 3 at the end."""
    axes = [word for word in words if word in ("x", "y", "z")]
    if len(axes) == 1:
        return [word for word in words if word != axes[0]], axes[0]
    if len(words) > 1 and not axes and words[-1] in ("0", "1", "2", "3"):
        return words[:-1], words[-1]
    return words, ""


def _kinds_of(words: list[str]) -> set[Kind]:
    kinds = {kind for kind, known in _WORDS.items() if not known.isdisjoint(words)}
    kinds |= {kind for stem, kind in _STEMS for word in words if word.startswith(stem)}
    return kinds | ({"time"} if not _TIME_UNITS.keys().isdisjoint(words) else set())


def _find_kind(words: list[str], axis: str) -> Kind | None:
    kinds = _kinds_of(words)
    against = _NOTHING - _SATELLITES if kinds == {"time"} and not axis else _NOTHING
    if not words or not against.isdisjoint(words):
        return None
    if len(words) == 1 and words[0] in (_LETTERS if axis else _ALONE):
        return _LETTERS[words[0]] if axis else _ALONE[words[0]]
    if axis and ("gravity" in words or "grav" in words) and kinds <= {"acc"}:
        return "gravity"
    if axis in ("x", "y", "z"):
        kinds -= {"time", "counter"}
    elif "index" in words or kinds == {"counter"}:
        return "counter"
    elif "time" in kinds:
        return "time"
    if len(kinds - {"counter"}) != 1:
        return None
    (kind,) = kinds - {"counter"}
    return "no gravity" if kind == "acc" and not _NO_GRAVITY.isdisjoint(words) else kind
