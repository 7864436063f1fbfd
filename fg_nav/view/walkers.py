"""What a page draws of a walk in progress: the path of one sensor, or those of two feet and of the person between them.

Lines of two feet say whose they are (`foot`, `frame`: `fg_nav.online.feet_lines`). The page's path is then the
person's; before there is one the left foot's, and where that is not there the right one's. Both feet come with it, with
their newest lines, as far as they are in its frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fg_nav.view.history import History, turn_ellipse, turn_row

FEET = ("left", "right")

ORDER = ("person", *FEET)  # Whose path is the page's, where it has one.


class Walker:
    """The path of one sensor or of a person, its newest line, and the frame it is in, where one was said."""

    def __init__(self) -> None:
        self.history, self.frame = History(), ""
        self.last: dict[str, Any] | None = None

    def add(self, event: Mapping[str, Any]) -> bool:
        """Follow a line; return whether rows that were there before have changed."""
        changed = self.history.add(event)
        self.frame = event.get("frame", "")
        if event["kind"] == "now":
            self.last = dict(event)
        if event["kind"] == "turned" and self.last is not None:
            turn_moment(self.last, event["angle_deg"])
            turn_ellipse(self.last, event["angle_deg"])
        return changed

    def describe(self) -> dict[str, Any]:
        """Return what a page draws of it."""
        return {"path": self.history.rows(), "last": self.last}


class Walkers:
    """All that a page draws."""

    def __init__(self) -> None:
        self._known: dict[str, Walker] = {"": Walker()}

    @property
    def main(self) -> Walker:
        """Whose path is the page's."""
        return self._known[self._find_main()]

    def add(self, event: Mapping[str, Any]) -> tuple[bool, bool]:
        """Follow a line; return whether what was there before has changed, and whether it is of the page's path."""
        who, before = event.get("foot", ""), self._find_main()
        if event["kind"] == "foot":
            return False, False
        walker = self._known.setdefault(who, Walker())
        frame = walker.frame
        changed = walker.add(event)
        main = self._find_main()
        return changed or main != before or frame != walker.frame, who == main

    def describe(self) -> dict[str, Any]:
        """Return the page's path and newest line, and both feet where there are two."""
        main = self.main
        feet = {name: self._known[name].describe() for name in FEET if name in self._known}
        shown = {name: one for name, one in feet.items() if self._known[name].frame == main.frame}
        return {**main.describe(), "distance_m": round(main.history.distance_m, 3), "feet": shown}

    def _find_main(self) -> str:
        return next((name for name in ORDER if name in self._known and self._known[name].last is not None), "")


def turn_moment(known: dict[str, Any], angle_deg: float) -> None:
    """Turn place and heading of a line or status with the map, where it has them."""
    if known["position_m"] is not None:
        known["position_m"] = turn_row((0.0, *known["position_m"]), angle_deg)[1:]
    if known["heading_deg"] is not None:
        known["heading_deg"] = (known["heading_deg"] + angle_deg) % 360.0
