"""In which unit the first samples of a stream are, told by their size, as for a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.samples.plausibility import (
    find_acc_problem,
    find_mag_problem,
    find_stamp_problem,
    measure_field_strength,
    median_period_s,
)
from fg_nav.text import format_count

PLAUSIBLE_G = (0.7, 2.0)  # Median specific force on a foot, in g.
FIELD_UT = (5.0, 200.0)  # Field on a foot; a magnet makes more of it for a while ...
MIN_SHARE = 0.05  # ... but not always.


CHECKED = 1000  # Samples, some seconds, that show in which unit they are.


class UnitCheck:
    """Looks at the first `CHECKED` samples of a stream, `left` of which are still to come.

    `blocks` are those that came, (n, 11) each of t, acc, gyr, mag.
    """

    def __init__(self, left: int = CHECKED, blocks: Sequence[Floats] = ()) -> None:
        self.left, self._first = left, [*blocks] if left > 0 else []

    def see(self, rows: Floats) -> None:
        """Add rows (n, 11); raises `RecordingError` once they show a wrong unit."""
        if self.left <= 0:
            return
        self._first.append(rows[: self.left])
        self.left -= len(rows)
        if self.left > 0:
            return
        seen, self._first = np.concatenate(self._first), []
        for problem in find_unit_problems(seen[:, 0], seen[:, 1:4], seen[:, 7:10]):
            if problem is not None:
                raise RecordingError(f"{problem} (seen in the first {format_count(CHECKED, 'sample')}).")


def find_unit_problems(t: Floats, acc: Floats, mag: Floats) -> Iterator[str | None]:
    """Name what is in a wrong unit, as for a file; but not because a sensor hangs, or a magnet is near, for seconds."""
    period = median_period_s(t)
    yield find_stamp_problem(period)
    low, high = np.array(PLAUSIBLE_G) * GRAVITY_M_S2
    if not low < np.median(np.linalg.norm(acc, axis=1)) < high:
        yield find_acc_problem(acc, period)
    strength = measure_field_strength(mag)
    if not np.mean((strength > FIELD_UT[0]) & (strength < FIELD_UT[1])) > MIN_SHARE:
        yield find_mag_problem(mag)
