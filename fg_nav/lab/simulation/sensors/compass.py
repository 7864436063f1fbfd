"""All magnetometer chips of a sensor: read at once, in the iron they share, and averaged."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.lab.simulation.sensors import checks
from fg_nav.lab.simulation.sensors.average import mean_of
from fg_nav.lab.simulation.sensors.iron import Iron
from fg_nav.lab.simulation.sensors.magnetometer import Magnetometer, MagnetometerPrior, Ticks

BodyField: TypeAlias = Callable[[Floats], Floats]
"""The field (M, 3) uT in the body frame, without iron, at rising instants (M,) s."""


class Compass:
    """The magnetometers of all units during one walk: they are read at once."""

    def __init__(
        self,
        prior: MagnetometerPrior | None,
        chips: list[Magnetometer | None],
        iron: Iron,
        board_R_body: Floats,
        rng: np.random.Generator,
    ) -> None:
        self._prior = prior
        self._chips = [chip for chip in chips if chip is not None]
        self._iron, self._turn = iron, board_R_body.T
        ticks_rng, *self._rngs = rng.spawn(1 + len(self._chips))
        timing = prior or MagnetometerPrior()
        self._ticks, self._lag_s = Ticks(timing.rate_hz, ticks_rng), timing.lag_s
        self._last = np.full((1, 3), np.nan)

    def measure(self, t: Floats, body_field: BodyField | None) -> tuple[Floats | None, Bools | None]:
        """Readings (N, 3) uT of the next N rows and which (N,) are fresh.

        Raises
        ------
        SimulationError
            If the field is not a finite vector for every instant it is asked for.
        """
        if self._prior is None or body_field is None:
            return None, None
        fresh = self._ticks.fresh(t)
        reading = self._read(body_field, t[fresh] - self._lag_s)
        if self._prior.held:
            return self._repeated(reading, fresh), fresh
        mag = np.full((len(t), 3), np.nan)
        mag[fresh] = reading
        return mag, fresh

    def _read(self, body_field: BodyField, instants: Floats) -> Floats:
        """Readings (M, 3) uT of the samples taken at these instants (M,) s; a block may have none."""
        if not len(instants):
            return np.zeros((0, 3))
        field = body_field(instants)
        checks.rows("field", field, instants)
        bent = self._iron.bent(field @ self._turn)
        return mean_of([chip.read(bent, rng) for chip, rng in zip(self._chips, self._rngs, strict=True)])

    def _repeated(self, reading: Floats, fresh: Bools) -> Floats:
        known = np.vstack([self._last, reading])
        self._last = known[-1:]
        return np.asarray(known[np.cumsum(fresh)])
