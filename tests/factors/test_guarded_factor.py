"""A residual function that returns nonsense is named in a ValueError, and the interpreter lives on."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V, X

from fg_nav.factors import guarded_factor

EYE = np.eye(3)
NOISE = gtsam.noiseModel.Isotropic.Sigma(3, 0.5)


def values():
    v = gtsam.Values()
    v.insert(V(0), np.array([1.0, 2.0, 3.0]))
    v.insert(V(1), np.array([0.0, 1.0, 5.0]))
    return v


def difference(values, with_jacobians):
    e = values.atVector(V(1)) - values.atVector(V(0))
    return e, [-EYE, EYE] if with_jacobians else []


def graph_of(residual, dims=(3, 3)):
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(guarded_factor("wobble", [V(0), V(1)], dims, NOISE, residual))
    return graph


def test_a_good_residual_is_the_factor_that_gtsam_has_itself():
    ours, theirs = graph_of(difference), gtsam.NonlinearFactorGraph()
    theirs.push_back(gtsam.BetweenFactorPoint3(V(0), V(1), np.zeros(3), NOISE))
    assert ours.error(values()) == pytest.approx(theirs.error(values()), rel=1e-12)
    np.testing.assert_allclose(
        ours.linearize(values()).augmentedJacobian(), theirs.linearize(values()).augmentedJacobian(), atol=1e-12
    )


BAD_RESIDUALS = {
    "too short": np.zeros(2),
    "column": np.zeros((3, 1)),
    "float32": np.zeros(3, dtype=np.float32),
    "NaN": np.array([0.0, np.nan, 0.0]),
    "infinite": np.array([np.inf, -np.inf, 0.0]),
    "nothing": None,
}


@pytest.mark.parametrize("returned", BAD_RESIDUALS.values(), ids=BAD_RESIDUALS)
@pytest.mark.parametrize("call", ["error", "linearize"])
def test_a_bad_residual(returned, call):
    graph = graph_of(lambda values, with_jacobians: (returned, [EYE, EYE]))
    with pytest.raises(ValueError, match=r"^wobble: the residual is"):
        getattr(graph, call)(values())


BAD_JACOBIANS = {
    "none": [],
    "one of two": [EYE],
    "a column short": [EYE, np.zeros((3, 2))],
    "float32": [EYE, EYE.astype(np.float32)],
    "NaN": [EYE, np.full((3, 3), np.nan)],
    "infinite": [np.diag([np.inf, -np.inf, 0.0]), EYE],
    "a gap": [None, EYE],
}


@pytest.mark.parametrize("returned", BAD_JACOBIANS.values(), ids=BAD_JACOBIANS)
def test_a_bad_jacobian(returned):
    graph = graph_of(lambda values, with_jacobians: (np.ones(3), returned))
    assert graph.error(values()) == pytest.approx(6.0)  # nobody asked for them yet
    with pytest.raises(ValueError, match=r"^wobble: (the Jacobian [01] is|there must be a Jacobian for each of the 2)"):
        graph.linearize(values())


def test_an_exception_of_the_residual_itself_comes_through():
    graph = graph_of(lambda values, with_jacobians: (values.atVector(X(7)), [EYE, EYE]))
    with pytest.raises(RuntimeError, match="x7"):
        graph.error(values())


@pytest.mark.parametrize("dims", [(3,), (3, 3, 3), ()])
def test_every_key_needs_its_dimension(dims):
    """Else a Jacobian would stay unassigned, which gtsam does not survive."""
    with pytest.raises(ValueError, match="wobble: there are 2 keys and"):
        graph_of(difference, dims)
