"""From a recording to its stances: one threshold, footfalls, and what is said where nothing is found."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection import StanceParameters, detect_stances
from fg_nav.detection import stance as stance_module
from fg_nav.detection.stance import ACC_NOISE_M_S2, GYR_NOISE_DEG_S, STATISTICS
from fg_nav.errors import DetectionError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation.motion import Style
from fg_nav.lab.simulation.person import Mount, Person
from fg_nav.recording import Recording
from tests.simulated import WALKERS, straight_walk


def standing(seconds, seed=0):
    """A sensor at rest, with its nominal noise."""
    rng = np.random.default_rng(seed)
    n = round(seconds * 200)
    acc = np.array([0.0, 0.0, GRAVITY_M_S2]) + ACC_NOISE_M_S2 * rng.standard_normal((n, 3))
    return Recording(t=np.arange(n) / 200, acc=acc, gyr=np.radians(GYR_NOISE_DEG_S) * rng.standard_normal((n, 3)))


def with_turns(recording, rate_rad_s, at_s, lasting_s=0.15):
    """The same, turning at a rate for a moment at each of these times."""
    gyr = recording.gyr.copy()
    for begin in at_s:
        gyr[(recording.t >= begin) & (recording.t < begin + lasting_s), 1] += rate_rad_s
    return replace(recording, gyr=gyr)


# one threshold


@pytest.mark.parametrize("detector", STATISTICS)
def test_one_threshold_cuts_the_statistic_at_that_level(detector, monkeypatch):
    """And the window is a time."""
    monkeypatch.setattr(stance_module, "MIN_S", 0.0)
    for rate_hz in (200.0, 800.0):
        recording = straight_walk(strides=3, rate_hz=rate_hz).recording
        statistic = STATISTICS[detector](recording.acc, recording.gyr, round(0.05 * rate_hz))
        threshold = float(np.quantile(statistic, 0.4))
        stances = detect_stances(recording, StanceParameters(detector, threshold=threshold))
        np.testing.assert_array_equal(stances.mask, statistic < threshold)
        np.testing.assert_allclose(stances.statistic, statistic / threshold)
        assert (stances.detector, stances.threshold, stances.n_samples) == (detector, threshold, len(recording))


def test_stances_shorter_than_the_shortest_are_dropped(monkeypatch):
    monkeypatch.setattr(stance_module, "MIN_S", 0.0)
    recording = with_turns(standing(4.0), 1.0, [0.5, 0.8, 2.0, 2.4])
    found = detect_stances(recording, StanceParameters("are", threshold=100.0))
    lasting = recording.t[found.stop - 1] - recording.t[found.start]
    assert np.count_nonzero(lasting < 0.3) == 2
    monkeypatch.setattr(stance_module, "MIN_S", 0.3)
    kept = detect_stances(recording, StanceParameters("are", threshold=100.0))
    np.testing.assert_array_equal(kept.start, found.start[lasting >= 0.3])
    np.testing.assert_array_equal(kept.stop, found.stop[lasting >= 0.3])


# footfalls


def test_a_foot_that_fidgets_on_the_ground_makes_one_footfall_and_a_swing_divides():
    assert detect_stances(with_turns(standing(4.0), 1.5, [1.0, 2.0, 2.6])).footfall.tolist() == [0, 0, 0, 0]
    assert detect_stances(with_turns(standing(4.0), 3.0, [1.0], lasting_s=0.5)).footfall.tolist() == [0, 1]
    stances = detect_stances(standing(5.0))
    assert (stances.start.tolist(), stances.stop.tolist(), stances.n_footfalls) == ([0], [1000], 1)
    assert len(detect_stances(standing(0.1))) == 1


@WALKERS
def test_fidgets_and_swings_are_told_apart_in_one_recording(person: Person, mount: Mount):
    walk = straight_walk(person, strides=4, standing_s=3.0, mount=mount)
    stances = detect_stances(with_turns(walk.recording, 1.5, [0.8, 1.6]))
    assert stances.n_footfalls == 5
    assert np.count_nonzero(stances.footfall == 0) == 3
    assert detect_stances(walk.recording, StanceParameters(threshold=3e4)).n_footfalls == 5


# the statistic over the threshold


@WALKERS
@pytest.mark.parametrize("style", [Style.WALK, Style.RUN], ids=["walk", "run"])
def test_the_statistic_is_relative_to_the_threshold_of_the_nearest_stance(person: Person, mount: Mount, style: Style):
    walk = straight_walk(person, style, strides=6, mount=mount)
    stances = detect_stances(walk.recording)
    assert stances.statistic is not None
    assert stances.statistic[stances.mask].max() < 1.0
    before, after = stances.start[1:] - 1, stances.stop[:-1]  # the threshold is where the stance ends
    assert stances.statistic[before].min() >= 1.0
    assert stances.statistic[after].min() >= 1.0


# nothing found, nothing sensible asked


def refused(recording, **parameters):
    with pytest.raises(DetectionError) as error:
        detect_stances(recording, StanceParameters(**parameters))
    message = str(error.value)
    assert "\n" not in message
    assert message.endswith(("?", "."))
    return message


def test_what_cannot_be_is_refused():
    still = standing(2.0)
    for parameters, words in (
        ({"detector": "glrt"}, "there is no stance detector 'glrt': choose one of shoe, are, mv, mag."),
        ({"detector": "are"}, "give are a threshold or a false-alarm rate"),
        ({"threshold": 10.0, "false_alarm_rate": 0.01}, "choose one of them"),
        ({"false_alarm_rate": 0.0}, "between 0 and 1"),
        ({"false_alarm_rate": 20.0}, "between 0 and 1"),
        ({"false_alarm_rate": np.nan}, "between 0 and 1"),
        ({"threshold": 1e-3}, "the threshold 0.001; raise it"),
    ):
        assert words in refused(still, **parameters)
    turning = refused(replace(still, gyr=still.gyr + np.array([0.0, 0.0, 5.0])))
    assert "no stance was found in 2.0 s" in turning
    assert "turns at 286 deg/s with a specific force of 9.8 m/s^2" in turning
    for acc in (still.acc - np.array([0, 0, GRAVITY_M_S2]), 0.0 * still.acc):
        assert "specific force of 0.0" in refused(replace(still, acc=acc))


@WALKERS
@pytest.mark.parametrize(("style", "pace"), [(Style.WALK, 2.5), (Style.RUN, 1.0)], ids=["brisk", "run"])
def test_a_swing_alone(person: Person, mount: Mount, style: Style, pace: float):
    """Of a slower one the middle may pass for a stance: nothing else is there to compare it with."""
    walk = straight_walk(person, style, strides=4, pace=pace, mount=mount)
    begin, end = walk.swing[2]
    a, b = np.searchsorted(walk.recording.t, [begin + 0.15 * (end - begin), end - 0.15 * (end - begin)])
    assert "no stance was found" in refused(walk.recording.slice(a, b))
