"""What a walk in progress takes back: lines of JSON that come before the next line of the moment.

============ =========================================================================================================
"turned"     the map was turned about its origin by `angle_deg`, clockwise: lines before are in the old one
"retracted"  the footfall of line `stance`, whose `t` was `stance_t`, was none, and is taken back
"revised"    the past as it is known now: `path`, [t, east, north, up] at `MAX_POINTS` footfalls at most, all of it
============ =========================================================================================================

All have `t`, s, of the newest footfall that they know.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.frames import compute_heading
from fg_nav.online.estimates import EstimateRow, split_rows
from fg_nav.solution import StanceTable
from fg_nav.text import to_json

TURNED_RAD = float(np.radians(1.0))  # A smaller turn is one of many corrections of the past.
MAX_POINTS = 200  # Of a revised path.
DIGITS = 3  # After the point: a millimetre, a millidegree.


@dataclass(frozen=True)
class Revision:
    """What changed when a walk was solved again.

    Attributes
    ----------
    t : of the newest footfall that was solved again, s.
    turn : of the map about its origin, rad clockwise; 0 where it did not turn.
    retracted : numbers and stamps of the lines whose footfalls were none.
    path : (K, 4) t (s), east, north, up (m) at footfalls of the walk so far, `MAX_POINTS` at most.
    """

    t: float
    turn: float
    retracted: tuple[tuple[int, float], ...]
    path: Floats


def compare_pasts(
    before: Sequence[EstimateRow], after: Sequence[EstimateRow], first: int, untold: Sequence[tuple[int, float]]
) -> Revision:
    """Return what changed of a walk from one solution to the next.

    Parameters
    ----------
    before, after : estimates of the footfalls, before from number `first` on.
    untold : numbers and stamps of the lines whose footfalls are none.
    """
    old, new = split_rows(before), split_rows(after[first:])
    _, i, j = np.intersect1d(old.sample, new.sample, return_indices=True)
    turns = compute_heading(new.nav_R_body[j]) - compute_heading(old.nav_R_body[i])
    turn = float(np.angle(np.exp(1j * turns).sum())) if len(turns) else 0.0
    path = split_rows([after[k] for k in thin_rows(len(after))])
    return Revision(
        t=float(path.t[-1]),
        turn=turn if abs(turn) > TURNED_RAD else 0.0,
        retracted=tuple(untold),
        path=np.column_stack([path.t, path.position]),
    )


def thin_rows(count: int) -> list[int]:
    """Return the numbers of at most `MAX_POINTS` of so many footfalls, the first and the last among them."""
    return sorted(set(np.linspace(0, count - 1, min(count, MAX_POINTS)).round().astype(int).tolist()))


def describe_past(table: StanceTable) -> Revision:
    """Return the past of a walk as it is known, for who has seen nothing of it."""
    path = np.column_stack([table.t, table.position])
    return Revision(float(table.t[-1]), 0.0, (), path[thin_rows(len(path))])


def format_revision(revision: Revision) -> Iterator[str]:
    """Yield the lines of a revision."""
    t = round(revision.t, 9)
    if revision.turn:
        yield _format("turned", {"t": t, "angle_deg": round(float(np.degrees(revision.turn)), DIGITS)})
    for number, stamp in revision.retracted:
        yield _format("retracted", {"stance": number, "t": t, "stance_t": round(stamp, 9)})
    yield _format("revised", {"t": t, "path": np.round(revision.path, DIGITS)})


def _format(kind: str, content: dict[str, object]) -> str:
    return json.dumps(to_json({"kind": kind, **content}), allow_nan=False)
