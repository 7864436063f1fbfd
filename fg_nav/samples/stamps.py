"""The stamps of a file in order: what is taken as it is, spread, sorted, set on, left out, bridged, or cut.

A file is judged as a whole, so less is lost than in a stream, and nothing of unknown length is assumed:

=============================================== =======================================================================
samples with one stamp, all the same            the later ones are repeats, and left out
... that differ, with time for them before      polled at once: spread over the time since the stamp before
... that differ, without                        the later ones are left out
some stamps far ahead, the next ones in line    left out
stamps before the last one, and then beyond it  came late: sorted, or left out where there is no time for them
stamps before the last one, and on from there   the clock began again: set on by one period where force and rate go on
                                                without a jump, so that nothing is lost; else the recording ends there
a gap of more than `MAX_BRIDGED_S`              the recording ends there, if no longer one is allowed
=============================================== =======================================================================

Of the parts that an end leaves, the longest is taken, with a remark that says what was left out. A shorter gap is
bridged as in a stream: what lies in it has the spread of a walking foot (`fg_nav.samples.gaps`), and the sigmas behind
it are larger. With more than `MAX_BACKWARD` steps backward the column is no clock.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import RecordingError
from fg_nav.samples.gaps import MAX_HELD_S
from fg_nav.text import format_count

MAX_BRIDGED_S = MAX_HELD_S
"""In a longer gap a foot may have stepped and turned anywhere: behind this one the heading's sigma is a radian."""

LOST_PERIODS = 1.5  # A step of more periods than this leaves out a sample.

ROOM = 0.55
"""Least distance of two stamps, in periods, if they are those of two samples: with half a period for each, one is a
repeat; polling every 6 ms leaves 0.6 of a sensor's 5 ms."""

SAME_S = 1e-7  # Stamps that rise by no more are the same: no sensor samples as fast, and no result is written finer.

JUMP_S, MAX_AHEAD = 1.0, 20
"""Stamps so far ahead, and not more of them, are wrong, if the next goes on from before them."""

AROUND, JUMP = 20, 3.0
"""Force and rate go on without a jump if they change by less than this many times their largest change within so many
samples on either side."""

MAX_BACKWARD = 100


class Ordered(NamedTuple):
    """Samples `kept` (M,) of a file in order of time, their stamps `t` (M,) s, strictly rising, and what was done.

    So many samples are `cut` off, in parts that are not used.
    """

    kept: Ints
    t: Floats
    remarks: tuple[str, ...]
    cut: int = 0


def order_stamps(t: Floats, samples: Floats, row: Ints, longest_gap_s: float = MAX_BRIDGED_S) -> Ordered:
    """Put the samples of a file in order of time.

    Parameters
    ----------
    t : (N,) s, finite, as in the file.
    samples : (N, 6) force and rate, finite.
    row : (N,) of each sample in its file, for the remarks.
    longest_gap_s : the recording ends at a longer one.

    Raises
    ------
    RecordingError
        Where the stamps are no clock.
    """
    period = _mean_period(t)
    parts, remarks = _follow_clock(t, samples, row, period)
    spread = [_spread_doubles(part, samples, row, period) for part in parts]
    pieces = [piece for part in spread for piece in _split_at_gaps(part, longest_gap_s)]
    kept, stamps = max(pieces, key=lambda piece: len(piece[0]))
    remarks += [words for part in spread if kept[0] in part.kept for words in part.remarks]
    cut = sum(len(piece) for piece, _ in pieces) - len(kept)
    return Ordered(kept, stamps, (*remarks, *_describe_cut(pieces, kept, row)), cut)


def _mean_period(t: Floats) -> float:
    """Mean step, s, of those that are neither backward nor gaps; so polled samples count.

    What is no gap follows from the step that is usual where the time goes: stamps that all but coincide, as those of
    samples polled at once do, take none of it.
    """
    step = np.diff(t)
    forward = np.sort(step[step > 0])
    if not len(forward):
        return 0.0
    forward = forward[forward <= max(forward[0], MAX_BRIDGED_S)]
    elapsed = np.cumsum(forward)
    usual = forward[np.searchsorted(elapsed, elapsed[-1] / 2)]
    return float(step[(step >= 0) & (step < 10 * usual)].mean())


def _follow_clock(t: Floats, samples: Floats, row: Ints, period: float) -> tuple[list[Ordered], list[str]]:
    """Cut the samples where their clock begins again; in each part the stamps do not fall any more."""
    backward = np.flatnonzero(np.diff(t) < 0) + 1
    if len(backward) > MAX_BACKWARD:
        raise RecordingError(
            f"the stamps run backward {len(backward)} times, the first at row {row[backward[0]]}: mend their column."
        )
    t, keep, late = t.copy(), np.ones(len(t), dtype=np.bool_), np.zeros(len(t), dtype=np.bool_)
    begins, remarks = [0], []
    for at in backward.tolist():
        since = slice(begins[-1], at)
        wrong = _find_ahead(t, at)
        keep[wrong:at] = False
        last = float(t[since][keep[since]].max(initial=-np.inf))
        if t[at] > last:
            continue
        stop = _end_of_late(t, at, last, period)
        late[at:stop] = True
        if stop > at:
            continue
        if goes_on(samples, at):
            remarks.append(
                f"the clock began again at row {row[at]} (t = {t[at]:.3f} s, after {last:.3f} s) with nothing missing: "
                f"stamps are set on from there"
            )
            t[at:] += last + period - t[at]
        else:
            begins.append(at)
    return [_sort_part(t, keep, late, start, stop, row, period) for start, stop in pairwise([*begins, len(t)])], remarks


def _find_ahead(t: Floats, at: int) -> int:
    """First of the wrong stamps far ahead that come before a sample; the sample itself where there are none."""
    for first in range(at - 1, max(at - 1 - MAX_AHEAD, 0), -1):
        if t[first - 1] < t[at]:
            return first if t[first] - t[first - 1] > JUMP_S else at
    return at


def _end_of_late(t: Floats, at: int, last: float, period: float) -> int:
    """Sample behind those that came late, from one on; the one itself where the clock goes on from there."""
    beyond = np.flatnonzero(t[at:] > last)
    stop = at + int(beyond[0]) if beyond.size else len(t)
    if stop == len(t):
        return stop if stop - at <= MAX_AHEAD else at
    return stop if t[stop] - t[stop - 1] > LOST_PERIODS * period else at


def goes_on(samples: Floats, at: int, jump: float = JUMP) -> bool:
    """Whether force and rate (N, 6) change from the sample before to this one as they do around them."""
    before, after = samples[max(at - AROUND, 0) : at], samples[at : at + AROUND]
    if len(before) < 2 or len(after) < 2:
        return False
    usual = np.maximum(np.abs(np.diff(before, axis=0)).max(axis=0), np.abs(np.diff(after, axis=0)).max(axis=0))
    return bool((np.abs(after[0] - before[-1]) <= jump * usual).all())


def _sort_part(t: Floats, keep: Bools, late: Bools, start: int, stop: int, row: Ints, period: float) -> Ordered:
    """Put the samples `start <= i < stop` in order of time."""
    index = np.arange(start, stop)
    kept = index[keep[start:stop] & ~late[start:stop]]
    came_late = index[keep[start:stop] & late[start:stop]]
    away = np.abs(t[came_late][:, None] - t[kept][np.clip(_neighbors(t[kept], t[came_late]), 0, len(kept) - 1)])
    fits = (away > ROOM * period).all(axis=1)
    both = np.concatenate([kept, came_late[fits]])
    both = both[np.argsort(t[both], kind="stable")]
    remarks = []
    for which, words in (
        (index[~keep[start:stop]], "far ahead of those around: left out"),
        (came_late[fits], "behind later ones: sorted"),
        (came_late[~fits], "behind later ones, where there are others: left out"),
    ):
        if len(which):
            remarks.append(f"{format_count(len(which), 'stamp')}, the first in row {row[which[0]]}, {words}")
    return Ordered(both, t[both], tuple(remarks))


def _neighbors(t: Floats, late: Floats) -> Ints:
    """Positions (L, 2) among stamps that do not fall of those next to each of (L,)."""
    place = np.searchsorted(t, late)
    return np.stack([place - 1, place], axis=1)


def _spread_doubles(part: Ordered, samples: Floats, row: Ints, period: float) -> Ordered:
    """Give samples with one stamp stamps of their own, or leave out all but the first."""
    t = part.t
    first = np.flatnonzero(np.diff(t, prepend=-np.inf) > SAME_S)
    if len(first) == len(t):
        return part
    keep, spread, even = np.ones(len(t), dtype=np.bool_), np.zeros(len(t), dtype=np.bool_), t.copy()
    for start, stop in pairwise([*first.tolist(), len(t)]):
        if stop - start == 1:
            continue
        same = (samples[part.kept[start + 1 : stop]] == samples[part.kept[start : stop - 1]]).all(axis=1)
        before = t[start - 1] if start else t[start] - (stop - start) * period
        if not same.any() and t[start] - before >= ROOM * period * (stop - start):
            spread[start:stop] = True
            even[start:stop] = before + (t[start] - before) * np.arange(1, stop - start + 1) / (stop - start)
        else:
            keep[start + 1 : stop] = False
    return Ordered(part.kept[keep], even[keep], (*part.remarks, *_describe_doubles(part, keep, spread, row)))


def _describe_doubles(part: Ordered, keep: Bools, spread: Bools, row: Ints) -> list[str]:
    """Remarks on samples with one stamp."""
    remarks = []
    if not keep.all():
        first = row[part.kept[np.argmin(keep)]]
        remarks.append(f"left out {format_count(int((~keep).sum()), 'repeated stamp')}, the first in row {first}")
    if spread.any():
        first = row[part.kept[np.argmax(spread)]]
        remarks.append(
            f"{int(spread.sum())} samples share their stamps with others, from row {first} on: spread evenly"
        )
    return remarks


def _split_at_gaps(part: Ordered, longest_s: float) -> list[tuple[Ints, Floats]]:
    """Split samples where a gap is too long to be bridged."""
    ends = np.flatnonzero(np.diff(part.t) > longest_s) + 1
    return list(zip(np.split(part.kept, ends), np.split(part.t, ends), strict=True))


def _describe_cut(pieces: list[tuple[Ints, Floats]], kept: Ints, row: Ints) -> list[str]:
    """Say which part of a recording is used, if not the whole."""
    if len(pieces) == 1:
        return []
    others = sum(len(piece) for piece, _ in pieces) - len(kept)
    at = next(i for i, (piece, _) in enumerate(pieces) if piece[0] == kept[0])
    t = pieces[at][1]
    why = [] if at == 0 else [_describe_end(pieces[at - 1], pieces[at], row)]
    why += [] if at == len(pieces) - 1 else [_describe_end(pieces[at], pieces[at + 1], row)]
    return [
        f"only rows {row[kept[0]]} to {row[kept[-1]]} (t = {t[0]:.3f} to {t[-1]:.3f} s) are used, and "
        f"{format_count(others, 'sample')} left out: {' and '.join(why)}"
    ]


def _describe_end(before: tuple[Ints, Floats], after: tuple[Ints, Floats], row: Ints) -> str:
    step = float(after[1][0] - before[1][-1])
    where = f"row {row[after[0][0]]}"
    return f"there is a gap of {step:.2f} s before {where}" if step > 0 else f"the clock begins again at {where}"
