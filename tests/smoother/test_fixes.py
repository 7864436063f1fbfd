"""Fixes: where they are used, what they do to the heading at the start, and which are refused."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError
from fg_nav.factors import guarded_factor
from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.magnetic import average_footfall_field
from fg_nav.smoother import ExtraFactors, GraphNodes, SmoothedWalk, smooth, smooth_graph
from fg_nav.smoother.constraints import FIX_SPEED_M_S, KnownTies, OwnFactors, pin_to_times, select_reached_fixes
from fg_nav.solution import Solution
from fg_nav.truth import Fix, check_fixes
from tests.smoother.walks import DEFAULT, Walk, demo, part, smoothed


def inertial() -> Solution:
    return smoothed()


def truth_from_start(walk: Walk) -> Floats:
    """True path (N, 3) m in the walk's own frame: from the start, which has heading zero."""
    sample = inertial().stances.sample[0]
    truth = walk.recording.truth
    x_axis = truth.nav_R_body[sample][:, 0]
    north = yaw_rotation(np.pi / 2 - np.arctan2(x_axis[1], x_axis[0]))
    return (truth.position - truth.position[sample]) @ north.T


def fixes_at(
    footfalls: Sequence[int], turn_deg: float = 0.0, sigma: float = 0.02, vertical: float = np.inf
) -> list[Fix]:
    """Fixes of the true path, turned as a whole."""
    place = truth_from_start(demo()) @ yaw_rotation(np.radians(turn_deg)).T
    table = inertial().stances
    return [Fix(float(table.t[k]), place[table.sample[k]], sigma, vertical) for k in footfalls]


def with_fixes(fixes: Sequence[Fix], heading: float | None = None) -> Solution:
    return smooth(demo().recording, demo().stances, DEFAULT, heading, fixes=fixes)


def errors(found: Solution, turn_deg: float = 0.0) -> Floats:
    """(F,) m over ground, of footfalls against the turned truth."""
    expected = truth_from_start(demo())[found.stances.sample] @ yaw_rotation(np.radians(turn_deg)).T
    return np.linalg.norm((found.stances.position - expected)[:, :2], axis=1)


def last() -> int:
    return len(inertial().stances.t) - 1


def test_the_walk_goes_through_its_fixes_and_is_nearer_to_the_truth_between_them() -> None:
    where = [last() // 3, 2 * last() // 3, last()]
    found = with_fixes(fixes_at(where), heading=0.0)
    assert errors(found)[where].max() < 0.04
    assert np.sqrt(np.mean(errors(found) ** 2)) < 0.7 * np.sqrt(np.mean(errors(inertial()) ** 2))
    assert np.linalg.norm(found.stances.position[0]) < 1e-3


@pytest.mark.parametrize(("turn_deg", "heading"), [(130.0, None), (180.0, None), (4.0, 0.0)])
def test_a_heading_that_is_not_given_comes_from_the_fixes_and_one_given_wrongly_gives_way(turn_deg, heading) -> None:
    found = with_fixes(fixes_at([20, 30], turn_deg, sigma=0.02), heading)
    assert errors(found, turn_deg).max() < 0.25
    assert np.degrees(found.stances.heading_sigma[0]) < 1.2


def test_a_fix_at_the_start_leaves_the_heading_as_it_is_by_definition() -> None:
    back = Fix(float(inertial().stances.t[-1]), np.zeros(3), 0.05)
    for heading in (None, 0.0):
        found = with_fixes([back], heading=heading)
        assert found.stances.heading_sigma[0] == pytest.approx(inertial().stances.heading_sigma[0], rel=0.05)
        assert np.linalg.norm(found.stances.position[-1, :2]) < 0.1


def test_fixes_about_another_place_show_where_the_walk_starts() -> None:
    """The same walk, turned and moved, whose sigma at the start is that of the fixes and of the walk between them."""
    turn, move, origin = 40.0, np.array([70.0, -30.0, 5.0]), (48.1, 11.6, 500.0)
    for vertical in (np.inf, 0.05):
        fixes = fixes_at([10, 20, 30], turn, sigma=0.05, vertical=vertical)
        moved = [replace(fix, position=fix.position + move, origin=origin) for fix in fixes]
        shift = with_fixes(moved).stances.position - with_fixes(fixes).stances.position
        expected = move if np.isfinite(vertical) else [*move[:2], 0.0]
        assert np.abs(shift - expected).max() < 0.15
        sigma = with_fixes(moved).stances.position_sigma[0]
        assert 0.05 / 3**0.5 < sigma[0] < 1.0
        assert (sigma[2] < 0.01) == np.isinf(vertical)
    (one,) = with_fixes([replace(fixes[1], position=move, origin=origin)], heading=0.0).stances.position[[20]]
    np.testing.assert_allclose(one, move, atol=0.02)  # a single one moves the walk
    with pytest.raises(EstimationError, match="different origins"):
        check_fixes([*moved, *fixes])


def test_a_planar_fix_says_nothing_of_the_height() -> None:
    wrong = [replace(fix, position=fix.position + np.array([0.0, 0.0, 50.0])) for fix in fixes_at([20])]
    planar, spatial = (with_fixes(fixes, 0.0) for fixes in (wrong, fixes_at([20], vertical=0.01)))
    free = inertial().stances.position_cov[20, 2, 2]
    assert np.abs((planar.position - inertial().position)[:, 2]).max() < 0.05
    assert planar.stances.position_cov[20, 2, 2] > 0.9 * free
    assert spatial.stances.position_cov[20, 2, 2] < 1.01e-4


def test_where_fixes_show_north_the_direction_of_the_field_is_found() -> None:
    """The field points 1.5 deg to the west of the fixes' north, and the heading is not given: most of it is found.

    Not all: before the walk compass and fixes have the same north to within 2 deg.
    """
    west_deg = 1.5
    mag = demo().recording.truth.nav_R_body.transpose(0, 2, 1) @ np.array([0.0, 20.0, -43.0])
    mag += np.random.default_rng(0).normal(0, 0.3, mag.shape)
    walk = replace(demo().recording, mag=mag)
    field = average_footfall_field(walk, demo().stances)
    table, turn = inertial().stances, yaw_rotation(np.radians(west_deg))
    place = (walk.truth.position - walk.truth.position[table.sample[0]])[table.sample] @ turn.T
    fixes = [Fix(float(table.t[k]), place[k], 0.02) for k in (20, 30)]
    found = smooth(walk, demo().stances, DEFAULT, None, field=field, fixes=fixes)
    assert np.linalg.norm((found.stances.position - place)[:, :2], axis=1).max() < 0.2
    note = next(note for note in found.notes if "from north" in note)
    assert float(note.split(",")[1].split()[0]) == pytest.approx(-west_deg, abs=0.6)


def test_fixes_and_own_factors_join_the_nearest_node_within_reach_and_their_sigma_grows_by_walking_pace() -> None:
    t_node, apart = np.array([0.0, 1.0, 4.5, 5.0]), np.array([0.0, 0.05, -0.2, 1.49])
    fixes = [Fix(float(t), np.ones(3), 0.1, 0.3) for t in np.array([1.0, 1.0, 5.0, 1.0]) + apart]
    pinned = pin_to_times(fixes, t_node)
    assert list(pinned.node) == [1, 1, 3, 1]
    np.testing.assert_allclose(pinned.horizontal, np.hypot(0.1, FIX_SPEED_M_S * apart))
    np.testing.assert_allclose(pinned.vertical, 0.3)
    late = replace(fixes[0], time_s=2.52)
    with pytest.raises(EstimationError, match="farther than a stride"):
        pin_to_times([late], t_node)
    assert select_reached_fixes([*fixes, late], t_node) == tuple(fixes)
    assert select_reached_fixes(fixes, t_node[:2]) == (fixes[0],)  # the others are later than the walk
    assert select_reached_fixes(fixes, t_node, after_s=1.0) == tuple(fixes[1:])
    nodes = smooth_graph(part(demo(), 4).recording, part(demo(), 4).stances).nodes
    assert [nodes.at(float(t)) for t in (nodes.t[3], nodes.t[3] + 1e-3, nodes.t[-1] + 1.49)] == [3, 3, len(nodes.t) - 1]
    with pytest.raises(EstimationError, match=r"no node within 1\.5 s"):
        nodes.at(float(nodes.t[-1]) + 1.51)


# --- places known from an earlier walk


SHIFT, TURN = np.array([1.0, -0.7, 0.3]), np.deg2rad(12.0)
TIE_SIGMA_M = 0.2


def tie(every: int, arm: np.ndarray = np.zeros(3)) -> KnownTies:
    """Tie every so many-th footfall, by a point next to it, to its place on a path that is moved and turned."""
    table = inertial().stances
    rows = np.arange(0, len(table), every)
    point = table.position[rows] + np.einsum("kij,j->ki", table.nav_R_body[rows], arm)
    place = SHIFT + point @ yaw_rotation(TURN).T
    count = len(rows)
    return KnownTies(table.t[rows], np.tile(arm, (count, 1)), place, np.tile(TIE_SIGMA_M**2 * np.eye(3), (count, 1, 1)))


def with_ties(ties: KnownTies) -> Solution:
    return smooth(demo().recording, demo().stances, heading=0.0, known=ties)


def test_start_and_heading_follow_the_known_places_and_their_sigma() -> None:
    free = inertial()
    for arm in (np.zeros(3), np.array([0.4, -0.8, 0.1])):  # at the footfalls, and next to them
        tied = with_ties(tie(5, arm))
        assert tied.stances.position == pytest.approx(SHIFT + free.stances.position @ yaw_rotation(TURN).T, abs=0.05)
        turned = compute_heading(free.stances.nav_R_body) - compute_heading(tied.stances.nav_R_body)
        assert np.angle(np.exp(1j * (turned - TURN))) == pytest.approx(0.0, abs=np.deg2rad(0.5))
        assert tied.graph["known_place"] == len(tie(5).t)
    few, many = (with_ties(tie(every)).stances for every in (20, 2))
    assert (many.position_sigma[0] < few.position_sigma[0]).all()
    assert (few.position_sigma[0, :2] < 1.5 * TIE_SIGMA_M).all()
    assert many.position_sigma[0, 0] > TIE_SIGMA_M / np.sqrt(len(many) / 2)
    assert free.stances.position_sigma[0].max() < 0.01
    assert few.heading_sigma[0] > free.stances.heading_sigma[0]


# --- factors of the caller's own


SIGMA_M = 0.05
FOOTFALLS = 16


def join(extra: ExtraFactors | None = None, heading: float | None = 0.0, fixes: Sequence[Fix] = ()) -> SmoothedWalk:
    walk = part(demo(), FOOTFALLS)
    return smooth_graph(walk.recording, walk.stances, DEFAULT, heading, fixes=fixes, extra=extra)


@cache
def free() -> Solution:
    return join().solution


@cache
def fixed(heading: float | None) -> Solution:
    fix = Fix(float(free().stances.t[-1]), place(), SIGMA_M, SIGMA_M)
    return join(heading=heading, fixes=[fix]).solution


def place() -> Floats:
    """Of the last footfall, to pin it to: a step to the side of where it is without."""
    return free().stances.position[-1] + np.array([0.3, -0.2, 0.1])


def joined(*factors: gtsam.NonlinearFactor) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.push_back(factor)
    return graph


def test_own_factors_leave_the_heading_open_by_their_sigma_over_their_distance() -> None:
    values = gtsam.Values()
    values.insert(X(4), gtsam.Pose3(gtsam.Rot3.Ypr(2.0, 0.4, -0.3), [6.0, 8.0, 1.0]))
    noise = gtsam.noiseModel.Diagonal.Sigmas([0.1, 0.2, 0.3])
    found = OwnFactors(joined(gtsam.GPSFactor(X(4), np.array([6.0, 8.0, 1.0]), noise)), values)
    assert found.heading_sigma == pytest.approx(np.hypot(8.0 / 0.1, 6.0 / 0.2) ** -1)


def last_of(nodes: GraphNodes) -> int:
    return nodes.pose[nodes.stillest[-1]]


def at_place(nodes: GraphNodes) -> gtsam.NonlinearFactorGraph:
    return joined(gtsam.GPSFactor(last_of(nodes), place(), gtsam.noiseModel.Isotropic.Sigma(3, SIGMA_M)))


def at_place_in_python(nodes: GraphNodes) -> gtsam.NonlinearFactorGraph:
    key = last_of(nodes)

    def evaluate(values: gtsam.Values, _: bool) -> tuple[Floats, list[Floats]]:
        pose = values.atPose3(key)
        return pose.translation() - place(), [np.hstack([np.zeros((3, 3)), pose.rotation().matrix()])]

    noise = gtsam.noiseModel.Isotropic.Sigma(3, SIGMA_M)
    return joined(guarded_factor("a place", [key], [6], noise, evaluate))


@pytest.mark.parametrize("heading", [0.0, None], ids=["heading given", "heading not given"])
@pytest.mark.parametrize("extra", [at_place, at_place_in_python])
def test_a_position_is_worth_what_a_fix_there_is(extra: ExtraFactors, heading: float | None) -> None:
    own, table = join(extra, heading).solution, fixed(heading).stances
    np.testing.assert_allclose(own.stances.position, table.position, atol=1e-3)
    np.testing.assert_allclose(own.stances.position_cov, table.position_cov, rtol=2e-2, atol=1e-7)
    np.testing.assert_allclose(own.stances.heading_sigma, table.heading_sigma, rtol=2e-2)
    assert own.graph["own"] == 1
    assert np.abs(own.stances.position[-1] - place()).max() < 2 * SIGMA_M


def test_a_start_that_is_known_elsewhere_turns_the_walk() -> None:
    """A walk without a heading is turned to its factors, however far."""
    table = free().stances
    turned = table.position[[8, -1]] @ np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])

    def along(nodes: GraphNodes) -> gtsam.NonlinearFactorGraph:
        noise = gtsam.noiseModel.Isotropic.Sigma(3, SIGMA_M)
        keys = [nodes.pose[nodes.at(float(t))] for t in table.t[[8, -1]]]
        return joined(*(gtsam.GPSFactor(key, at, noise) for key, at in zip(keys, turned, strict=True)))

    found = join(along, heading=None).solution
    np.testing.assert_allclose(found.stances.position[[8, -1]], turned, atol=2 * SIGMA_M)


def test_the_graph_at_hand_is_the_one_that_was_solved() -> None:
    walk = join(at_place)
    gradient = walk.graph.linearize(walk.values).gradientAtZero()
    curvature = walk.find_covariance(last_of(walk.nodes))
    step = np.sqrt(np.diag(curvature)) * np.abs(gradient.at(last_of(walk.nodes)))
    assert step.max() < 0.05  # sigmas from the minimum
    nav_R_body = walk.solution.stances.nav_R_body[-1]
    np.testing.assert_allclose(
        nav_R_body @ curvature[3:, 3:] @ nav_R_body.T, walk.solution.stances.position_cov[-1], rtol=1e-9
    )
    with pytest.raises(EstimationError, match="no variable l3"):
        walk.find_covariance(L(3))


UNIT, NOWHERE = gtsam.noiseModel.Unit.Create(3), np.full(3, np.nan)


REFUSED: dict[str, Callable[[GraphNodes], object]] = {
    "returned a list: return a gtsam.NonlinearFactorGraph": lambda nodes: [at_place(nodes).at(0)],
    "joins l7, which is no variable of this walk": lambda _: joined(gtsam.GPSFactor(L(7), np.zeros(3), UNIT)),
    "cannot be linearized": lambda nodes: joined(gtsam.GPSFactor(nodes.velocity[0], np.zeros(3), UNIT)),
    "error of extra factor 0 is nan": lambda nodes: joined(gtsam.GPSFactor(nodes.pose[0], NOWHERE, UNIT)),
    "extra factor 0 joins no variable": lambda _: joined(gtsam.CustomFactor(UNIT, [], lambda *_: np.zeros(3))),
}


def test_what_cannot_join_is_refused_in_a_sentence() -> None:
    fix, walk = Fix(5.0, np.zeros(3), 1.0), part(demo(), FOOTFALLS)
    outside = [replace(fix, time_s=t) for t in (-100.0, 1000.0, np.nan)]
    odd = [replace(fix, position=NOWHERE), replace(fix, horizontal_sigma_m=0.0), replace(fix, vertical_sigma_m=-1.0)]
    field = average_footfall_field(replace(walk.recording, mag=walk.recording.acc), walk.stances)
    for words, given in (
        *((words, {"extra": extra}) for words, extra in REFUSED.items()),
        *(("outside the walk", {"fixes": [one]}) for one in outside),
        *(("finite position and sigmas above zero", {"fixes": [one]}) for one in odd),
        ("no magnetometer", {"field": field}),
    ):
        with pytest.raises(EstimationError, match=words) as caught:
            smooth_graph(walk.recording, walk.stances, DEFAULT, 0.0, **given)
        assert ". " not in str(caught.value)
        assert ".)" not in str(caught.value)
