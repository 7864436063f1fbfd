"""Fixes of a satellite receiver: level axes of an origin, errors that last, and outliers.

A receiver's error lasts, so fixes less than `CORRELATED_S` apart share the information of one. Walls and the first
seconds after a start put some off by many sigmas, so residuals are Cauchy's: at `CAUCHY` sigmas a fix counts half.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Bools, Floats
from fg_nav.errors import EstimationError
from fg_nav.frames import yaw_rotation
from fg_nav.truth import Fix

CORRELATED_S = 10.0  # a receiver's filter, and the walls about it, keep an error for so long
CAUCHY = 2.0  # residual in sigmas at which a fix counts half

MIN_FIXES = 3

TURNS = 72  # directions that are tried


@dataclass(frozen=True)
class Gnss:
    """Fixes in the recording's time, m east and north of an origin at these geodetic degrees; heights are not used."""

    fixes: tuple[Fix, ...]
    latitude_deg: float
    longitude_deg: float

    def locate(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Latitude and longitude, deg, of a place."""
        from pymap3d import enu2geodetic

        latitude, longitude, _ = enu2geodetic(east_m, north_m, 0.0, self.latitude_deg, self.longitude_deg, 0.0)
        return float(latitude), float(longitude)


@dataclass(frozen=True)
class FixColumns:
    """Fixes: `time` (K,) s, `place` (K, 2) m, and `sigma` (K,) m by which each counts as an independent one."""

    time: Floats
    place: Floats
    sigma: Floats


def select_fixes(fixes: Sequence[Fix], begin_s: float, end_s: float) -> FixColumns:
    """Return the fixes in a walk, sigmas raised for their correlation; raises `EstimationError` if too few."""
    inside = sorted((fix for fix in fixes if begin_s <= fix.time_s <= end_s), key=lambda fix: fix.time_s)
    if len(inside) < MIN_FIXES:
        raise EstimationError(
            f"{len(inside)} of {len(fixes)} fixes are within the walk, which lasts from {begin_s:.1f} s to {end_s:.1f} "
            f"s, and {MIN_FIXES} are needed: give fixes in the recording's own time, or leave --gnss out."
        )
    time = np.array([fix.time_s for fix in inside])
    place = np.array([fix.position[:2] for fix in inside])
    sharing = np.sqrt(np.clip(CORRELATED_S / np.maximum(np.gradient(time), 1e-3), 1.0, None))
    return FixColumns(time, place, sharing * np.array([fix.horizontal_sigma_m for fix in inside]))


def find_turn(walked: Floats, fixes: FixColumns) -> tuple[float, Floats]:
    """Fit walked positions (K, 2) m to the fixes, robustly; return turn (rad, counter-clockwise) and shift (2,) m."""
    best = (np.inf, 0.0, np.zeros(2))
    for turn in np.linspace(-np.pi, np.pi, TURNS, endpoint=False):
        miss = fixes.place - walked @ yaw_rotation(turn)[:2, :2].T
        # iteratively reweighted mean (Cauchy loss), starting from the median
        shift = np.median(miss, axis=0)
        for _ in range(5):
            off = ((miss - shift) ** 2).sum(axis=1) / fixes.sigma**2
            weight = 1.0 / (fixes.sigma**2 * (1.0 + off / CAUCHY**2))
            shift = weight @ miss / weight.sum()
        cost = float(np.log1p(off / CAUCHY**2).sum())
        if cost < best[0]:
            best = (cost, float(turn), shift)
    return best[1], best[2]


def describe_start(gnss: Gnss, start: Floats, sigma_m: float, close: Bools) -> dict[str, float]:
    """Return latitude, longitude (deg) and sigma (m) of `start` (2,) m, with the fixes not `close` (K,) counted."""
    latitude, longitude = gnss.locate(float(start[0]), float(start[1]))
    return {
        "latitude_deg": latitude,
        "longitude_deg": longitude,
        "sigma_m": sigma_m,
        "fixes": len(close),
        "at_less_than_half_weight": int((~close).sum()),
    }


def describe_fixes(start: dict[str, float]) -> str:
    """Return a note on a walk that was laid on fixes."""
    return (
        f"laid on {start['fixes']} fixes of GNSS, {start['at_less_than_half_weight']} of them at less than half "
        f"weight: north is the true one, and the start at {start['latitude_deg']:.6f}, "
        f"{start['longitude_deg']:.6f} within {start['sigma_m']:.1f} m"
    )
