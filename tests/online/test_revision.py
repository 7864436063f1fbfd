"""What is taken back of a walk in progress: footfalls in hindsight, and the lines that say what changed."""

import json
from functools import cache

import numpy as np
import pytest

from fg_nav.detection.causal import CausalParameters, CausalStances
from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.online.buffer import CHUNK, OnlineOptions, ReportedFootfall, SampleBuffer
from fg_nav.online.estimates import Revision, StanceEstimate, compare_pasts, format_revision
from fg_nav.online.resolve import OPEN_S, UNREPORTED, review_footfalls
from tests.online.walks import (
    add,
    estimates_of,
    farthest,
    footfall_at,
    in_field,
    revisions_of,
    short_walk,
    smoother_of,
)
from tests.smoother.walks import demo


@cache
def told_footfalls() -> tuple[ReportedFootfall, ...]:
    walk = short_walk()
    stances = CausalStances(CausalParameters())
    found = [*stances.push(walk.t, walk.acc, walk.gyr), *stances.finish()]
    ends = [min(int(one.stop[-1]) + 1, len(walk)) for one in found]
    return tuple(ReportedFootfall(one, k, end) for k, (one, end) in enumerate(zip(found, ends, strict=True)))


def swing_behind(k: int) -> ReportedFootfall:
    """A false footfall in the middle of the swing behind one."""
    before, after = (told_footfalls()[i].footfall for i in (k, k + 1))
    middle = (int(before.stop[-1]) + int(after.start[0])) // 2
    return ReportedFootfall(footfall_at(np.array([middle - 5]), np.array([middle + 5]), middle), 99, middle + 6)


def test_footfalls_that_are_none_are_taken_out_and_those_that_were_missed_are_put_in():
    told, walk = list(told_footfalls()), short_walk()
    assert review_footfalls(walk, 0, told) == told
    assert review_footfalls(walk, 0, [*told[:6], swing_behind(5), *told[6:]]) == told
    first = int(told[3].footfall.start[0]) - 50  # samples of a part of the walk are enough
    part = walk.slice(first, len(walk))
    assert review_footfalls(part, first, [*told[3:5], swing_behind(4), *told[5:]]) == told[3:]
    found = review_footfalls(walk, 0, [*told[:5], *told[6:]])
    assert [one.line for one in found] == [*range(5), UNREPORTED, *range(6, len(told))]
    missed, true = found[5].footfall, told[5].footfall
    assert missed.start[0] < true.stop[-1]
    assert true.start[0] < missed.stop[-1] <= found[5].until
    assert (np.diff([one.until for one in found]) >= 0).all()


def test_the_newest_part_of_a_walk_stays_as_it_was_told():
    walk, told = short_walk(), list(told_footfalls())
    cut = int(told[8].footfall.start[0]) + 20
    part, swing = walk.slice(0, cut), swing_behind(7)
    for one, given in ((swing, [*told[:8], swing]), (told[7], told[:7])):
        assert walk.t[cut - 1] - walk.t[one.footfall.stop[-1]] < OPEN_S
        assert review_footfalls(part, 0, given) == given


# --- what changed ----------------------------------------------------------------------------------------------------


def straight(count: int, heading: float = 0.0) -> list:
    R, zero = yaw_rotation(heading), np.zeros(3)
    rest = float(compute_heading(R)), zero, zero, np.eye(4), np.ones(3), 1.0, "none", ""
    return [
        StanceEstimate(k, 100 * k, 1.0 * k, R @ np.array([0.0, 1.3 * k, 0.0]), R, *rest).as_row() for k in range(count)
    ]


def lines(revision: Revision) -> list[dict]:
    return [json.loads(line) for line in format_revision(revision)]


@pytest.mark.parametrize("angle_deg", [-150.0, 0.7, 2.0])
def test_a_map_that_turns_by_more_than_a_degree_is_announced(angle_deg):
    """Clockwise, as headings are."""
    before, after = straight(12), straight(14, np.radians(angle_deg))
    clockwise = np.degrees(compute_heading(yaw_rotation(np.radians(angle_deg))) - compute_heading(np.eye(3)))
    found = lines(compare_pasts(before, after, 0, []))
    assert [line["kind"] for line in found] == ["turned"] * (abs(angle_deg) > 1.0) + ["revised"]
    if len(found) == 2:
        assert np.isclose((found[0]["angle_deg"] - clockwise + 180) % 360, 180, atol=1e-3)


def test_lines_whose_footfalls_were_none_are_retracted_before_the_path():
    found = lines(compare_pasts(straight(12), straight(12), 0, [(7, 7.5), (9, 9.5)]))
    expected = [("retracted", 7, 7.5), ("retracted", 9, 9.5), ("revised", None, None)]
    assert [(line["kind"], line.get("stance"), line.get("stance_t")) for line in found] == expected
    assert {line["t"] for line in found} == {11.0}


@pytest.mark.parametrize("count", [1, 200, 201, 5000])
def test_the_path_is_all_of_the_walk_in_two_hundred_points_at_most(count):
    rows = straight(count)
    path = np.array(lines(compare_pasts(rows[-10:], rows, max(count - 10, 0), []))[-1]["path"])
    assert path.shape == (min(count, 200), 4)
    np.testing.assert_allclose(path[-1], [count - 1, 0.0, 1.3 * (count - 1), 0.0], atol=1e-3)
    np.testing.assert_allclose(path[0], 0.0)
    gaps = np.diff(path[:, 0])
    assert not len(gaps) or ((gaps > 0).all() and gaps.max() - gaps.min() <= 1.0)


def test_a_false_footfall_is_taken_back_and_what_rests_on_it_is_made_anew():
    """In the middle of the swing before footfall `at`; and one that was missed is put in."""
    walk, at = demo(), 14
    online, undisturbed, short = smoother_of(walk), smoother_of(walk), smoother_of(walk)
    found = [one for k in range(at) for one in add(online, walk, k)]
    before, after = (walk.stances.footfall == i for i in (at - 1, at))
    middle = int(walk.stances.stop[before][-1] + walk.stances.start[after][0]) // 2
    found += online.add_footfall(footfall_at(np.array([middle - 10]), np.array([middle + 10]), middle), middle + 12)
    found += [one for k in range(at, at + 10) for one in add(online, walk, k)]
    for k in range(at + 10):
        add(undisturbed, walk, k)
        if k != at:
            add(short, walk, k)
    (retracted,) = [line for one in revisions_of(found) for line in one.retracted]
    assert retracted == (at, next(one.t for one in estimates_of(found) if one.number == at))
    assert [one.number for one in estimates_of(found)] == list(range(at + 11))
    assert [one.line for one in online.footfalls] == [k for k in range(online.n_reported) if k != at]
    assert len(online.smoothed()) == len(online.causal()) - 1 == at + 10
    np.testing.assert_allclose(online.latest.position, undisturbed.latest.position, atol=0.05)
    assert online.latest.number == online.n_reported - 1
    assert [one.line for one in short.footfalls] == [*range(at), UNREPORTED, *range(at, at + 9)]
    assert farthest(short.smoothed(), undisturbed.smoothed()) < 0.05


def test_a_map_that_was_turned_is_where_the_field_has_north():
    """Without a heading the walk begins to the north; the field says where that is."""
    online = smoother_of(in_field(), OnlineOptions(heading_rad=None))
    told, turns, sigma = [], [], []
    for k in range(12):
        found = add(online, in_field(), k)
        turns += [(len(told), one.turn) for one in revisions_of(found) if one.turn]
        sigma.append(np.degrees(np.sqrt(found[-1].pose_cov[3, 3])))
        told.append(found[-1].heading)
    assert turns
    now = compute_heading(online.smoothed().nav_R_body)
    announced = np.array([sum(turn for line, turn in turns if line > k) for k in range(12)])
    error = np.degrees(np.angle(np.exp(1j * (now - np.array(told) - announced))))
    assert (np.abs(error) < np.maximum(2.0, sigma)).all()
    assert np.median(np.abs(error)) < 1.0
    assert np.abs(np.degrees(announced)).max() > 1.0


def test_what_is_since_a_stamp_is_found_at_the_end_of_a_chunk():
    buffer, t = SampleBuffer(), np.arange(2 * CHUNK) * 0.01
    buffer.append(np.column_stack([t, np.zeros((len(t), 10))]))
    for stop in (CHUNK, CHUNK + 1, 2 * CHUNK):
        for since in (0, CHUNK - 1, stop):
            assert buffer.find_since(since * 0.01 - 1e-6, stop) == since if since < stop else stop
