"""A piece of a walk laid on an earlier one as a whole: in a field of long waves."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.places import Signature, locate, recognize_known
from fg_nav.places.alignment import USUAL_DECAY
from fg_nav.places.overlay import HOP, MIN_DECAY, PIECE, find_decay, overlay_known
from fg_nav.places.recognition import LONE_EXPECTED
from fg_nav.places.signature import MIN_POINTS
from tests.places.floors import EARTH, OPEN, Floor, along, carry, save

START = np.array([25.0, 0.2])
PART = along([START, (60, 0.2), (60, 7)])


def soft(seed: int) -> Floor:
    """A field of which little is shorter than 10 m, 1 uT strong."""
    floor = Floor.draw(seed, waves_m=(10.0, 40.0))
    return replace(floor, strength=0.25 * floor.strength)


@pytest.fixture(scope="module")
def known() -> Signature:
    return carry(soft(8), along(OPEN), noise_uT=0.1)


def walk(seed: int, place=PART) -> Signature:
    return carry(soft(seed), place, noise_uT=0.1, seed=1)


def test_a_piece_is_found_where_it_lies_that_no_alignment_shows(known):
    for path, opposite, earlier in ((PART, False, 50.0), (PART[::-1], True, 133.0)):
        found = overlay_known(walk(8, path), known)
        best = found.stretches[0]
        assert best.opposite == opposite
        assert best.expected_false < 1e-6
        assert best.earlier[0] == pytest.approx(earlier, abs=1.0)
        assert found.chance.decay == USUAL_DECAY
    assert all(one.expected_false > LONE_EXPECTED for one in recognize_known(walk(8), known).stretches)
    located = locate(walk(8), save(known))
    assert located is not None
    assert np.linalg.norm(located.start[:2] - START) < 1.0


def test_a_walk_on_another_floor_is_not_found(known):
    for seed in range(20, 26):
        assert all(one.expected_false > LONE_EXPECTED for one in overlay_known(walk(seed), known).stretches)
        assert locate(walk(seed), save(known)) is None


def test_iron_of_the_shoe_and_a_soft_one_change_nothing(known):
    path = walk(8)
    c, s = np.cos(path.heading), np.sin(path.heading)
    earth = np.stack([c * EARTH[0] + s * EARTH[1], c * EARTH[1] - s * EARTH[0], 0.0 * c + EARTH[2]], axis=1)
    iron = np.array([3.0, -2.0, 5.0]) + earth @ np.array([[0.05, 0.01, 0.0], [0.02, -0.03, 0.01], [0.0, 0.02, 0.04]])
    one, other = (overlay_known(replace(path, field=field), known) for field in (path.field, path.field + iron))
    assert other.stretches[0].score == pytest.approx(one.stretches[0].score, abs=1e-6)
    assert np.array_equal(other.stretches[0].earlier, one.stretches[0].earlier)


def test_a_field_that_is_the_same_everywhere_shows_no_place():
    places = carry(replace(soft(8), strength=np.zeros(120)), along(OPEN), noise_uT=0.1)
    assert overlay_known(places, replace(places, field=places.field[::-1])).stretches == ()
    still = replace(places, field=np.tile(EARTH, (len(places), 1)))
    assert overlay_known(still, still).stretches == ()


def test_where_chance_scores_as_well_as_a_place_nothing_is_recognized():
    assert find_decay(np.full(100, 2.0)) == MIN_DECAY
    assert find_decay(np.array([-3.0, -2.0, 1.0])) == USUAL_DECAY
    assert find_decay(np.array([-1.0, 2.0])) == MIN_DECAY
    decay = find_decay(np.array([-1.0, -1.0, -1.0, 1.5]))
    assert 0.75 * np.exp(-decay) + 0.25 * np.exp(1.5 * decay) == pytest.approx(1.0)
    assert MIN_DECAY < decay < USUAL_DECAY


def test_a_walk_of_another_shape_is_not_located(known):
    """The field of a known corner on a path whose odometry made it straight."""
    path = walk(8, along([(40, 0), (60, 0), (60, 22)]))
    straight = np.column_stack([path.distance_m, 0.0 * path.distance_m, path.position[:, 2]])
    unrolled = replace(path, position=straight)
    assert overlay_known(unrolled, known).stretches[0].expected_false < LONE_EXPECTED
    assert locate(unrolled, save(known)) is None


def test_pieces_cover_a_long_walk_and_a_short_one_is_left(known):
    begins = sorted({one.later[0] for one in overlay_known(known, known).stretches})
    assert begins[0] == 0
    assert begins[-1] == len(known) - PIECE
    assert np.diff(begins).max() <= HOP
    few = Signature(**{name: column[: MIN_POINTS - 1] for name, column in vars(known).items()})
    assert overlay_known(few, known).stretches == ()
