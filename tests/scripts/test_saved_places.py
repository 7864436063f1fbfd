"""The script that measures a second walk on saved places: its walks are of one building, and what it counts."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.frames import compute_heading
from fg_nav.places import SavedPlaces
from tests.places.floors import OPEN, Floor, along, carry
from tests.scripts import load_script

saved_places = load_script("saved_places")


def test_the_second_walk_reads_the_field_of_the_first():
    lap = saved_places.draw_lap(1).part(0.0, 30.0)
    scenario = saved_places.walk_along(lap)
    first = saved_places.simulate(scenario, 1, saved_places.Choices(field="indoor", calibrated=True))
    second = saved_places.simulate_second(1, first, lap.part(5.0, 25.0))
    seen = np.flatnonzero(np.isfinite(second.recording.mag).all(axis=1))
    sample = int(seen[len(seen) // 2])
    place, heading = saved_places.true_start(first, second, sample)
    nav_R_body = second.recording.truth.nav_R_body[sample]
    assert heading == pytest.approx(float(compute_heading(nav_R_body)))
    read = nav_R_body @ second.recording.mag[sample]
    assert read == pytest.approx(first.field.at(place[None] + first.origin)[0], abs=2.0)


def test_parts_begin_anywhere_and_go_in_both_directions():
    lap = saved_places.draw_lap(1)
    parts = [saved_places.draw_part(seed, lap, 40.0) for seed in range(20)]
    assert all(part.length_m == pytest.approx(40.0) for part in parts)
    assert np.ptp([part.start.position[0] for part in parts]) > 20.0


def test_a_walk_is_found_within_a_meter_and_five_degrees_and_counted_elsewhere():
    path = carry(Floor.draw(1), along(OPEN))
    known = SavedPlaces(path, np.full((len(path), 3), 0.1))
    one = saved_places.Second(known, carry(Floor.draw(1), along([(10, 0), (60, 0)]), seed=1), 0.5, 1.0)
    assert one.is_found
    assert not replace(one, error_m=1.1).is_found
    assert not replace(one, error_deg=5.1).is_found
    assert not saved_places.Second(known, path).is_found
    other = replace(one, path=carry(Floor.draw(2), along(OPEN)))
    assert saved_places.count_elsewhere([one, replace(one)]) == 2
    assert saved_places.count_elsewhere([replace(other, known=known), other]) == 0
