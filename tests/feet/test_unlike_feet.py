"""Two feet whose recordings are unlike: other rates, starts and clocks, a field of one alone; who runs; real ones."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fg_nav import navigate as navigate_one
from fg_nav.both_feet import FeetResult, navigate_feet
from fg_nav.evaluation.comparison import align
from fg_nav.lab.simulation import simulate_feet
from fg_nav.recording import Recording
from fg_nav.walk import Options
from tests.feet.walks import demo_feet, without_field
from tests.real_data import DATA, needs_data


def navigate(feet: Mapping[str, Recording], **more: object) -> FeetResult:
    return navigate_feet(feet["left"], feet["right"], sides="left,right", **more)  # type: ignore[arg-type]


def halve_rate(recording: Recording) -> Recording:
    """The mean of two samples each, as of a sensor of half the rate."""
    n = len(recording) // 2 * 2
    acc, gyr = (x[:n].reshape(-1, 2, 3).mean(axis=1) for x in (recording.acc, recording.gyr))
    return Recording(recording.t[0:n:2], acc, gyr, truth=recording.truth)


def cut(recording: Recording, begin: float, end: float) -> Recording:
    kept = (recording.t < begin) | (recording.t > end)
    return Recording(recording.t[kept], recording.acc[kept], recording.gyr[kept], truth=recording.truth)


def test_one_sensor_of_half_the_rate() -> None:
    result = navigate({**without_field(), "right": halve_rate(without_field()["right"])})
    assert result.verdict.word == "trusted"
    assert result.pairing.cells > 8
    assert result.metrics.rmse_2d_m < 0.1


@pytest.mark.parametrize("late", ["left", "both"])
def test_a_recording_that_begins_amid_the_walk(late: str) -> None:
    """Nobody stood still first: the bias is less known, and both feet still go on from where they are."""
    cut = {
        side: one.slice(int(np.searchsorted(one.t, 14.0)), len(one)) if late in (side, "both") else one
        for side, one in without_field().items()
    }
    result = navigate(cut)
    assert result.pairing.cells > 5
    assert result.metrics.rmse_2d_m < 0.3


@pytest.mark.parametrize(("side", "heading_deg"), [("left", None), ("right", 40.0)])
def test_a_field_of_one_foot_is_for_both(side: str, heading_deg: float | None) -> None:
    """The one magnetometer holds the heading of both; which foot it is on makes no difference to the shape."""
    bare = {one: foot.recording for one, foot in demo_feet().sides.items()} | {side: without_field()[side]}
    result = navigate(bare, heading_deg=heading_deg)
    assert result.verdict.word == "trusted"
    assert result.metrics.rmse_2d_m < 0.15
    for one, foot in result.feet.items():
        used = bare[one].mag is not None
        assert foot.outcome.field_used is used
        assert foot.metrics.rmse_2d_m < 0.15
    if heading_deg is not None:
        start = result.feet["left"].stances.nav_R_body[0]
        assert np.degrees(np.arctan2(start[0, 0], start[1, 0])) == pytest.approx(heading_deg, abs=1.0)


def test_who_runs_steps_in_turn_too() -> None:
    """From the second half of the first minute on, for forty seconds."""
    whole = {side: one.recording for side, one in simulate_feet("mixed-gait", 2).sides.items()}
    feet = {side: replace(one, mag=None).slice(0, int(np.searchsorted(one.t, 105.0))) for side, one in whole.items()}
    result = navigate(feet, options=Options())
    assert result.pairing.cells > 10
    assert result.pairing.width_m > 0.0
    assert result.metrics.rmse_2d_m < 0.3


@pytest.mark.parametrize(("side", "hole"), [("left", (8.0, 30.0)), ("right", (40.0, 60.0))])
def test_a_part_of_a_few_steps_about_a_hole_is_left_out(side: str, hole: tuple[float, float]) -> None:
    """Nothing ties it: with it both feet had no solution, or the end was known to no one."""
    bare = without_field()
    result = navigate({**bare, side: cut(bare[side], *hole)})
    assert result.verdict.word == "trusted"
    assert max(foot.metrics.rmse_2d_m for foot in result.feet.values()) < 0.1
    notes = dict(result.feet)[side].walk.recording.provenance.notes
    assert any("too few footfalls to be laid beside the other foot" in note for note in notes)


def test_where_the_other_foot_failed_the_longest_part_is_used_as_of_a_foot_alone() -> None:
    bare = without_field()
    broken = cut(bare["left"], 45.0, 52.0)
    result = navigate({"left": broken, "right": cut(bare["right"], 2.0, 200.0)})
    assert set(result.feet) == {"left"}
    alone = navigate_one(broken.slice(0, int(np.searchsorted(broken.t, 48.0))))
    np.testing.assert_allclose(result.feet["left"].position, alone.position, atol=1e-6)
    assert result.verdict.word == "doubtful"
    assert all("nothing was recorded" not in reason for reason in result.verdict.reasons)


# --- as they were recorded -------------------------------------------------------------------------------------------


def navigate_files(left: str, right: str, **more: object) -> FeetResult:
    folder = DATA or Path()
    return navigate_feet(folder / left, folder / right, "inertial", sides="left,right", **more)  # type: ignore[arg-type]


@needs_data
@pytest.mark.parametrize("clock_offset_s", [None, 0.0])
def test_a_slow_short_walk_with_a_turn_on_the_spot(clock_offset_s: float | None) -> None:
    result = navigate_files("feet_vicon/L_Foot.csv.gz", "feet_vicon/R_Foot.csv.gz", clock_offset_s=clock_offset_s)
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


@needs_data
def test_clocks_that_run_apart_by_a_percent() -> None:
    result = navigate_files("feet_2min/good_leftfoot.csv.gz", "feet_2min/good_rightfoot.csv.gz")
    assert result.pairing.clock_drift == pytest.approx(0.01, abs=0.002)
    assert result.pairing.cells > 20
    # The strides of both feet are of one length where both are on one clock.
    walked = [foot.metrics.distance_m for foot in result.feet.values()]
    assert walked[0] == pytest.approx(walked[1], rel=0.04)


@needs_data
@pytest.mark.parametrize("name", ["circle11m_24", "rectangle16m_16", "straight5m_4"])
def test_a_walk_of_some_strides(name: str) -> None:
    result = navigate_files(*(f"feet_thighs/{name}_{side}.csv.gz" for side in ("LF", "RF")))
    assert result.pairing.cells >= 2
    assert result.pairing.clock_offset_s == 0.0
    ends = [np.linalg.norm((foot.position[-1] - foot.position[0])[:2]) for foot in result.feet.values()]
    assert (np.abs(np.array(ends) - (5.0 if "straight" in name else 0.0)) < 0.35).all()
