"""Array types: one name per dtype, so that signatures say what flows."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Complexes: TypeAlias = NDArray[np.complex128]
Ints: TypeAlias = NDArray[np.int64]
Bools: TypeAlias = NDArray[np.bool_]

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
