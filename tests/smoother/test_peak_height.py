"""How far clipped peaks rise above the range: the walk shows it, and what is rebuilt is raised to it."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection import detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.lab.simulation.motion import Style
from fg_nav.recording import Recording
from fg_nav.smoother.parameters import SmootherParameters
from fg_nav.smoother.problem import walk_problem
from tests.simulated import straight_walk

RANGE_RAD_S = 8.9
NOTE = "clipped peaks of the rate"


@pytest.fixture(scope="module")
def run() -> Recording:
    return straight_walk(style=Style.RUN, strides=20, seed=1).recording


@pytest.fixture(scope="module")
def clipped(run) -> Recording:
    return replace(run, gyr=np.clip(run.gyr, -RANGE_RAD_S, RANGE_RAD_S))


@pytest.fixture(scope="module")
def stances(clipped) -> Stances:
    return detect_stances(clipped)


def test_the_height_of_a_run_is_nearer_to_the_truth_than_its_flanks_say(run, clipped, stances):
    """These feet turn by half as much again above the range as a parabola on the flanks does."""
    found = walk_problem(clipped, stances, 0.0, SmootherParameters())
    assert any(note.startswith(NOTE) for note in found.known.notes)
    hidden = np.abs(run.gyr - clipped.gyr).sum()
    by_flanks, by_walk = (np.abs(some.peaks[1].whole - clipped.gyr).sum() for some in (clipped, found.recording))
    assert abs(by_walk - hidden) < 0.3 * abs(by_flanks - hidden)


def test_what_is_not_clipped_or_not_to_be_chosen_stays_as_it_is(run, clipped, stances):
    for recording, parameters in (
        (run, SmootherParameters()),
        (clipped, replace(SmootherParameters(), choose_swing_noise=False)),
    ):
        found = walk_problem(recording, stances, 0.0, parameters)
        assert found.recording is recording
        assert not any(note.startswith(NOTE) for note in found.known.notes)
