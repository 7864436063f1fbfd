"""Where a walk is on the places of an earlier one: start and heading with a covariance, or nothing."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fg_nav.frames import yaw_rotation
from fg_nav.places import Signature, locate, recognize_known
from fg_nav.places.alignment import USUAL_DECAY
from fg_nav.places.location import DRIFT, MAX_PIECES, MAX_STRETCHES, _covariance_of, _linearize
from fg_nav.places.overlay import HOP, MIN_DECAY, PIECE, find_decay, overlay_known
from fg_nav.places.recognition import ALONG_SIGMA_M, HEADING_SIGMA_RAD, LATERAL_SIGMA_M, LONE_EXPECTED, UP_SIGMA_M
from fg_nav.places.signature import MIN_POINTS
from tests.places.floors import EARTH, LOOP, OPEN, Floor, along, carry, save

START = np.array([25.0, 0.2])
PART = along([START, (60, 0.2), (60, 40)])


@pytest.fixture(scope="module")
def known():
    """Places of a walk whose frame is at its first corner, (0, 0)."""
    return save(carry(Floor.draw(8), along(OPEN)))


def turned(walk, degrees):
    """The same walk in a frame of its own that is turned by so much."""
    angle = np.deg2rad(degrees)
    return replace(walk, position=walk.position @ yaw_rotation(angle).T, heading=walk.heading + angle)


def test_start_and_heading_are_found_whatever_the_frame_of_the_walk_and_in_the_opposite_direction(known):
    for degrees, path in ((0.0, PART), (77.0, PART), (-170.0, PART), (0.0, PART[::-1])):
        found = locate(turned(carry(Floor.draw(8), path, seed=1), degrees), known)
        assert found is not None
        error = np.append(found.start[:2] - path[0, :2], found.turn_rad + np.deg2rad(degrees))
        sigma = np.sqrt(np.diag(found.covariance))[[0, 1, 3]]
        assert (np.abs(error) < 3.0 * sigma).all()
        assert (sigma < [0.6, 0.6, np.deg2rad(2.0)]).all()
        assert found.expected_false < LONE_EXPECTED
        assert all(stretch.opposite == (path is not PART) for stretch in found.stretches)


def test_the_start_is_less_sure_the_later_the_walk_comes_to_known_places_and_the_less_those_are_known(known):
    elsewhere = along([(0, -60), (0, 0), (60, 0), (60, 30)])
    soon = carry(Floor.draw(8), PART, seed=3)
    late = locate(carry(Floor.draw(8), elsewhere, drift_deg_m=0.02, seed=3), known)
    sure, unsure = locate(soon, known), locate(soon, save(known.path, 3.0))
    assert np.linalg.norm(late.start[:2] - [0, -60]) < 3.0
    assert np.trace(late.covariance[:2, :2]) > 2.0 * np.trace(sure.covariance[:2, :2])
    assert np.diag(unsure.covariance)[:3] == pytest.approx(np.diag(sure.covariance)[:3] + 9.0, abs=0.5)
    assert unsure.map_variance == pytest.approx(9.0)


def test_a_walk_on_another_floor_or_too_short_a_one_is_not_found(known):
    for seed in range(5):
        assert locate(carry(Floor.draw(20 + seed), PART, seed=seed), known) is None
    assert locate(carry(Floor.draw(8), along([(20, 0), (35, 0)])), known) is None


def test_a_walk_that_could_be_at_two_places_is_not_found():
    """Corridors alike, 100 m apart; or two that lead from one corner, which have one start and two headings."""
    floor, quarter = Floor.draw(3), yaw_rotation(np.pi / 2)

    def fork(place):
        turned = EARTH + (floor.at(place @ quarter) - EARTH) @ quarter.T
        return np.where(place[:, 1:2] > place[:, :1], turned, floor.at(place))

    def twice(place):
        return floor.at(np.column_stack([np.mod(place[:, 0], 100.0), place[:, 1], place[:, 2]]))

    corner = along([(60, 0), (0, 0), (0, 60)])
    for field, path, ambiguous, plain in (
        (twice, along([(20, 0), (80, 0)]), along([(0, 0), (190, 0)]), along([(0, 0), (99, 0)])),
        (fork, along([(1, 0), (50, 0)]), corner, corner),
    ):
        walk = carry(floor, path, seed=1)
        assert locate(walk, save(carry(SimpleNamespace(at=field), ambiguous))) is None
        assert locate(walk, save(carry(floor, plain)))


def test_passes_of_one_corridor_are_no_two_places():
    laps = np.vstack([along(LOOP)] * 4)
    known = save(carry(Floor.draw(4), laps))
    for path in (along([(10, 0), (30, 0), (30, 18)]), laps):
        found = locate(carry(Floor.draw(4), path, seed=1), known)
        assert found is not None
        assert len(found.stretches) > 1
        assert len(found.pieces.t) < MAX_PIECES + MAX_STRETCHES  # what a fit can take
        assert np.linalg.norm(found.start[:2] - path[0, :2]) < 1.0


def test_a_stretch_that_lies_elsewhere_is_left_out(known):
    """The second part of the walk is on another corridor than it should be: the odometry lost 15 m."""
    path = carry(Floor.draw(8), along([(5, 0), (60, 0), (60, 60), (110, 60)]), seed=1)
    lost = path.position.copy()
    lost[path.distance_m > 120.0] += [15.0, 0.0, 0.0]
    found = locate(replace(path, position=lost), known)
    assert found is not None
    assert np.linalg.norm(found.start[:2] - [5, 0]) < 1.5


def test_the_jacobian_of_the_transform_is_its_derivative(known):
    found = locate(carry(Floor.draw(8), PART, seed=1), known)
    x, step = np.append(found.start, found.turn_rad + 0.3), 1e-5
    jacobian = _linearize(found.pieces, x)[1]
    for k, axis in enumerate(step * np.eye(4)):
        ahead, behind = (_linearize(found.pieces, x + sign * axis)[0] for sign in (1.0, -1.0))
        np.testing.assert_allclose(jacobian[:, k], (behind - ahead) / (2.0 * step), atol=1e-6)


def test_errors_of_ties_average_out_over_a_piece_but_that_of_its_height(known):
    pieces = locate(carry(Floor.draw(8), PART, seed=1), known).pieces
    assert pieces.count.max() > 1.2
    axes, one = yaw_rotation(pieces.heading), np.ones(len(pieces.count))
    own = np.swapaxes(axes, 1, 2) @ pieces.tie_covariance @ axes
    level = np.array([ALONG_SIGMA_M, LATERAL_SIGMA_M]) ** 2 / pieces.count[:, None]
    expected = np.column_stack([level, UP_SIGMA_M**2 * one])
    np.testing.assert_allclose(np.diagonal(own, axis1=1, axis2=2), expected)
    drift = DRIFT.heading_rad(0.0 * one, pieces.walked_m) ** 2
    heading = np.diag(_covariance_of(pieces))[3::4]
    np.testing.assert_allclose(heading, HEADING_SIGMA_RAD**2 / pieces.count + drift)


# --- a piece of a walk laid on an earlier one as a whole: in a field of long waves


SHORT = along([START, (60, 0.2), (60, 7)])


def soft(seed: int) -> Floor:
    """A field of which little is shorter than 10 m, 1 uT strong."""
    floor = Floor.draw(seed, waves_m=(10.0, 40.0))
    return replace(floor, strength=0.25 * floor.strength)


@pytest.fixture(scope="module")
def soft_places() -> Signature:
    return carry(soft(8), along(OPEN), noise_uT=0.1)


def walk(seed: int, place=SHORT) -> Signature:
    return carry(soft(seed), place, noise_uT=0.1, seed=1)


def test_a_piece_is_found_where_it_lies_that_no_alignment_shows(soft_places):
    for path, opposite, earlier in ((SHORT, False, 50.0), (SHORT[::-1], True, 133.0)):
        found = overlay_known(walk(8, path), soft_places)
        best = found.stretches[0]
        assert best.opposite == opposite
        assert best.expected_false < 1e-6
        assert best.earlier[0] == pytest.approx(earlier, abs=1.0)
        assert found.chance.decay == USUAL_DECAY
    assert all(one.expected_false > LONE_EXPECTED for one in recognize_known(walk(8), soft_places).stretches)
    located = locate(walk(8), save(soft_places))
    assert located is not None
    assert np.linalg.norm(located.start[:2] - START) < 1.0


def test_a_walk_on_another_floor_is_not_found(soft_places):
    for seed in range(20, 26):
        assert all(one.expected_false > LONE_EXPECTED for one in overlay_known(walk(seed), soft_places).stretches)
        assert locate(walk(seed), save(soft_places)) is None


def test_iron_of_the_shoe_and_a_soft_one_change_nothing(soft_places):
    path = walk(8)
    c, s = np.cos(path.heading), np.sin(path.heading)
    earth = np.stack([c * EARTH[0] + s * EARTH[1], c * EARTH[1] - s * EARTH[0], 0.0 * c + EARTH[2]], axis=1)
    iron = np.array([3.0, -2.0, 5.0]) + earth @ np.array([[0.05, 0.01, 0.0], [0.02, -0.03, 0.01], [0.0, 0.02, 0.04]])
    one, other = (overlay_known(replace(path, field=field), soft_places) for field in (path.field, path.field + iron))
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


def test_a_walk_of_another_shape_is_not_located(soft_places):
    """The field of a known corner on a path whose odometry made it straight."""
    path = walk(8, along([(40, 0), (60, 0), (60, 22)]))
    straight = np.column_stack([path.distance_m, 0.0 * path.distance_m, path.position[:, 2]])
    unrolled = replace(path, position=straight)
    assert overlay_known(unrolled, soft_places).stretches[0].expected_false < LONE_EXPECTED
    assert locate(unrolled, save(soft_places)) is None


def test_pieces_cover_a_long_walk_and_a_short_one_is_left(soft_places):
    begins = sorted({one.later[0] for one in overlay_known(soft_places, soft_places).stretches})
    assert begins[0] == 0
    assert begins[-1] == len(soft_places) - PIECE
    assert np.diff(begins).max() <= HOP
    few = Signature(**{name: column[: MIN_POINTS - 1] for name, column in vars(soft_places).items()})
    assert overlay_known(few, soft_places).stretches == ()
