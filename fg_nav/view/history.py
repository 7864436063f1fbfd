"""The path of a walk in progress as it is known now, bounded however long the walk is.

`History.add` follows the lines of a stream (`fg_nav.online.estimates`). A row is t (s), east, north, up (m):

    now         one row more, and the distance to it
    turned      all rows turn about the origin, clockwise
    retracted   the row of that line is taken off
    revised     rows move as the revised path does at their times, linear in time between its points
    smoothed, polished   the rows of the end take the place of those of the moment, in the order of time

Above `MAX_ROWS` those are dropped that lie nearest to the line through their neighbors.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fg_nav.arrays import Floats

MAX_ROWS = 3000  # Two hours of footfalls; as JSON 100 kB.
NEWEST_ROWS = 200  # Never thinned: what one looks at.
MILLIMETRES = 3  # Digits of a path after the point.
STILL_S = 2.5  # No stride takes so long: a person whose last footfall was before that stands.
SAME_S = 1e-3  # Stamps of one footfall in two lines are that close: those of a revised path are rounded.


class History:
    """The path so far. `distance_m` is that over the ground, from row to row as they came."""

    def __init__(self) -> None:
        self.distance_m = 0.0
        self._rows: list[tuple[float, float, float, float]] = []
        self._stamps: dict[int, float] = {}  # of the newest lines, by number
        self._stands = True
        self._at_end = ""
        self._replaced: list[tuple[float, float, float, float]] = []

    def add(self, event: Mapping[str, Any]) -> bool:
        """Follow one line; return whether rows that were there before have changed."""
        match event["kind"]:
            case "now":
                self._stands = bool(event["continues"])
                self._stamps[event["stance"]] = event["t"]
                self._stamps.pop(event["stance"] - MAX_ROWS, None)
                return self._append(_row_of(event))
            case "turned":
                self._rows = [turn_row(row, event["angle_deg"]) for row in self._rows]
            case "retracted":
                t = self._stamps.get(event["stance"], np.nan)
                self._rows = [row for row in self._rows if not abs(row[0] - t) <= SAME_S]
            case "revised":
                self._revise(np.array(event["path"], dtype=np.float64).reshape(-1, 4))
            case "smoothed" | "polished":
                self._replace(event)
            case _:
                return False
        return True

    def speed_m_s(self, t: float) -> float:
        """Return the speed at a time, of the last stride; 0 where the person stands."""
        if len(self._rows) < 2 or self._stands or t - self._rows[-1][0] > STILL_S:
            return 0.0
        (before, *start, _), (after, *stop, _) = self._rows[-2:]
        return float(np.hypot(stop[0] - start[0], stop[1] - start[1])) / max(after - before, SAME_S)

    def rows(self) -> list[list[float]]:
        """Return the path: t, east, north, up; to the millimetre and the millisecond."""
        last = self._rows[-1][0] if self._rows else -np.inf
        shown = self._rows + [row for row in self._replaced if row[0] > last]
        return [[round(value, MILLIMETRES) for value in row] for row in shown]

    def _append(self, row: tuple[float, float, float, float]) -> bool:
        if self._rows:
            self.distance_m += float(np.hypot(row[1] - self._rows[-1][1], row[2] - self._rows[-1][2]))
        self._rows.append(row)
        return self._thin()

    def _replace(self, event: Mapping[str, Any]) -> None:
        """Take a row of the end: the first of its kind begins the path again."""
        if event["kind"] != self._at_end:
            self._at_end, self._replaced, self._rows = event["kind"], self._rows, []
        self._rows.append(_row_of(event))
        self._thin()

    def _revise(self, revised: Floats) -> None:
        """Move the rows by what the revised path differs at its times; rows before and behind it as at its ends."""
        known = np.array(self._rows).reshape(-1, 4)
        if len(revised) == 0:
            return
        if len(known) == 0:
            known = revised
        outside = (revised[:, 0] < known[0, 0] - SAME_S) | (revised[:, 0] > known[-1, 0] + SAME_S)
        inside = revised[~outside]
        if len(inside):
            difference = inside[:, 1:] - _interpolate(inside[:, 0], known[:, 0], known[:, 1:])
            known = known + np.column_stack([np.zeros(len(known)), _interpolate(known[:, 0], inside[:, 0], difference)])
        joined = np.concatenate([known, revised[outside]])
        self._rows = [tuple(row) for row in joined[np.argsort(joined[:, 0], kind="stable")].tolist()]
        self._thin()

    def _thin(self) -> bool:
        """Drop a quarter of the older rows while there are too many; return whether there were."""
        if len(self._rows) <= MAX_ROWS:
            return False
        while len(self._rows) > MAX_ROWS:
            self._drop_quarter()
        return True

    def _drop_quarter(self) -> None:
        rows = np.array(self._rows)
        candidates = np.arange(1, len(rows) - NEWEST_ROWS, 2)
        before, at, behind = (rows[candidates + step, 1:3] for step in (-1, 0, 1))
        to, on = at - before, behind - before
        area = np.abs(to[:, 0] * on[:, 1] - to[:, 1] * on[:, 0])
        dropped = candidates[area <= np.median(area)]
        self._rows = [tuple(row) for row in np.delete(rows, dropped, axis=0).tolist()]


def turn_row(row: tuple[float, float, float, float], angle_deg: float) -> tuple[float, float, float, float]:
    """Turn a row about the origin, clockwise."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return row[0], float(c * row[1] + s * row[2]), float(c * row[2] - s * row[1]), row[3]


def turn_ellipse(event: dict[str, Any], angle_deg: float) -> None:
    """Turn the sigmas of a line about the vertical, clockwise."""
    east, north, up = event["position_sigma_m"]
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    turn = np.array([[c, s], [-s, c]])
    covariance = np.array([[east**2, event["east_north_cov_m2"]], [event["east_north_cov_m2"], north**2]])
    turned = turn @ covariance @ turn.T
    event["position_sigma_m"] = [*np.sqrt(np.diagonal(turned)).tolist(), up]
    event["east_north_cov_m2"] = float(turned[0, 1])


def _row_of(event: Mapping[str, Any]) -> tuple[float, float, float, float]:
    east, north, up = event["position_m"]
    return event["t"], east, north, up


def _interpolate(at: Floats, t: Floats, values: Floats) -> Floats:
    """Return the columns of (K, 3) values at some times; before the first and after the last as there."""
    return np.column_stack([np.interp(at, t, column) for column in values.T])
