"""Checks of a sensor's parameters and inputs: what cannot be is named, parameters before anything is simulated.

A parameter may be a number or nested tuples of numbers, as `Triple` and `Matrix`.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import SimulationError

Triple: TypeAlias = tuple[float, float, float]
"""A constant vector along the body's axes."""

Matrix: TypeAlias = tuple[Triple, Triple, Triple]
"""A constant 3 x 3 matrix, row by row."""

ZERO: Triple = (0.0, 0.0, 0.0)

IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def not_negative(owner: object, *names: str) -> None:
    """Demand finite numbers of 0 or more.

    Raises `SimulationError`, naming the field.
    """
    _demand(owner, names, lambda value: math.isfinite(value) and value >= 0, "a finite number of 0 or more")


def positive(owner: object, *names: str) -> None:
    """Demand numbers above 0, infinity included; raises SimulationError."""
    _demand(owner, names, lambda value: value > 0, "a number above 0")


def positive_finite(owner: object, *names: str) -> None:
    """Demand finite numbers above 0; raises SimulationError."""
    _demand(owner, names, lambda value: math.isfinite(value) and value > 0, "a finite number above 0")


def at_least(owner: object, name: str, least: float) -> None:
    """Demand a finite number no smaller than `least`; raises SimulationError."""
    wanted = f"a finite number of {least:g} or more"
    _demand(owner, (name,), lambda value: math.isfinite(value) and value >= least, wanted)


def share(owner: object, name: str, most: float) -> None:
    """Demand a number from 0 to `most`; raises SimulationError."""
    up_to(most, owner, name)


def between(least: float, most: float, owner: object, *names: str, called: str = "") -> None:
    """Demand numbers from `least` to `most`; `called` is the owner's name if not its type's; raises SimulationError."""
    _demand(owner, names, lambda value: least <= value <= most, f"a number from {least:g} to {most:g}", called)


def up_to(most: float, owner: object, *names: str, called: str = "") -> None:
    """Demand numbers from 0 to `most`; raises SimulationError."""
    between(0.0, most, owner, *names, called=called)


def vector(owner: object, name: str, shape: tuple[int, ...] = (3,), most: float = math.inf, called: str = "") -> None:
    """Demand finite numbers in this shape, none larger than `most` either way; raises SimulationError."""
    if not _is_numeric(getattr(owner, name), shape, most):
        form = " x ".join(str(length) for length in shape)
        limits = f" from {-most:g} to {most:g}" if math.isfinite(most) else ""
        raise SimulationError(_complaint(owner, name, f"{form} finite numbers{limits}", called))


def rows(name: str, value: Floats, t: Floats) -> None:
    """Demand a finite vector (N, 3) for each of the instants `t` (N,) s.

    Raises `SimulationError`, naming the input, and the first instant that is not finite.
    """
    if value.shape != (len(t), 3):
        raise SimulationError(f"{name} to measure has shape {value.shape}, not ({len(t)}, 3): give each instant a row.")
    finite = np.isfinite(value).all(axis=1)
    if not finite.all():
        when = t[np.argmin(finite)]
        raise SimulationError(f"{name} to measure is not finite at {when:.3f} s: look at what moves there.")


def _is_numeric(value: object, shape: tuple[int, ...], most: float) -> bool:
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    return numbers.shape == shape and bool((np.isfinite(numbers) & (np.abs(numbers) <= most)).all())


def _demand(
    owner: object, names: tuple[str, ...], holds: Callable[[float], bool], wanted: str, called: str = ""
) -> None:
    for name in names:
        value = getattr(owner, name)
        if not isinstance(value, numbers.Real) or not holds(float(value)):
            raise SimulationError(_complaint(owner, name, wanted, called))


def _complaint(owner: object, name: str, wanted: str, called: str) -> str:
    return f"{name} of a {called or type(owner).__name__} is {getattr(owner, name)!r}: give {wanted}."
