"""Do the sensors of a stream have the same, right-handed axes? Asked of its first strides (`detection.handedness`).

Strides are counted in blocks of `BLOCK_S`, until `ENOUGH` of them show the axes that were given. Where others are
certain, a stream is refused in its first minute; later there is a remark, for a walk is not ended, and each line says
that it is not to be used.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.handedness import DECISIVE, NO_EVIDENCE, measure_axes
from fg_nav.errors import RecordingError
from fg_nav.online.source_check import REFUSED_S

BLOCK_S = 5.0
"""Four strides, most of them whole."""

ENOUGH = 15
"""Strides that show the axes given."""

FEWEST = 50
"""Samples of a block; fewer show no stride."""


class AxesCheck:
    """Looks at the rows of a stream as they come, whatever the blocks.

    Parameters
    ----------
    remark : given one sentence if wrong axes are seen later than `REFUSED_S`.
    refuses : whether a stream is refused in its first minute; not where a walk is resumed.

    Attributes
    ----------
    evidence : of the strides so far.
    """

    def __init__(self, remark: Callable[[str], None], refuses: bool = True) -> None:
        self.evidence = NO_EVIDENCE
        self._remark, self._refuses, self._remarked = remark, refuses, False
        self._rows = np.empty((0, 7))
        self._passed_s = 0.0

    def add(self, rows: Floats) -> None:
        """Look at rows (n, 10) as they were sent.

        Raises
        ------
        RecordingError
            If strides of the first minute surely show other axes than those given.
        """
        if self._is_settled:
            return
        usable = rows[np.isfinite(rows[:, :7]).all(axis=1), :7]
        self._rows = np.concatenate([self._rows, usable])
        while len(self._rows) and (full := np.abs(self._rows[:, 0] - self._rows[0, 0]) >= BLOCK_S).any():
            stop = int(np.argmax(full))
            block, self._rows = self._rows[:stop], self._rows[stop:]
            self._look(block)

    @property
    def _is_settled(self) -> bool:
        return self._remarked or (self.evidence.strides >= ENOUGH and self.evidence.against < 1.0)

    def _look(self, rows: Floats) -> None:
        """Count the strides of a block, if its stamps are in order."""
        if len(rows) < FEWEST or (np.diff(rows[:, 0]) <= 0.0).any():
            return
        self._passed_s += float(np.ptp(rows[:, 0]))
        self.evidence += measure_axes(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
        if self.evidence.against <= DECISIVE or self._remarked:
            return
        if self._refuses and self._passed_s <= REFUSED_S:
            raise RecordingError(f"{self.evidence.problem}.")
        self._remark(f"{self.evidence.problem}; the track is not to be used.")
        self._remarked = True
