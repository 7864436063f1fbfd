"""The form of a calibration: what it undoes, and what it may not be."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.calibration import (
    LEVEL_FIELD_UT,
    UPPER,
    MagnetometerCalibration,
    check_strength,
    differentiate_inverse,
    matrix_of,
)
from fg_nav.errors import CalibrationError
from fg_nav.recording import Recording

HARD = np.array([14.0, -8.0, 3.0])
C = np.array([[1.1, 0.02, -0.03], [0.02, 0.9, 0.05], [-0.03, 0.05, 1.0]])


def calibration(**changed):
    usual = {"hard_iron_uT": HARD, "correction": C, "covariance": np.diag(np.arange(1.0, 10.0) ** 2)}
    return MagnetometerCalibration("by hand", **(usual | changed), strength_uT=48.0, residual_uT=0.5, samples=100)


def test_a_recording_is_corrected_row_by_row_and_keeps_its_gaps():
    field = np.random.default_rng(0).standard_normal((30, 3))
    mag = field @ np.linalg.inv(C).T + HARD
    mag[2] = np.nan
    still = np.zeros((30, 3))
    recording = Recording(np.arange(30) / 100.0, still, still, mag)
    corrected = calibration().apply_to(recording)
    assert np.delete(corrected.mag, 2, axis=0) == pytest.approx(np.delete(field, 2, axis=0))
    assert np.isnan(corrected.mag[2]).all()
    assert corrected.acc is recording.acc
    assert recording.mag[0] == pytest.approx(mag[0])
    assert calibration().parameters == pytest.approx([14.0, -8.0, 3.0, 1.1, 0.02, -0.03, 0.9, 0.05, 1.0])
    assert calibration().sigma == pytest.approx(np.arange(1.0, 10.0))
    with pytest.raises(CalibrationError, match="no magnetometer"):
        calibration().apply_to(replace(recording, mag=None))


def test_what_cannot_be_is_refused():
    for changed, words in (
        ({"hard_iron_uT": np.zeros(2)}, "hard_iron_uT"),
        ({"correction": np.eye(2)}, "correction"),
        ({"covariance": np.eye(6)}, "covariance"),
        ({"hard_iron_uT": np.array([0.0, np.nan, 0.0])}, "finite"),
        ({"correction": np.triu(C)}, "symmetric"),
        ({"correction": np.diag([1.0, 1.0, -1.0])}, "turns a field round"),
        ({"correction": np.diag([1.0, 1.0, 0.0])}, "turns a field round"),
    ):
        with pytest.raises(CalibrationError, match=words):
            calibration(**changed)


def test_the_slope_of_an_inverse_is_its_change():
    assert matrix_of(C[UPPER]) == pytest.approx(C)
    step = 1e-6
    ahead, behind = (
        np.stack([np.linalg.inv(matrix_of(C[UPPER] + sign * step * one))[UPPER] for one in np.eye(6)], axis=1)
        for sign in (1, -1)
    )
    assert differentiate_inverse(C)[3:, 3:] == pytest.approx((ahead - behind) / (2 * step), abs=1e-8)
    assert (differentiate_inverse(C)[:3] == np.eye(9)[:3]).all()


def test_a_field_that_earth_has_passes_and_others_do_not():
    for strength in (22.0, 48.0, 67.0):
        check_strength(strength)
    check_strength(4.0, LEVEL_FIELD_UT)
    for strength in (0.3, 4.0, 48e-6, 48e3, np.nan):
        with pytest.raises(CalibrationError, match=r"uT strong, and .* readings in uT"):
            check_strength(strength)
