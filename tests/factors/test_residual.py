"""One residual, two ways: linearized together in numpy and one by one by gtsam it is the same, sign for sign."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import A, B, L, M, P, S, V, X, Z
from scipy.spatial.transform import Rotation

from fg_nav.factors import (
    BarometerDrift,
    BarometricHeight,
    BuildingDirection,
    FieldPotential,
    FieldPrior,
    FieldTransition,
    FloorHeight,
    Heading,
    MagneticHeading,
    ResidualBlock,
    StanceVelocity,
    factor_of,
    guarded_factor,
    linear_factor_of,
    residual,
)
from fg_nav.factors.differential_field import DifferentialField
from fg_nav.factors.magnetic_field import E_H, SIZE
from fg_nav.factors.residual import one_of
from fg_nav.factors.same_place import BesideEachOther, SamePlace, WithinReach
from fg_nav.factors.walk_constraints import UnseenWalk
from fg_nav.factors.zero_velocity import ZeroRate
from fg_nav.frames import yaw_rotation
from tests.factors.variables import assert_jacobians_are_derivatives, jacobians, moved, values_of
from tests.linear import linear_factors

COUNT = 5
FIELD = np.array([0.0, 0, 0, 0, 3.0, 20.0, 0, 0, 0])
ROBUST = ("magnetic heading", "building direction", "barometric height", "barometer drift", "zero rate")
"""Their Jacobians hold the weight: those of the loss are right, not those of the rows."""


def random_blocks(seed):
    """Blocks of all residuals, with anything measured, and values of all their variables."""
    rng, values = np.random.default_rng(seed), gtsam.Values()
    for k in range(COUNT + 2):
        R = gtsam.Rot3(Rotation.random(rng=rng).as_matrix())
        values.insert(X(k), gtsam.Pose3(R, np.array([1.5 * k, 0.0, 0.0]) + 0.3 * rng.standard_normal(3)))
        values.insert(V(k), rng.standard_normal(3))
        values.insert(S(k), 0.01 * rng.standard_normal(1))
        values.insert(Z(k), rng.standard_normal(1))
        values.insert(A(k), 0.1 * rng.standard_normal(1))
        values.insert(P(k), rng.standard_normal(2))
        values.insert(M(k), FIELD + rng.standard_normal(SIZE))
        values.insert(B(k), gtsam.imuBias.ConstantBias(rng.standard_normal(3), rng.standard_normal(3)))
    three, sigma = (lambda: rng.standard_normal((COUNT, 3))), rng.uniform(0.5, 2.0, (COUNT, SIZE))
    level, tilted = (Rotation.random(COUNT, rng=rng).as_matrix() for _ in range(2))
    residuals = [
        ("xvs", StanceVelocity(three(), three(), sigma[:, :3], sigma[:, 3])),
        ("xm", MagneticHeading(20.0 * three(), level, tilted, sigma[:, 0])),
        ("xmm", FieldPotential(sigma[:, 1], three(), three(), three(), tilted, sigma[:, 0])),
        ("mm", FieldTransition(np.exp(-sigma), sigma)),
        ("xz", FloorHeight(0.02)),
        ("x", Heading(3.0 * sigma[:, 0], sigma[:, 1], three())),
        ("xp", BarometricHeight(three()[:, :1], sigma[:, :1])),
        ("pp", BarometerDrift(sigma[:, :1], sigma[:, :2])),
        ("xxa", BuildingDirection(0.5, 0.05, sigma[:, 0])),
        ("xx", SamePlace(three(), three(), rng.standard_normal((COUNT, 3, 3)))),
        ("xxs", BesideEachOther(three(), three(), three(), rng.standard_normal((COUNT, 3, 3)))),
        ("xx", WithinReach(np.full(COUNT, 1.5), sigma[:, 0])),
        ("xx", UnseenWalk(sigma[:, :3], 0.5 * sigma[:, 0], sigma[:, 4], sigma[:, 5])),
        ("b", ZeroRate(three(), rng.standard_normal((COUNT, 3, 3)))),
        ("b", DifferentialField(rng.standard_normal((COUNT, 3, 3)), three())),
    ]
    letter = {"a": A, "b": B, "x": X, "v": V, "s": S, "m": M, "p": P, "z": Z}
    blocks = {}
    for names, one in residuals:
        shift = [names[:i].count(name) for i, name in enumerate(names)]
        keys = [[letter[name](k + by) for name, by in zip(names, shift, strict=True)] for k in range(COUNT)]
        blocks[one.name] = ResidualBlock(one, keys)
    return blocks, values


NAMES = list(random_blocks(0)[0])


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", NAMES)
def test_a_block_has_the_linearization_of_its_factors(name, seed):
    blocks, values = random_blocks(seed)
    block = blocks[name]
    factors = list(block.factors())
    assert len(factors) == len(block) == COUNT
    for together, factor in zip(linear_factors(block, values), factors, strict=True):
        alone = factor.linearize(values)
        assert list(together.keys()) == list(alone.keys()) == list(factor.keys())
        for a, b in zip(together.jacobian(), alone.jacobian(), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
    assert block.error(values) == pytest.approx(sum(factor.error(values) for factor in factors), rel=1e-12)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", [name for name in NAMES if name not in ROBUST])
def test_jacobians_are_the_derivatives_with_their_sign(name, seed):
    blocks, values = random_blocks(seed)
    for factor in blocks[name].factors():
        assert_jacobians_are_derivatives(factor, values, atol=1e-6)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", ROBUST)
def test_a_robust_loss_has_the_slope_that_its_rows_say(name, seed):
    blocks, values = random_blocks(seed)
    for factor in blocks[name].factors():
        e = factor.unwhitenedError(values)
        for key, by_key in jacobians(factor, values).items():
            for i, direction in enumerate(np.eye(by_key.shape[1])):
                ahead, behind = (factor.error(moved(values, key, sign * 1e-5 * direction)) for sign in (1.0, -1.0))
                assert (ahead - behind) / 2e-5 == pytest.approx(by_key[:, i] @ e, abs=1e-5, rel=1e-5)


def test_at_the_tilt_that_levels_the_compass_knows_a_turn_about_up_alone():
    """Whatever the heading has become since: the Jacobian by the pose has nothing of tilt and place."""
    blocks, values = random_blocks(4)
    block = blocks["magnetic heading"]
    for k, factor in enumerate(block.factors()):
        key, turned = factor.keys()[0], gtsam.Rot3.Rz(0.7 * k).matrix() @ block.residuals.nav_R_level[k]
        values.update(key, gtsam.Pose3(gtsam.Rot3(turned), values.atPose3(key).translation()))
        by_pose, up = jacobians(factor, values)[key][0], np.concatenate([turned[2], np.zeros(3)])
        assert abs(by_pose @ up) > 1e-3
        np.testing.assert_allclose(by_pose, (by_pose @ up) * up, atol=1e-12 * abs(by_pose @ up))


def test_the_prior_of_the_field_is_of_its_direction_and_its_strength_and_has_its_derivatives():
    """Else a field of none would have no direction to be wrong by."""
    rng = np.random.default_rng(5)
    prior, values, other = FieldPrior(FIELD, rng.uniform(0.5, 2.0, SIZE)), gtsam.Values(), FIELD.copy()
    strength, other[E_H] = np.linalg.norm(FIELD[E_H]), 1.1 * yaw_rotation(-0.5)[:2, :2] @ FIELD[E_H]
    off = np.zeros(SIZE)
    off[E_H] = 0.5 * strength, 0.1 * strength
    np.testing.assert_allclose(prior.evaluate([other], False)[0], off / prior.sigma, atol=1e-12)
    values.insert(M(0), prior.mean + rng.standard_normal(SIZE))
    assert_jacobians_are_derivatives(factor_of(prior, [M(0)]), values, atol=1e-6)


@pytest.mark.parametrize("name", ["field transition", "differential field"])
def test_a_linear_factor_is_the_residual_wherever_it_is(name):
    blocks, values = random_blocks(6)
    block = blocks[name]
    for k, keys in enumerate(block.keys):
        one = one_of(block.residuals, k)
        linear, factor = linear_factor_of(one, keys), factor_of(one, keys)
        assert linear.error(values) == pytest.approx(factor.error(values), rel=1e-9)
        for a, b in zip(linear.linearize(values).jacobian(), factor.linearize(values).jacobian(), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-9)


@pytest.mark.parametrize("own", [False, True], ids=["walk", "poses of another letter"])
def test_many_variables_are_read_as_one_by_one(own: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where numbers are left out, and those wanted are in another order."""
    rng, values = np.random.default_rng(0), gtsam.Values()
    numbers = [*range(3, 40, 2), 300]
    for j in numbers:
        values.insert(X(j), gtsam.Pose3.Expmap(rng.standard_normal(6)))
        values.insert(V(j), rng.standard_normal(3))
    if own:
        values.insert(L(0), gtsam.Pose3())
    wanted = rng.permutation(numbers)
    poses = [X(int(j)) for j in wanted]
    velocities = [V(int(j)) for j in wanted]
    one_by_one = [values.atPose3(key).matrix() for key in poses], [values.atVector(key) for key in velocities]
    read_one = residual._read
    monkeypatch.setattr(residual, "_read", lambda *args: pytest.fail("one by one") if not own else read_one(*args))
    np.testing.assert_array_equal(residual.read_variables(values, poses, residual.POSE), one_by_one[0])
    np.testing.assert_array_equal(residual.read_variables(values, velocities, 3), one_by_one[1])


def test_a_variable_that_is_not_there_is_not_read_as_another() -> None:
    values = gtsam.Values()
    for j in range(residual.FEW):
        values.insert(V(j), np.zeros(3))
    with pytest.raises(RuntimeError):
        residual.read_variables(values, [V(j + 1) for j in range(residual.FEW)], 3)


# --- a residual function that returns nonsense is named in a ValueError, and the interpreter lives on


EYE = np.eye(3)
NOISE = gtsam.noiseModel.Isotropic.Sigma(3, 0.5)
VALUES = values_of({V(0): np.array([1.0, 2.0, 3.0]), V(1): np.array([0.0, 1.0, 5.0])})


def graph_of(residual, dims=(3, 3)):
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(guarded_factor("wobble", [V(0), V(1)], dims, NOISE, residual))
    return graph


BAD_RESIDUALS = {
    "too short": np.zeros(2),
    "column": np.zeros((3, 1)),
    "float32": np.zeros(3, dtype=np.float32),
    "NaN": np.array([0.0, np.nan, 0.0]),
    "infinite": np.array([np.inf, -np.inf, 0.0]),
    "nothing": None,
}
BAD_JACOBIANS = {
    "none": [],
    "one of two": [EYE],
    "a column short": [EYE, np.zeros((3, 2))],
    "float32": [EYE, EYE.astype(np.float32)],
    "NaN": [EYE, np.full((3, 3), np.nan)],
    "infinite": [np.diag([np.inf, -np.inf, 0.0]), EYE],
    "a gap": [None, EYE],
}


@pytest.mark.parametrize("returned", BAD_RESIDUALS.values(), ids=BAD_RESIDUALS)
def test_a_bad_residual(returned):
    graph = graph_of(lambda values, with_jacobians: (returned, [EYE, EYE]))
    for call in (graph.error, graph.linearize):
        with pytest.raises(ValueError, match=r"^wobble: the residual is"):
            call(VALUES)


@pytest.mark.parametrize("returned", BAD_JACOBIANS.values(), ids=BAD_JACOBIANS)
def test_a_bad_jacobian(returned):
    graph = graph_of(lambda values, with_jacobians: (np.ones(3), returned))
    assert graph.error(VALUES) == pytest.approx(6.0)  # nobody asked for them yet
    with pytest.raises(ValueError, match=r"^wobble: (the Jacobian [01] is|there must be a Jacobian for each of the 2)"):
        graph.linearize(VALUES)


def test_an_exception_of_the_residual_itself_comes_through_and_every_key_needs_its_dimension():
    """Else a Jacobian would stay unassigned, which gtsam does not survive."""
    graph = graph_of(lambda values, with_jacobians: (values.atVector(X(7)), [EYE, EYE]))
    with pytest.raises(RuntimeError, match="x7"):
        graph.error(VALUES)
    for dims in ((3,), (3, 3, 3), ()):
        with pytest.raises(ValueError, match="wobble: there are 2 keys and"):
            graph_of(lambda values, with_jacobians: (np.ones(3), [EYE, EYE]), dims)
