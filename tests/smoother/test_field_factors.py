"""The factors of the field: their sigmas, the processes of their states, and the compass that is their limit."""

from dataclasses import replace
from itertools import chain

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import M, X
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.factors.magnetic_field import DELTA, IRON, PHI, REGION, SIZE, TAIL_SIGMAS, FieldPrior
from fg_nav.frames import yaw_rotation
from fg_nav.smoother import field_factors
from fg_nav.smoother.parameters import FieldParameters
from tests.factors.variables import pose, values_of
from tests.linear import linear_factors
from tests.smoother.walks import ordering_of

P = FieldParameters()
COMPASS = replace(P, potential=False)
EARTH = np.array([3.0, 20.0, -43.0])
STRENGTH = float(np.hypot(3.0, 20.0))
RIGHT = np.array([EARTH[1], -EARTH[0]]) / STRENGTH  # Of the field, over ground.
ROUGH = field_factors.FieldRoughness(
    field_factors.Roughness(4.0, 2.0), field_factors.Roughness(5.0, 1.5), field_factors.Roughness(2.0, 60.0), 3.0
)
FIRST = FieldPrior(
    np.array([0.0, 0.0, 0.0, 0.0, *EARTH[:2], 0.0, 0.0, 0.0]), np.array([4.0, 5.0, 2.0, 2.0, 1.0, 5.0, 0.3, 0.3, 15.0])
)
NEVER = 1e-4  # Sigma of what is as good as known.
UNIT = gtsam.noiseModel.Unit.Create(1)


def error_of(factors: field_factors.FieldFactors, values: gtsam.Values) -> float:
    return sum(block.error(values) for block in factors.blocks)


class Walked:
    """Footfalls in the Earth's field, their factors, and the truth to linearize them at."""

    def __init__(
        self,
        count: int = 4,
        tilt: float = 0.3,
        rough: field_factors.FieldRoughness = ROUGH,
        first: FieldPrior = FIRST,
        p: FieldParameters = P,
        used: Floats | bool = True,
    ) -> None:
        rng, self.count = np.random.default_rng(0), count
        yaw, heading = rng.uniform(-np.pi, np.pi, (2, count))
        tilted = Rotation.from_rotvec(tilt * rng.standard_normal((count, 3)) * [1.0, 1.0, 0.0]).as_matrix()
        R = self.nav_R_body = yaw_rotation(yaw) @ tilted
        steps = 1.3 * np.stack([np.sin(heading), np.cos(heading), 0.05 * rng.standard_normal(count)], axis=1)
        self.position, move = np.cumsum(steps, axis=0), steps[1:]
        self.path = field_factors.FieldPath(
            u=move[:, :2] @ EARTH[:2],
            level_path=rng.standard_normal((count - 1, 3)),
            by_up=np.zeros((count - 1, 3)),
            body_move=np.einsum("nji,nj->ni", R[:-1], move),
            nav_R_level=R[:-1],
            sigma_uT_m=np.full(count - 1, field_factors.PATH_SIGMA_UT_M),
            distance_m=np.linalg.norm(move, axis=1),
            level_R_body=Rotation.random(rng=rng).as_matrix(),
            jumps=np.zeros(count - 1, dtype=np.bool_),
        )
        sigma = np.where(np.broadcast_to(used, count), field_factors.COMPASS_SIGMA_UT, np.inf)
        self.readings = field_factors.CompassReadings(2 * np.arange(count), np.swapaxes(R, 1, 2) @ EARTH, R, sigma)
        self.factors = field_factors.FieldFactors(self.readings, self.path, first, rough, p)

    def values(self) -> gtsam.Values:
        states = zip(self.nav_R_body, self.position, strict=True)
        values = values_of({X(2 * k): pose(R, at) for k, (R, at) in enumerate(states)})
        self.factors.insert(values)
        return values

    def information(self) -> Floats:
        """Of all poses and then of all states, at the truth."""
        graph = gtsam.GaussianFactorGraph()
        for factor in chain.from_iterable(linear_factors(block, self.values()) for block in self.factors.blocks):
            graph.push_back(factor)
        poses, states = [X(2 * k) for k in range(self.count)], [M(k) for k in range(self.count)]
        for key in poses:  # a pose that no factor knows is there all the same
            graph.push_back(gtsam.JacobianFactor(key, np.zeros((1, 6)), np.zeros(1), UNIT))
        return graph.hessian(ordering_of([*poses, *states]))[0]

    def covariance_of_yaws(self) -> Floats:
        """(F, F) of the headings, once the states of the field are eliminated."""
        information, n = self.information(), 6 * self.count
        to_states, of_states = information[:n, n:], information[n:, n:]
        of_poses = information[:n, :n] - to_states @ np.linalg.solve(of_states, to_states.T)
        turn = block_diag(*(np.append(R[2], np.zeros(3))[:, None] for R in self.nav_R_body))  # about up, of each pose
        return np.linalg.inv(turn.T @ of_poses @ turn)


def tail(x: float) -> float:
    return 0.5 * TAIL_SIGMAS**2 * float(np.log1p((x / TAIL_SIGMAS) ** 2))


@pytest.mark.parametrize("sigmas", [1e-2, 1.0, 9.0])
def test_residuals_are_in_units_of_their_sigmas_and_those_of_the_compass_have_a_tail(sigmas: float) -> None:
    """Each alone: potential, deviation across the field, and that of the region, which no stride begins in."""
    walked = Walked(count=2)
    true, d = walked.values(), walked.path.distance_m
    right = np.zeros(SIZE)
    right[REGION] = RIGHT
    parts = (
        (np.eye(SIZE)[PHI], field_factors.PATH_SIGMA_UT_M, ROUGH.potential, 0.5 * sigmas**2),
        (np.eye(SIZE)[DELTA], field_factors.COMPASS_SIGMA_UT, ROUGH.across, tail(sigmas)),
        (right, field_factors.COMPASS_SIGMA_UT, ROUGH.regional, tail(sigmas)),
    )
    for one, sigma, rough, loss in parts:
        off, changed = sigmas * sigma, gtsam.Values(true)
        changed.update(M(1), true.atVector(M(1)) + off * one)
        new = rough.sigma * np.sqrt(1 - np.exp(-2 * d[0] / rough.length_m))
        assert error_of(walked.factors, changed) == pytest.approx(loss + 0.5 * (off / new) ** 2, rel=1e-2)


def test_states_are_processes_of_their_roughness() -> None:
    """Without a reading their covariance is that of stationary processes along the path; region: each axis its own."""
    walked = Walked(count=6, p=COMPASS, used=np.zeros(6, dtype=bool))
    states = np.linalg.inv(walked.information()[36:, 36:]).reshape(6, SIZE, 6, SIZE)
    way = np.append(0.0, np.cumsum(walked.path.distance_m))
    apart = np.abs(way[:, None] - way)
    of = {PHI: ROUGH.potential, DELTA: ROUGH.across, 2: ROUGH.regional, 3: ROUGH.regional}
    for part, rough in of.items():
        expected = rough.sigma**2 * np.exp(-apart / rough.length_m)
        np.testing.assert_allclose(states[:, part, :, part], expected, rtol=1e-6)
    np.testing.assert_allclose(states[:, 2, :, 3], 0.0, atol=1e-9)


def test_hard_iron_is_that_of_the_stance_s_axes() -> None:
    walked, iron = Walked(count=3), np.array([0.2, -0.1, 5.0])
    body_iron = walked.path.level_R_body.T @ iron
    seen = replace(walked.readings, body_field=walked.readings.body_field + body_iron)
    path = replace(walked.path, u=walked.path.u + walked.path.level_path @ iron)
    factors = field_factors.FieldFactors(seen, path, FIRST, ROUGH, P)
    values = walked.values()
    assert error_of(factors, values) > 1.0
    for k in range(3):
        m = values.atVector(M(k)).copy()
        m[IRON] = iron
        values.update(M(k), m)
    of_prior = 0.5 * float(((iron / FIRST.sigma[IRON]) ** 2).sum())
    assert error_of(factors, values) == pytest.approx(of_prior, rel=1e-9)


KNOWN = FieldPrior(FIRST.mean, np.full(SIZE, NEVER))  # The Earth's field and no iron: nothing is asked.
NONE = field_factors.Roughness(NEVER, 1.0)


@pytest.fixture
def steady(monkeypatch: pytest.MonkeyPatch) -> None:
    """Field and iron do not wander, and of an endless deviation nothing is new."""
    for name, value in (("MEAN_WALK_UT", NEVER), ("HARD_IRON_WALK_UT", NEVER), ("MIN_INNOVATION", 0.0)):
        monkeypatch.setattr(field_factors, name, value)


@pytest.mark.usefixtures("steady")
@pytest.mark.parametrize(("count", "region_uT"), [(4, NEVER), (4, 2.0), (12, 2.0)])
def test_headings_are_known_to_the_noise_of_a_compass_and_all_of_them_to_the_region(count, region_uT) -> None:
    """However many footfalls; differences as if the region were not there."""
    first = replace(KNOWN, sigma=np.where(np.isin(np.arange(SIZE), [2, 3]), region_uT, NEVER))
    rough = field_factors.FieldRoughness(NONE, NONE, field_factors.Roughness(region_uT, 1e12), 0.0)
    found = Walked(count=count, rough=rough, first=first, p=COMPASS).covariance_of_yaws()
    expected = region_uT**2 + field_factors.COMPASS_SIGMA_UT**2 * np.eye(count)
    np.testing.assert_allclose(found * STRENGTH**2, expected, rtol=1e-3, atol=1e-3 * field_factors.COMPASS_SIGMA_UT**2)


def test_a_compass_counts_by_its_variance_and_for_no_more_than_one_of_the_walk() -> None:
    sigma = field_factors.compass_sigma(np.array([0.0, 1.0, 4.0, np.inf]), ROUGH)
    np.testing.assert_allclose(
        sigma, np.hypot(field_factors.COMPASS_SIGMA_UT, ROUGH.white_uT * np.array([0.0, 1.0, 2.0, np.inf]))
    )
    np.testing.assert_allclose(field_factors.weigh_compass(sigma, ROUGH), [1.0, 1.0, (sigma[1] / sigma[2]) ** 2, 0.0])
