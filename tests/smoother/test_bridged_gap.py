"""A gap of some tenths of a second in a file: the walk goes on behind it, less certain, and says so."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.ekf import run_iez
from fg_nav.lab.walked import measure_walk
from fg_nav.recording import RawRecording, Recording
from fg_nav.smoother import smooth
from fg_nav.truth import TrajectoryTruth
from tests.smoother.walks import demo


def holed(lost_s: float) -> Recording:
    """The demonstration with a hole in a swing in its middle."""
    walk = demo(1)
    recording, stances = walk.recording, walk.stances
    first = int(stances.stop[len(stances) // 2]) + 10
    keep = np.ones(len(recording), dtype=bool)
    keep[first : first + round(lost_s / recording.period_s)] = False
    raw = RawRecording(recording.t[keep], recording.acc[keep], recording.gyr[keep], np.flatnonzero(keep))
    return replace(Recording.from_raw(raw), truth=recording.truth)


@pytest.mark.parametrize("estimate", [smooth, run_iez])
def test_a_gap_in_a_swing_is_bridged_with_larger_sigmas(estimate) -> None:
    recording = holed(0.2)
    assert "bridged" in recording.provenance.notes[0]
    solution, whole = estimate(recording, detect_stances(recording)), estimate(demo(1).recording, demo(1).stances)
    assert len(solution.stances) == len(whole.stances)
    assert isinstance(recording.truth, TrajectoryTruth)
    errors = measure_walk(solution, recording.truth)
    assert np.radians(errors.heading_deg) < 3 * solution.stances.heading_sigma[-1]
    sigma = np.linalg.norm(solution.stances.position_sigma[-1, :2])
    assert errors.end_m < 3 * sigma
    assert sigma > 3 * np.linalg.norm(whole.stances.position_sigma[-1, :2])
    before = len(solution.stances) // 2 - 2
    np.testing.assert_allclose(
        solution.stances.position_sigma[before], whole.stances.position_sigma[before], rtol=0.3, atol=0.01
    )
