"""Places that the walk came back to: which stretch was recognized as which, and the field of both passes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fg_nav.report.aligned import AlignedSolution
from fg_nav.report.decimation import spread_rows
from fg_nav.report.page.figures import (
    GRAY,
    PURPLE,
    TEAL,
    Chart,
    Panel,
    Trace,
    fade,
    line,
    stack,
    to_meters,
    to_numbers,
)
from fg_nav.solution import Return
from fg_nav.text import format_count

MAX_SHOWN = 3  # Returns whose field is drawn: the longest ones explain the others.
MAX_TIES = 60  # Lines on the map from a footfall to the earlier one at its place.
MAX_DRAWN_M = 120.0  # Of each return, from its begin: waves of some meters are to be seen.
NEVER = 1e-6  # Expected number below which the exact one says no more.

COMPONENTS = ("ahead (µT)", "to the left (µT)", "up (µT)")


def describe_returns(returns: Sequence[Return]) -> list[str]:
    """Say what was recognized, the longest first."""
    if not returns:
        return ["No place was recognized as one where the walk was before."]
    shown = sorted(returns, key=lambda one: -one.length_m)
    words = [_describe(one) for one in shown[:MAX_SHOWN]]
    more = len(shown) - len(words)
    if more:
        words.append(f"{format_count(more, 'more return')} of {shown[MAX_SHOWN].length_m:.0f} m or less.")
    return words


def _describe(one: Return) -> str:
    way = "in the opposite direction" if one.opposite else "in the same direction"
    chance = f"{one.expected_false:.1g}" if one.expected_false > NEVER else f"fewer than {NEVER:g}"
    return (
        f"{one.length_m:.0f} m from {one.t[0]:.0f} to {one.t[-1]:.0f} s are those of {one.earlier_t.min():.0f} to "
        f"{one.earlier_t.max():.0f} s, walked {way}: by {one.score:.0f} nats, where chance makes {chance} such "
        "recognitions in the walk."
    )


def draw_returns(returns: Sequence[Return]) -> list[Chart]:
    """Draw the field of both passes of the longest returns along the path, as the later one was walked."""
    shown = sorted(returns, key=lambda one: -one.length_m)[:MAX_SHOWN]
    return [_draw_passes(f"return-{k}", one) for k, one in enumerate(shown, start=1)]


def _draw_passes(name: str, one: Return) -> Chart:
    walked = np.linspace(0.0, one.length_m, len(one.t))
    row = np.flatnonzero(walked <= MAX_DRAWN_M)
    along = to_meters(walked[row])
    passes = (("then", GRAY, one.earlier_field_uT), ("now", PURPLE, one.field_uT))
    panels = [
        Panel(label, [line(along, to_numbers(field[row, k]), color, word) for word, color, field in passes])
        for k, label in enumerate(COMPONENTS)
    ]
    return stack(name, panels, _describe(one), "length of the path since the return began (m)")


def mark_map(view: AlignedSolution) -> list[Trace]:
    """Draw on the map which footfalls are at a place where the walk was before, and lines to the earlier ones."""
    table = view.solution.stances
    if table.same_place is None:
        return []
    later = np.flatnonzero(table.same_place >= 0)
    if not len(later):
        return []
    position = view.stance_position()[:, :2]
    # Stretches with gaps between them, which break the line.
    breaks = np.flatnonzero(np.diff(later) > 1) + 1
    runs = [np.vstack([position[run], [[np.nan, np.nan]]]) for run in np.split(later, breaks)]
    path = np.vstack(runs)
    chosen = later[spread_rows(len(later), MAX_TIES)]
    pairs = np.stack([position[chosen], position[table.same_place[chosen]], np.full((len(chosen), 2), np.nan)], axis=1)
    ties = pairs.reshape(-1, 2)
    words = "recognized as walked before"
    wide = {"width": 9, "hoverinfo": "skip", "legendgroup": words}
    return [
        line(to_meters(path[:, 0]), to_meters(path[:, 1]), fade(PURPLE, 0.3), words, **wide),
        line(
            to_meters(ties[:, 0]),
            to_meters(ties[:, 1]),
            TEAL,
            words,
            width=1.2,
            showlegend=False,
            hoverinfo="skip",
            legendgroup=words,
        ),
    ]
