"""Which samples of a stream are taken. What a file would be refused for is left out here: a walk in progress goes on.

================================= ==========================================================================
missing (NaN, empty, no range)    left out
stamp as the one before           left out
stamp before the last one         left out; after `RESTART` of them in order the clock has begun anew, and
                                  is carried on
stamp more than `JUMP_S` ahead    waits for the next: left out if that one is back in line
gap of more than `MAX_GAP_S`      told; the estimator doubts what nobody saw
wrong unit, gravity removed       refused, as in a file, once `CHECKED` samples are there
================================= ==========================================================================

Each kind is counted, and told once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.online.store import COLUMNS
from fg_nav.plausibility import acc_problem, field_strength, mag_problem, median_period_s, stamp_problem
from fg_nav.recording import MAX_GAP_S, RawRecording, usable_samples
from fg_nav.wording import counted

JUMP_S = 1.0
"""A step ahead that is believed only if the next stamp goes on from there."""

RESTART = 100
"""Stamps before the last one that follow each other: no delay on the way, but a clock that was set anew."""

CHECKED = 1000
"""Samples, some seconds, that show in which unit they are."""

PLAUSIBLE_G = (0.7, 2.0)
"""Median specific force on a foot, in g."""

FIELD_UT = (5.0, 200.0)
"""Field on a foot; a magnet makes more of it for a while ..."""

LEAST_SHARE = 0.05
"""... but not always."""

WORDS = {
    "missing": "samples are missing (empty, NaN or out of any range) and left out",
    "repeated": "stamps repeat the one before, and their samples are left out",
    "backward": "stamps are before the last one, and their samples are left out",
    "ahead": "stamps are far ahead of the next ones, and their samples are left out",
    "restart": "the clock of the sensor was set anew, and is carried on",
    "gap": f"there is a gap of more than {MAX_GAP_S:g} s: the track goes on with larger sigmas",
    "known": "samples are in the checkpoint already and left out",
}
"""What is said of each kind, the first time."""


class SampleJudge:
    """Takes what can be navigated with; `counts` holds how much of each kind of `WORDS` there was.

    Parameters
    ----------
    remark
        Told one sentence the first time that something of a kind happens.

    Raises
    ------
    RecordingError
        From `admit`, if the samples are in a wrong unit.
    """

    def __init__(self, remark: Callable[[str], None] = lambda words: None) -> None:
        self.counts: Counter[str] = Counter()
        self._remark = remark
        self._last = -np.inf
        self._before = np.nan
        self._offset = 0.0
        self._behind: list[float] = []
        self._waits = np.empty((0, COLUMNS))
        self._known_until = -np.inf
        self._first: list[Floats] = []
        self._to_check = CHECKED

    def admit(self, t: Floats, acc: Floats, gyr: Floats, mag: Floats | None = None) -> Floats:
        """Return the rows (m, 10) to take, of this block and of what waited: t, acc, gyr, mag.

        Parameters
        ----------
        t, acc, gyr, mag
            (n,) s, (n, 3) m/s^2, (n, 3) rad/s, (n, 3) uT; whatever a sensor may deliver.
        """
        field = np.full((len(t), 3), np.nan) if mag is None else mag
        raw = RawRecording(t, acc, gyr, np.arange(len(t)), field)
        usable = usable_samples(raw)
        if not usable.all():
            self._count("missing", int((~usable).sum()), f"near t = {self._last:.3f} s")
        rows = np.column_stack([t, acc, gyr, field])[usable]
        rows[:, 0] += self._offset
        rows = self._in_order(np.concatenate([self._waits, self._unknown(rows)]))
        self._tell_gaps(rows)
        self._check_units(rows)
        return rows

    def state(self) -> dict[str, Any]:
        """Return what `resumed` needs, as JSON knows it."""
        return {"counts": dict(self.counts), "last": self._last, "offset": self._offset, "to_check": self._to_check}

    @classmethod
    def resumed(cls, state: Mapping[str, Any], remark: Callable[[str], None]) -> SampleJudge:
        """Return a judge that goes on behind a checkpoint: what was taken before is left out without a word."""
        judge = cls(remark)
        judge.counts.update(state["counts"])
        judge._last = judge._before = judge._known_until = float(state["last"])
        judge._offset = float(state["offset"])
        judge._to_check = CHECKED if state["to_check"] > 0 else 0
        return judge

    @property
    def notes(self) -> tuple[str, ...]:
        """What there was, in words."""
        return tuple(f"{number} times: {WORDS[kind]}" for kind, number in self.counts.items())

    def _count(self, kind: str, number: int, where: str) -> None:
        if number and not self.counts[kind]:
            self._remark(f"{WORDS[kind]}, the first {where}.")
        self.counts[kind] += number

    def _unknown(self, rows: Floats) -> Floats:
        """Leave out what a checkpoint knows already."""
        if self._known_until == -np.inf:
            return rows
        beyond = rows[:, 0] > self._known_until
        first = int(np.argmax(beyond)) if beyond.any() else len(rows)
        if first:
            self._count("known", first, f"at t = {rows[0, 0]:.3f} s")
        if beyond.any():
            self._known_until = -np.inf
        return rows[first:]

    def _in_order(self, rows: Floats) -> Floats:
        """Leave out the rows whose stamps do not go on from the last one."""
        self._waits = rows[:0]
        step = np.diff(rows[:, 0], prepend=self._last)
        started = self._last > -np.inf
        if not self._behind and (step > 0).all() and (step[not started :] <= JUMP_S).all():
            self._last = float(rows[-1, 0]) if len(rows) else self._last
            return rows
        keep = np.zeros(len(rows), dtype=bool)
        for i in range(len(rows)):
            t, before = float(rows[i, 0]), self._last
            if t <= before:
                rows[i:, 0] += self._restart(t)
                keep[i] = rows[i, 0] > before
            elif t - before <= JUMP_S or not started:
                keep[i], self._behind = True, []
            elif i + 1 == len(rows):
                self._waits = rows[i:]
            elif rows[i + 1, 0] > t:
                keep[i], self._behind = True, []
            else:
                self._count("ahead", 1, f"at t = {t:.3f} s")
            if keep[i]:
                self._last, started = float(rows[i, 0]), True
        return rows[keep]

    def _restart(self, t: float) -> float:
        """Count a stamp that is not after the last one; by how much the clock has to be set on, mostly nothing, s."""
        if t == self._last:
            self._count("repeated", 1, f"at t = {t:.3f} s")
            return 0.0
        self._count("backward", 1, f"at t = {t:.3f} s, after {self._last:.3f} s")
        self._behind = [*self._behind, t] if not self._behind or t > self._behind[-1] else [t]
        if len(self._behind) < RESTART:
            return 0.0
        first, period = self._behind[0], (t - self._behind[0]) / (RESTART - 1)
        shift = self._last + period - first
        self._count("restart", 1, f"at t = {t:.3f} s, after {self._last:.3f} s")
        self._offset += shift
        self._behind = []
        return shift

    def _tell_gaps(self, rows: Floats) -> None:
        if len(rows) == 0:
            return
        step = np.diff(rows[:, 0], prepend=rows[0, 0] if np.isnan(self._before) else self._before)
        self._before = float(rows[-1, 0])
        gap = step > MAX_GAP_S
        if gap.any():
            i = int(np.argmax(gap))
            self._count("gap", int(gap.sum()), f"of {step[i]:.2f} s before t = {rows[i, 0]:.3f} s")

    def _check_units(self, rows: Floats) -> None:
        """Refuse samples whose first ones show a wrong unit."""
        if self._to_check <= 0:
            return
        self._first.append(rows[: self._to_check])
        self._to_check -= len(rows)
        if self._to_check > 0:
            return
        seen = np.concatenate(self._first)
        self._first = []
        for problem in _unit_problems(seen[:, 0], seen[:, 1:4], seen[:, 7:10]):
            if problem is not None:
                raise RecordingError(f"{problem} (seen in the first {counted(CHECKED, 'sample')}).")


def _unit_problems(t: Floats, acc: Floats, mag: Floats) -> Iterator[str | None]:
    """Name what is in a wrong unit, as for a file; but not because a sensor hangs, or a magnet is near, for seconds."""
    period = median_period_s(t)
    yield stamp_problem(period)
    low, high = np.array(PLAUSIBLE_G) * GRAVITY_M_S2
    if not low < np.median(np.linalg.norm(acc, axis=1)) < high:
        yield acc_problem(acc, period)
    strength = field_strength(mag)
    if not np.mean((strength > FIELD_UT[0]) & (strength < FIELD_UT[1])) > LEAST_SHARE:
        yield mag_problem(mag)
