"""The path that a page is sent: turned, retracted and revised as the lines say, bounded; of one sensor, or two feet."""

import json

import numpy as np
import pytest

from fg_nav.view.history import MAX_ROWS, NEWEST_ROWS, History, Walkers, turn_line
from tests.view.lines import circle, now


def history_of(lines):
    history = History()
    for line in lines:
        history.add(json.loads(line))
    return history


def test_rows_distance_and_speed_are_those_of_the_lines():
    history = history_of([now(0, 0.0, 0.0), now(1, 3.0, 4.0), now(2, 3.0, 5.0)])
    assert history.rows() == [[0.0, 0.0, 0.0, 0.0], [1.0, 3.0, 4.0, 0.1], [2.0, 3.0, 5.0, 0.2]]
    assert history.distance_m == pytest.approx(6.0)
    assert [history.speed_m_s(t) for t in (2.3, 9.0)] == pytest.approx([1.0, 0.0])
    history.add(json.loads(now(3, 3.01, 5.0, continues=True)))  # who stands has no speed
    assert history.speed_m_s(3.1) == 0.0
    before = history.rows()
    for nothing in ({"kind": "revised", "t": 2.0, "path": []}, {"kind": "something new"}):
        history.add(nothing)
    assert history.rows() == before


def test_a_turn_is_clockwise_and_a_false_footfall_is_taken_off():
    history = history_of([now(0, 0.0, 0.0), now(1, 0.0, 2.0)])
    assert history.add({"kind": "turned", "t": 1.0, "angle_deg": 90.0})
    assert history.rows()[1] == pytest.approx([1.0, 2.0, 0.0, 0.1])
    assert history.distance_m == pytest.approx(2.0)
    history = history_of(circle(5))
    assert history.add({"kind": "retracted", "stance": 3, "t": 4.0})  # the stamp is that of the newest footfall
    assert [row[0] for row in history.rows()] == [0.0, 1.0, 2.0, 4.0]


def test_a_revised_path_whose_stamps_are_rounded_adds_no_row():
    history = history_of(circle(5))
    path = np.array(history.rows()) + np.array([4e-4, 0.5, 0.0, 0.0])
    path[0, 0] -= 8e-4
    history.add({"kind": "revised", "t": 4.0, "path": path.tolist()})
    assert len(history.rows()) == 5
    assert np.allclose(np.array(history.rows())[:, 1], path[:, 1], atol=2e-3)
    assert history.speed_m_s(4.1) < 5.0


def test_a_footfall_that_a_revision_brought_is_there_once_and_the_distance_is_the_paths():
    """As of a stream: the path up to the newest footfall with rounded stamps, moved, and then the line of that."""
    history, lines = History(), [json.loads(line) for line in circle(41)]
    for k, line in enumerate(lines):
        line["t"] += 4e-4
        if k % 4 == 0:
            path = [[round(one["t"], 3), *(1.1 * np.array(one["position_m"]))] for one in lines[: k + 1]]
            assert history.add({"kind": "revised", "t": line["t"], "path": path})
        assert history.add({**line, "position_m": [1.1 * value for value in line["position_m"]]}) == (k % 4 == 0)
        rows = np.array(history.rows())
        assert len(rows) == k + 1
        assert history.distance_m == pytest.approx(np.hypot(*np.diff(rows[:, 1:3], axis=0).T).sum(), abs=0.05)
    assert history.distance_m == pytest.approx(1.1 * 2 * np.pi * 5.0, rel=0.01)


def test_who_stands_stands_since_the_last_step():
    history = history_of([now(0, 0.0, 0.0), now(1, 1.0, 0.0), *(now(k, 1.0, 0.0, continues=True) for k in (3, 5))])
    assert history.stepped_s == 1.0


def test_the_past_moves_as_the_revised_path_does_and_keeps_its_shape():
    history = history_of(circle(41))
    before = np.array(history.rows())
    moved = before[::10] + np.outer(np.arange(5), [0.0, 0.1, -0.2, 0.05])
    moved[:, 0] += [-4e-4, 0.0, 0.0, 0.0, 4e-4]  # stamps are rounded, and add no row
    assert history.add({"kind": "revised", "t": 40.0, "path": moved.tolist()})
    after = np.array(history.rows())
    np.testing.assert_allclose(after[:, 1:] - before[:, 1:], np.outer(np.arange(41) / 10, [0.1, -0.2, 0.05]), atol=2e-3)
    assert history.speed_m_s(40.1) < 5.0


def test_a_revised_path_begins_one_that_was_not_seen():
    history = History()
    path = [[0.0, 0.0, 0.0, 0.0], [5.0, 1.0, 2.0, 3.0]]
    assert history.add({"kind": "revised", "t": 5.0, "path": path})
    assert history.rows() == path
    history.add(json.loads(now(6, 2.0, 2.0)))
    assert history.add({"kind": "revised", "t": 6.0, "path": [[-1.0, 9.0, 9.0, 9.0], *path, [6.0, 4.0, 4.0, 4.0]]})
    assert history.rows() == [[-1.0, 9.0, 9.0, 9.0], *path, [6.0, 4.0, 4.0, 4.0]]


@pytest.mark.parametrize("kind", ["smoothed", "polished"])
def test_the_path_of_the_end_replaces_that_of_the_moment(kind):
    history = history_of(circle(6))
    for line in circle(3):
        history.add(
            {**json.loads(line), "kind": kind, "position_m": [7.0, 7.0, 7.0], "verdict": "doubtful", "reasons": []}
        )
    assert history.last["verdict"] == "doubtful"
    rows = history.rows()
    assert [row[0] for row in rows] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert [row[1] == 7.0 for row in rows] == [True] * 3 + [False] * 3


def test_a_long_walk_stays_bounded_and_near_its_path():
    history, side, step, line = History(), 50.0, 1.3, json.loads(now(0, 0.0, 0.0))
    for k in range(25_000):
        piece, along = divmod(k * step, side)
        corner, way = [((0, 0), (1, 0)), ((1, 0), (0, 1)), ((1, 1), (-1, 0)), ((0, 1), (0, -1))][int(piece) % 4]
        east, north = side * corner[0] + along * way[0], side * corner[1] + along * way[1]
        history.add({**line, "stance": k, "t": float(k), "position_m": [east, north, 0.1 * k]})
        assert len(history._rows) <= MAX_ROWS
    rows = np.array(history.rows())
    assert len(rows) > MAX_ROWS / 2
    assert np.all(np.diff(rows[:, 0]) > 0)
    assert np.all(np.diff(rows[-NEWEST_ROWS:, 0]) == 1.0)
    middle = (rows[1:, 1:3] + rows[:-1, 1:3]) / 2
    off_the_square = np.min(np.abs([middle[:, 0], middle[:, 1], middle[:, 0] - side, middle[:, 1] - side]), axis=0)
    assert np.quantile(off_the_square, 0.95) < 1.0
    assert history.distance_m == pytest.approx(25_000 * step, rel=0.02)
    day = np.column_stack([np.arange(80_000.0), np.cumsum(np.ones(80_000)), np.zeros((80_000, 2))])
    history.add({"kind": "revised", "t": day[-1, 0], "path": day.tolist()})
    assert len(history.rows()) <= MAX_ROWS


def test_an_ellipse_turns_with_the_map():
    event = {"position_sigma_m": [0.3, 0.1, 0.5], "east_north_cov_m2": 0.0}
    turn_line(event, 90.0)
    assert event["position_sigma_m"] == pytest.approx([0.1, 0.3, 0.5])
    turn_line(event, 45.0)  # the long axis, north, is north-east now
    assert event["east_north_cov_m2"] == pytest.approx((0.3**2 - 0.1**2) / 2)
    assert event["position_sigma_m"][0] == pytest.approx(np.sqrt((0.3**2 + 0.1**2) / 2))


# --- of two feet -----------------------------------------------------------------------------------------------------


def of_foot(foot, t, east, frame="left"):
    return {
        "kind": "now", "foot": foot, "frame": frame, "stance": int(t), "continues": False, "t": t,
        "position_m": [east, 0.0, 0.0], "heading_deg": None if foot == "person" else 90.0,
        "position_sigma_m": [0.1, 0.2, 0.1], "east_north_cov_m2": 0.0,
    }  # fmt: skip


def test_of_one_sensor_there_are_no_feet_and_news_of_a_foot_draw_nothing():
    walkers = Walkers()
    news = {"kind": "foot", "foot": "left", "frame": "left", "t": 1.0, "state": "silent", "reason": ""}
    assert walkers.add(news) == (False, False)
    assert walkers.describe()["path"] == []
    line = {key: value for key, value in of_foot("", 1.0, 2.0).items() if key not in ("foot", "frame")}
    assert walkers.add(line) == (False, True)
    found = walkers.describe()
    assert (found["path"], found["last"]["t"], found["feet"]) == ([[1.0, 2.0, 0.0, 0.0]], 1.0, {})


def test_a_right_foot_in_a_frame_of_its_own_is_not_drawn_next_to_the_left_one():
    walkers = Walkers()
    walkers.add(of_foot("right", 0.5, 7.0, "right"))
    assert walkers.describe()["last"]["foot"] == "right"
    assert walkers.add(of_foot("left", 1.0, 1.0)) == (True, True)  # the page's path is another from here on
    assert set(walkers.describe()["feet"]) == {"left"}
    assert walkers.add(of_foot("right", 1.5, 1.5)) == (True, False)
    assert set(walkers.describe()["feet"]) == {"left", "right"}


def test_the_path_of_the_page_is_the_persons_once_there_is_one():
    walkers = Walkers()
    walkers.add(of_foot("left", 1.0, 1.0))
    walkers.add({"kind": "revised", "foot": "person", "frame": "left", "t": 0.8, "path": [[0.8, 0.5, 0.0, 0.0]]})
    assert walkers.describe()["last"]["foot"] == "left"
    walkers.add(of_foot("person", 1.2, 1.5))
    found = walkers.describe()
    assert found["last"]["foot"] == "person"
    assert [row[1] for row in found["path"]] == [0.5, 1.5]


def test_a_foot_turns_with_its_own_map_only():
    walkers = Walkers()
    walkers.add(of_foot("left", 1.0, 2.0))
    walkers.add(of_foot("right", 1.5, 2.0))
    walkers.add({"kind": "turned", "foot": "right", "frame": "left", "t": 1.5, "angle_deg": 90.0})
    feet = walkers.describe()["feet"]
    assert feet["right"]["last"]["position_m"] == pytest.approx([0.0, -2.0, 0.0], abs=1e-9)
    assert feet["right"]["last"]["position_sigma_m"][:2] == pytest.approx([0.2, 0.1])
    assert feet["left"]["last"]["position_m"] == [2.0, 0.0, 0.0]
