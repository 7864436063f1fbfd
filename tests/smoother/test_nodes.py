"""Nodes stand where the foot stands: at the ends of its stances, between, and at the stillest sample."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fg_nav.detection.stance import Stances
from fg_nav.recording import Recording
from fg_nav.smoother.strides import LONG_STANCE_S, REST_SPACING_S, place_nodes
from tests.smoother.walks import DEFAULT, demo

RATE = 200.0


def walk_with(lengths: list[tuple[int, int]], seed: int, one_footfall: bool = False) -> tuple[Recording, Stances]:
    """Stances of some samples, each after a swing of some samples, in a recording that is nothing but noise."""
    gaps, stands = np.array(lengths).T
    start = np.cumsum(gaps) + np.concatenate([[0], np.cumsum(stands)[:-1]])
    stop = start + stands
    n = int(stop[-1]) + 20
    rng = np.random.default_rng(seed)
    recording = Recording(t=np.arange(n) / RATE, acc=np.tile([0.0, 0.0, 9.8], (n, 1)), gyr=rng.standard_normal((n, 3)))
    footfall = np.zeros(len(start), dtype=np.int64) if one_footfall else np.arange(len(start))
    return recording, Stances(start, stop, footfall, n)


some_stances = st.lists(st.tuples(st.integers(1, 80), st.integers(1, 500)), min_size=1, max_size=6)


@settings(max_examples=60, deadline=None)
@given(lengths=some_stances, seed=st.integers(0, 99), one=st.booleans())
def test_nodes_are_in_order_and_in_their_stances(lengths: list[tuple[int, int]], seed: int, one: bool) -> None:
    recording, stances = walk_with(lengths, seed, one)
    nodes = place_nodes(recording, stances, DEFAULT)
    assert np.all(np.diff(nodes.sample) > 0)
    assert np.all((stances.start[nodes.interval] <= nodes.sample) & (nodes.sample < stances.stop[nodes.interval]))
    assert set(nodes.interval) == set(range(len(stances)))
    np.testing.assert_array_equal(nodes.footfall, stances.footfall[nodes.interval])
    np.testing.assert_array_equal(nodes.footfall[nodes.first[:-1]], np.arange(stances.n_footfalls))
    assert nodes.first[-1] == len(nodes)


@settings(max_examples=60, deadline=None)
@given(lengths=some_stances, seed=st.integers(0, 99), one=st.booleans())
def test_the_stillest_sample_of_a_footfall_has_its_result_node(
    lengths: list[tuple[int, int]], seed: int, one: bool
) -> None:
    recording, stances = walk_with(lengths, seed, one)
    nodes = place_nodes(recording, stances, DEFAULT)
    np.testing.assert_array_equal(nodes.sample[nodes.result], stances.stillest(recording.gyr))


@settings(max_examples=60, deadline=None)
@given(lengths=some_stances, seed=st.integers(0, 99))
def test_nodes_of_a_stance_are_neither_close_nor_far(lengths: list[tuple[int, int]], seed: int) -> None:
    recording, stances = walk_with(lengths, seed)
    nodes = place_nodes(recording, stances, DEFAULT)
    for k in range(len(stances)):
        mine = nodes.sample[nodes.interval == k]
        step = np.diff(recording.t[mine])
        duration = recording.t[stances.stop[k] - 1] - recording.t[stances.start[k]]
        spacing = DEFAULT.node_spacing_s if duration <= LONG_STANCE_S else REST_SPACING_S
        assert np.all(step >= DEFAULT.shortest_interval_s - 1e-9)
        assert np.all(step <= 1.5 * spacing + 2 / RATE)  # the node on the stillest sample was moved by half a step


@pytest.mark.parametrize("spacing", [0.05, 0.1, 0.4])
def test_spacing_is_what_was_asked_for(spacing: float) -> None:
    walk = demo()
    nodes = place_nodes(walk.recording, walk.stances, replace(DEFAULT, node_spacing_s=spacing))
    walking = nodes.interval[1:] == nodes.interval[:-1]
    inner = walking & (nodes.interval[1:] > 0) & (nodes.interval[1:] < len(walk.stances) - 1)
    step = np.diff(walk.recording.t[nodes.sample])[inner]
    assert np.median(step) <= spacing
    assert step.max() <= 1.5 * spacing + 0.01
