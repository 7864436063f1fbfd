"""A walk that is tied to places known from an earlier one is solved in that one's frame, with its start to be found."""

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.smoother import smooth
from fg_nav.smoother.constraints import KnownTies
from fg_nav.solution import Solution
from tests.smoother.walks import demo

SHIFT, TURN = np.array([1.0, -0.7, 0.3]), np.deg2rad(12.0)
SIGMA_M = 0.2


@pytest.fixture(scope="module")
def free() -> Solution:
    recording = demo().recording
    return smooth(recording, detect_stances(recording), heading=0.0)


def tie(free: Solution, every: int, arm: np.ndarray) -> KnownTies:
    """Tie every so many-th footfall, by a point next to it, to its place on a path that is moved and turned."""
    table = free.stances
    rows = np.arange(0, len(table), every)
    point = table.position[rows] + np.einsum("kij,j->ki", table.nav_R_body[rows], arm)
    place = SHIFT + point @ yaw_rotation(TURN).T
    count = len(rows)
    return KnownTies(table.t[rows], np.tile(arm, (count, 1)), place, np.tile(SIGMA_M**2 * np.eye(3), (count, 1, 1)))


@pytest.mark.parametrize("arm", [np.zeros(3), np.array([0.4, -0.8, 0.1])], ids=["at the footfall", "next to it"])
def test_start_and_heading_follow_the_known_places(free: Solution, arm: np.ndarray) -> None:
    recording = demo().recording
    tied = smooth(recording, detect_stances(recording), heading=0.0, known=tie(free, 5, arm))
    assert tied.stances.position == pytest.approx(SHIFT + free.stances.position @ yaw_rotation(TURN).T, abs=0.05)
    turned = compute_heading(free.stances.nav_R_body) - compute_heading(tied.stances.nav_R_body)
    assert np.angle(np.exp(1j * (turned - TURN))) == pytest.approx(0.0, abs=np.deg2rad(0.5))
    assert tied.graph["known_place"] == len(tie(free, 5, arm).t)


def test_the_sigma_of_the_start_is_that_of_the_ties(free: Solution) -> None:
    recording = demo().recording
    few, many = (
        smooth(recording, detect_stances(recording), heading=0.0, known=tie(free, every, np.zeros(3))).stances
        for every in (20, 2)
    )
    assert (many.position_sigma[0] < few.position_sigma[0]).all()
    assert (few.position_sigma[0, :2] < 1.5 * SIGMA_M).all()
    assert many.position_sigma[0, 0] > SIGMA_M / np.sqrt(len(many) / 2)
    assert free.stances.position_sigma[0].max() < 0.01
    assert few.heading_sigma[0] > free.stances.heading_sigma[0]
