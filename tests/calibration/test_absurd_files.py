"""Calibration files that no sensor has are refused in one sentence when they are read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fg_nav.calibration import MagnetometerCalibration
from fg_nav.calibration.of_recording import Calibration, read_calibration, write_calibration
from fg_nav.errors import CalibrationError

GOOD = MagnetometerCalibration("walk", np.array([5.0, -3.0, 20.0]), np.eye(3), 0.01 * np.eye(9), 48.0, 0.5, 100)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("hard_iron_uT", [1e6, 0.0, 0.0]),
        ("hard_iron_uT", [float("nan"), 0.0, 0.0]),
        ("hard_iron_uT", [1e300, 0.0, 0.0]),
        ("hard_iron_uT", [1.0, 2.0]),
        ("hard_iron_uT", "much"),
        ("correction", (50.0 * np.eye(3)).tolist()),
        ("covariance", (-np.eye(9)).tolist()),
        ("covariance", (np.eye(9) + np.eye(9, k=1)).tolist()),
        ("covariance", (np.eye(9) + 5.0 * (np.eye(9, k=1) + np.eye(9, k=-1))).tolist()),
        ("covariance", (1e300 * np.eye(9)).tolist()),
    ],
)
def test_absurd_magnetometers(key: str, value: Any, tmp_path: Path) -> None:
    path = tmp_path / "cal.json"
    write_calibration(path, Calibration(magnetometer=GOOD))
    assert read_calibration(path).magnetometer is not None
    content = json.loads(path.read_text())
    content["magnetometer"][key] = value
    path.write_text(json.dumps(content))
    with pytest.raises(CalibrationError, match=r"cal.json.*calibrate again|cal.json: .* must be"):
        read_calibration(path)
