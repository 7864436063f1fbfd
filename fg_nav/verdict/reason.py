"""How what is measured becomes a reason for or against a path, and reasons a word."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

Word = Literal["trusted", "doubtful", "not to be used"]

UNUSABLE: Word = "not to be used"

NO_USE = 2.0  # Weight of a sign that spoils a path alone.
LIGHT = 0.8  # Weight of a sign that makes no path doubtful, but is named.
NAMING = 0.0  # Weight of words that say what others may come from.
UNSEEN = -1.0  # Weight of a sign that there is not.
MANY = 4.0  # Sum of the weights, of those of 1 and more, that spoils a path.


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


HARMLESS_SHARE = 0.01  # Of the way, m: what a good path is off by, whatever its sigma says.
USE_SHARE = 0.1  # Of the way, m: a path that is off by more, or has so large a 95 % region, is of no use.
MIN_WAY_M = 10.0  # A shorter way is judged as if it were that: seven strides.


def weigh_error(error_m: float, sigma_m: float, way_m: float) -> float:
    """Weight of an error of the end, m: 1 at the sigma of the result, 2 at a tenth of the way, or two sigmas."""
    way_m = max(way_m, MIN_WAY_M)
    known_m = float(np.hypot(sigma_m, HARMLESS_SHARE * way_m))
    return weigh(error_m, known_m, max(USE_SHARE * way_m, 2.0 * known_m))


def combine(found: Sequence[Reason]) -> Verdict:
    """Combine reasons by their weight."""
    heavy = sorted((reason for reason in found if reason.weight >= 1.0), key=lambda reason: -reason.weight)
    light = [reason for reason in found if reason.weight in (LIGHT, NAMING)]
    words = tuple(reason.words for reason in (*heavy, *light))
    if not heavy:
        return Verdict("trusted", tuple(reason.words for reason in light if reason.weight == LIGHT))
    spoiled = heavy[0].weight >= NO_USE or sum(min(reason.weight, NO_USE) for reason in heavy) >= MANY
    return Verdict(UNUSABLE if spoiled else "doubtful", words)
