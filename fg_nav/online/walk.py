"""The walk so far: samples and footfalls as they came, cut out again as a recording and its stances.

Samples, footfalls and stance intervals are counted from the first of the walk. What was forgotten leaves the count as
it is. What only a whole recording tells of a sensor, its sample period and at which levels it clips, is kept from when
the walk was last cut out as a whole, for the parts that are cut out after that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.recording import Recording
from fg_nav.stances import Stances

_COLUMNS = 10
"""Stamp, specific force, rate, field."""

_FIRST_ROWS = 4096

AT_END = 0.97
"""Share of the largest that was read, from which on a level may be that of a range: calibration smears it."""

_BEFORE = 40
"""Samples before a node that are cut out with those after it: enough for a recording."""


class Samples(NamedTuple):
    """Samples in order of time: `t` (n,) s, `acc` (n, 3) m/s^2, `gyr` (n, 3) rad/s, `mag` (n, 3) uT or None.

    `acc` and `gyr` are finite, stamps increase; rows of `mag` without a sample are NaN.
    """

    t: Floats
    acc: Floats
    gyr: Floats
    mag: Floats | None = None


@dataclass(frozen=True)
class Footfall:
    """One footfall: its stance intervals `start[k] <= i < stop[k]` and the stillest sample, within one of them.

    Samples are counted from the first of the walk. One that `continues` is a further piece of a long standing.
    """

    start: Ints
    stop: Ints
    stillest: int
    continues: bool = False


class WalkSoFar:
    """Samples and footfalls that were not yet forgotten."""

    def __init__(self) -> None:
        self._rows = np.empty((_FIRST_ROWS, _COLUMNS))
        self._first, self._count = 0, 0
        self._footfalls: list[Footfall] = []
        self._forgotten = 0
        self._steps = 0
        self._with_mag = False
        self._sensor: tuple[float, tuple[Floats, Floats]] | None = None
        self._extreme = np.zeros((2, 2, 3))  # specific force and rate, upper and lower end

    @property
    def first(self) -> int:
        """First sample that is kept."""
        return self._first

    @property
    def stop(self) -> int:
        """Sample after the last."""
        return self._first + self._count

    @property
    def n_footfalls(self) -> int:
        """Number of footfalls of the walk, forgotten ones among them."""
        return self._forgotten + len(self._footfalls)

    @property
    def n_steps(self) -> int:
        """Number of footfalls that were not further pieces of a standing."""
        return self._steps

    @property
    def t(self) -> Floats:
        """Stamps of the samples that are kept, s."""
        return self._rows[: self._count, 0]

    def footfall(self, number: int) -> Footfall:
        """Return a footfall that is kept."""
        return self._footfalls[number - self._forgotten]

    def add(self, samples: Samples, footfall: Footfall) -> None:
        """Append samples, and the footfall that they complete.

        Raises
        ------
        EstimationError
            With samples that are not finite or out of order, or a footfall that is not among them.
        """
        rows = _as_rows(samples)
        self._check(rows, footfall)
        self._make_room(len(rows))
        self._rows[self._count : self._count + len(rows)] = rows
        self._count += len(rows)
        for sensor, columns in enumerate((rows[:, 1:4], rows[:, 4:7])):
            ends = columns.max(axis=0, initial=0.0), -columns.min(axis=0, initial=0.0)
            self._extreme[sensor] = np.maximum(self._extreme[sensor], ends)
        self._with_mag |= samples.mag is not None
        self._footfalls.append(footfall)
        self._steps += not footfall.continues

    def forget(self, footfalls: int, samples: int) -> None:
        """Forget all footfalls before one, and all samples before one."""
        self._footfalls = self._footfalls[max(footfalls - self._forgotten, 0) :]
        self._forgotten = max(self._forgotten, footfalls)
        drop = min(max(samples - self._first, 0), self._count)
        kept = self._rows[drop : self._count].copy()
        self._rows[: len(kept)] = kept
        self._first, self._count = self._first + drop, len(kept)

    def whole(self) -> Recording:
        """Cut out all samples; a copy."""
        recording = self._cut(self._rows[: self._count])
        self._sensor = recording.period_s, recording.clipping
        return recording

    def recording(self, first: int) -> Recording:
        """Cut out the samples from one on; a copy."""
        return self._of_sensor(self._cut(self._rows[first - self._first : self._count]))

    def stances(self, first_footfall: int, first: int) -> Stances:
        """Stances of the footfalls from one on, on the recording cut out from sample `first` on."""
        return stances_of(self._footfalls[first_footfall - self._forgotten :], first, self.stop)

    def with_more(self, samples: Samples, sample: int) -> tuple[Recording, int]:
        """Samples from some before `sample` on, with more behind them; and where in them `sample` is."""
        first = max(sample - _BEFORE, self._first)
        rows = np.vstack([self._rows[first - self._first : self._count], _as_rows(samples)])
        return self._of_sensor(self._cut(rows)), sample - first

    def _cut(self, rows: Floats) -> Recording:
        mag = rows[:, 7:] if self._with_mag else None
        return Recording(t=rows[:, 0], acc=rows[:, 1:4], gyr=rows[:, 4:7], mag=mag)

    def _of_sensor(self, part: Recording) -> Recording:
        """A part of the walk, clipped at the levels of the whole.

        Where the whole had not clipped yet, at its own, if these are at the end of all that was read: what is flat in a
        part may be someone who stands.
        """
        if self._sensor is None:
            return part
        period_s, known = self._sensor
        of_part = zip(part.clipping, self._extreme, strict=True)
        believed = (np.where(level >= AT_END * extreme, level, np.inf) for level, extreme in of_part)
        acc, gyr = (np.where(np.isfinite(k), k, new) for k, new in zip(known, believed, strict=True))
        return part.known_by(period_s, (acc, gyr))

    def _check(self, rows: Floats, footfall: Footfall) -> None:
        begins = self._footfalls[-1].stop[-1] if self._footfalls else 0
        ends = np.stack([footfall.start, footfall.stop], axis=1).ravel()
        in_order = len(ends) > 0 and ends[0] >= begins and (np.diff(ends)[::2] > 0).all() and (np.diff(ends) >= 0).all()
        within = ((footfall.start <= footfall.stillest) & (footfall.stillest < footfall.stop)).any()
        if not in_order or not within or ends[-1] > self.stop + len(rows):
            raise EstimationError(
                f"footfall {self.n_footfalls} is not one: its stances must follow those before, within the "
                "samples, and the stillest sample must be in one of them."
            )
        stamps = np.concatenate([self._rows[self._count - 1 : self._count, 0] if self._count else [], rows[:, 0]])
        if not np.isfinite(rows[:, :7]).all() or not (np.diff(stamps) > 0).all():
            raise EstimationError(
                f"samples of footfall {self.n_footfalls} are not finite, or their stamps do not rise: leave them out."
            )

    def _make_room(self, rows: int) -> None:
        needed = self._count + rows
        if needed > len(self._rows):
            grown = np.empty((max(needed, 2 * len(self._rows)), _COLUMNS))
            grown[: self._count] = self._rows[: self._count]
            self._rows = grown


def stances_of(footfalls: list[Footfall], first: int, stop: int) -> Stances:
    """Stances of some footfalls on the samples `first <= i < stop`; intervals outside of these are cut."""
    number = np.repeat(np.arange(len(footfalls)), [len(one.start) for one in footfalls])
    start = np.concatenate([one.start for one in footfalls]) - first
    end = np.concatenate([one.stop for one in footfalls]) - first
    statistic = np.ones(stop - first)
    statistic[np.array([one.stillest for one in footfalls]) - first] = 0.0
    return Stances(start, end, number, n_samples=stop - first, statistic=statistic)


def _as_rows(samples: Samples) -> Floats:
    mag = np.full((len(samples.t), 3), np.nan) if samples.mag is None else samples.mag
    return np.column_stack([samples.t, samples.acc, samples.gyr, mag])
