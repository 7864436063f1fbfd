"""Footfalls as calibrations look at them: some of them, corrected, how they stand, how far their compass spreads."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.calibration.magnetometer import MagnetometerCalibration
from fg_nav.magnetic.footfall_field import FootfallField


def some_of(field: FootfallField, chosen: Bools) -> FootfallField:
    """Those footfalls for which `chosen` (F,) holds."""
    return FootfallField(*(getattr(field, f.name)[chosen] for f in fields(field)))


def corrected_field(field: FootfallField, calibration: MagnetometerCalibration) -> FootfallField:
    """Return the field at the footfalls as a corrected magnetometer would have it; its scatter and slope stay."""
    return replace(field, body_field=calibration.corrected(field.body_field))


def circular_sd_deg(angle: Floats) -> float:
    """Circular standard deviation, deg, of angles (N,) rad; NaN ones are left out."""
    resultant = min(float(np.abs(np.nanmean(np.exp(1j * angle)))), 1.0)
    return float(np.degrees(np.sqrt(-2 * np.log(max(resultant, 1e-12)))))


def mean_up(nav_R_body: Floats) -> Floats:
    """Mean direction (3,) of up in the body, of attitudes (F, 3, 3)."""
    up = nav_R_body[:, 2].sum(axis=0)
    return np.asarray(up / np.linalg.norm(up))
