"""The differential field of a walk in progress: it shows the bias, and what the graph has of it counts once."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B

from fg_nav.factors.differential_field import BiasInformation, FieldNoise, Iron, Variogram
from fg_nav.online import smoother as online_smoother
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.field import BiasLedger
from fg_nav.online.isam2 import ISAM2Backend
from fg_nav.online.window import Window
from fg_nav.smoother import SmootherParameters
from fg_nav.smoother.differential import LevelBias, limit_information
from tests.online.test_online_smoother import FOOTFALLS, fed, in_field, polished
from tests.online.walks import solve_only_at
from tests.simulated import corridor
from tests.smoother.test_differential import NO_REST
from tests.smoother.walks import DEFAULT

SOLVED_AGAIN = (1, 2, 3, 4, 8)  # Footfalls; those behind extend the graph.

WITHOUT_REST = replace(DEFAULT, rest=NO_REST)
NO_HEADING = replace(DEFAULT.magnetic, compass=False, potential=False)
"""Only the differential field is left of the magnetometer."""

VARIABLES = 3
NOISE = FieldNoise(Variogram(5.0, 1.0, 1.0), 0.2, Iron(np.array([3.0, -5.0, 1.0]), 4.0 * np.eye(3)))


def random_information(rng: np.random.Generator) -> BiasInformation:
    root = rng.normal(size=(6, 6)) * np.repeat([500.0, 0.5], 3)
    return BiasInformation(root.T @ root, rng.normal(size=6) * np.repeat([1e4, 1.0], 3))


@pytest.mark.parametrize("seed", range(5))
def test_what_a_re_solve_has_put_there_counts_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stances, standings, more = (random_information(rng) for _ in range(3))
    in_graph = limit_information(stances, standings, NOISE.iron, VARIABLES)
    ledger = BiasLedger(NOISE, VARIABLES, stances + more, standings, in_graph)
    values = gtsam.Values()
    values.insert(B(3), gtsam.imuBias.ConstantBias())
    shown = limit_information(stances + more, standings, NOISE.iron, VARIABLES) - in_graph
    agrees = LevelBias(np.linalg.solve(shown.matrix, shown.vector), np.array([0.0, 0.6, 0.8]))
    further = ledger.complete(3, agrees).linearize(values)
    whole = limit_information(stances + more, standings, NOISE.iron, VARIABLES)
    np.testing.assert_allclose(further.information()[3:, 3:] + in_graph.matrix, whole.matrix, rtol=1e-6, atol=1e-3)
    vector = further.augmentedInformation()[3:6, 6] + in_graph.vector
    np.testing.assert_allclose(vector, whole.vector, rtol=1e-4, atol=1e-2 * np.abs(whole.vector).max())


@pytest.fixture
def solved_again_early(monkeypatch: pytest.MonkeyPatch) -> None:
    solve_only_at(monkeypatch, *SOLVED_AGAIN)


def count_calls(monkeypatch: pytest.MonkeyPatch, owner: object, name: str) -> list[object]:
    """A list that grows by one with each call."""
    calls, called = [], getattr(owner, name)

    def counted(*given: object) -> object:
        calls.append(given)
        return called(*given)

    monkeypatch.setattr(owner, name, counted)
    return calls


@pytest.mark.usefixtures("solved_again_early")
@pytest.mark.parametrize("heading", [0.0, None])
@pytest.mark.parametrize("parameters", [DEFAULT, WITHOUT_REST])
def test_a_stride_extends_the_graph_and_is_never_solved_in_batch_instead(
    monkeypatch: pytest.MonkeyPatch, parameters: SmootherParameters, heading: float | None
) -> None:
    """Neither by what is behind the schedule nor by a tree that had to be built again."""
    solved_again = count_calls(monkeypatch, online_smoother, "solve_from_start")
    others = [
        count_calls(monkeypatch, owner, name) for owner, name in ((ISAM2Backend, "_rebuild"), (Window, "_recover"))
    ]
    online = fed(in_field(), OnlineOptions(heading_rad=heading, parameters=parameters))
    assert online.window.counts["differential_field"] > 0
    assert len(solved_again) == len(SOLVED_AGAIN)
    assert not any(others)


@pytest.mark.usefixtures("solved_again_early")
def test_a_walk_in_progress_finds_the_bias_by_it_as_the_batch_does() -> None:
    given = replace(WITHOUT_REST, gyr_density_deg_s=0.015)  # noise of the simulated gyroscope
    with_it, without = (replace(given, magnetic=replace(NO_HEADING, differential=used)) for used in (True, False))
    online = fed(in_field(), OnlineOptions(parameters=with_it))
    table, batch = online.smoothed(), polished(in_field(), OnlineOptions(parameters=with_it)).stances
    inertial = fed(in_field(), OnlineOptions(parameters=without)).smoothed()
    middle = FOOTFALLS // 2
    assert online.window.counts["differential_field"] > 2
    truth = corridor(seed=0).gyro_bias
    assert (np.abs(table.gyro_bias - truth)[middle] < 3.0 * table.gyro_bias_sigma[middle]).all()
    assert (np.abs(table.gyro_bias - batch.gyro_bias)[middle] < batch.gyro_bias_sigma[middle]).all()
    np.testing.assert_allclose(table.gyro_bias_sigma[middle], batch.gyro_bias_sigma[middle], rtol=0.25)
    # All stances of a bias variable have 0.2 deg/s in common, so the sigma is no less than three quarters.
    assert table.gyro_bias_sigma[middle, 2] < 0.8 * inertial.gyro_bias_sigma[middle, 2]
