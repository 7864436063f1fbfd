"""One seed, many independent streams of random numbers, each known by what it is for.

The same seed is the same sensor on the same person in every scenario: what a calibration loop finds holds in the
office of that seed. The walk, the field, what a sensor wakes up with and its noise are new in every scenario.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from fg_nav.errors import SimulationError

MAX_SEED = 2**63 - 1


@dataclass(frozen=True)
class Streams:
    """The generators of one seed and one scenario."""

    seed: int
    scenario: str

    def __post_init__(self) -> None:
        if not 0 <= self.seed <= MAX_SEED:
            raise SimulationError(f"{self.seed} is no seed: give a whole number from 0 to 2^63 - 1.")

    def lasting(self, purpose: str) -> np.random.Generator:
        """For what stays the same from scenario to scenario."""
        return self._generator(purpose)

    def of_this_walk(self, purpose: str) -> np.random.Generator:
        """For what is new in every scenario."""
        return self._generator(f"{self.scenario}/{purpose}")

    def _generator(self, name: str) -> np.random.Generator:
        return np.random.default_rng([self.seed, zlib.crc32(name.encode())])
