"""The differential field of a walk in progress: what the graph has of a bias variable counts once."""

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B

from fg_nav.factors.differential_field import BiasInformation, FieldNoise, Iron, Variogram
from fg_nav.online.differential import BiasLedger
from fg_nav.smoother.differential_factors import limit_information

NOISE = FieldNoise(Variogram(5.0, 1.0, 1.0), 0.2, Iron(np.array([3.0, -5.0, 1.0]), 4.0 * np.eye(3)))


def random_information(rng: np.random.Generator) -> BiasInformation:
    root = rng.normal(size=(6, 6)) * np.repeat([500.0, 0.5], 3)
    return BiasInformation(root.T @ root, rng.normal(size=6) * np.repeat([1e4, 1.0], 3))


@pytest.mark.parametrize("seed", range(5))
def test_what_a_re_solve_has_put_there_counts_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stances, standings, more = (random_information(rng) for _ in range(3))
    in_graph = limit_information(stances, standings, NOISE.iron)
    ledger = BiasLedger(NOISE, stances + more, standings, in_graph)
    values = gtsam.Values()
    values.insert(B(3), gtsam.imuBias.ConstantBias())
    further = ledger.complete(3).linearize(values)
    whole = limit_information(stances + more, standings, NOISE.iron)
    np.testing.assert_allclose(further.information()[3:, 3:] + in_graph.matrix, whole.matrix, rtol=1e-6, atol=1e-3)
    vector = further.augmentedInformation()[3:6, 6] + in_graph.vector
    np.testing.assert_allclose(vector, whole.vector, rtol=1e-4, atol=1e-2 * np.abs(whole.vector).max())
