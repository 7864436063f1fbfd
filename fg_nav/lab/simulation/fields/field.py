"""What a magnetic field is: flux density as a function of place. Fields of separate sources add."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fg_nav.arrays import Floats


class Field(Protocol):
    """A static magnetic field."""

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT in nav (East-North-Up) at `position` (N, 3) m in nav."""
        ...


@dataclass(frozen=True)
class Sum:
    """The field of several sources."""

    parts: Sequence[Field]

    def at(self, position: Floats) -> Floats:
        """Flux density (N, 3) uT at `position` (N, 3) m."""
        total: Floats = np.sum([part.at(position) for part in self.parts], axis=0)
        return total
