"""Array types: one name per dtype, so that signatures say what flows; and dataclasses of arrays, printed in a line."""

from collections.abc import Sized
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Complexes: TypeAlias = NDArray[np.complex128]
Ints: TypeAlias = NDArray[np.int64]
Bools: TypeAlias = NDArray[np.bool_]

MAX_WORDS = 60  # Letters of a field that is printed; a longer one is named by its type.

MAD_TO_SIGMA = 1.4826  # Median absolute deviation to standard deviation, of a normal distribution.


def robust_sigma(values: Floats) -> float:
    """Standard deviation of values (N,) about zero, without the tails, by their median."""
    return MAD_TO_SIGMA * float(np.median(np.abs(values)))


def weigh_models(log_evidence: Floats, prior: Floats | None = None) -> Floats:
    """Posterior weights (L,) of L models, by log evidence (L,) and, if given, prior weights (L,); their sum is 1."""
    weight = np.exp(log_evidence - log_evidence.max()) * (1.0 if prior is None else prior)
    return np.asarray(weight / weight.sum())


def interpolate_columns(asked: Floats, x: Floats, values: Floats) -> Floats:
    """Return the rows (M, c) of values (K, c) at x (K,), interpolated where they are asked for (M,)."""
    return np.stack([np.interp(asked, x, column) for column in values.T], axis=1)


def find_runs(mask: Bools) -> tuple[Ints, Ints]:
    """First sample (K,) and sample after the last (K,) of each run of True in an (N,) mask."""
    edges = np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


class Brief:
    """A base of dataclasses with a repr of one line: arrays by their shapes, what is long by its type."""

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        if "__repr__" not in vars(cls):  # else `dataclass` makes one
            cls.__repr__ = Brief.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        """Name the fields in a line."""
        known = ((item.name, getattr(self, item.name)) for item in fields(cast("Any", self)) if item.repr)
        return f"{type(self).__name__}({', '.join(f'{name}={abbreviate(value)}' for name, value in known)})"


def abbreviate(value: object) -> str:
    """Return the repr of a value where it is short, else its type, of an array with its shape."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}"
    kind = type(value).__name__
    if isinstance(value, str | int | float | Path | None) and len(words := repr(value)) <= MAX_WORDS:
        return words
    return f"<{kind} of {len(value)}>" if isinstance(value, Sized) else f"<{kind}>"
