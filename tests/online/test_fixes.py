"""Fixes while the walk goes on: taken when their time has come, turning the map where they show the heading."""

from functools import cache

import numpy as np

from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.strides import find_stride_fixes
from fg_nav.smoother.constraints import pin_to_times
from fg_nav.truth import Fix
from tests.online.walks import estimates_of, revisions_of, walked
from tests.smoother.test_fixes import demo, errors, fixes_at, truth_from_start, with_fixes

TURN_DEG = 40.0


@cache
def through_fixes(heading: float | None, turn_deg: float):
    """The navigator of a walk with two fixes, and what it told."""
    options = OnlineOptions(heading_rad=heading, use_field=False, fixes=tuple(fixes(turn_deg)))
    rows = rows_of(demo().recording)
    return walked(rows, options, cuts=range(64, len(rows), 64))


def fixes(turn_deg: float = 0.0) -> list[Fix]:
    return fixes_at([12, 25], turn_deg, sigma=0.05)


def test_the_walk_goes_through_its_fixes_as_in_batch():
    found, batch = through_fixes(0.0, 0.0)[0].finish(), with_fixes(fixes(), heading=0.0)
    where = np.searchsorted(found.stances.t, [fix.time_s - 0.05 for fix in fixes()])
    assert errors(found)[where].max() < 0.04
    assert found.graph["position_fix"] == len(fixes())
    assert np.linalg.norm((found.stances.position - batch.stances.position)[:, :2], axis=1).max() < 0.1


def test_the_map_turns_to_the_fixes_and_says_so_and_what_they_have_yet_to_show_is_in_the_sigmas():
    navigator, told = through_fixes(None, TURN_DEG)
    assert errors(navigator.finish(), TURN_DEG).max() < 0.25
    turns, turn = [one for one in revisions_of(told) if one.turn], np.radians(TURN_DEG)
    assert abs(sum(one.turn for one in turns) + turn) < np.radians(1.5)
    first = fixes()[0].time_s
    assert first < turns[0].t < first + 12.0  # the next solution of all of it
    lines = estimates_of(told)
    truth = truth_from_start(demo())[[one.sample for one in lines]]
    east = np.cos(turn) * truth[:, 0] - np.sin(turn) * truth[:, 1]
    off = np.abs([one.position[0] for one in lines] - east)
    sigma = np.sqrt([one.pose_cov[0, 0] for one in lines])
    assert off.max() > 2.0
    assert (off < 3.0 * sigma + 0.02).all()
    assert np.degrees(lines[-1].pose_cov[3, 3] ** 0.5) < 3.0


def test_a_fix_of_a_stride_has_the_node_and_the_sigma_of_the_batch():
    rng = np.random.default_rng(4)
    t_node = np.sort(rng.uniform(0.0, 4.0, 6))
    several = [Fix(float(t), rng.normal(size=3), 0.2, 0.3) for t in rng.uniform(-1.0, 5.0, 40)]
    before = float(t_node[2])
    found = find_stride_fixes(several, t_node, before)
    inside = [fix for fix in several if before < fix.time_s <= t_node[-1]]
    assert [fix.time_s for _, fix in found] == [fix.time_s for fix in inside]
    pinned = pin_to_times(inside, t_node)
    np.testing.assert_array_equal([node for node, _ in found], pinned.node)
    np.testing.assert_allclose([fix.horizontal_sigma_m for _, fix in found], pinned.horizontal)
