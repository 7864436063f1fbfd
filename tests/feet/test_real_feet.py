"""Pairs of feet as they were recorded: slow, short, of clocks that run apart, with turns on the spot."""

from pathlib import Path

import numpy as np
import pytest

from fg_nav.both_feet import FeetResult, navigate_feet
from fg_nav.evaluation.comparison import align
from tests.real_data import DATA, needs_data

pytestmark = needs_data


def navigate(left: str, right: str, **more: object) -> FeetResult:
    folder = DATA or Path()
    return navigate_feet(folder / left, folder / right, "inertial", sides="left,right", **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("clock_offset_s", [None, 0.0])
def test_a_slow_short_walk_with_a_turn_on_the_spot(clock_offset_s: float | None) -> None:
    result = navigate("feet_vicon/L_Foot.csv.gz", "feet_vicon/R_Foot.csv.gz", clock_offset_s=clock_offset_s)
    assert result.pairing.cells >= 2
    assert result.pairing.clock_offset_s == 0.0
    truth = np.load((DATA or Path()) / "feet_vicon" / "vicon.npz")
    for side, foot in result.feet.items():
        ankle, toe = (truth[side[0].upper() + name] for name in ("TIO", "TOE"))
        # The sensor is on the instep, between the two.
        place = ankle + 0.65 * (toe - ankle)
        known = np.isfinite(place).all(axis=1)
        error = (align(foot.position[known], place[known], "yaw").apply(foot.position[known]) - place[known])[:, :2]
        assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.03


def test_clocks_that_run_apart_by_a_percent() -> None:
    result = navigate("feet_2min/good_leftfoot.csv.gz", "feet_2min/good_rightfoot.csv.gz")
    assert result.pairing.clock_drift == pytest.approx(0.01, abs=0.002)
    assert result.pairing.cells > 20
    # The strides of both feet are of one length where both are on one clock.
    walked = [foot.metrics.distance_m for foot in result.feet.values()]
    assert walked[0] == pytest.approx(walked[1], rel=0.04)


@pytest.mark.parametrize("name", ["circle11m_24", "rectangle16m_16", "straight5m_4"])
def test_a_walk_of_some_strides(name: str) -> None:
    result = navigate(*(f"feet_thighs/{name}_{side}.csv.gz" for side in ("LF", "RF")))
    assert result.pairing.cells >= 2
    assert result.pairing.clock_offset_s == 0.0
    ends = [np.linalg.norm((foot.position[-1] - foot.position[0])[:2]) for foot in result.feet.values()]
    assert (np.abs(np.array(ends) - (5.0 if "straight" in name else 0.0)) < 0.35).all()
