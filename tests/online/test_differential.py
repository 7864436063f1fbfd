"""The differential field of a walk in progress: it shows the bias as in batch, by the solutions of the walk."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.online import smoother as online_smoother
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.window import Window
from fg_nav.smoother import SmootherParameters
from tests.online.test_online_smoother import FOOTFALLS, fed, in_field, polished
from tests.online.walks import solve_only_at
from tests.simulated import corridor
from tests.smoother.test_differential import NO_REST
from tests.smoother.walks import DEFAULT

SOLVED_AGAIN = (1, 2, 3, 4, 8)  # Footfalls; those behind extend the graph.

WITHOUT_REST = replace(DEFAULT, rest=NO_REST)
NO_HEADING = replace(DEFAULT.magnetic, compass=False, potential=False)
"""Only the differential field is left of the magnetometer."""


def count_calls(monkeypatch: pytest.MonkeyPatch, owner: object, name: str) -> list[object]:
    """A list that grows by one with each call."""
    calls, called = [], getattr(owner, name)

    def counted(*given: object) -> object:
        calls.append(given)
        return called(*given)

    monkeypatch.setattr(owner, name, counted)
    return calls


@pytest.mark.parametrize(("parameters", "heading"), [(DEFAULT, None), (WITHOUT_REST, 0.0)])
def test_a_stride_extends_the_graph_and_is_never_solved_in_batch_instead(
    monkeypatch: pytest.MonkeyPatch, parameters: SmootherParameters, heading: float | None
) -> None:
    """Neither by what is behind the schedule nor by a graph that had to begin again."""
    solve_only_at(monkeypatch, *SOLVED_AGAIN)
    solved_again = count_calls(monkeypatch, online_smoother, "solve_from_start")
    others = count_calls(monkeypatch, Window, "_begin_again")
    online = fed(in_field(), OnlineOptions(heading_rad=heading, parameters=parameters))
    assert online.initial.counts["differential_field"] > 0
    assert len(solved_again) == len(SOLVED_AGAIN)
    assert not others


def test_a_walk_finds_the_bias_by_it_at_its_end_as_the_batch_does() -> None:
    given = replace(WITHOUT_REST, gyr_density_deg_s=0.015)  # noise of the simulated gyroscope
    with_it, without = (replace(given, magnetic=replace(NO_HEADING, differential=used)) for used in (True, False))
    online, other = (fed(in_field(), OnlineOptions(parameters=one)) for one in (with_it, without))
    for one in (online, other):
        one.begin_end()
        one.take_end()
    table, inertial = online.smoothed(), other.smoothed()
    batch = polished(in_field(), OnlineOptions(parameters=with_it)).stances
    middle = FOOTFALLS // 2
    assert online.initial.counts["differential_field"] > 2
    truth = corridor(seed=0).gyro_bias
    assert (np.abs(table.gyro_bias - truth)[middle] < 3.0 * table.gyro_bias_sigma[middle]).all()
    assert (np.abs(table.gyro_bias - batch.gyro_bias)[middle] < batch.gyro_bias_sigma[middle]).all()
    np.testing.assert_allclose(table.gyro_bias_sigma[middle], batch.gyro_bias_sigma[middle], rtol=0.25)
    # The field takes a tenth of the sigma about the vertical, as in batch (0.90 of it is left).
    assert table.gyro_bias_sigma[middle, 2] < 0.92 * inertial.gyro_bias_sigma[middle, 2]
