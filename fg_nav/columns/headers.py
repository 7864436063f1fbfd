"""What the name of a column says: `Acc X [g]`, `gyro_x (deg/s)`, `angular_velocity.x`, `mag_z_uT`, `ax`, `Time (ms)`.

A name is taken apart into words at blanks, signs and capitals. A unit stands in brackets or at its end, an axis is a
word of its own or the last letter, and what is left says the quantity. Acceleration without gravity (linear, user,
free) is a kind of its own: no path can be had of it. Names of what is computed of samples, a covariance, say nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from fg_nav.columns.units import Quantity, find_factor

Kind = Literal["time", "acc", "gyr", "mag", "counter", "no gravity"]

_WORDS: dict[Kind, frozenset[str]] = {
    "time": frozenset({
        *("time", "times", "timestamp", "timestamps", "stamp", "stamps", "epoch", "epoc", "utc", "datetime", "ts"),
        *("elapsed", "seconds", "secs", "millis", "milliseconds", "micros", "microseconds", "nanos", "nanoseconds"),
    }),
    "acc": frozenset({"acc", "accl", "accel", "accelero", "accelerometer", "acceleration", "accelerations", "gforce"}),
    "gyr": frozenset({"gyr", "gyro", "gyros", "gyroscope", "omega", "angvel", "angrate", "rotationrate", "ω"}),
    "mag": frozenset({"mag", "magn", "magneto", "magnetometer", "magnetic", "compass", "bfield"}),
    "counter": frozenset({"sample", "samples", "counter", "count", "packet", "seq", "index", "frame", "row", "idx"}),
}  # fmt: skip

_PAIRS: dict[tuple[str, str], str] = {
    ("angular", "velocity"): "gyr", ("angular", "rate"): "gyr", ("angular", "speed"): "gyr", ("ang", "vel"): "gyr",
    ("rotation", "rate"): "gyr", ("turn", "rate"): "gyr", ("specific", "force"): "acc", ("g", "force"): "gforce",
    ("g", "f"): "gforce", ("packet", "counter"): "packet", ("sample", "counter"): "sample",
}  # fmt: skip

_LETTERS: dict[str, Literal["acc", "gyr", "mag"]] = {
    "a": "acc",
    "g": "gyr",
    "w": "gyr",
    "ω": "gyr",
    "m": "mag",
    "b": "mag",
}
"""In front of an axis."""

_ALONE: dict[str, Kind] = {"t": "time", "ms": "time", "us": "time", "ns": "time", "n": "counter", "i": "counter"}
"""As a whole name."""

_TIME_UNITS = {
    "seconds": "s", "secs": "s", "millis": "ms", "milliseconds": "ms", "ms": "ms", "micros": "us", "microseconds": "us",
    "us": "us", "nanos": "ns", "nanoseconds": "ns", "ns": "ns",
}  # fmt: skip
"""Words for time that are its unit too."""

_NO_GRAVITY = frozenset({"linear", "lin", "user", "free"})

_NOTHING = frozenset({
    *("covariance", "cov", "variance", "var", "bias", "sigma", "std", "accuracy", "valid", "status", "rms", "norm"),
    *("temp", "temperature", "pressure", "gravity", "grav", "orientation", "quat", "quaternion", "euler", "heading"),
    *("roll", "pitch", "yaw", "delta", "magnitude", "absolute", "abs", "total", "position", "velocity", "jerk"),
    *("world", "earth", "global", "enu", "ned", "gps", "gnss", "date", "zone", "clip", "zupt", "zero", "label"),
    *("truth", "gt", "ref"),
})  # fmt: skip

_UNSURE = frozenset({"uncal", "uncalibrated", "raw", "uncomp", "uncompensated"})

_BRACKETS = re.compile(r"^(.*?)\s*[(\[{<]\s*(.*?)\s*[)\]}>]\s*$", re.DOTALL)
_PIECES = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+|\d+")


@dataclass(frozen=True)
class Meaning:
    """What a header says of its column.

    Attributes
    ----------
    kind : what the column measures.
    axis : x, y, z or, where axes are numbered, 0 to 3; empty where there is none.
    unit : the word for its unit, known or not; None where there is none.
    stem : the words without axis and unit: the same for the three axes of a sensor.
    """

    kind: Kind
    axis: str
    unit: str | None
    stem: str

    @property
    def is_unsure(self) -> bool:
        """Whether the samples are raw or uncalibrated: used where there are no others."""
        return not _UNSURE.isdisjoint(self.stem.split())


def read_header(name: str) -> Meaning | None:
    """Say what a column's name means; None if nothing that is used here.

    >>> read_header("Gyro_X (deg/s)")
    Meaning(kind='gyr', axis='x', unit='deg/s', stem='gyro')
    >>> read_header("temperature") is None
    True
    """
    for stem, unit, is_certain in _readings(name):
        words, axis = _split_axis(_split_words(stem))
        kind = _find_kind(words, axis)
        if kind is None or not (is_certain or find_factor(quantity_of(kind), unit or "") is not None):
            continue
        if kind == "time" and unit is None:
            unit = next((_TIME_UNITS[word] for word in words if word in _TIME_UNITS), None)
        return Meaning(kind, axis, "g" if unit is None and "gforce" in words else unit, " ".join(words))
    return None


def quantity_of(kind: Kind) -> Quantity:
    """Return the quantity whose units a kind has."""
    return "acc" if kind == "no gravity" else "time" if kind == "counter" else kind


def _readings(name: str) -> Iterator[tuple[str, str | None, bool]]:
    """Ways to split a name into a rest and a unit, the likeliest first; True where the unit may be unknown."""
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


def _split_words(name: str) -> list[str]:
    """Words of a name in lower case; the pairs that mean one thing are one word."""
    words: list[str] = []
    for piece in _PIECES.findall(name):
        words += _split_run(piece.lower())
    joined: list[str] = []
    for word in words:
        if joined and (joined[-1], word) in _PAIRS:
            joined[-1] = _PAIRS[joined[-1], word]
        else:
            joined.append(word)
    return joined


def _split_run(word: str) -> list[str]:
    """Split a word that ends with its axis, such as accx or ax."""
    head, axis = word[:-1], word[-1:]
    if axis and axis in "xyz":
        if head in _LETTERS:
            return [_LETTERS[head], axis]
        if head == "f" or any(head in words for words in _WORDS.values()):
            return [head, axis]
    return [word]


def _split_axis(words: list[str]) -> tuple[list[str], str]:
    """Take the axis out of the words: the only x, y or z, else a number from 0 to 3 at the end."""
    axes = [word for word in words if word in ("x", "y", "z")]
    if len(axes) == 1:
        return [word for word in words if word != axes[0]], axes[0]
    if len(words) > 1 and not axes and words[-1] in ("0", "1", "2", "3"):
        return words[:-1], words[-1]
    return words, ""


def _find_kind(words: list[str], axis: str) -> Kind | None:
    if not words or not _NOTHING.isdisjoint(words):
        return None
    if len(words) == 1 and words[0] in (_LETTERS if axis else _ALONE):
        return _LETTERS[words[0]] if axis else _ALONE[words[0]]
    kinds = {kind for kind, known in _WORDS.items() if not known.isdisjoint(words)}
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
