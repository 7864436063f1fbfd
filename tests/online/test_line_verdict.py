"""The verdict that each line of a walk in progress has, and the axes of its sensors."""

import json
from functools import cache

import numpy as np
import pytest

from fg_nav.detection.source import AxesCheck
from fg_nav.errors import RecordingError
from fg_nav.lab.simulation import simulate
from fg_nav.online.buffer import rows_of
from fg_nav.online.estimates import Revision, StanceEstimate, format_estimate
from fg_nav.online.follow import LineVerdict
from fg_nav.verdict.limits import judge_position


@cache
def rows() -> np.ndarray:
    found = rows_of(simulate("demo", 4).recording)
    return found[found[:, 0] < 20.0]


def estimate(number: int, t: float, position: list[float], sigma_m: float = 0.05) -> StanceEstimate:
    cov = np.diag([sigma_m**2] * 3 + [0.01])
    zero = np.zeros(3)
    return StanceEstimate(number, number, t, np.array(position), np.eye(3), 0.0, zero, zero, cov, zero, 0.0, "none", "")


def walked(verdict: LineVerdict, count: int = 20, first: int = 0) -> str:
    """Strides of 1.4 m, and the word of the last line."""
    word = ""
    for k in range(first, first + count):
        ((_, found),) = verdict.judge([estimate(k, 1.2 * k, [1.4 * k, 0.0, 0.0])], [False] * (k + 1))
        word = found.word
    return word


def next_word(verdict: LineVerdict, t: float, position: list[float], number: int = 20, sigma_m: float = 0.05) -> str:
    ((_, found),) = verdict.judge([estimate(number, t, position, sigma_m)], [False] * (number + 1))
    return found.word


@pytest.mark.parametrize(
    ("t", "position", "sigma_m", "word"),
    [
        (24.0, [28.0, 0.0, 0.0], 0.05, "trusted"),
        (24.0, [26.6, 3.1, 0.0], 0.05, "doubtful"),  # a stride of 3.1 m is off by 1 m
        (24.0, [26.6, 6.1, 0.0], 0.05, "not to be used"),  # and one of 6.1 m by a tenth of the way
        (22.9, [26.6, 2.0, 0.0], 0.05, "not to be used"),  # at 20 m/s
        (24.0, [28.0, 0.0, 0.0], 9.0, "not to be used"),  # known to 45 %
        (32.8, [28.0, 0.0, 0.0], 0.05, "not to be used"),  # ten seconds, and no footfall
    ],
)
def test_a_line_beyond_the_limits_of_a_person_says_so(
    t: float, position: list[float], sigma_m: float, word: str
) -> None:
    verdict = LineVerdict()
    fed(verdict.axes, OWN)
    assert walked(verdict) == "trusted"
    assert next_word(verdict, t, position, sigma_m=sigma_m) == word
    if word != "trusted" and sigma_m < 1.0:
        assert next_word(verdict, t + 1.2, position, 21) == word


def test_a_place_after_a_short_way_is_said_after_that_way() -> None:
    """It is judged over more."""
    verdict = LineVerdict()
    walked(verdict, 2)
    ((_, found),) = verdict.judge([estimate(2, 2.4, [2.0, 0.0, 0.0], 4.0)], [False] * 3)
    assert "known to 9.8 m only (95 %), after 2 m" in " ".join(found.reasons)
    assert judge_position(np.eye(2), 2.0).weight == judge_position(np.eye(2), 10.0).weight


def test_a_map_that_is_revised_is_no_stride_and_no_speed() -> None:
    verdict = LineVerdict()
    walked(verdict)
    revision = Revision(22.8, 0.5, (), np.array([[0.0, 0.0, 0.0, 0.0], [22.8, 0.0, 26.6, 0.0]]))
    (_, none), (_, found) = verdict.judge([revision, estimate(20, 24.0, [0.0, 28.0, 0.0])], [False] * 21)
    assert none is None
    assert found.word == "trusted"


def test_word_and_reasons_stand_in_the_line() -> None:
    verdict = LineVerdict()
    walked(verdict)
    ((one, found),) = verdict.judge([estimate(20, 24.0, [26.6, 3.1, 0.0])], [False] * 21)
    line = json.loads(format_estimate(one, False, verdict=found))
    assert line["verdict"] == "doubtful"
    assert "a stride of 3.1 m, at 24.0 s" in line["reasons"][0]


def fed(looks: AxesCheck, scales: list[float], block: int = 64) -> None:
    """Give rows, t, acc, gyr and mag times `scales`, and their pressure, in blocks."""
    for start in range(0, len(rows()), block):
        looks.push(rows()[start : start + block] * [*scales, 1.0])


OWN, NEGATED, Z_NEGATED = ([1.0] * 4 + list(gyr) + [1.0] * 3 for gyr in ((1.0,) * 3, (-1.0,) * 3, (1.0, 1.0, -1.0)))


def test_wrong_axes_are_refused_in_the_first_minute_and_remarked_later() -> None:
    with pytest.raises(RecordingError, match="the rate about z has the wrong sign"):
        fed(AxesCheck(lambda words: None), Z_NEGATED)
    remarks: list[str] = []
    verdict = LineVerdict(remark=remarks.append)
    verdict.axes._passed_s = 61.0
    fed(verdict.axes, NEGATED)
    assert len(remarks) == 1
    assert "not to be used" in remarks[0]
    assert walked(verdict) == "not to be used"


def test_own_axes_are_taken_and_the_scale_of_gravity_is_seen() -> None:
    check = AxesCheck(lambda words: None)
    fed(check, OWN)
    assert check.evidence.against == 0.0
    assert np.median(check.evidence.gravity) == pytest.approx(9.81, abs=0.1)
    verdict = LineVerdict()
    fed(verdict.axes, [1.0] + [0.9] * 3 + [1.0] * 6)
    assert walked(verdict) == "doubtful"  # a scale of a tenth puts the end off by 2 of 27 m


def test_the_check_does_not_hang_on_the_blocks_in_which_rows_come() -> None:
    found = [AxesCheck(lambda words: None) for _ in range(2)]
    for one, block in zip(found, (7, 1000), strict=True):
        fed(one, OWN, block)
    np.testing.assert_allclose(found[0].evidence.scores, found[1].evidence.scores)


def test_a_revision_that_does_not_know_the_last_footfall_makes_no_stride_of_two_at_any_epoch() -> None:
    verdict, epoch = LineVerdict(), 1.7e9
    lines = [estimate(k, epoch + 1.2 * k, [1.6 * k, 0.0, 0.0]) for k in range(21)]
    verdict.judge(lines[:20], [False] * 21)
    older = Revision(lines[18].t, 0.5, (), np.array([[lines[18].t, *lines[18].position]]))
    (_, _), (_, found) = verdict.judge([older, lines[20]], [False] * 21)
    assert found.word == "trusted"


def test_a_place_that_is_known_to_decimeters_is_no_doubt_after_a_stride_and_to_meters_is() -> None:
    for sigma_m, count in ((0.2, 1), (9.0, 2)):
        lines = [estimate(k, 1.2 * k, [1.4 * k, 0.0, 0.0], sigma_m) for k in range(3)]
        assert all(len(found.reasons) == count for _, found in LineVerdict().judge(lines, [False] * 3))


def test_a_walk_is_not_trusted_before_enough_was_walked_and_its_axes_were_seen() -> None:
    verdict = LineVerdict()
    assert walked(verdict, 19) == "doubtful"  # no axes seen so far
    assert walked(verdict, 1, first=19) == "doubtful"
    assert walked(verdict, 1, first=20) == "trusted"  # such a sensor shows none
    verdict = LineVerdict()
    fed(verdict.axes, OWN)
    assert walked(verdict, 5) == "doubtful"  # four strides
    assert walked(verdict, 1, first=5) == "trusted"
    ((_, found),) = LineVerdict().judge([estimate(0, 0.0, [0.0, 0.0, 0.0])], [False])
    assert found.reasons == ("too little has been walked to know: 0 strides",)
