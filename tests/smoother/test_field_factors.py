"""The factors of the field: their derivatives, what they leave alone, and the factors that are their limits."""

from dataclasses import replace
from itertools import chain

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import M, X
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.factors.magnetic_field import (
    DELTA,
    E_H,
    IRON,
    PHI,
    REGION,
    SIZE,
    TAIL_SIGMAS,
    FieldPrior,
)
from fg_nav.factors.rotation import skew
from fg_nav.frames import yaw_rotation
from fg_nav.smoother import field_factors
from fg_nav.smoother.field_factors import (
    COMPASS_SIGMA_UT,
    PATH_SIGMA_UT_M,
    CompassReadings,
    FieldFactors,
    FieldPath,
    FieldRoughness,
    Roughness,
    compass_sigma,
    weigh_compass,
)
from fg_nav.smoother.parameters import FieldParameters
from tests.factors.attitudes import eliminated, pose, values_of
from tests.linear import linear_factors

P = FieldParameters()
COMPASS = replace(P, potential=False)
EARTH = np.array([3.0, 20.0, -43.0])
STRENGTH = float(np.hypot(3.0, 20.0))
RIGHT = np.array([EARTH[1], -EARTH[0]]) / STRENGTH  # Of the field, over ground.
ROUGH = FieldRoughness(Roughness(4.0, 2.0), Roughness(5.0, 1.5), Roughness(2.0, 60.0), 3.0)
FIRST = FieldPrior(
    np.array([0.0, 0.0, 0.0, 0.0, *EARTH[:2], 0.0, 0.0, 0.0]), np.array([4.0, 5.0, 2.0, 2.0, 1.0, 5.0, 0.3, 0.3, 15.0])
)
NEVER = 1e-4  # Sigma of what is as good as known.
STEP = 1e-5
UNIT = gtsam.noiseModel.Unit.Create(1)


def attitudes(rng: np.random.Generator, count: int, tilt: float = 0.3) -> Floats:
    yaw = rng.uniform(-np.pi, np.pi, count)
    tilted = Rotation.from_rotvec(tilt * rng.standard_normal((count, 3)) * [1.0, 1.0, 0.0]).as_matrix()
    return np.array([yaw_rotation(a) for a in yaw]) @ tilted


def path_of(
    position: Floats, nav_R_body: Floats, u: Floats, level_path: Floats, level: Floats = np.eye(3)
) -> FieldPath:
    move = np.diff(position, axis=0)
    return FieldPath(
        u=u,
        level_path=level_path,
        by_up=np.zeros((len(move), 3)),
        body_move=np.einsum("nji,nj->ni", nav_R_body[:-1], move),
        nav_R_level=nav_R_body[:-1],
        sigma_uT_m=np.full(len(move), PATH_SIGMA_UT_M),
        distance_m=np.linalg.norm(move, axis=1),
        level_R_body=level,
        jumps=np.zeros(len(move), dtype=np.bool_),
    )


def error_of(factors: FieldFactors, values: gtsam.Values) -> float:
    return sum(block.error(values) for block in factors.blocks)


class Walked:
    """Footfalls in a field, their factors, and values at which to linearize them."""

    def __init__(
        self,
        seed: int = 0,
        count: int = 4,
        tilt: float = 0.3,
        deviation: Floats | None = None,
        rough: FieldRoughness = ROUGH,
        first: FieldPrior = FIRST,
        p: FieldParameters = P,
        used: Floats | None = None,
        stride_m: float = 1.3,
    ) -> None:
        rng = np.random.default_rng(seed)
        self.nav_R_body = attitudes(rng, count, tilt)
        heading = rng.uniform(-np.pi, np.pi, count)
        steps = stride_m * np.stack([np.sin(heading), np.cos(heading), 0.05 * rng.standard_normal(count)], axis=1)
        self.position = np.cumsum(steps, axis=0)
        field = EARTH + (np.zeros((count, 3)) if deviation is None else deviation)
        level = Rotation.random(rng=rng).as_matrix()
        u = np.diff(self.position, axis=0)[:, :2] @ EARTH[:2]
        self.path = path_of(self.position, self.nav_R_body, u, rng.standard_normal((count - 1, 3)), level)
        sigma = np.where(np.ones(count, dtype=bool) if used is None else used, COMPASS_SIGMA_UT, np.inf)
        body_field = np.einsum("nji,nj->ni", self.nav_R_body, field)
        self.readings = CompassReadings(2 * np.arange(count), body_field, self.nav_R_body, sigma)
        self.factors = FieldFactors(self.readings, self.path, first, rough, p)
        self.rng, self.count = rng, count

    def values(self, off: float = 0.0) -> gtsam.Values:
        """The truth; or, with `off`, states and attitudes that differ from it at random."""
        poses = {}
        for k, (R, at) in enumerate(zip(self.nav_R_body, self.position, strict=True)):
            turn = Rotation.from_rotvec(0.1 * off * self.rng.standard_normal(3)).as_matrix()
            poses[X(2 * k)] = pose(R @ turn, at)
        values = values_of(poses)
        self.factors.insert(values)
        for k in range(self.count):
            values.update(M(k), values.atVector(M(k)) + off * self.rng.standard_normal(SIZE))
        return values

    def order(self) -> gtsam.Ordering:
        """Poses, then states."""
        ordering = gtsam.Ordering()
        for key in [*(X(2 * k) for k in range(self.count)), *(M(k) for k in range(self.count))]:
            ordering.push_back(key)
        return ordering

    def linear(self, values: gtsam.Values) -> gtsam.GaussianFactorGraph:
        graph = gtsam.GaussianFactorGraph()
        for factor in chain.from_iterable(linear_factors(block, values) for block in self.factors.blocks):
            graph.push_back(factor)
        for k in range(self.count):  # a pose that no factor knows is there all the same
            graph.push_back(gtsam.JacobianFactor(X(2 * k), np.zeros((1, 6)), np.zeros(1), UNIT))
        return graph

    def of_yaws(self, values: gtsam.Values) -> Floats:
        """(F, F) information on the headings once the states of the field are eliminated."""
        information = self.linear(values).hessian(self.order())[0]
        of_poses = eliminated(information, 6 * self.count)
        turn = np.zeros((6 * self.count, self.count))
        for k in range(self.count):
            turn[6 * k : 6 * k + 3, k] = values.atPose3(X(2 * k)).rotation().matrix()[2]
        return turn.T @ of_poses @ turn


def about_up(values: gtsam.Values, key: int, angle: float) -> gtsam.Values:
    """Values with one pose turned about up, on the spot."""
    moved = gtsam.Values(values)
    one = values.atPose3(key)
    moved.update(key, gtsam.Pose3(gtsam.Rot3(yaw_rotation(angle) @ one.rotation().matrix()), one.translation()))
    return moved


def tail(x: float) -> float:
    """Cauchy's loss of the compass at so many sigmas."""
    return 0.5 * TAIL_SIGMAS**2 * float(np.log1p((x / TAIL_SIGMAS) ** 2))


@pytest.mark.parametrize("sigmas", [1e-2, 1.0, 9.0])
def test_residuals_are_in_units_of_their_sigmas_and_those_of_the_compass_have_a_tail(sigmas: float) -> None:
    """Each alone: potential, deviation across the field, and that of the region, which no stride begins in."""
    walked = Walked(count=2)
    true, d = walked.values(), walked.path.distance_m
    right = np.zeros(SIZE)
    right[REGION] = RIGHT
    parts = (
        (np.eye(SIZE)[PHI], PATH_SIGMA_UT_M, ROUGH.potential, 0.5 * sigmas**2),
        (np.eye(SIZE)[DELTA], COMPASS_SIGMA_UT, ROUGH.across, tail(sigmas)),
        (right, COMPASS_SIGMA_UT, ROUGH.regional, tail(sigmas)),
    )
    for one, sigma, rough, loss in parts:
        off, changed = sigmas * sigma, gtsam.Values(true)
        changed.update(M(1), true.atVector(M(1)) + off * one)
        new = rough.sigma * np.sqrt(1 - np.exp(-2 * d[0] / rough.length_m))
        assert error_of(walked.factors, changed) == pytest.approx(loss + 0.5 * (off / new) ** 2, rel=1e-2)


def test_states_are_processes_of_their_roughness() -> None:
    """Without a reading their covariance is that of stationary processes along the path; region: each axis its own."""
    walked = Walked(count=6, p=COMPASS, used=np.zeros(6, dtype=bool))
    information = walked.linear(walked.values()).hessian(walked.order())[0]
    states = np.linalg.inv(information[36:, 36:]).reshape(6, SIZE, 6, SIZE)
    way = np.append(0.0, np.cumsum(walked.path.distance_m))
    apart = np.abs(way[:, None] - way)
    of = {PHI: ROUGH.potential, DELTA: ROUGH.across, 2: ROUGH.regional, 3: ROUGH.regional}
    for part, rough in of.items():
        expected = rough.sigma**2 * np.exp(-apart / rough.length_m)
        np.testing.assert_allclose(states[:, part, :, part], expected, rtol=1e-6)
    np.testing.assert_allclose(states[:, 2, :, 3], 0.0, atol=1e-9)


def test_a_heading_wrong_by_an_angle_is_seen_across_and_along_the_path() -> None:
    walked = Walked(count=2, seed=3)
    angle = 1e-3
    error = error_of(walked.factors, about_up(walked.values(), X(0), angle))
    east, north = np.diff(walked.position, axis=0)[0, :2]
    along = (EARTH[1] * east - EARTH[0] * north) * angle / PATH_SIGMA_UT_M
    across = STRENGTH * angle / COMPASS_SIGMA_UT
    assert error == pytest.approx(0.5 * (across**2 + along**2), rel=2e-3)
    assert abs(along) > 1e-3


def test_hard_iron_is_that_of_the_stance_s_axes() -> None:
    walked, iron = Walked(count=3), np.array([0.2, -0.1, 5.0])
    body_iron = walked.path.level_R_body.T @ iron
    seen = replace(walked.readings, body_field=walked.readings.body_field + body_iron)
    path = replace(walked.path, u=walked.path.u + walked.path.level_path @ iron)
    factors = FieldFactors(seen, path, FIRST, ROUGH, P)
    values = walked.values()
    assert error_of(factors, values) > 1.0
    for k in range(3):
        m = values.atVector(M(k)).copy()
        m[IRON] = iron
        values.update(M(k), m)
    of_prior = 0.5 * float(((iron / FIRST.sigma[IRON]) ** 2).sum())
    assert error_of(factors, values) == pytest.approx(of_prior, rel=1e-9)


def solved(walked: Walked, values: gtsam.Values, heading_sigma_rad: float) -> gtsam.Values:
    """Where the headings and states come to lie, with a gyroscope that holds the poses by so much."""
    for _ in range(15):
        graph = walked.linear(values)
        for k, R in enumerate(walked.nav_R_body):
            key = X(2 * k)
            off = np.concatenate(
                [
                    Rotation.from_matrix(R.T @ values.atPose3(key).rotation().matrix()).as_rotvec(),
                    values.atPose3(key).translation() - walked.position[k],
                ]
            )
            noise = gtsam.noiseModel.Isotropic.Sigma(6, heading_sigma_rad)
            graph.push_back(gtsam.JacobianFactor(key, np.eye(6), -off, noise))
        values = values.retract(graph.eliminateMultifrontal(walked.order(), gtsam.EliminateQR).optimize())
    return values


def headings_off(walked: Walked, values: gtsam.Values) -> Floats:
    turn = [values.atPose3(X(2 * k)).rotation().matrix() @ R.T for k, R in enumerate(walked.nav_R_body)]
    return np.array([Rotation.from_matrix(one).as_rotvec()[2] for one in turn])


def next_to_a_magnet(smooth: FieldRoughness, used: Floats | None = None) -> tuple[Walked, gtsam.Values]:
    """The fourth of eight footfalls stands next to a magnet."""
    deviation = np.zeros((8, 3))
    deviation[3, :2] = 60.0 * RIGHT
    walked = Walked(count=8, tilt=0.0, deviation=deviation, rough=smooth, p=COMPASS, used=used)
    return walked, solved(walked, walked.values(), np.radians(1.0))


SMOOTH = FieldRoughness(Roughness(0.5, 1.5), Roughness(0.5, 1.5), Roughness(0.2, 60.0), 0.0)


def test_a_compass_that_is_not_used_turns_nothing_and_one_in_the_tail_little() -> None:
    """60 uT at 200 sigmas: of the 70 deg by which it points away hardly anything is left."""
    unused, in_tail = (
        np.degrees(np.abs(headings_off(*next_to_a_magnet(SMOOTH, used)))).max() for used in (np.arange(8) != 3, None)
    )
    assert unused < 0.1
    assert unused < in_tail < 1.0


def test_a_field_that_is_not_where_it_was_expected_turns_and_does_not_shrink() -> None:
    """Direction and strength are priors of their own: an E of none would have no direction to be wrong by."""
    expected = FieldPrior(
        np.array([0.0, 0, 0, 0, 0, STRENGTH, 0, 0, 0]), np.array([1.0, 0.3, 0.3, 0.3, 0.7, 5.0, 0.3, 0.3, 15])
    )
    deviation = np.zeros((30, 3))
    deviation[:, :2] = STRENGTH * np.array([np.sin(0.5), np.cos(0.5)]) - EARTH[:2]
    smooth = FieldRoughness(NONE, NONE, NONE, 0.0)
    walked = Walked(count=30, tilt=0.0, deviation=deviation, rough=smooth, first=expected, p=COMPASS)
    states = walked.factors.states(solved(walked, walked.values(), NEVER))
    strength = np.linalg.norm(states[:, E_H], axis=1)
    np.testing.assert_allclose(strength, STRENGTH, atol=1.0)
    direction = np.arctan2(*states[:, E_H].T)
    assert 0.2 < direction.min() < direction.max() < 0.51


KNOWN = FieldPrior(FIRST.mean, np.full(SIZE, NEVER))  # The Earth's field and no iron: nothing is asked.
NONE = Roughness(NEVER, 1.0)


@pytest.fixture
def steady(monkeypatch: pytest.MonkeyPatch) -> None:
    """Field and iron do not wander."""
    monkeypatch.setattr(field_factors, "MEAN_WALK_UT", NEVER)
    monkeypatch.setattr(field_factors, "HARD_IRON_WALK_UT", NEVER)


@pytest.mark.usefixtures("steady")
def test_without_any_deviation_it_is_a_compass() -> None:
    """As much information on each heading as an azimuth with its honest sigma, and none that is shared."""
    walked = Walked(rough=FieldRoughness(NONE, NONE, NONE, 0.0), first=KNOWN, p=COMPASS)
    found = walked.of_yaws(walked.values())
    expected = (COMPASS_SIGMA_UT / STRENGTH) ** -2
    np.testing.assert_allclose(found, expected * np.eye(walked.count), rtol=1e-4, atol=1e-4 * expected)


@pytest.fixture
def nothing_new(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an endless deviation even the least that is new would be much."""
    monkeypatch.setattr(field_factors, "MIN_INNOVATION", 0.0)


@pytest.mark.usefixtures("nothing_new", "steady")
def test_with_endless_deviation_that_stays_it_is_the_difference_of_two_fields() -> None:
    """Nothing on the heading itself; on the difference of two, what their difference has across the field."""
    endless = Roughness(1e4, 1e14)
    first = replace(KNOWN, sigma=np.where(np.arange(SIZE) == DELTA, 1e4, NEVER))
    walked = Walked(count=2, tilt=0.0, rough=FieldRoughness(NONE, endless, NONE, 0.0), first=first, p=COMPASS)
    found = walked.of_yaws(walked.values())
    # e = R_i y_i - R_j y_j of two poses that see one field, whatever it is
    of_turn = [
        sign * R @ skew(y) / (np.sqrt(2.0) * COMPASS_SIGMA_UT)
        for sign, R, y in zip((-1, 1), walked.nav_R_body, walked.readings.body_field, strict=True)
    ]
    none = np.zeros((3, 3))
    H = np.hstack([of_turn[0], none, of_turn[1], none])
    information = H.T @ H
    turn = np.zeros((12, 2))
    turn[:3, 0], turn[6:9, 1] = walked.nav_R_body[0][2], walked.nav_R_body[1][2]
    expected = turn.T @ information @ turn
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())
    assert np.abs(found.sum(axis=1)).max() < 1e-3 * found[0, 0]


@pytest.mark.usefixtures("nothing_new", "steady")
def test_a_region_is_one_unknown_for_all_footfalls_in_it() -> None:
    """The common heading is known to its deviation, however many footfalls; differences as if it were not there."""
    first = replace(KNOWN, sigma=np.where(np.isin(np.arange(SIZE), [2, 3]), 2.0, NEVER))
    for count in (4, 12):
        region = Roughness(2.0, 1e12)
        walked = Walked(count=count, rough=FieldRoughness(NONE, NONE, region, 0.0), first=first, p=COMPASS)
        covariance = np.linalg.inv(walked.of_yaws(walked.values())) * STRENGTH**2
        expected = 2.0**2 + COMPASS_SIGMA_UT**2 * np.eye(count)
        np.testing.assert_allclose(covariance, expected, rtol=1e-3)


def test_a_footfall_without_a_field_is_passed_over() -> None:
    walked = Walked(used=np.array([True, False, True, True]), p=COMPASS)
    found = walked.of_yaws(walked.values())
    np.testing.assert_allclose(found[1], 0.0, atol=1e-6 * found[0, 0])
    assert found[0, 0] > 1.0
    anything = replace(walked.readings, body_field=walked.readings.body_field + 1e4 * (np.arange(4) == 1)[:, None])
    factors = FieldFactors(anything, walked.path, FIRST, ROUGH, COMPASS)
    assert error_of(factors, walked.values()) < 1e-18


def test_a_compass_counts_by_its_variance_and_for_no_more_than_one_of_the_walk() -> None:
    sigma = compass_sigma(np.array([0.0, 1.0, 4.0, np.inf]), ROUGH)
    np.testing.assert_allclose(sigma, np.hypot(COMPASS_SIGMA_UT, ROUGH.white_uT * np.array([0.0, 1.0, 2.0, np.inf])))
    np.testing.assert_allclose(weigh_compass(sigma, ROUGH), [1.0, 1.0, (sigma[1] / sigma[2]) ** 2, 0.0])
