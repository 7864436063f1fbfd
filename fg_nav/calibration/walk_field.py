"""The field at the footfalls of a walk with its magnetometer corrected by the walk itself or by a calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fg_nav.calibration.magnetometer import MagnetometerCalibration
from fg_nav.calibration.stride_readings import read_strides
from fg_nav.calibration.walk import find_iron, find_iron_sigma
from fg_nav.errors import CalibrationError
from fg_nav.magnetic.footfall_field import FootfallField, average_footfall_field
from fg_nav.recording import Recording
from fg_nav.stances import Stances


def find_own_iron(recording: Recording, stances: Stances) -> tuple[MagnetometerCalibration | None, str]:
    """Find the iron of a walk's own magnetometer, and describe it; None where the walk does not show it.

    Raises
    ------
    MagneticError
        Without a magnetometer that measures a field.
    """
    try:
        found = find_iron(read_strides(recording, stances))
    except CalibrationError as error:
        return None, f"iron of the magnetometer unknown: {error}"
    h, sigma = (", ".join(f"{x:.1f}" for x in v[:3]) for v in (found.hard_iron_uT, found.sigma))
    return found, f"magnetometer corrected by the walk itself: hard iron {h} uT, each known to {sigma}"


def average_corrected_field(
    recording: Recording, stances: Stances, heading: float, calibration: MagnetometerCalibration | None
) -> FootfallField:
    """Average the field over each footfall of a corrected recording, with the sigma of the iron that is left.

    Raises
    ------
    MagneticError
        As `average_footfall_field`.
    """
    field = average_footfall_field(recording, stances, heading)
    if calibration is None:
        return field
    return replace(field, iron_sigma_uT=np.tile(find_iron_sigma(calibration, field), (len(field), 1)))
