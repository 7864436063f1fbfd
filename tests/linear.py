"""Blocks of factors linearized, as factors of gtsam one by one."""

from collections.abc import Iterator
from typing import Any, Protocol

import gtsam
import numpy as np

from fg_nav.factors.residual import Stack


class Linearizable(Protocol):
    """What has its linear factors as arrays."""

    def stack(self, values: gtsam.Values) -> list[Stack]: ...


def linear_factors(block: Linearizable, values: gtsam.Values) -> Iterator[gtsam.JacobianFactor]:
    """Linear factors of a block at these values, in its order."""
    make: Any = gtsam.JacobianFactor
    sizes = values.dims()
    for keys, rows in block.stack(values):
        ends = np.cumsum([sizes[int(key)] for key in keys[0]])[:-1]
        noise = gtsam.noiseModel.Unit.Create(rows.shape[1])
        for names, A_b in zip(keys.tolist(), rows, strict=True):
            parts = np.split(A_b[:, :-1], ends, axis=1)
            yield make(*(x for pair in zip(names, parts, strict=True) for x in pair), A_b[:, -1], noise)
