"""A method in one word: its name, its preset and its changed parameters.

    smoother    ma2018:as-printed    smoother,magnetic.rounds=3,walk.floors=true

The word is part of a result's key; one without changes is the name and the preset alone.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import cast

from fg_nav.ekf.presets import TUNED, check_preset
from fg_nav.errors import EstimationError
from fg_nav.estimators import find_method, find_parameters
from fg_nav.pipeline import run_method
from fg_nav.text import Changes, Scalar, Value, change_parameters
from fg_nav.walk import Outcome, Walk

_WORD = re.compile(r"[\w.-]+")


@dataclass(frozen=True)
class Method:
    """A method, its preset, and changes of its parameters."""

    name: str
    preset: str = TUNED
    changes: Changes = ()

    @property
    def base(self) -> str:
        """Word of the same without changes."""
        return self.name if self.preset == TUNED else f"{self.name}:{self.preset}"

    @property
    def word(self) -> str:
        """Its word."""
        changes = (f"{name}={value if isinstance(value, str) else json.dumps(value)}" for name, value in self.changes)
        return ",".join([self.base, *changes])

    def checked(self) -> Method:
        """Return itself with its values as the parameters have them: 1 and 1.0 are one value of a real number.

        Raises `EstimationError` if there is no such method, preset of it or parameter, or a value is of another type.
        """
        found = find_method(self.name)
        check_preset(self.preset)
        if "preset" not in found.uses and self.preset != TUNED:
            raise EstimationError(f"{self.name} has no presets: leave ':{self.preset}' out.")
        for name, value in self.changes:
            if not isinstance(value, Scalar):
                raise EstimationError(f"the parameter '{name}' cannot be {value!r} here: give a number or a word.")
            if isinstance(value, str) and not _WORD.fullmatch(value):
                raise EstimationError(f"the parameter '{name}' cannot be {value!r}: give one word.")
        parameters = change_parameters(find_parameters(self.name, self.preset), self.changes)
        typed = tuple((name, cast("Value", attrgetter(name)(parameters))) for name, _ in self.changes)
        return replace(self, changes=typed)


def method_of(word: str) -> Method:
    """Read a word; raises `EstimationError` if there is no such method or preset."""
    base, *words = word.split(",")
    name, _, preset = base.partition(":")
    find_method(name)
    check_preset(preset or TUNED)
    changes: list[tuple[str, Value]] = []
    for parameter, _, text in (one.partition("=") for one in words):
        try:
            changes.append((parameter, json.loads(text)))
        except ValueError:  # a word
            changes.append((parameter, text))
    return Method(name, preset or TUNED, tuple(changes))


def solve_by(word: str, walk: Walk) -> Outcome:
    """Run a method by its word; raises as `fg_nav.pipeline.run_method`."""
    method = method_of(word)
    changes = tuple((f"{find_method(method.name).owner}.{name}", value) for name, value in method.changes)
    options = replace(walk.options, preset=method.preset, changes=changes)
    return run_method(replace(walk, options=options), method.name)
