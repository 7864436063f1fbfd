"""Parts of a recording that was interrupted, between its holes: those that the other foot's steps can lay beside it.

A part of a few footfalls is tied by no cell of steps (`steps`): it would lie anywhere, and say nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fg_nav.arrays import Bools, Ints
from fg_nav.recording import Recording
from fg_nav.samples.gaps import find_holes
from fg_nav.stances import Stances

MIN_FOOTFALLS = 10  # Of a part: some fifteen meters, and two cells.


def keep_walked_parts(recording: Recording, stances: Stances) -> Recording:
    """Return a recording without its parts of a few footfalls; the same where there are none."""
    part = number_parts(recording)
    footfalls = np.bincount(part[stances.spans[0]], minlength=part[-1] + 1)
    return _keep(recording, (footfalls >= MIN_FOOTFALLS)[part], "too few footfalls to be laid beside the other foot")


def keep_longest_part(recording: Recording) -> Recording:
    """Return the longest part of a recording, as of a foot alone; the same where there is one."""
    part = number_parts(recording)
    return _keep(recording, part == np.bincount(part).argmax(), "the longest part is used, as there is one foot alone")


def number_parts(recording: Recording) -> Ints:
    """Number (N,) the samples by the part that they are in, from 0."""
    begins = np.zeros(len(recording), dtype=np.int64)
    begins[find_holes(recording.t) + 1] = 1
    return np.asarray(np.cumsum(begins))


def _keep(recording: Recording, kept: Bools, why: str) -> Recording:
    """Keep some samples of a recording, with a note; all of them where none would be left."""
    if kept.all() or not kept.any():
        return recording
    t, lost = recording.t, np.flatnonzero(~kept)
    note = f"left out {len(lost)} samples between {t[lost[0]]:.1f} and {t[lost[-1]]:.1f} s, about gaps: {why}"
    provenance = replace(recording.provenance, notes=(*recording.provenance.notes, note))
    mag = None if recording.mag is None else recording.mag[kept]
    unread = None if recording.unread is None else recording.unread[kept]
    return replace(
        recording, t=t[kept], acc=recording.acc[kept], gyr=recording.gyr[kept], mag=mag, unread=unread,
        provenance=provenance,
    )  # fmt: skip
