"""What each line of a walk in progress says of it: the verdict by its limits and axes, and the floor."""

import json
from functools import cache, reduce

import numpy as np
import pytest

from fg_nav.detection.source import AxesCheck
from fg_nav.errors import RecordingError
from fg_nav.lab.simulation import simulate
from fg_nav.online.buffer import rows_of
from fg_nav.online.estimates import Revision, StanceEstimate, format_estimate
from fg_nav.online.follow import LineVerdict
from fg_nav.online.strides import FloorTrack, number_floors, track_floors


@cache
def rows() -> np.ndarray:
    found = rows_of(simulate("demo", 4).recording)
    return found[found[:, 0] < 20.0]


def feed(looks: AxesCheck, acc: float = 1.0, gyr: tuple[float, ...] = (1.0, 1.0, 1.0)) -> None:
    for start in range(0, len(rows()), 64):
        looks.push(rows()[start : start + 64] * [1.0, acc, acc, acc, *gyr, 1.0, 1.0, 1.0, 1.0])


def seen() -> LineVerdict:
    verdict = LineVerdict()
    feed(verdict.axes)
    return verdict


def estimate(number: int, t: float, position: list[float], sigma_m: float = 0.05) -> StanceEstimate:
    cov, zero = np.diag([sigma_m**2] * 3 + [0.01]), np.zeros(3)
    return StanceEstimate(number, number, t, np.array(position), np.eye(3), 0.0, zero, zero, cov, zero, 0.0, "none", "")


def judge(verdict: LineVerdict, *lines: StanceEstimate | Revision):
    return verdict.judge(lines, [False] * 30)[-1][1]


def walk(verdict: LineVerdict, count: int = 20, first: int = 0) -> str:
    """Strides of 1.4 m, and the word of the last line."""
    return [judge(verdict, estimate(k, 1.2 * k, [1.4 * k, 0.0, 0.0])).word for k in range(first, first + count)][-1]


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
def test_a_line_beyond_the_limits_of_a_person_says_so(t, position, sigma_m, word) -> None:
    verdict = seen()
    assert walk(verdict) == "trusted"
    assert judge(verdict, estimate(20, t, position, sigma_m)).word == word
    if word != "trusted" and sigma_m < 1.0:
        one = estimate(21, t + 1.2, position)
        found = judge(verdict, one)
        line = json.loads(format_estimate(one, False, verdict=found))
        assert (line["verdict"], line["reasons"]) == (word, list(found.reasons))


def test_wrong_axes_are_refused_in_the_first_minute_and_remarked_later() -> None:
    with pytest.raises(RecordingError, match="the rate about z has the wrong sign"):
        feed(AxesCheck(lambda words: None), gyr=(1.0, 1.0, -1.0))
    remarks: list[str] = []
    verdict = LineVerdict(remark=remarks.append)
    verdict.axes._passed_s = 61.0
    feed(verdict.axes, gyr=(-1.0, -1.0, -1.0))
    assert ["not to be used" in words for words in remarks] == [True]
    assert walk(verdict) == "not to be used"


def test_own_axes_are_taken_and_the_scale_of_gravity_is_seen() -> None:
    evidence = seen().axes.evidence
    assert evidence.against == 0.0
    assert np.median(evidence.gravity) == pytest.approx(9.81, abs=0.1)
    verdict = LineVerdict()
    feed(verdict.axes, acc=0.9)
    assert walk(verdict) == "doubtful"  # a scale of a tenth puts the end off by 2 of 27 m


def test_a_walk_is_not_trusted_before_enough_was_walked_and_its_axes_were_seen() -> None:
    unseen, known = LineVerdict(), seen()
    assert walk(unseen, 19) == "doubtful"  # no axes seen so far
    assert walk(unseen, 1, first=19) == "doubtful"
    assert walk(unseen, 1, first=20) == "trusted"  # such a sensor shows none
    assert walk(known, 5) == "doubtful"  # four strides
    assert walk(known, 1, first=5) == "trusted"
    first = judge(LineVerdict(), estimate(0, 0.0, [0.0, 0.0, 0.0]))
    assert first.reasons == ("too little has been walked to know: 0 strides",)


def test_a_map_that_is_revised_is_no_stride_and_no_speed() -> None:
    """Nor is one that does not know the last footfall yet, at any epoch."""
    verdict = LineVerdict()
    walk(verdict)
    revision = Revision(22.8, 0.5, (), np.array([[0.0, 0.0, 0.0, 0.0], [22.8, 0.0, 26.6, 0.0]]))
    assert judge(verdict, revision, estimate(20, 24.0, [0.0, 28.0, 0.0])).word == "trusted"
    assert judge(verdict, revision) is None
    standing = seen()
    walk(standing)
    assert standing.judge([estimate(20, 36.0, [26.6, 0.0, 0.0])], [True] * 30)[-1][1].word == "trusted"
    verdict, epoch = LineVerdict(), 1.7e9
    lines = [estimate(k, epoch + 1.2 * k, [1.6 * k, 0.0, 0.0]) for k in range(21)]
    judge(verdict, *lines[:20])
    older = Revision(lines[18].t, 0.5, (), np.array([[lines[18].t, *lines[18].position]]))
    assert judge(verdict, older, lines[20]).word == "trusted"


# --- the number of the floor -----------------------------------------------------------------------------------------


FLIGHT = [0.34] * 5
CORRIDOR = [0.0] * 12


def numbers_of(climbs: list[float]) -> list[int | None]:
    """Number at each footfall of a walk that climbs by so much a stride."""
    drifted = reduce(FloorTrack.add, [3.3] * 4, FloorTrack((0.0, 3.0), None, 0.3, (1.0, 2.0, 3.0, 3.3)))
    assert (drifted.on, drifted.floors) == (1, (0.0, 3.0))  # heights have drifted by that since
    track, found = FloorTrack(), []
    for height in np.cumsum(climbs).tolist():
        track = track.add(height)
        found.append(track.number)
    return found


def test_stairs_lead_from_floor_to_floor_and_back() -> None:
    down = [-x for x in FLIGHT]
    numbers = numbers_of(
        [*CORRIDOR, *FLIGHT, 0.0, *FLIGHT, *CORRIDOR, *down, 0.0, *down, *CORRIDOR, *down, *down, *CORRIDOR]
    )
    assert numbers[:12] == [0] * 12
    assert numbers[12:25] == [None] * 11 + [None] * 2
    assert numbers[26:35] == [1] * 9
    assert set(numbers[35:46]) == {None}
    assert numbers[49:58] == [0] * 9
    assert numbers[-8:] == [-1] * 8


@pytest.mark.parametrize(("a_stride", "number"), [(0.01, 0), (-0.01, 0), (0.07, None)])
def test_a_gentle_slope_or_a_drift_is_the_same_floor_and_a_ramp_is_none(a_stride: float, number: int | None) -> None:
    assert numbers_of([*CORRIDOR, *[a_stride] * 300])[-1] == number


def test_a_kerb_and_a_floor_that_is_met_again_elsewhere_begin_no_number() -> None:
    assert number_floors([0.0, 0.15, 3.2, 3.5, 6.4, -3.1, -1.6, 1.7]) == [0, 0, 1, 1, 2, -1, None, None]
    assert set(numbers_of([*CORRIDOR, 0.15, *CORRIDOR][-4:])) == {0}


def test_a_solution_of_the_walk_says_on_which_floor_it_is() -> None:
    heights = np.concatenate([np.zeros(6), [0.5, 1.0, 1.5, 2.0, 2.5], np.full(4, 3.0), [3.0]])
    floor = np.array([0] * 6 + [-1] * 5 + [1] * 4 + [-1])
    pieces = np.zeros(len(heights), dtype=bool)
    assert track_floors(heights, floor, pieces).number == 1
    assert track_floors(heights[:9], floor[:9], pieces[:9]).number is None
    assert track_floors(heights[:4], None, pieces[:4]).number == 0
    # A standing on a stair, in pieces, is no floor.
    standing = np.concatenate([np.zeros(4), np.full(6, 2.5)])
    assert track_floors(standing, None, np.arange(10) > 4).number is None
    assert reduce(FloorTrack.add, [3.0] * 4, track_floors(heights[:9], floor[:9], pieces[:9])).number == 1
