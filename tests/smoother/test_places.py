"""Places that a walk comes back to: two laps of a corridor on a rough floor, with a gyroscope that drifts."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X

from fg_nav.detection import detect_stances
from fg_nav.evaluation import evaluate
from fg_nav.factors.residual import Keys
from fg_nav.lab.simulation import simulate
from fg_nav.lab.simulation.scenario_file import read_scenario
from fg_nav.magnetic import average_footfall_field
from fg_nav.places import Signature, Stretch
from fg_nav.recording import Recording
from fg_nav.smoother import SmootherParameters, building, smooth_graph
from fg_nav.smoother.batch import SmoothedWalk
from fg_nav.smoother.building import (
    keep_common,
    make_place_factors,
    measure_uncertainty,
)
from fg_nav.smoother.field_factors import FieldFactors
from fg_nav.smoother.graph import order_variables
from fg_nav.smoother.parameters import FieldParameters, WalkParameters
from fg_nav.smoother.solver import CONVERGENCE, find_minimum, list_in_time
from fg_nav.truth import TrajectoryTruth

LAPS = """
like = "office"
field = "indoor"
rests = "none"
[course]
points_m = [[0, 0], [0, 16], [22, 16], [22, 0], [0, 0]]
laps = {laps}
"""
NO_FIELD = FieldParameters(compass=False, potential=False, differential=False)
WITH, WITHOUT = (SmootherParameters(magnetic=NO_FIELD, walk=WalkParameters(places=places)) for places in (True, False))


@cache
def walked(laps: int) -> Recording:
    """Laps of 76 m, the rate about up off by 0.2 deg/s, and no rest to see it by."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "laps.toml"
        file.write_text(LAPS.format(laps=laps))
        recording = simulate(read_scenario(file), 3).recording
    truth = recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    return replace(recording, gyr=recording.gyr + np.radians(0.2) * truth.nav_R_body[:, 2])


@cache
def solved(laps: int, places: bool) -> SmoothedWalk:
    recording = walked(laps)
    stances = detect_stances(recording)
    field = average_footfall_field(recording, stances)
    return smooth_graph(recording, stances, WITH if places else WITHOUT, 0.0, field=field)


def test_a_second_lap_is_recognized_and_halves_the_error() -> None:
    with_places, without = (solved(2, places).solution for places in (True, False))
    assert sum(one.length_m for one in with_places.returns) > 60.0
    assert without.returns == ()
    errors = [evaluate(one, walked(2).truth).rmse_2d_m or 0.0 for one in (with_places, without)]
    assert errors[0] < 0.7 * errors[1]
    assert "recognized by the field" in with_places.notes[-1] + with_places.notes[-2]


def test_nothing_is_recognized_on_one_lap_but_its_end() -> None:
    assert sum(one.length_m for one in solved(1, True).solution.returns) < 12.0


def test_footfalls_are_marked_with_those_at_their_place() -> None:
    table, truth = solved(2, True).solution.stances, walked(2).truth
    assert table.same_place is not None
    later = np.flatnonzero(table.same_place >= 0)
    assert len(later) > 40
    place = truth.position[table.sample]
    apart = np.linalg.norm(place[later] - place[table.same_place[later]], axis=1)
    assert np.median(apart) < 0.6  # half a stride
    assert (table.same_place[later] < later).all()


def test_the_order_of_elimination_changes_nothing() -> None:
    """Tied footfalls last, or all in the order of time."""
    problem = solved(2, True).walk.problem
    assert len(problem.get(building.PlaceFactors)) > 2
    in_time = list_in_time(problem.nodes, problem.find(FieldFactors) is not None, problem.floor)
    orders: list[Keys] = [in_time, order_variables(problem)]
    assert (np.sort(orders[0]) == np.sort(orders[1])).all()
    assert (orders[0] != orders[1]).any()
    one, other = (find_minimum(problem.system, problem.values, keys, CONVERGENCE) for keys in orders)
    assert one.error == pytest.approx(other.error, rel=1e-9)
    key = int(in_time[0])
    np.testing.assert_allclose(
        one.root.covariances([key])[key], other.root.covariances([key])[key], rtol=1e-5, atol=1e-12
    )


def test_uncertainty_is_that_of_the_whole_graph() -> None:
    """Of a footfall relative to the first anchors, against the inverse of the information matrix."""
    walk = solved(1, False).walk
    problem, minimum = walk.problem, walk.solved
    found = measure_uncertainty(problem, minimum)
    ordering = gtsam.Ordering()
    for key in order_variables(problem).tolist():
        ordering.push_back(key)
    A, _ = problem.factors().linearize(minimum.linearized_at).jacobian(ordering)
    scale = np.linalg.norm(A, axis=0)
    root = np.linalg.inv(np.linalg.qr(A / scale, mode="r")) / scale[:, None]
    covariance = root @ root.T
    node = problem.nodes.result[[0, -1]]
    columns = minimum.root.find_columns([(X(int(node[1])), X(int(node[0])))])[0]
    R = [minimum.linearized_at.atPose3(X(int(j))).rotation().matrix() for j in node[::-1]]
    difference = np.hstack([np.zeros((3, 3)), R[0], np.zeros((3, 3)), -R[1]])
    expected = difference @ covariance[np.ix_(columns, columns)] @ difference.T
    variance = found.place[0, -1]
    assert variance == pytest.approx(np.linalg.eigvalsh(expected[:2, :2])[-1], rel=0.05)
    assert found.height[0, -1] == pytest.approx(expected[2, 2], rel=0.05)


def test_what_two_rounds_have_in_common_is_kept() -> None:
    later = np.arange(100.0, 200.0)
    one = Stretch(later, later - 90.0, False, 50.0, 1e-9)
    bent = replace(one, earlier=one.earlier + np.where((later >= 140.0) & (later < 150.0), 6.0, 1.0))
    pieces = keep_common((one,), (bent,))
    assert [(piece.later[0], piece.later[-1]) for piece in pieces] == [(100.0, 139.0), (150.0, 199.0)]
    assert sum(piece.score for piece in pieces) == pytest.approx(45.0)
    assert keep_common((one,), ()) == ()
    assert keep_common((one,), (replace(one, opposite=True),)) == ()
    assert keep_common((one,), (replace(one, later=later + 92.0, earlier=one.earlier + 92.0),)) == ()


def test_a_walk_whose_rounds_say_different_things_is_not_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each round recognizes another stretch: nothing is confirmed, so nothing is used."""
    walk = solved(2, False).walk
    at = iter([0.0, 30.0, 60.0])

    def recognize(path: Signature, *_: object) -> tuple[Stretch, ...]:
        later = np.arange(30.0) + len(path) / 2 + next(at)
        return (Stretch(np.floor(later), np.floor(later) - len(path) // 2, False, 50.0, 1e-9),)

    monkeypatch.setattr(building, "select_consistent", recognize)
    same, minimum, returns, notes = building.tie_places(replace(walk.problem, parameters=WITH), walk.solved)
    assert same.find(building.PlaceFactors) is None
    assert minimum is walk.solved
    assert (returns, notes) == ((), ())


def test_laps_of_hours_are_tied_cell_by_cell() -> None:
    """Sixty laps of a loop of 80 m: cells are as long as on two laps, and no footfall is tied to itself."""
    points = np.arange(60 * 160, dtype=float)
    angle = points * 2.0 * np.pi / 160.0
    place = np.column_stack([12.7 * np.cos(angle), 12.7 * np.sin(angle), 0.0 * angle])
    path = Signature(0.5 * points, 0.4 * points, place, angle + 0.5 * np.pi, place, points >= 0.0)
    laps = [Stretch(points[160 * k :], points[: -160 * k], False, 500.0, 1e-99) for k in range(1, 60)]
    foot = np.arange(0, len(points), 3)
    poses = path.t[foot], place[foot], np.tile(np.eye(3), (len(foot), 1, 1))
    factors = make_place_factors(path, laps, *poses, np.arange(len(foot)))
    ties = np.array(factors.keys)
    assert len(ties) > 200
    assert len(np.unique(ties[:, 1])) <= 5
    assert (ties[:, 0] > ties[:, 1]).all()
