"""How what is measured becomes a reason for or against a path, and reasons a word."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

Word = Literal["trusted", "doubtful", "not to be used"]

UNUSABLE: Word = "not to be used"

NO_USE = 2.0
"""Weight of a sign that spoils a path alone."""

LIGHT = 0.8
"""Weight of a sign that makes no path doubtful, but is named."""

NAMING = 0.0
"""Weight of words that say what others may come from."""

MANY = 4.0
"""Sum of the weights, of those of 1 and more, that spoils a path."""


@dataclass(frozen=True)
class Reason:
    """A sign that was seen: its weight, and words with what was measured."""

    weight: float
    words: str


@dataclass(frozen=True)
class Verdict:
    """The word, and what speaks against the path, the heaviest first; a trusted path may have light reasons."""

    word: Word
    reasons: tuple[str, ...]


def weigh(value: float, doubtful: float, no_use: float) -> float:
    """Weight of a value: 1 at the first limit, 2 at the second, linear in the logarithm; nothing is as bad as NaN."""
    if np.isnan(value):
        return NO_USE
    return 1.0 + float(np.log(max(value, 1e-12) / doubtful) / np.log(no_use / doubtful))


def combine(found: Sequence[Reason]) -> Verdict:
    """Combine reasons by their weight."""
    heavy = sorted((reason for reason in found if reason.weight >= 1.0), key=lambda reason: -reason.weight)
    light = [reason for reason in found if reason.weight in (LIGHT, NAMING)]
    words = tuple(reason.words for reason in (*heavy, *light))
    if not heavy:
        return Verdict("trusted", tuple(reason.words for reason in light if reason.weight == LIGHT))
    spoiled = heavy[0].weight >= NO_USE or sum(min(reason.weight, NO_USE) for reason in heavy) >= MANY
    return Verdict(UNUSABLE if spoiled else "doubtful", words)
