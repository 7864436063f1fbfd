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

    Raises
    ------
    SimulationError
        Naming the field.
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
    _demand(owner, (name,), lambda value: 0 <= value <= most, f"a number from 0 to {most:g}")


def vector(owner: object, name: str, shape: tuple[int, ...] = (3,)) -> None:
    """Demand finite numbers in this shape; raises SimulationError."""
    if not _is_numeric(getattr(owner, name), shape):
        form = " x ".join(str(length) for length in shape)
        raise SimulationError(_complaint(owner, name, f"{form} finite numbers"))


def rows(name: str, value: Floats, t: Floats) -> None:
    """Demand a finite vector (N, 3) for each of the instants `t` (N,) s.

    Raises
    ------
    SimulationError
        Naming the input, and the first instant that is not finite.
    """
    if value.shape != (len(t), 3):
        raise SimulationError(f"{name} to measure has shape {value.shape}, not ({len(t)}, 3): give each instant a row.")
    finite = np.isfinite(value).all(axis=1)
    if not finite.all():
        when = t[np.argmin(finite)]
        raise SimulationError(f"{name} to measure is not finite at {when:.3f} s: look at what moves there.")


def _is_numeric(value: object, shape: tuple[int, ...]) -> bool:
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    return numbers.shape == shape and bool(np.isfinite(numbers).all())


def _demand(owner: object, names: tuple[str, ...], holds: Callable[[float], bool], wanted: str) -> None:
    for name in names:
        value = getattr(owner, name)
        if not isinstance(value, numbers.Real) or not holds(float(value)):
            raise SimulationError(_complaint(owner, name, wanted))


def _complaint(owner: object, name: str, wanted: str) -> str:
    return f"{name} of a {type(owner).__name__} is {getattr(owner, name)!r}: give {wanted}."
