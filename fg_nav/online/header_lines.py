"""Which lines of a stream are headers: names where rows have numbers."""

from __future__ import annotations

MIN_NAMES = 6  # Of a header, force and rate; fewer words are a message of the device.


def is_header(fields: list[str]) -> bool:
    """Whether a line is made of names: as many as a sample has, each another, text, and no number among them."""
    names = fields if fields[-1] else fields[:-1]
    return len(set(names)) == len(names) >= MIN_NAMES and all(map(_is_name, names))


def _is_name(word: str) -> bool:
    is_text = word.isprintable() and "\ufffd" not in word and any(map(str.isalpha, word))
    return is_text and not is_number(word)


def is_number(field: str) -> bool:
    """Whether a field is a number, NaN included."""
    try:
        float(field)
    except ValueError:
        return False
    return True
