"""The samples of a walk in progress, wherever its sensor is worn: those that pass the checks are kept."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.online.buffer import COLUMNS, SampleBuffer, as_recording
from fg_nav.online.estimates import Revision, StanceEstimate
from fg_nav.online.sample_filter import SampleFilter
from fg_nav.online.unit_monitor import UnitMonitor
from fg_nav.recording import Recording

NO_ROWS = np.empty((0, COLUMNS))


class SampleIntake(ABC):
    """Navigates by samples in blocks of any size.

    Attributes
    ----------
    buffer, judge : the samples so far, and what was left out of them.
    units : in which they are.
    source : what a checkpoint keeps of the source for its reader, as JSON values.
    """

    def __init__(self, remark: Callable[[str], None], judge: SampleFilter | None) -> None:
        self.buffer = SampleBuffer()
        self.judge = SampleFilter(remark) if judge is None else judge
        self.units = UnitMonitor(remark)
        self.source: dict[str, Any] = {}
        self._closed, self._busy_s = False, 0.0

    def push(
        self, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None = None, pressure: Floats | None = None
    ) -> list[StanceEstimate | Revision]:
        """Add samples and return the estimates that they complete, and what they take back, in order.

        Parameters
        ----------
        t, acc, gyr, mag, pressure
            (n,) s, (n, 3) m/s^2, (n, 3) rad/s, (n, 3) uT and (n,) Pa, as they come; n may be 0 or 1. What cannot be
            used is left out (`fg_nav.online.sample_filter`).

        Raises
        ------
        RecordingError
            Where the first seconds show that a unit is wrong.
        EstimationError
            After the end; in a pocket, where there is no up to begin with.
        """
        if self._closed:
            raise EstimationError("this walk has ended: begin a new one for more samples.")
        began = perf_counter()
        field = np.full((len(t), 3), np.nan) if mag is None else mag
        air = np.full(len(t), np.nan) if pressure is None else pressure
        rows = self._accept(np.column_stack([t, acc, gyr, field, air]))
        self._busy_s += perf_counter() - began
        if len(rows):
            self._prepare()
        return self.add_rows(rows)

    def add_rows(self, rows: Floats) -> list[StanceEstimate | Revision]:
        """Add rows (n, 12) that passed the checks, here or as a recording; return estimates as `push` does."""
        began = perf_counter()
        found = self._add_rows(rows)
        self._busy_s += perf_counter() - began
        return found

    @property
    def has_ended(self) -> bool:
        """Whether the walk was closed."""
        return self._closed

    @property
    def races(self) -> int:
        """Number of decisions that depended on solver timing."""
        return 0

    @property
    def takeovers(self) -> tuple[int, ...]:
        """Lines before which a background solution was adopted, since the newest state."""
        return ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out or odd, in words."""
        return (*self.judge.notes, *self.units.notes)

    def _accept(self, sent: Floats = NO_ROWS, at_end: bool = False) -> Floats:
        """Return the rows (m, 12) to use, of these as sent and of what waited; `at_end` none waits any more."""
        rows = self.units.accept(sent, at_end)
        self.source["units"] = self.units.state()
        rows = self.judge.accept(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10], rows[:, 10])
        return np.concatenate([rows, self.judge.flush()]) if at_end else rows

    @abstractmethod
    def _prepare(self) -> None:
        """Get ready for samples that just came from a source."""

    @abstractmethod
    def _add_rows(self, rows: Floats) -> list[StanceEstimate | Revision]:
        """Put rows into the buffer, and estimate by them."""

    def _cut_all(self, use_mag: bool = True) -> Recording:
        """Cut out all samples, with the magnetometer if there is one; raises `RecordingError` if there are too few."""
        rows = self.buffer.between(0, self.buffer.stop)
        return as_recording(rows, use_mag and bool(np.isfinite(rows[:, 7:10]).all(axis=1).any()))
