"""Two feet in progress: against the batch solution of both, each foot alone, and the truth."""

from __future__ import annotations

import json
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError, RecordingError
from fg_nav.feet import SIDES, Side
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.estimates import (
    FeetLine,
    FootState,
    PersonEstimate,
    Revision,
    StanceEstimate,
    format_estimate,
    format_feet_line,
    format_revision,
)
from fg_nav.online.feet import FeetNavigator, FeetWalk
from fg_nav.online.navigator import OnlineNavigator
from fg_nav.truth import Fix
from tests.feet.walks import both, truth_of
from tests.online.feet_walks import heads_known, list_blocks, push_feet


@cache
def walked() -> tuple[list[FeetLine], FeetWalk]:
    """Lines and end of both feet, without the field, whose heading is given; clocks that fit are not remarked on."""
    remarks: list[str] = []
    navigator = FeetNavigator(heads_known(), remarks.append)
    lines = push_feet(navigator)
    assert not [words for words in remarks if "clocks" in words]
    return lines, navigator.finish()


def contents(found: list[FeetLine], kind: type | tuple[type, ...], foot: str = "") -> list:
    return [one.content for one in found if isinstance(one.content, kind) and foot in (one.foot, "")]


def states(found: list[FeetLine]) -> list[tuple[str, str]]:
    return [(one.foot, one.content.state) for one in found if isinstance(one.content, FootState)]


def texts(found: list[FeetLine]) -> list:
    return [
        format_estimate(one, False) if isinstance(one, StanceEstimate) else list(format_revision(one))
        for one in contents(found, (StanceEstimate, Revision), "left")
    ]


def interpolate(t, path):
    return np.stack([np.interp(t, path.t, column) for column in path.position.T], axis=1)


def true_path(side: Side, t: Floats) -> Floats:
    """From where the left foot stood at first."""
    return interpolate(t, truth_of(side)) - truth_of("left").position[0]


def test_at_the_end_both_feet_and_the_person_are_where_the_batch_has_them() -> None:
    """Found: 9 mm rms, 22 mm at most; in the left foot's frame, whose heading was given."""
    end = walked()[1]
    for side in SIDES:
        found, batch = end.feet[side].stances, getattr(both(), side)
        apart = np.linalg.norm(found.position - interpolate(found.t, batch), axis=1)
        assert np.sqrt(np.mean(apart**2)) < 0.02
        assert apart.max() < 0.05
        assert found.position_sigma[-1, :2] == pytest.approx(batch.stances.position_sigma[-1, :2], rel=0.1)
    assert end.both.width_m == pytest.approx(both().width_m, abs=0.02)
    assert end.both.width_sigma_m == pytest.approx(both().width_sigma_m, rel=0.1)
    assert end.both.person.position[-1] == pytest.approx(both().person.position[-1], abs=0.05)


def test_lines_of_both_are_in_one_frame_after_some_strides() -> None:
    lines = [one for one in walked()[0] if isinstance(one.content, StanceEstimate)]
    assert {one.frame for one in lines if one.foot == "left"} == {"left"}
    own = [one.content.t for one in lines if one.frame == "right"]
    assert 0 < len(own) < 20
    assert max(own) < 20.0
    pairs = [
        pair for pair in pairwise(one for one in lines if one.content.t > max(own)) if pair[0].foot != pair[1].foot
    ]
    assert len(pairs) > 60
    for one, other in pairs:
        assert np.linalg.norm(one.content.position - other.content.position) < 1.0
    others = [line for line in walked()[0] if not isinstance(line.content, StanceEstimate)]
    assert {line.foot for line in others} == {"left", "right", "person"}
    for content in (json.loads(words) for line in others for words in format_feet_line(line)):
        assert list(content)[:3] == ["kind", "foot", "frame"]


def test_the_person_is_where_it_was_by_the_sigmas_told() -> None:
    """Line by line, against the truth; and the path told last, which is of the end."""
    people = contents(walked()[0], PersonEstimate)
    assert len(people) > 80
    t = np.array([one.t for one in people])
    error = np.array([one.position for one in people]) - np.mean([true_path(side, t) for side in SIDES], axis=0)
    sigma = np.sqrt([np.diagonal(one.pose_cov)[:3] for one in people])
    assert np.abs(error[:, :2] / sigma[:, :2]).max() < 3.0
    ahead = [one.heading for one in people if 22.0 < one.t < 26.0]  # to the south
    assert len(ahead) > 4
    assert np.abs(np.degrees(np.angle(np.exp(1j * (np.array(ahead, dtype=float) - np.pi))))).max() < 15.0
    path = contents(walked()[0], Revision, "person")[-1].path
    assert path[0, 0] < 5.0  # with the steps before the feet were tied
    truth = np.mean([true_path(side, path[:, 0]) for side in SIDES], axis=0)
    off, walks = np.linalg.norm(path[:, 1:] - truth, axis=1), (path[:, 0] > 6.0) & (path[:, 0] < 58.5)
    assert off[walks].max() < 0.25
    assert off.max() < 0.5  # the first step and the last, of 0.7 m, are there or not


def test_a_foot_that_is_silent_from_the_start_leaves_the_other_as_it_is_alone() -> None:
    found = push_feet(FeetNavigator(heads_known()), lambda side, t: side == "left" and t < 20.0)
    assert states(found) == [("right", "silent")]
    navigator, alone = OnlineNavigator(heads_known()), []
    for _, rows in list_blocks(lambda side, t: side == "left" and t < 20.0):
        alone += navigator.push(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10])
    alone = [FeetLine("left", "left", one) for one in [*alone, *navigator.close()]]
    assert texts(found) == texts(alone)
    found = push_feet(FeetNavigator(heads_known()), lambda side, t: side == "right" and t < 12.0)
    assert {(one.foot, one.frame) for one in found if isinstance(one.content, StanceEstimate)} == {("right", "right")}


def test_a_foot_that_comes_back_joins_again() -> None:
    """Right foot without samples from 20 to 30 s: told once each, and at the end both are within decimetres."""
    remarks: list[str] = []
    navigator = FeetNavigator(heads_known(), remarks.append)
    found = push_feet(navigator, lambda side, t: t < 43.0 and (side == "left" or not 20.0 <= t < 30.0))
    assert not [words for words in remarks if "clocks" in words]
    assert states(found) == [("right", "silent"), ("right", "back")]
    for side, one in navigator.finish().feet.items():
        assert np.linalg.norm(one.stances.position - true_path(side, one.stances.t), axis=1).max() < 0.3
    people = [one.t for one in contents(found, PersonEstimate)]
    assert any(t < 20.0 for t in people)
    assert not any(23.0 < t < 29.0 for t in people)
    assert max(people) > 40.0


def test_a_foot_in_another_unit_is_refused_once_and_the_other_goes_on() -> None:
    def push_in_g(navigator: FeetNavigator, *sides: Side) -> list[FeetLine]:
        def change(side: Side, rows: Floats) -> Floats:
            rows[:, 1:4] /= 9.81 if side in sides else 1.0
            return rows

        return push_feet(navigator, lambda side, t: t < 12.0, change)

    navigator = FeetNavigator(heads_known())
    found = push_in_g(navigator, "right")
    assert states(found) == [("right", "refused")]
    assert "in g" in contents(found, FootState)[0].reason
    assert set(navigator.finish().feet) == {"left"}
    assert "right" in navigator.finish().lost
    with pytest.raises(RecordingError, match="in g"):
        push_in_g(FeetNavigator(heads_known()), *SIDES)


def late(by_s: float, since_s: float = 0.0):
    """Set the clock of the right foot ahead since some time."""

    def change(side: Side, rows: Floats) -> Floats:
        rows[:, 0] += by_s if side == "right" and rows[0, 0] > since_s else 0.0
        return rows

    return change


def test_clocks_that_do_not_fit_are_told_once_with_what_to_begin_again_with() -> None:
    """Half a second more than the offset that was given."""
    remarks: list[str] = []
    navigator = FeetNavigator(heads_known(), remarks.append, clock_offset_s=1.5)
    push_feet(navigator, lambda side, t: t < 43.0, late(-2.0, -1.0))
    (said,) = [words for words in remarks if "clocks" in words]
    assert float(said.rsplit(" ", 1)[1]) == pytest.approx(2.0, abs=0.03)


def test_a_clock_that_restarts_parts_the_feet() -> None:
    navigator = FeetNavigator(heads_known())
    found = push_feet(navigator, lambda side, t: t < 28.0, late(-19.0, 20.0))
    assert ("right", "parted") in states(found)
    assert found[-1].frame == "right"
    assert navigator.finish().both is None


def test_beside_says_the_same_as_in_between() -> None:
    """Both feet in the other process: at the end the same to the last digits that are told."""
    between, background = FeetNavigator(heads_known()), FeetNavigator(heads_known(), background=True)
    for navigator in (between, background):
        push_feet(navigator, lambda side, t: t < 20.0)
    assert between.finish().both is not None
    for side, one in background.finish().feet.items():
        assert one.stances.position == pytest.approx(between.finish().feet[side].stances.position, abs=1e-3)


def test_lag_and_fixes_are_refused() -> None:
    fix = Fix(10.0, np.zeros(3), 0.1)
    for options, words in ((OnlineOptions(lag_s=60.0), "a lag"), (OnlineOptions(fixes=(fix,)), "fixes")):
        with pytest.raises(EstimationError, match=f"^{words} cannot be used with two feet"):
            FeetNavigator(options)
    with pytest.raises(EstimationError, match="is no time"):
        FeetNavigator(clock_offset_s=np.nan)
