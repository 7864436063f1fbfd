"""Samples that were lost on the way, counted by the stamps of those that came.

A sensor samples evenly: within a window of `WINDOW` rows the median step between stamps is its period T, and a step of
k T, k = 2, 3, ..., lacks k - 1 samples. Longer steps than `MAX_S` are gaps, which are remarked by themselves.
Of stamps that jitter only steps of more than `GAP_PERIODS` periods are counted. Where T is another in `IN_A_ROW`
windows, the sensor's rate has changed, which is said.

What this machine had no room for is counted by the system (`live.Datagrams`), as datagrams.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.online.overlap import Overlap
from fg_nav.recording import GAP_PERIODS
from fg_nav.samples.plausibility import find_stamp_problem, median_period_s
from fg_nav.text import format_count

WINDOW = 200  # Rows; more than half of the steps among them are one period, unless more than every third sample is lost
MAX_S = 1.0  # A longer step is a sensor that was off, or a clock that was set.

EVEN, MAX_UNEVEN = 0.25, 0.1
"""Steps within so many periods of a whole number of them are even; so many of the others are let pass."""


IN_A_ROW, ANOTHER = 3, 1.2
"""Windows with a period this many times longer or shorter than that before them: the rate has changed."""


class LossCounter:
    """Counts what is lost of a stream, whatever the blocks in which its rows come.

    Attributes
    ----------
    samples, came : how many are missing by the stamps, and how many came.

    Parameters
    ----------
    remark : given one sentence the first time that samples are missing, and whenever the rate changes.
    """

    def __init__(self, remark: Callable[[str], None]) -> None:
        self.samples = self.came = 0
        self._remark = remark
        self._window = self._held = np.empty(0)
        self._period_s, self._others = np.nan, 0

    def add(self, t: Floats, overlap: Overlap | None = None) -> None:
        """Look at the stamps (n,) s of rows as they were sent; NaN is ignored.

        Those of a resumed walk wait until its `overlap`, which has seen them, is over: only what is new counts.
        """
        t, self._held = np.concatenate([self._held, t]), t[:0]
        if overlap is not None and overlap.skips:
            seen = np.flatnonzero(np.isin(t, [overlap.known_until, *self._window[-1:]]))
            t = t[seen[-1] + 1 :] if len(seen) else t
        if overlap is not None and not overlap.is_over:
            self._held = t
            return
        self.came += len(t)
        self._window = np.concatenate([self._window, t[np.isfinite(t)]])
        while len(self._window) > WINDOW:
            self._count(self._window[: WINDOW + 1])
            self._note_rate(self._window[: WINDOW + 1])
            self._window = self._window[WINDOW:]

    def finish(self) -> None:
        """Count the rows of a window that is not full, at the end, and of those that wait the later ones."""
        t, self._held = self._held, self._held[:0]
        self.add(t[t > self._window[-1]] if len(self._window) else t)
        self._count(self._window)
        self._window = self._window[-1:]

    def report(self, datagrams: int) -> dict[str, int]:
        """Return what was lost so far, with the datagrams for which this machine had no room."""
        return {"samples": self.samples, "came": self.came, "datagrams": datagrams}

    def state(self) -> dict[str, Any]:
        """Return what `resume` needs, as JSON values."""
        period_s = self._period_s if np.isfinite(self._period_s) else None
        counts = {"samples": self.samples, "came": self.came, "others": self._others}
        return counts | {"window": self._window.tolist(), "held": self._held.tolist(), "period_s": period_s}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on where another counter of the same stream was; raises `ValueError` for what none can be."""
        self.samples, self.came, self._others = (int(state[name]) for name in ("samples", "came", "others"))
        self._window, self._held = (np.array(state[name], dtype=float).reshape(-1) for name in ("window", "held"))
        self._period_s = np.nan if state["period_s"] is None else float(state["period_s"])
        if min(self.samples, self.came, self._others) < 0 or not np.isfinite(self._window).all():
            raise ValueError("a count below zero, or a stamp that is none")

    def _count(self, t: Floats) -> None:
        missing = count_missing(t)
        lost = int(missing.sum())
        if lost and not self.samples:
            first = int(np.argmax(missing > 0))
            self._remark(
                f"samples are lost on the way here, by the stamps: the first {missing[first]} before "
                f"t = {t[first + 1]:.3f} s."
            )
        self.samples += lost

    def _note_rate(self, t: Floats) -> None:
        """Say it where the rate has changed."""
        period_s = median_period_s(t)
        if find_stamp_problem(period_s) is not None:
            return  # no rate: stamps in another unit
        if not max(period_s / self._period_s, self._period_s / period_s) > ANOTHER:
            self._period_s, self._others = period_s, 0
            return
        self._others += 1
        if self._others == IN_A_ROW:
            self._remark(
                f"the rate of the sensor has changed near t = {t[0]:.3f} s, from {1.0 / self._period_s:.4g} to "
                f"{1.0 / period_s:.4g} Hz."
            )
            self._period_s, self._others = period_s, 0


def count_missing(t: Floats) -> Ints:
    """Count the samples (n - 1,) that are missing between stamps (n,) s of a sensor that samples evenly."""
    step = np.diff(t)
    forward = (step > 0.0) & (step <= MAX_S)
    if not forward.any():
        return np.zeros(len(step), dtype=np.int64)
    period = float(np.median(step[forward]))
    periods = np.where(forward, step, period) / period
    is_even = np.mean(np.abs(periods - np.rint(periods)) > EVEN) < MAX_UNEVEN
    missing = np.where(periods > (1.5 if is_even else GAP_PERIODS), np.rint(periods) - 1.0, 0.0)
    return np.asarray(missing, dtype=np.int64)


def describe_losses(lost: Mapping[str, int]) -> tuple[str, ...]:
    """Say what was lost in all, of `samples` and `datagrams`, where `came` samples came; nothing if nothing was."""
    words = []
    if lost.get("samples"):
        words.append(
            f"by the stamps {format_count(lost['samples'], 'sample')} of {lost['samples'] + lost['came']} were lost "
            "on the way, steps of more than a second not counted"
        )
    if lost.get("datagrams"):
        words.append(f"this machine had no room for {format_count(lost['datagrams'], 'datagram')}")
    return tuple(words)
