"""Do the sensors of a stream have the same, right-handed axes? Asked of its first strides.

Foot and pocket as in `detection.handedness`. They are counted
in blocks of `BLOCK_S`, until `ENOUGH` of them show the axes that were given, or `MAX_STRIDES` are there. Where others
are certain, a stream is refused in its first minute; later there is a remark, for a walk is not ended, and each line
says that it is not to be used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.detection.handedness import (
    AXES,
    DECISIVE,
    MAX_STRIDES,
    NO_EVIDENCE,
    NO_SWINGS,
    SWINGS_S,
    AxesEvidence,
    MeasureAxes,
    measure_axes,
    measure_swing_axes,
)
from fg_nav.detection.mount import Wearing
from fg_nav.errors import RecordingError
from fg_nav.online.buffer import SampleBuffer
from fg_nav.online.source_check import REFUSED_S

BLOCK_S: Mapping[Wearing, float] = {"foot": 5.0, "pocket": SWINGS_S + 0.05}
"""Four strides, most of them whole; of a thigh a window in which their period is found."""

MEASURES: Mapping[Wearing, MeasureAxes] = {"foot": measure_axes, "pocket": measure_swing_axes}

UNSEEN: Mapping[Wearing, AxesEvidence] = {"foot": NO_EVIDENCE, "pocket": NO_SWINGS}

ENOUGH = 15  # Strides that show the axes given.
FEWEST = 50  # Samples of a block; fewer show no stride.


class AxesCheck:
    """Looks at the samples of a walk as they come, whatever the blocks.

    Parameters
    ----------
    remark : given one sentence if wrong axes are seen later than `REFUSED_S`.
    refuses : whether a stream is refused in its first minute; not where a walk is resumed.
    mount : where the sensor is worn.

    Attributes
    ----------
    evidence : of the strides so far.
    """

    def __init__(self, remark: Callable[[str], None], refuses: bool = True, mount: Wearing = "foot") -> None:
        self.evidence = UNSEEN[mount]
        self._block_s, self._measure = BLOCK_S[mount], MEASURES[mount]
        self._remark, self._refuses = remark, refuses
        self._begins = 0  # sample at which the next block begins
        self._passed_s = 0.0

    def look_at(self, buffer: SampleBuffer) -> None:
        """Look at the samples that have come since.

        Raises
        ------
        RecordingError
            If strides of the first minute surely show other axes than those given.
        """
        while not self._is_settled and (stop := self._find_end(buffer)) is not None:
            self._look(buffer.between(self._begins, stop))
            self._begins = stop

    def state(self) -> dict[str, Any]:
        """Return what `resume` needs, as JSON values; of axes that are settled no more than their number."""
        found = self.evidence
        scores = [] if self._is_settled and not found.against else found.scores.tolist()
        return {"begins": self._begins, "passed_s": self._passed_s, "scores": scores, "gravity": found.gravity.tolist()}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on where another check of the same walk was."""
        self._begins, self._passed_s = int(state["begins"]), float(state["passed_s"])
        gravity = np.array(state["gravity"], dtype=np.float64)
        scores = np.array(state["scores"] or np.zeros((len(gravity), len(AXES))), dtype=np.float64)
        self.evidence = replace(self.evidence, scores=scores.reshape(len(gravity), len(AXES)), gravity=gravity)

    @property
    def _is_settled(self) -> bool:
        found = self.evidence
        agrees = found.strides >= ENOUGH and found.against < 1.0
        return agrees or found.strides >= MAX_STRIDES or found.against > DECISIVE

    def _find_end(self, buffer: SampleBuffer) -> int | None:
        """Return the end of the block that begins now; None where it has not come."""
        self._begins = max(self._begins, buffer.first)
        if self._begins >= buffer.stop:
            return None
        stop = buffer.find_since(buffer.stamp(self._begins) + self._block_s, buffer.stop)
        return None if stop == buffer.stop else stop

    def _look(self, rows: Floats) -> None:
        """Count the strides of a block."""
        if len(rows) < FEWEST:
            return
        self._passed_s += float(np.ptp(rows[:, 0]))
        self.evidence += self._measure(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
        if self.evidence.against <= DECISIVE:
            return
        if self._refuses and self._passed_s <= REFUSED_S:
            raise RecordingError(f"{self.evidence.problem}.")
        self._remark(f"{self.evidence.problem}; the track is not to be used.")
