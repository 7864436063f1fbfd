"""What a building shows: directions that courses follow, places that a walk comes back to, and level floors."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from gtsam.symbol_shorthand import A, X

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.evaluation import evaluate
from fg_nav.factors.walk_constraints import measure_course, wrap_quarter
from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.lab.simulation import simulate
from fg_nav.lab.simulation.path import arc, polyline
from fg_nav.lab.simulation.plan import Walk
from fg_nav.lab.simulation.scenario_file import read_scenario
from fg_nav.magnetic import average_footfall_field
from fg_nav.places import Signature, Stretch
from fg_nav.places.recognition import ALONG_SIGMA_M, LATERAL_SIGMA_M, UP_SIGMA_M, find_shift, weigh_shifts
from fg_nav.places.signature import whiten
from fg_nav.recording import Recording
from fg_nav.smoother import SmootherParameters, building, smooth_graph
from fg_nav.smoother.batch import SmoothedWalk
from fg_nav.smoother.graph import order_variables, solve
from fg_nav.smoother.parameters import FieldParameters, WalkParameters
from fg_nav.smoother.problem import walk_problem
from fg_nav.smoother.solver import CONVERGENCE, find_minimum
from tests.places.floors import Floor, retrace
from tests.simulated import FIRM, INDUSTRIAL, QUIET, simulated
from tests.smoother.walks import DEFAULT, FREE, demo, dense_root, find_columns, part, smoothed

# --- directions


STRIDE_M = 1.4
WITH = replace(DEFAULT, walk=WalkParameters(directions=True))


def path_of(turn: Floats, weave_m: float) -> Floats:
    """Footfalls (F, 3) of a foot that turns by `turn` (F-1,) rad before its strides."""
    course = np.cumsum(turn)
    steps = STRIDE_M * np.stack([np.cos(course), np.sin(course), 0 * course], axis=1)
    place = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    place[:, :2] += weave_m * np.random.default_rng(0).standard_normal((len(place), 2))
    return place


def rounds(legs: int, strides: int, drift_deg: float = 0.0) -> Floats:
    """Turns of a foot on legs at right angles, which drifts at each stride."""
    turn = np.full(legs * strides, np.radians(drift_deg))
    turn[strides::strides] += np.pi / 2
    return turn


def track(position: Floats, drift_deg: float = 5.0):
    pairs = building.list_displacements(position)
    course = measure_course(position[pairs[:, 1]] - position[pairs[:, 0]])
    at = pairs.mean(axis=1) / len(position)
    return course, building.track_directions(course, np.ones(len(course)), at, float(np.radians(drift_deg)))


@pytest.mark.parametrize("alpha_deg", [0.0, 30.0, 44.9, 70.0])
def test_directions_are_found_wherever_they_lie(alpha_deg: float) -> None:
    position = path_of(rounds(8, 20), 0.05) @ yaw_rotation(np.radians(alpha_deg)).T
    _, found = track(position)
    assert np.degrees(np.abs(wrap_quarter(found.phi - np.radians(alpha_deg))).max()) < 1.5
    assert found.evidence > 2 * building.MIN_EVIDENCE
    assert found.mixture.share > 0.9
    assert np.degrees(found.mixture.sigma) == pytest.approx(1.5, abs=0.5)


def test_a_drift_beyond_half_a_quarter_turn_is_tracked() -> None:
    """By 0.4 deg a stride to 64 deg, where the nearest direction is the wrong one."""
    position = path_of(rounds(8, 20, 0.4), 0.05)
    _, found = track(position, 40.0)
    middle = building.list_displacements(position).mean(axis=1)
    drift = np.degrees(found.phi - found.phi[0])
    np.testing.assert_allclose(drift, 0.4 * (middle - middle[0]), atol=3.0)
    assert drift[-1] > 55.0


@pytest.mark.parametrize("drift_deg", [3.0, 80.0])
@pytest.mark.parametrize("seed", range(20))
def test_courses_that_are_anything_show_none(seed: int, drift_deg: float) -> None:
    course = np.random.default_rng(seed).uniform(-np.pi, np.pi, 40)
    found = building.track_directions(course, np.ones(40), np.linspace(0.0, 1.0, 40), float(np.radians(drift_deg)))
    assert found.evidence < building.MIN_EVIDENCE


@cache
def turning(kind: str) -> tuple[Recording, SmoothedWalk, SmoothedWalk]:
    """A walk whose rate about up is off by 0.2 deg/s, 13 deg in all; solved without directions and with them."""
    path = {
        "rectangle": polyline([[0, 0], [28, 0], [28, 19], [0, 19], [0, 0]], 1.0),
        "circle": arc(9.0, 4 * np.pi),
    }[kind]
    recording = simulated([Walk(path)], QUIET, FIRM, INDUSTRIAL.at_rate(100.0), 0).recording
    recording = replace(recording, gyr=recording.gyr + np.radians([0.0, 0.0, 0.2]))
    stances, heading = detect_stances(recording), float(compute_heading(recording.truth.nav_R_body[0]))
    free, held = (smooth_graph(recording, stances, p, heading) for p in (DEFAULT, WITH))
    return recording, free, held


def test_a_rectangle_with_a_drifting_heading_is_made_right_by_a_direction_that_is_eliminated_last() -> None:
    recording, *both = turning("rectangle")
    free, held = (one.solution for one in both)
    expected = recording.truth.position - recording.truth.position[0]
    errors = [np.linalg.norm((one.position - expected)[:, :2], axis=1).max() for one in (free, held)]
    assert errors[0] > 2.0
    assert errors[1] < 0.4 * errors[0]
    assert held.stances.heading_sigma[-1] < free.stances.heading_sigma[-1]
    assert held.graph["direction"] > 6
    assert "direction" not in free.graph
    assert any("follow the directions of a building" in note for note in held.notes)
    walk, solved = both[1], both[1].walk.problem
    # Four legs of four and two displacements, which count as three courses at most.
    share = solved.get(building.DirectionFactors).courses.residuals.share
    np.testing.assert_allclose(share, np.tile(np.repeat([0.75, 1.0], [4, 2]), 2))
    keys = order_variables(solved)
    assert int(keys[-1]) == A(0)
    assert (keys != A(0)).sum() == len(keys) - 1
    # a leg's course is 1.5 deg at least, and alpha that of a few
    assert 0.2 < np.degrees(np.sqrt(walk.find_covariance(A(0))[0, 0])) < 5.0
    assert walk.graph.error(walk.values) == pytest.approx(walk.walk.solved.error, rel=1e-6)


def test_a_circle_is_the_same_walk_with_directions() -> None:
    free, held = (one.solution for one in turning("circle")[1:])
    np.testing.assert_array_equal(held.position, free.position)
    np.testing.assert_array_equal(held.stances.heading_sigma, free.stances.heading_sigma)
    assert building.NONE_FOUND in held.notes
    assert building.NONE_FOUND not in free.notes


def test_a_walk_is_split_where_its_heading_is_lost() -> None:
    grown_deg = np.array([0.0, 1, 2, 2, 0, 50, 33, 3, 8, 12, 1])  # over the stride before each footfall
    drift = building.split_drift(np.cumsum(np.radians(grown_deg) ** 2))
    np.testing.assert_array_equal(drift.piece, [0, 0, 0, 0, 0, 1, 2, 2, 2, 3, 3])
    assert np.degrees(drift.sigma) == pytest.approx(np.sqrt(1 + 4 + 4 + 9 + 64 + 1))
    assert building.split_drift(np.radians(np.linspace(0.0, 80.0, 240)) ** 2).piece[-1] == 0


def test_nothing_is_carried_over_a_lost_turn() -> None:
    """By half a right angle: both halves find their own directions."""
    position = path_of(rounds(8, 20), 0.05)
    turned = np.vstack([position[:81], position[81:] @ yaw_rotation(np.pi / 4).T])
    pairs = building.list_displacements(position)
    course = measure_course(turned[pairs[:, 1]] - turned[pairs[:, 0]])
    at, is_lost = pairs.mean(axis=1) / len(position), np.diff(pairs[:, 0] > 80) > 0
    found = building.track_directions(course, np.ones(len(course)), at, np.radians(3.0), is_lost)
    off = np.where(pairs[:, 0] > 80, np.pi / 4, 0.0)
    assert np.degrees(np.abs(wrap_quarter(found.phi - off)).max()) < 2.0
    assert found.mixture.share > 0.9


# --- places


LAPS = """
like = "office"
field = "indoor"
rests = "none"
[course]
points_m = [[0, 0], [0, 16], [22, 16], [22, 0], [0, 0]]
laps = {laps}
"""
NO_FIELD = FieldParameters(compass=False, potential=False, differential=False)
TYING, OPEN = (SmootherParameters(magnetic=NO_FIELD, walk=WalkParameters(places=places)) for places in (True, False))


@cache
def walked(laps: int) -> Recording:
    """Laps of 76 m, the rate about up off by 0.2 deg/s, and no rest to see it by."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "laps.toml"
        file.write_text(LAPS.format(laps=laps))
        recording = simulate(read_scenario(file), 3).recording
    return replace(recording, gyr=recording.gyr + np.radians(0.2) * recording.truth.nav_R_body[:, 2])


@cache
def solved(laps: int, places: bool) -> SmoothedWalk:
    recording = walked(laps)
    stances = detect_stances(recording)
    field = average_footfall_field(recording, stances)
    return smooth_graph(recording, stances, TYING if places else OPEN, 0.0, field=field)


def test_a_second_lap_is_recognized_halves_the_error_and_marks_its_footfalls() -> None:
    tied, without = (solved(2, places).solution for places in (True, False))
    assert sum(one.length_m for one in tied.returns) > 60.0
    assert without.returns == ()
    errors = [evaluate(one, walked(2).truth).rmse_2d_m or 0.0 for one in (tied, without)]
    assert errors[0] < 0.7 * errors[1]
    assert "recognized by the field" in tied.notes[-1] + tied.notes[-2]
    assert sum(one.length_m for one in solved(1, True).solution.returns) < 12.0  # one lap returns at its end alone
    table = tied.stances
    assert table.same_place is not None
    later = np.flatnonzero(table.same_place >= 0)
    assert len(later) > 40
    place = walked(2).truth.position[table.sample]
    apart = np.linalg.norm(place[later] - place[table.same_place[later]], axis=1)
    assert np.median(apart) < 0.6  # half a stride
    assert (table.same_place[later] < later).all()


def test_the_order_of_elimination_changes_nothing() -> None:
    """Tied footfalls last, or all in the order of time."""
    problem = solved(2, True).walk.problem
    assert len(problem.get(building.PlaceFactors)) > 2
    orders, key = (problem.time_order, order_variables(problem)), int(problem.time_order[0])
    assert (np.sort(orders[0]) == np.sort(orders[1])).all()
    assert (orders[0] != orders[1]).any()
    one, other = (find_minimum(problem.system, problem.values, keys, CONVERGENCE) for keys in orders)
    assert one.error == pytest.approx(other.error, rel=1e-9)
    covariances = [found.root.covariances([key])[key] for found in (one, other)]
    np.testing.assert_allclose(*covariances, rtol=1e-5, atol=1e-12)


def test_the_uncertainty_of_a_place_is_that_of_the_whole_graph() -> None:
    """Of footfalls relative to an earlier one, against the inverse of the information matrix."""
    walk = part(demo(), 8)
    short = walk_problem(walk.recording, walk.stances, 0.0, DEFAULT)
    minimum, columns = solve(short), find_columns(short)
    found, root = building.measure_uncertainty(short, minimum), dense_root(short, minimum.linearized_at)[2]
    rows = []
    for key in (X(int(short.nodes.result[k])) for k in (-1, 1)):
        R, pose = minimum.linearized_at.atPose3(key).rotation().matrix(), root[columns[key]]
        rows.append(np.vstack([R @ pose[3:], R[2:] @ pose[:3]]))
    expected = (rows[0] - rows[1]) @ (rows[0] - rows[1]).T
    position, height, heading = np.linalg.eigvalsh(expected[:2, :2])[-1], expected[2, 2], expected[3, 3]
    assert (found.place[1, -1], found.height[1, -1]) == pytest.approx((position, height), rel=0.05)
    assert found.heading[1, -1] == pytest.approx(heading, rel=0.05)
    ends = found.walked_m[[1]], found.walked_m[[-1]]
    assert found.position_m(*ends) == pytest.approx(np.hypot(np.sqrt(position), building.MIN_PLACE_M), rel=0.01)
    assert found.height_m(*ends) == pytest.approx(np.hypot(np.sqrt(height), building.MIN_HEIGHT_M), rel=0.01)
    assert found.heading_rad(*ends) == pytest.approx(
        np.hypot(np.sqrt(heading), np.radians(building.MIN_HEADING_DEG)), rel=0.01
    )


def test_by_way_of_an_anchor_behind_the_first_place_the_sigmas_of_both_ways_add_up() -> None:
    walked_m, variance = 5.0 * np.arange(7), np.arange(14.0).reshape(2, 7)
    path = building.PathUncertainty(walked_m, np.array([0.0, 20.0]), variance, variance, variance)
    for first_m, sigma_m in ((4.0, np.sqrt(6.0)), (12.0, np.sqrt(10.0) + np.sqrt(13.0)), (20.0, np.sqrt(13.0))):
        found = path.position_m(np.array([first_m]), np.array([30.0]))
        assert found == pytest.approx(np.hypot(sigma_m, building.MIN_PLACE_M)), first_m


def test_what_two_rounds_have_in_common_is_kept() -> None:
    later = np.arange(100.0, 200.0)
    one = Stretch(later, later - 90.0, False, 50.0, 1e-9)
    bent = replace(one, earlier=one.earlier + np.where((later >= 140.0) & (later < 150.0), 6.0, 1.0))
    pieces = building.keep_common((one,), (bent,))
    assert [(piece.later[0], piece.later[-1]) for piece in pieces] == [(100.0, 139.0), (150.0, 199.0)]
    assert sum(piece.score for piece in pieces) == pytest.approx(45.0)
    assert building.keep_common((one,), ()) == ()
    assert building.keep_common((one,), (replace(one, opposite=True),)) == ()
    assert building.keep_common((one,), (replace(one, later=later + 92.0, earlier=one.earlier + 92.0),)) == ()


def test_a_walk_whose_rounds_say_different_things_is_not_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each round recognizes another stretch: nothing is confirmed, so nothing is used."""
    walk = solved(2, False).walk
    at = iter([0.0, 30.0, 60.0])

    def recognize(path: Signature, *_: object) -> tuple[Stretch, ...]:
        later = np.arange(30.0) + len(path) / 2 + next(at)
        return (Stretch(np.floor(later), np.floor(later) - len(path) // 2, False, 50.0, 1e-9),)

    monkeypatch.setattr(building, "select_consistent", recognize)
    same, minimum, returns, notes = building.tie_places(replace(walk.problem, parameters=TYING), walk.solved)
    assert same.find(building.PlaceFactors) is None
    assert minimum is walk.solved
    assert (returns, notes) == ((), ())


@pytest.mark.parametrize("opposite", [False, True])
def test_ties_have_the_errors_that_they_claim_on_a_rough_floor_and_on_a_smooth_one(opposite: bool) -> None:
    """Two laps, the second a step aside and aligned wrongly by up to 0.8 m: along the path as sharp as the field is."""
    sigmas = {}
    for name, waves_m, strength in (("rough", (1.5, 12.0), 1.0), ("smooth", (10.0, 40.0), 0.25)):
        z, along_m = [], []
        for seed in range(8):
            rng, floor = np.random.default_rng(seed), Floor.draw(seed, waves_m=waves_m)
            floor = replace(floor, strength=strength * floor.strength)
            path, true = retrace(opposite, floor=floor, aside=0.2 * rng.standard_normal(2), noise_uT=0.1)
            wrong = replace(true, earlier=true.move_earlier(rng.uniform(-0.8, 0.8)))
            foot = np.arange(0, len(path), 3)
            R = np.tile(np.eye(3), (len(foot), 1, 1))
            factors = building.make_place_factors(
                path, [wrong], path.t[foot], path.position[foot], R, np.arange(len(foot))
            )
            poses = np.tile(np.eye(4), (len(foot), 1, 1))
            poses[:, :3, 3] = path.position[foot]
            joined = np.array(factors.keys) - X(0)
            z.append(factors.residuals.evaluate([poses[joined[:, 0]], poses[joined[:, 1]]], False)[0])
            along_m.append(1.0 / np.linalg.norm(factors.residuals.weight[:, 0], axis=1))
        e = np.concatenate(z)[:, 0]
        sigmas[name] = np.median(np.concatenate(along_m))
        assert len(e) >= 16
        assert 0.3 < np.sqrt(np.mean(e**2)) < 1.6, name
        assert np.mean(np.abs(e) < 2.0) > 0.85, name
    assert sigmas["rough"] < 0.35
    assert sigmas["smooth"] > 1.5 * sigmas["rough"]


def test_a_tie_is_as_sharp_along_the_path_as_its_alignment_and_its_shift_together() -> None:
    """13.5 m of one cell, over a floor that shows its shift to 0.3 m."""
    floor = Floor.draw(3, waves_m=(4.0, 16.0))
    path, whole = retrace(False, floor=replace(floor, strength=0.5 * floor.strength))
    piece = replace(whole, later=whole.later[:28], earlier=whole.earlier[:28])
    foot = np.arange(0, len(path), 3)
    R = np.tile(np.eye(3), (len(foot), 1, 1))
    tie = building.make_place_factors(path, [piece], path.t[foot], path.position[foot], R, 2 * foot)
    (pair,), count = tie.keys, 13.5 / building.APART_M
    assert np.abs(path.distance_m[(np.array(pair) - X(0)) // 2] - [108.0, 10.0]).max() < 0.9  # the middles
    shift_sigma = find_shift(weigh_shifts(whiten(path), piece))[1]
    assert 0.1 < shift_sigma < 0.8
    along_m = np.hypot(ALONG_SIGMA_M / np.sqrt(count), shift_sigma)
    expected = [along_m, LATERAL_SIGMA_M / np.sqrt(count), UP_SIGMA_M]
    np.testing.assert_allclose(1.0 / np.linalg.norm(tie.residuals.weight[0], axis=1), expected, rtol=1e-3)


def test_laps_of_hours_are_tied_cell_by_cell() -> None:
    """Sixty laps of a loop of 80 m: cells are as long as on two laps, and no footfall is tied to itself."""
    points = np.arange(60 * 160, dtype=float)
    angle = points * 2.0 * np.pi / 160.0
    place = np.column_stack([12.7 * np.cos(angle), 12.7 * np.sin(angle), 0.0 * angle])
    path = Signature(0.5 * points, 0.4 * points, place, angle + 0.5 * np.pi, place, points >= 0.0)
    laps = [Stretch(points[160 * k :], points[: -160 * k], False, 500.0, 1e-99) for k in range(1, 60)]
    foot = np.arange(0, len(points), 3)
    poses = path.t[foot], place[foot], np.tile(np.eye(3), (len(foot), 1, 1))
    factors = building.make_place_factors(path, laps, *poses, np.arange(len(foot)))
    ties = np.array(factors.keys)
    assert len(ties) > 200
    assert len(np.unique(ties[:, 1])) <= 5
    assert (ties[:, 0] > ties[:, 1]).all()


# --- floors


def test_floors_can_be_switched_off() -> None:
    assert DEFAULT.walk.floors
    free, flat = smoothed(0, FREE), smoothed()
    assert not any("level floor" in note for note in free.notes)
    assert any("1 level floor" in note for note in flat.notes)
    assert np.ptp(flat.stances.position[:, 2]) < min(0.02, 0.1 * np.ptp(free.stances.position[:, 2]))
    assert np.linalg.norm((flat.position - free.position)[:, :2], axis=1).max() < 0.1
    assert flat.stances.position_cov[-1, 2, 2] < 0.2 * free.stances.position_cov[-1, 2, 2]
