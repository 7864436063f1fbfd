"""Which samples of a stream are taken. What a file would be refused for is left out here: a walk in progress goes on.

================================= ==========================================================================
missing (NaN, empty, no range)    left out
stamp as the one before           left out
stamp before the last one         left out; after `RESTART` of them in order the clock has begun anew, and
                                  is carried on
stamp more than `JUMP_S` ahead    waits for the next: left out if that one is back in line
more than `LONGEST_GAP_S` ahead   carried on as after `UNKNOWN_GAP_S`: stamps are set back by the rest
gap of more than `MAX_GAP_S`      told; the estimator doubts what nobody saw
wrong unit, gravity removed       refused, as in a file, once `CHECKED` samples are there
================================= ==========================================================================

Each kind is counted, and told once.

A judge is resumed from a checkpoint to the last bit. What comes then may be the same stream from its beginning, or
what a sensor sends now (`overlap`). If the stamps of that are before the last one, the sensor was switched off and on,
and its clock began anew. For how long nobody saw the foot cannot be known; the walk is carried on after a gap of
`UNKNOWN_GAP_S`, in which heading and place are lost: their sigmas say so. A clock that began anew and has already
passed the last stamp looks like a gap, and is taken for one.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import RecordingError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.online.overlap import TAIL, Overlap, prints_of
from fg_nav.online.store import COLUMNS
from fg_nav.plausibility import acc_problem, field_strength, mag_problem, median_period_s, stamp_problem
from fg_nav.recording import MAX_GAP_S, RawRecording, usable_samples
from fg_nav.wording import counted

JUMP_S = 1.0
"""A step ahead that is believed only if the next stamp goes on from there."""

RESTART = 100
"""Stamps before the last one that follow each other: no delay on the way, but a clock that was set anew."""

LONGEST_GAP_S = 30.0
"""A longer step is no gap: its sigmas are kilometres, a second one makes more of them than the solver bears, and nobody
walks so far. It may be a clock that was set, too."""

UNKNOWN_GAP_S = 10.0
"""In place of a time that nobody knows: it loses place and heading."""

MOST_LEFT = 4096
"""Rows left out for their stamps that a checkpoint knows again."""

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
    "rebooted": f"the clock of the sensor began anew while nobody listened: a gap of {UNKNOWN_GAP_S:g} s is assumed",
    "gap": f"there is a gap of more than {MAX_GAP_S:g} s: the track goes on with larger sigmas",
    "unseen": f"nothing came for more than {LONGEST_GAP_S:g} s: a gap of {UNKNOWN_GAP_S:g} s is assumed",
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
        self._clocks = [(0, 0.0)]
        self._taken = 0
        self._behind: list[float] = []
        self._waits = np.empty((0, COLUMNS))
        self._tail = np.empty((0, COLUMNS))
        self._left: deque[int] = deque(maxlen=MOST_LEFT)
        self._overlap: Overlap | None = None
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
        return self._taken_of(self._unknown(np.column_stack([t, acc, gyr, field])[usable]))

    def rest(self) -> Floats:
        """Return the rows (m, 10) to take of those that wait, at the end of the stream, for more to be judged by."""
        return self._taken_of(self._unknown(np.empty((0, COLUMNS)), at_end=True))

    def state(self) -> dict[str, Any]:
        """Return what `resumed` needs, as JSON knows it."""
        held = self._waits[:0] if self._overlap is None else self._overlap.held
        return {
            "counts": dict(self.counts),
            "last": self._last,
            "before": self._before,
            "offset": self._offset,
            "clocks": self._clocks,
            "behind": self._behind,
            "waits": self._waits.tolist(),
            "tail": self._tail.tolist(),
            "held": held.tolist(),
            "left": list(self._left),
            "to_check": self._to_check,
        }

    @classmethod
    def resumed(cls, state: Mapping[str, Any], samples: Floats, remark: Callable[[str], None]) -> SampleJudge:
        """Return a judge that goes on behind a checkpoint with these samples (N, 10), as if it had never stopped."""
        judge = cls(remark)
        judge.counts.update(state["counts"])
        judge._last, judge._before, judge._offset = (float(state[name]) for name in ("last", "before", "offset"))
        judge._clocks = [(int(first), float(offset)) for first, offset in state["clocks"]]
        judge._taken = len(samples)
        judge._behind = [float(t) for t in state["behind"]]
        judge._waits, judge._tail, held = (_rows(state[name]) for name in ("waits", "tail", "held"))
        judge._to_check = int(state["to_check"])
        judge._first = [samples[:CHECKED]] if judge._to_check > 0 else []
        judge._left.extend(state["left"])
        judge._overlap = Overlap(samples, judge._clocks, judge._left, judge._tail, held)
        return judge

    @property
    def notes(self) -> tuple[str, ...]:
        """What there was, in words."""
        return tuple(f"{number} times: {WORDS[kind]}" for kind, number in self.counts.items())

    def _count(self, kind: str, number: int, where: str) -> None:
        if number and not self.counts[kind]:
            self._remark(f"{WORDS[kind]}, the first {where}.")
        self.counts[kind] += number

    def _unknown(self, rows: Floats, at_end: bool = False) -> Floats:
        """Leave out what a checkpoint knows already."""
        overlap = self._overlap
        if overlap is None:
            return rows
        began, known = overlap.is_over, overlap.known
        rows = overlap.beyond(rows, at_end)
        if overlap.known > known:
            self._count("known", overlap.known - known, f"before t = {self._tail[-1, 0]:.3f} s")
        if overlap.is_over and not began:
            if not overlap.known:
                self._look_for_reboot(rows[:, 0])
            self._overlap = None
        return rows

    def _look_for_reboot(self, t: Floats) -> None:
        """Set the clock on where a source goes on with stamps (n,) that are all before the last one."""
        restarts = self._behind and t[0] + self._offset > self._behind[-1]
        if len(t) and not restarts and (t[:RESTART] + self._offset < self._last).all():
            self._count("rebooted", 1, f"at t = {t[0]:.3f} s, after {self._last:.3f} s")
            self._set_on(self._last + UNKNOWN_GAP_S - (float(t[0]) + self._offset), self._taken)

    def _taken_of(self, sent: Floats) -> Floats:
        """Return the rows to take, of these as they were sent and of what waited."""
        self._tail = np.concatenate([self._tail, sent[-TAIL:]])[-TAIL:]
        rows = self._in_order(np.concatenate([self._waits, sent]))
        self._taken += len(rows)
        self._tell_gaps(rows)
        self._check_units(rows)
        return rows

    def _in_order(self, sent: Floats) -> Floats:
        """Leave out the rows whose stamps do not go on from the last one."""
        self._waits = sent[:0]
        rows = sent.copy()
        rows[:, 0] += self._offset
        step = np.diff(rows[:, 0], prepend=self._last)
        started = self._last > -np.inf
        if not self._behind and (step > 0).all() and (step[not started :] <= JUMP_S).all():
            self._last = float(rows[-1, 0]) if len(rows) else self._last
            return rows
        keep = np.zeros(len(rows), dtype=bool)
        for i in range(len(rows)):
            t, before, shift = float(rows[i, 0]), self._last, 0.0
            if t <= before:
                shift = self._restart(t)
                keep[i] = shift > 0.0
            elif t - before <= JUMP_S or not started:
                keep[i], self._behind = True, []
            elif i + 1 == len(rows):
                self._waits = sent[i:]
            elif rows[i + 1, 0] > t:
                keep[i], self._behind = True, []
                shift = self._jump(t)
            else:
                self._count("ahead", 1, f"at t = {t:.3f} s")
            if shift:
                self._set_on(shift, self._taken + int(keep[:i].sum()))
                rows[i:, 0] = sent[i:, 0] + self._offset
            if keep[i]:
                self._last, started = float(rows[i, 0]), True
        judged = len(sent) - len(self._waits)
        self._left.extend(prints_of(sent[:judged][~keep[:judged]]).tolist())
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
        self._count("restart", 1, f"at t = {t:.3f} s, after {self._last:.3f} s")
        return self._last + period - first

    def _jump(self, t: float) -> float:
        """By how much the clock has to be set back for a stamp far ahead, mostly nothing, s."""
        if t - self._last <= LONGEST_GAP_S:
            return 0.0
        self._count("unseen", 1, f"before t = {t:.3f} s, after {self._last:.3f} s")
        return self._last + UNKNOWN_GAP_S - t

    def _set_on(self, shift: float, sample: int) -> None:
        """Set the clock on from a sample on."""
        self._offset += shift
        self._clocks.append((sample, self._offset))
        self._behind = []

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


def _rows(content: Any) -> Floats:
    return np.array(content, dtype=np.float64).reshape(-1, COLUMNS)


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
