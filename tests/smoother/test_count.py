"""The counts of a summary are those of its graph, and the weights of the compass those of its factors."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from fg_nav.estimators import choose_parameters
from fg_nav.lab.simulation import scenario, simulate
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.plan import Stand
from fg_nav.lab.simulation.plan import Walk as Walking
from fg_nav.pipeline import prepare_walk
from fg_nav.smoother import SmoothedWalk, smooth_graph
from fg_nav.smoother.graph import KINDS, count_graph
from fg_nav.walk import Options, Walk

COURSE = [Stand(3.0), Walking(straight(25.0)), Stand(3.0)]


def solved(gate: str) -> SmoothedWalk:
    """A few strides in the field of a building."""
    course = replace(scenario("demo"), name="short", route=lambda _: COURSE, field="indoor", worn="heel")
    options = Options(gate=gate)
    walk = prepare_walk(Walk.of(simulate(course, 1).recording, options))
    return smooth_graph(walk.recording, walk.stances, choose_parameters(options), None, field=walk.field)


@pytest.mark.parametrize("gate", ["none", "ma2018", "ma2018:hard"])
def test_the_graph_has_the_factors_that_the_summary_counts_and_the_weights_of_its_gate(gate: str) -> None:
    walk = solved(gate)
    told = Counter({kind: count for kind, count in walk.solution.graph.items() if kind in KINDS and count})
    gated_out = told.pop("gated_out", 0)
    assert count_graph(walk.graph) == told
    assert told["differential_field"] > 0
    assert told["magnetic_heading"] + gated_out == len(walk.solution.stances)
    assert (gated_out > 0) == gate.endswith(":hard")
    table = walk.solution.stances
    weight, statistic = table.compass_weight, table.field_statistic
    assert weight is not None
    assert statistic is not None
    assert (weight > 0.0).sum() == walk.solution.graph["magnetic_heading"]
    assert (weight <= 1.0).all()
    judged = np.isfinite(statistic)
    if gate == "ma2018":
        order = np.argsort(statistic[judged])
        assert (np.diff(weight[judged][order]) <= 0.0).all()
        assert 0.0 < weight.min() < weight.max() == 1.0
    else:
        assert set(weight) <= {0.0, 1.0}
