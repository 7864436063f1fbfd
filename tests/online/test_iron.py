"""The iron of the magnetometer in a walk in progress: found by the walk so far, taken off what follows."""

from dataclasses import replace
from functools import cache

import numpy as np

from fg_nav.calibration import MagnetometerCalibration
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.smoother import OnlineSmoother
from tests.online.test_online_smoother import FOOTFALLS, farthest, fed, in_field, polished
from tests.smoother.walks import Walk

IRON_UT = np.array([14.0, -9.0, 20.0])


@cache
def with_iron() -> Walk:
    walk = in_field()
    return Walk(replace(walk.recording, mag=walk.recording.mag + IRON_UT), walk.stances)


@cache
def online() -> OnlineSmoother:
    return fed(with_iron())


def test_it_is_found_by_the_walk_and_ends_where_the_batch_ends():
    iron = online().walk.sensor.iron
    assert iron is not None
    assert (np.abs(iron.hard_iron_uT - IRON_UT) < 4.0 * iron.sigma[:3]).all()
    assert any("corrected by the walk itself" in note for note in online().initial.notes)
    assert farthest(online().smoothed(), polished(with_iron()).stances) < 0.10
    weight = online().smoothed().compass_weight
    assert weight.shape == (FOOTFALLS,)
    assert ((weight > 0.0) & (weight <= 1.0)).all()
    assert 0.3 < (weight == 1.0).mean() < 0.9


def test_a_part_is_corrected_and_the_whole_is_not():
    walk, raw = online().walk, with_iron().recording.mag
    np.testing.assert_array_equal(walk.cut_whole().mag, raw[: walk.stop])
    corrected = walk.sensor.iron.correct(raw[walk.stop - 500 : walk.stop])
    np.testing.assert_array_equal(walk.cut_recording(walk.stop - 500).mag, corrected)


def test_with_a_calibration_the_samples_stay_as_they_are():
    given = MagnetometerCalibration("loop", IRON_UT, np.eye(3), 0.01 * np.eye(9), 48.0, 1.0, 1000)
    options = OnlineOptions(calibration=given)
    calibrated = fed(in_field(), options)
    assert calibrated.walk.sensor.iron is None
    assert not any("by the walk itself" in note for note in calibrated.initial.notes)
    assert farthest(calibrated.smoothed(), polished(in_field(), options).stances) < 0.10
