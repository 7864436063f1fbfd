"""The script that measures what a walk gains where it comes back to its places, and loses where it does not."""

from argparse import Namespace
from dataclasses import replace

import numpy as np
import pytest

from fg_nav.lab.simulation import routes, scenario
from fg_nav.lab.simulation.path import polyline
from fg_nav.lab.simulation.plan import Stand, Walk
from fg_nav.lab.simulation.walk import Streams
from tests.scripts import load_script

returning = load_script("returning_walks")

LAP = polyline([(0, 0), (0, 11), (16, 11), (16, 0), (16, -8), (0, -8), (0, 0)], routes.CORNER_M)


def test_laps_are_walked_aside_of_each_other_and_landmarks_stay():
    lap = LAP.with_landmarks([5.0, 40.0])
    path = returning.move_path(lap.repeat(6), 3)
    assert path.length_m == pytest.approx(6 * lap.length_m, rel=0.02)
    passed = path.at([mark.arc for mark in path.landmarks])[0]
    apart = np.linalg.norm(passed - np.tile(lap.at([5.0, 40.0])[0], (6, 1)), axis=1)
    assert 0.1 < np.sqrt(np.mean(apart**2)) < 0.4
    assert apart.max() < 1.0


def test_floors_lie_above_each_other_and_rows_look_alike():
    floors, rows = returning.ALONE[2:]
    sections = floors.scenario.route(Streams(1, "any").of_this_walk("course"))
    below, above = (section.path for section in sections if isinstance(section, Walk))
    assert above.position[:, 2].min() == pytest.approx(returning.FLOOR_M)
    near = [np.linalg.norm(below.position[:, :2] - place[:2], axis=1).min() for place in above.position[-20:]]
    assert max(near) < 2.0
    walk, _ = replace(rows, surround=None).draw("homogeneous", 1)
    field = returning.surround_rows("smooth", walk, np.random.default_rng(1))
    place, north = np.array([[12.0, 0.3, 0.1]]), np.array([0.0, 1.0, 0.0])
    np.testing.assert_allclose(field.at(place), field.at(place + 2 * returning.ROWS_M * north))
    assert np.linalg.norm(field.at(place) - field.at(place + 4.0 * north)) > 0.1


def test_two_laps_are_measured_and_printed(monkeypatch, capsys):
    monkeypatch.setattr(returning, "LEVELS", ("indoor",))
    path = returning.move_path(LAP.repeat(2), 1)
    small = replace(scenario("office"), name="small", route=lambda _: [Stand(5.0), Walk(path), Stand(5.0)])
    found = returning.measure_courses(
        Namespace(seeds=1, first=1, jobs=1, feet="still"), [returning.Course("small", small, 2)]
    )
    figures = returning.print_laps("Laps", found)
    assert [figure.name for figure in figures] == 2 * ["last lap over first"]
    [one] = found["small", "indoor"]
    assert one[True, True].ties > 20
    assert one[True, False].ties == 0
    assert all(0.0 < errors.all_m < 1.0 for errors in one.values())
    assert "small, indoor, not given" in capsys.readouterr().out
