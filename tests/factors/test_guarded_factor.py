"""A residual function that returns nonsense is named in a ValueError, and the interpreter lives on."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V, X

from fg_nav.factors import guarded_factor
from tests.factors.variables import values_of

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
