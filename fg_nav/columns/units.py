"""Unit words: how much of s, m/s^2, rad/s, uT or Pa each is.

Words are compared without case, blanks, brackets, dots and typography: `m/s²`, `m/s^2`, `m/(s^2)` and `meters/second^2`
are one, and so are `µT` and `μT`, which look alike and are two characters. Bytes that an editor has mangled are read
where one unit is left that they can have been. A magnetometer in arbitrary units has a direction and no strength: NaN.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

import numpy as np

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

KNOWN_UNITS: Mapping[Quantity, str] = MappingProxyType({
    "time": "s, ms, us, ns", "acc": "m/s^2, g, mg", "gyr": "deg/s, rad/s, mdeg/s", "mag": "uT, nT, mT, T, G, mG",
    "pressure": "Pa, hPa, kPa, mbar",
})  # fmt: skip
"""The usual words of each quantity, for messages."""

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


def find_quantity(word: str) -> Quantity | None:
    """Return what a unit is a unit of; `g` and `mg` are those of acceleration, `G` and `mG` those of a field."""
    found: list[Quantity] = [quantity for quantity in _FACTORS if find_factor(quantity, word) is not None]
    if len(found) > 1:
        return "mag" if word.strip().endswith("G") else "acc"
    return found[0] if found else None


_OF_SOMETHING_ELSE = frozenset(
    {"deg", "rad", "degc", "c", "degf", "k", "f", "v", "mv", "a", "ma", "%", "pa", "hpa", "m", "mm", "cm", "km", "m/s"}
)


def is_of_something_else(word: str) -> bool:
    """Return whether a unit is certainly none of time: that of another quantity, or of an angle or a temperature."""
    return find_quantity(word) not in ("time", None) or _simplify(word).replace("\ufffd", "deg") in _OF_SOMETHING_ELSE


def _simplify(word: str) -> str:
    for mangled, sign in _MANGLED:
        word = word.replace(mangled, sign)
    plain = unicodedata.normalize("NFKC", word).lower().replace("μ", "u")
    plain = re.sub(r"[\s^()\[\].*·_]", "", plain)
    for long, short in _LONG_WORDS:
        plain = re.sub(long, short, plain)
    return plain
