"""The current path of a walk in progress, for a client that has just connected; bounded for walks of any length.

`History.add` takes the lines of a stream (`fg_nav.online.estimates`). A row is t (s), east, north, up (m):

    now         append a row, or put it in place of the one that a revision brought of its footfall
    turned      turn all rows about the origin, clockwise
    retracted   remove the row of that line
    revised     move rows by the revised path's difference at their times, linear in time between its points
    smoothed, polished   final rows, which replace those of the moment in the order of time

Above `MAX_ROWS` rows nearest to the line through their neighbours are dropped.

A page draws one sensor, or two feet and the person between them (`Walkers`). Lines of two feet carry `foot` and `frame`
(`fg_nav.online.estimates`). The main path is the person's, until there is one the left foot's, else the right one's;
both feet come with it while they are in its frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fg_nav.arrays import Floats, interpolate_columns

MAX_ROWS = 3000  # Two hours of footfalls; as JSON 100 kB.
NEWEST_ROWS = 200  # Never thinned: the part in view.
MILLIMETRES = 3  # Decimals of a path.
STILL_S = 2.5  # Longer than any stride: a person whose last footfall is older stands.
SAME_S = 1e-3  # Largest difference of the stamps of one footfall in two lines: those of a revised path are rounded.

FEET = ("left", "right")
ORDER = ("person", *FEET)  # Priority for the main path.

Row = tuple[float, float, float, float]


class History:
    """The path of one sensor, or of a person.

    `last` is the newest line `now`, `frame` that of the lines, empty where they name none, `stepped_s` the time of the
    newest footfall that began a stance.
    """

    def __init__(self) -> None:
        self.frame, self.stepped_s = "", np.inf
        self.last: dict[str, Any] | None = None
        self._rows: list[Row] = []
        self._stamps: dict[int, float] = {}  # of the newest lines, by number
        self._stands = True
        self._thinned_m = 0.0  # By which rows that were dropped made the path longer.
        self._at_end = ""
        self._replaced: list[Row] = []

    def add(self, event: Mapping[str, Any]) -> bool:
        """Apply a line of the stream; return whether earlier rows have changed."""
        kind, self.frame = event["kind"], event.get("frame", "")
        if kind == "now":
            self.last, row = dict(event), (event["t"], *event["position_m"])
            self._stands = bool(event["continues"])
            self.stepped_s = self.stepped_s if self._stands else event["t"]
            self._stamps[event["stance"]] = event["t"]
            self._stamps.pop(event["stance"] - MAX_ROWS, None)
            is_known = bool(self._rows) and abs(self._rows[-1][0] - row[0]) <= SAME_S
            self._rows[len(self._rows) - is_known :] = [row]
            return self._thin() or is_known
        if kind == "turned":
            self._rows = [turn_row(row, event["angle_deg"]) for row in self._rows]
            if self.last is not None:
                turn_line(self.last, event["angle_deg"])
        elif kind == "retracted":
            t = self._stamps.get(event["stance"], np.nan)
            self._rows = [row for row in self._rows if not abs(row[0] - t) <= SAME_S]
        elif kind == "revised":
            self._revise(np.array(event["path"], dtype=np.float64).reshape(-1, 4))
        elif kind in ("smoothed", "polished"):
            # the first of its kind begins the path again
            if kind != self._at_end:
                self._at_end, self._replaced, self._rows, self._thinned_m = kind, self._rows, [], 0.0
            self._rows.append((event["t"], *event["position_m"]))
            if self.last is not None and "verdict" in event:  # on the whole path
                self.last |= {key: event[key] for key in ("verdict", "reasons")}
            self._thin()
        else:
            return False
        return True

    @property
    def distance_m(self) -> float:
        """Length of the path over the ground."""
        return self._thinned_m + measure_length(np.array(self._list_shown()).reshape(-1, 4))

    def speed_m_s(self, t: float) -> float:
        """Speed of the last stride at a time; 0 where the person stands."""
        if len(self._rows) < 2 or self._stands or t - self._rows[-1][0] > STILL_S:
            return 0.0
        (before, *start, _), (after, *stop, _) = self._rows[-2:]
        return float(np.hypot(stop[0] - start[0], stop[1] - start[1])) / max(after - before, SAME_S)

    def rows(self) -> list[list[float]]:
        """Return the path: t, east, north, up; to the millimetre and the millisecond."""
        return [[round(value, MILLIMETRES) for value in row] for row in self._list_shown()]

    def _list_shown(self) -> list[Row]:
        """Return the rows, and behind the final ones those of the moment."""
        last = self._rows[-1][0] if self._rows else -np.inf
        return self._rows + [row for row in self._replaced if row[0] > last]

    def _revise(self, revised: Floats) -> None:
        """Shift the rows onto the revised path (R, 4), linear in time, constant beyond its ends; add its new rows."""
        known = np.array(self._rows).reshape(-1, 4)
        if len(revised) == 0:
            return
        if len(known) == 0:
            known = revised
        outside = (revised[:, 0] < known[0, 0] - SAME_S) | (revised[:, 0] > known[-1, 0] + SAME_S)
        inside = revised[~outside]
        if len(inside):
            difference = inside[:, 1:] - interpolate_columns(inside[:, 0], known[:, 0], known[:, 1:])
            moved = interpolate_columns(known[:, 0], inside[:, 0], difference)
            known = known + np.column_stack([np.zeros(len(known)), moved])
        joined = np.concatenate([known, revised[outside]])
        self._rows = [tuple(row) for row in joined[np.argsort(joined[:, 0], kind="stable")].tolist()]
        self._thin()

    def _thin(self) -> bool:
        """Drop older rows nearest to their neighbours' line down to `MAX_ROWS`; return whether there were more."""
        is_full = len(self._rows) > MAX_ROWS
        while len(self._rows) > MAX_ROWS:
            rows = np.array(self._rows)
            candidates = np.arange(1, len(rows) - NEWEST_ROWS, 2)
            before, at, behind = (rows[candidates + step, 1:3] for step in (-1, 0, 1))
            to, on = at - before, behind - before
            area = np.abs(to[:, 0] * on[:, 1] - to[:, 1] * on[:, 0])
            dropped = candidates[area <= np.median(area)]
            kept = np.delete(rows, dropped, axis=0)
            self._thinned_m += measure_length(rows) - measure_length(kept)
            self._rows = [tuple(row) for row in kept.tolist()]
        return is_full


class Walkers:
    """All paths of a page: one sensor's, or two feet's and the person's."""

    def __init__(self) -> None:
        self._known: dict[str, History] = {"": History()}

    @property
    def main(self) -> History:
        """The main path."""
        return self._known[self._find_main()]

    def add(self, event: Mapping[str, Any]) -> tuple[bool, bool]:
        """Apply a line; return whether anything earlier has changed, and whether the line is of the main path."""
        who, before = event.get("foot", ""), self._find_main()
        if event["kind"] == "foot":
            return False, False
        path = self._known.setdefault(who, History())
        frame = path.frame
        changed = path.add(event)
        main = self._find_main()
        return changed or main != before or frame != path.frame, who == main

    def describe(self) -> dict[str, Any]:
        """Return the main path and its newest line, and those of both feet where there are two."""
        main = self.main
        feet = {name: self._known[name] for name in FEET if name in self._known}
        shown = {name: foot for name, foot in feet.items() if foot.frame == main.frame}
        content = [{"path": one.rows(), "last": one.last} for one in (main, *shown.values())]
        distance_m = round(main.distance_m, 3)
        return {**content[0], "distance_m": distance_m, "feet": dict(zip(shown, content[1:], strict=True))}

    def _find_main(self) -> str:
        return next((name for name in ORDER if name in self._known and self._known[name].last is not None), "")


def measure_length(rows: Floats) -> float:
    """Length (m) over the ground of rows (R, 4)."""
    return float(np.hypot(*np.diff(rows[:, 1:3], axis=0).T).sum())


def turn_row(row: Row, angle_deg: float) -> Row:
    """Turn a row about the origin, clockwise."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return row[0], float(c * row[1] + s * row[2]), float(c * row[2] - s * row[1]), row[3]


def turn_line(known: dict[str, Any], angle_deg: float) -> None:
    """Turn position, heading and horizontal covariance of a line or status clockwise, in place, where it has them."""
    if known.get("position_m") is not None:
        known["position_m"] = turn_row((0.0, *known["position_m"]), angle_deg)[1:]
    if known.get("heading_deg") is not None:
        known["heading_deg"] = (known["heading_deg"] + angle_deg) % 360.0
    if "east_north_cov_m2" in known:
        (east, north, up), shared = known["position_sigma_m"], known["east_north_cov_m2"]
        c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
        turn = np.array([[c, s], [-s, c]])
        turned = turn @ np.array([[east**2, shared], [shared, north**2]]) @ turn.T
        known["position_sigma_m"] = [*np.sqrt(np.diagonal(turned)).tolist(), up]
        known["east_north_cov_m2"] = float(turned[0, 1])
