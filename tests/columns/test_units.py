"""Unit words of every spelling, and what they are in SI."""

import numpy as np
import pytest

from fg_nav.columns.headers import KNOWN_UNITS, find_factor, find_quantity
from fg_nav.frames import GRAVITY_M_S2

DEGREE = np.pi / 180


@pytest.mark.parametrize(
    ("quantity", "words", "factor"),
    [
        ("acc", "m/s^2, m/s², m/s2, m/(s^2), [m/s**2], M/S2, m/s/s, m s^-2, m·s⁻², meters/second^2, m/s�, m/sÂ²", 1.0),
        ("acc", "g, G, (g)", GRAVITY_M_S2),
        ("acc", "mg, milli g", 1e-3 * GRAVITY_M_S2),
        ("acc", "cm/s2, cm/s^2", 1e-2),
        ("gyr", "rad/s, rad s-1, radians per second, rad/sec, RAD/S, rad.s^-1", 1.0),
        ("gyr", "deg/s, °/s, º/s, dps, degrees/sec, Â°/s, �/s, deg_s-1", DEGREE),
        ("gyr", "mdps, mdeg/s", 1e-3 * DEGREE),
        ("mag", "uT, µT, μT, microtesla, Î¼T, �T, UT", 1.0),
        ("mag", "nT, nanoTesla", 1e-3),
        ("mag", "mT", 1e3),
        ("mag", "T, tesla", 1e6),
        ("mag", "G, gauss, Gs, Gauss", 100.0),
        ("mag", "mG, mgauss, milligauss", 0.1),
        ("time", "s, sec, seconds, (s)", 1.0),
        ("time", "ms, msec, milliseconds, millis", 1e-3),
        ("time", "us, µs, μs, usec, micros, microseconds", 1e-6),
        ("time", "ns, nanos", 1e-9),
        ("time", "min, minutes", 60.0),
    ],
)
def test_spellings(quantity, words, factor):
    for word in words.split(", "):
        assert find_factor(quantity, word) == pytest.approx(factor, rel=1e-15), word


def test_units_of_no_size_and_of_another_quantity():
    assert all(np.isnan(find_factor("mag", word)) for word in ("a.u.", "a.u", "arb. u.", "local_flux"))
    for quantity, word in (("acc", "deg/s"), ("gyr", "deg"), ("time", ""), ("mag", "furlong")):
        assert find_factor(quantity, word) is None


def test_units_without_a_quantity():
    assert [find_quantity(word) for word in ("ms", "g", "mg", "G", "mG", "deg/s", "uT", "counts")] == [
        *("time", "acc", "acc", "mag", "mag", "gyr", "mag"),
        None,
    ]


def test_the_words_of_messages_are_known():
    for quantity, words in KNOWN_UNITS.items():
        assert all(find_factor(quantity, word) for word in words.split(", "))
