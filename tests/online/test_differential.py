"""The differential field of a walk in progress: in the end the graph has the factors of a batch."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B

from fg_nav.factors.differential_field import BiasInformation, FieldNoise, Variogram
from fg_nav.online.differential import BiasLedger
from fg_nav.online.isam2 import ISAM2Backend
from fg_nav.online.smoother import OnlineOptions
from fg_nav.smoother.differential import add_differential_field
from fg_nav.smoother.differential_factors import limit_information
from fg_nav.smoother.graph import solve
from fg_nav.smoother.problem import walk_problem
from tests.online.test_online_smoother import fed, in_field
from tests.smoother.test_differential import UNRESTED

NOISE = FieldNoise(Variogram(5.0, 1.0, 1.0), 0.2, 1.0)


def random_information(rng: np.random.Generator) -> BiasInformation:
    root = rng.normal(size=(3, 3)) * 500.0
    return BiasInformation(root.T @ root, rng.normal(size=3) * 1e4)


@pytest.mark.parametrize("seed", range(5))
def test_what_a_re_solve_has_put_there_counts_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stances, standings, more = (random_information(rng) for _ in range(3))
    in_graph = limit_information(stances, standings)
    ledger = BiasLedger(NOISE, stances + more, standings, in_graph)
    values = gtsam.Values()
    values.insert(B(3), gtsam.imuBias.ConstantBias())
    further = ledger.complete(3).linearize(values)
    whole = limit_information(stances + more, standings)
    np.testing.assert_allclose(further.information()[3:, 3:] + in_graph.matrix, whole.matrix, rtol=1e-6, atol=1e-3)
    vector = further.augmentedInformation()[3:6, 6] + in_graph.vector
    np.testing.assert_allclose(vector, whole.vector, rtol=1e-4, atol=1e-2 * np.abs(whole.vector).max())


def test_footfall_by_footfall_the_graph_learns_what_a_batch_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Information on the bias variables that are complete, without any re-solve after the sixteenth footfall."""
    monkeypatch.setattr("fg_nav.online.smoother.RESOLVE_AT", (1, 2, 4, 8, 16))
    online = fed(in_field(), OnlineOptions(parameters=UNRESTED))
    backend = online._backend
    assert isinstance(backend, ISAM2Backend)
    count = online._places[-1].bias + 1
    found = np.zeros((count, 3, 3))
    values = backend._estimates()
    for factor in (backend._graph.at(i) for i in range(backend._graph.size())):
        for k in range(1, count):
            if list(factor.keys()) == [B(k)]:
                found[k] += factor.linearize(values).information()[3:, 3:]
    walk = online._walk
    whole = walk_problem(walk.cut_whole(), walk.cut_stances(0, 0), 0.0, UNRESTED, in_progress=True)
    expected = add_differential_field(whole, solve(whole).values).differential
    assert expected is not None
    assert count >= 4
    for k in range(1, count - 1):
        one, other = (np.linalg.eigvalsh(some) for some in (found[k], expected.information.matrix[k]))
        np.testing.assert_allclose(one[-1], other[-1], rtol=0.3)
