"""Fixes while the walk goes on: taken when their time has come, turning the map where they show the heading."""

from functools import cache

import numpy as np
import pytest

from fg_nav.io import write_canonical
from fg_nav.online import OnlineNavigator
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.estimates import Revision
from fg_nav.online.strides import find_stride_fixes
from fg_nav.smoother.constraints import pin_to_times
from fg_nav.truth import Fix
from tests.smoother.test_fixes import demo, errors, fixes_at, truth_from_start, with_fixes

TURN_DEG = 40.0


@cache
def walked(heading: float | None, turn_deg: float = 0.0, blocks: int = 64):
    """The navigator of a walk with two fixes, and what it told."""
    navigator = OnlineNavigator(OnlineOptions(heading_rad=heading, use_field=False, fixes=tuple(fixes(turn_deg))))
    rows, told = rows_of(demo().recording), []
    for start in range(0, len(rows), blocks):
        told += navigator.add_rows(rows[start : start + blocks])
    return navigator, told + navigator.close()


def fixes(turn_deg: float = 0.0) -> list[Fix]:
    return fixes_at([12, 25], turn_deg, sigma=0.05)


def test_the_walk_goes_through_its_fixes_as_in_batch():
    navigator, _ = walked(0.0)
    found, batch = navigator.finish(), with_fixes(fixes(), heading=0.0)
    where = np.searchsorted(found.stances.t, [fix.time_s - 0.05 for fix in fixes()])
    assert errors(found)[where].max() < 0.04
    assert found.graph["position_fix"] == len(fixes())
    assert np.linalg.norm((found.stances.position - batch.stances.position)[:, :2], axis=1).max() < 0.1


def test_the_map_turns_to_the_fixes_and_says_so():
    navigator, told = walked(None, TURN_DEG)
    assert errors(navigator.finish(), TURN_DEG).max() < 0.25
    turns = [one for one in told if isinstance(one, Revision) and one.turn]
    assert np.degrees(sum(one.turn for one in turns)) == pytest.approx(-TURN_DEG, abs=1.5)
    first = fixes()[0].time_s
    assert first < turns[0].t < first + 12.0  # the next solution of all of it


def test_a_heading_that_fixes_have_yet_to_show_is_in_the_sigmas():
    _, told = walked(None, TURN_DEG)
    lines = [one for one in told if not isinstance(one, Revision)]
    truth = truth_from_start(demo())[[one.sample for one in lines]]
    turn = np.radians(TURN_DEG)
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


def test_stream_and_run_take_fixes(fg_nav, tmp_path):
    write_canonical(demo().recording.slice(0, 4600), tmp_path / "walk.csv")
    one = fixes()[0]
    assert one.time_s < 20.0
    east, north, _ = one.position
    (tmp_path / "fixes.csv").write_text(f"time_s,x_m,y_m,z_m,sigma_m\n{one.time_s},{east},{north},,0.05\n")
    words = ("--heading", 0, "--fixes", tmp_path / "fixes.csv")
    ran = fg_nav(
        "run", tmp_path / "walk.csv", "--method", "online", *words, "--plots", "none", "--out", tmp_path / "run"
    )
    assert ran.code == 0, ran.err
    ran = fg_nav("stream", tmp_path / "walk.csv", "--silence", 0.3, *words, "--out", tmp_path / "stream")
    assert ran.code == 0, ran.err
    for name in ("run", "stream"):
        path = np.loadtxt(tmp_path / name / "trajectory.tum")
        at = path[np.argmin(np.abs(path[:, 0] - one.time_s)), 1:3]
        assert np.linalg.norm(at - one.position[:2]) < 0.1
    assert fg_nav("stream", tmp_path / "walk.csv", *words, "--mount", "pocket").refused("--fixes", "foot")
    assert fg_nav("stream", tmp_path / "walk.csv", "--fixes", tmp_path / "no.csv").refused("no.csv")
