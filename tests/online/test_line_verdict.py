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
        ((one, found),) = verdict.judge([estimate(21, t + 1.2, position)], [False] * 22)
        line = json.loads(format_estimate(one, False, verdict=found))
        assert (line["verdict"], line["reasons"]) == (word, list(found.reasons))


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


def test_a_map_that_is_revised_is_no_stride_and_no_speed() -> None:
    """Nor is one that does not know the last footfall yet, at any epoch."""
    verdict = LineVerdict()
    walked(verdict)
    revision = Revision(22.8, 0.5, (), np.array([[0.0, 0.0, 0.0, 0.0], [22.8, 0.0, 26.6, 0.0]]))
    (_, none), (_, found) = verdict.judge([revision, estimate(20, 24.0, [0.0, 28.0, 0.0])], [False] * 21)
    assert (none, found.word) == (None, "trusted")
    verdict, epoch = LineVerdict(), 1.7e9
    lines = [estimate(k, epoch + 1.2 * k, [1.6 * k, 0.0, 0.0]) for k in range(21)]
    verdict.judge(lines[:20], [False] * 21)
    older = Revision(lines[18].t, 0.5, (), np.array([[lines[18].t, *lines[18].position]]))
    (_, _), (_, found) = verdict.judge([older, lines[20]], [False] * 21)
    assert found.word == "trusted"
