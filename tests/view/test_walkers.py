"""What a page draws of one sensor, and of two feet."""

from __future__ import annotations

from typing import Any

import pytest

from fg_nav.view.history import Walkers


def now(foot: str, t: float, east: float, frame: str = "left") -> dict[str, Any]:
    return {
        "kind": "now", "foot": foot, "frame": frame, "stance": int(t), "continues": False, "t": t,
        "position_m": [east, 0.0, 0.0], "heading_deg": None if foot == "person" else 90.0,
        "position_sigma_m": [0.1, 0.2, 0.1], "east_north_cov_m2": 0.0,
    }  # fmt: skip


def test_of_one_sensor_there_are_no_feet() -> None:
    walkers = Walkers()
    line = {key: value for key, value in now("", 1.0, 2.0).items() if key not in ("foot", "frame")}
    assert walkers.add(line) == (False, True)
    found = walkers.describe()
    assert (found["path"], found["last"]["t"], found["feet"]) == ([[1.0, 2.0, 0.0, 0.0]], 1.0, {})


def test_a_right_foot_in_a_frame_of_its_own_is_not_drawn_next_to_the_left_one() -> None:
    walkers = Walkers()
    walkers.add(now("right", 0.5, 7.0, "right"))
    assert walkers.describe()["last"]["foot"] == "right"
    assert walkers.add(now("left", 1.0, 1.0)) == (True, True)  # the page's path is another from here on
    assert set(walkers.describe()["feet"]) == {"left"}
    assert walkers.add(now("right", 1.5, 1.5)) == (True, False)
    assert set(walkers.describe()["feet"]) == {"left", "right"}


def test_the_path_of_the_page_is_the_persons_once_there_is_one() -> None:
    walkers = Walkers()
    walkers.add(now("left", 1.0, 1.0))
    walkers.add({"kind": "revised", "foot": "person", "frame": "left", "t": 0.8, "path": [[0.8, 0.5, 0.0, 0.0]]})
    assert walkers.describe()["last"]["foot"] == "left"
    walkers.add(now("person", 1.2, 1.5))
    found = walkers.describe()
    assert found["last"]["foot"] == "person"
    assert [row[1] for row in found["path"]] == [0.5, 1.5]


def test_a_foot_turns_with_its_own_map_only() -> None:
    walkers = Walkers()
    walkers.add(now("left", 1.0, 2.0))
    walkers.add(now("right", 1.5, 2.0))
    walkers.add({"kind": "turned", "foot": "right", "frame": "left", "t": 1.5, "angle_deg": 90.0})
    feet = walkers.describe()["feet"]
    assert feet["right"]["last"]["position_m"] == pytest.approx([0.0, -2.0, 0.0], abs=1e-9)
    assert feet["right"]["last"]["position_sigma_m"][:2] == pytest.approx([0.2, 0.1])
    assert feet["left"]["last"]["position_m"] == [2.0, 0.0, 0.0]


def test_news_of_a_foot_draw_nothing() -> None:
    walkers = Walkers()
    news = {"kind": "foot", "foot": "left", "frame": "left", "t": 1.0, "state": "silent", "reason": ""}
    assert walkers.add(news) == (False, False)
    assert walkers.describe()["path"] == []
