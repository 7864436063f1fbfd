"""Whether the ellipsoid's sigmas are those of its errors: errors over their own sigmas, over many seeds.

    python scripts/ellipsoid_consistency.py [--seeds N]

Each seed draws a sensor (hard iron 15 uT and soft iron 6 % per axis, not symmetric), turns it to 400 orientations in a
field of 48 uT and adds noise of 0.5 uT per axis. The truth is what readings can tell: hard iron, and the symmetric
part P of the polar decomposition Q P of the inverse soft iron; of determinant 1 where the strength is not known.

========== ======================================================================================================
all ways   orientations are random
by hand    the field points within 60 deg of a plane through the sensor, as with a box that is turned about two of
           its axes
half       the field points into one half of the sphere
outliers   all ways, with 3 % of the readings wrong by 20 uT per axis
========== ======================================================================================================
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import figures as fig
import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.ellipsoid import fitted_ellipsoid, symmetric, unit_sphere
from fg_nav.calibration.magnetometer import UPPER
from fg_nav.errors import CalibrationError

FIRST_SEED = 101

STRENGTH_UT, NOISE_UT, HARD_UT, SOFT = 48.0, 0.5, 15.0, 0.06

READINGS = 400

WAYS = ("all ways", "by hand", "half", "outliers")

NAMES = ("h_x", "h_y", "h_z", "C_xx", "C_xy", "C_xz", "C_yy", "C_yz", "C_zz")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="Errors of the ellipsoid over their own sigmas.")
    parser.add_argument("--seeds", type=int, default=200, metavar="N", help="sensors, from seed 101 on")
    chosen = parser.parse_args(arguments)
    seeds = range(FIRST_SEED, FIRST_SEED + chosen.seeds)
    kinds = [(way, strength) for way in WAYS for strength in (STRENGTH_UT, None)]
    found = {kind: [standardised(seed, *kind) for seed in seeds] for kind in kinds}
    sphere = [standardised(seed, "all ways", STRENGTH_UT, algebraic=True) for seed in seeds]
    rows = [[*_words(way, strength), *_rms(errors)] for (way, strength), errors in found.items()]
    rows.append(["unit sphere, all ways", "known", *_rms(sphere)])
    fig.print_heading(f"rms over {chosen.seeds} seeds of errors over their own sigmas")
    fig.print_table(("readings", "strength", *NAMES, "all", "refused"), rows)
    asked = [
        fig.Figure(
            f"{way}, strength {_words(way, strength)[1]}", "rms of all errors", "ellipsoid", overall(errors), 0.8, 1.3
        )
        for (way, strength), errors in found.items()
    ]
    fig.print_verdict(asked)


def standardised(seed: int, way: str, strength_uT: float | None, algebraic: bool = False) -> Floats | None:
    """Errors (9,) over their sigmas for one sensor; None where the readings were refused."""
    rng = np.random.default_rng([seed, WAYS.index(way)])
    hard = HARD_UT * rng.standard_normal(3)
    soft = np.eye(3) + SOFT * rng.standard_normal((3, 3))
    readings = readings_of(hard, soft, way, rng)
    C = symmetric(np.linalg.inv(soft))
    if strength_uT is None:
        C = C / np.cbrt(np.linalg.det(C))
    try:
        found = unit_sphere(readings, STRENGTH_UT) if algebraic else fitted_ellipsoid(readings, strength_uT)
    except CalibrationError:
        return None
    return np.asarray((found.parameters - np.concatenate([hard, C[UPPER]])) / found.sigma)


def readings_of(hard_uT: Floats, soft: Floats, way: str, rng: np.random.Generator) -> Floats:
    """Readings (N, 3) uT of a sensor in the field, turned about this way."""
    field = STRENGTH_UT * _directions(way, rng)
    readings = field @ soft.T + hard_uT + NOISE_UT * rng.standard_normal(field.shape)
    if way == "outliers":
        wild = rng.uniform(size=READINGS) < 0.03
        readings[wild] += 20.0 * rng.standard_normal((int(wild.sum()), 3))
    return np.asarray(readings)


def _directions(way: str, rng: np.random.Generator) -> Floats:
    """Unit vectors (READINGS, 3): evenly over all directions that this way reaches."""
    axis = rng.standard_normal(3)
    low, high = {"by hand": (-np.sin(np.deg2rad(60.0)), np.sin(np.deg2rad(60.0))), "half": (0.0, 1.0)}.get(
        way, (-1.0, 1.0)
    )
    many = rng.standard_normal((10 * READINGS, 3))
    many /= np.linalg.norm(many, axis=1, keepdims=True)
    along = many @ (axis / np.linalg.norm(axis))
    return np.asarray(many[(along >= low) & (along <= high)][:READINGS])


def overall(errors: Sequence[Floats | None]) -> float:
    """Rms of all parameters over seeds; infinite where all were refused."""
    kept = [error for error in errors if error is not None]
    return float(np.sqrt(np.mean(np.square(kept)))) if kept else np.inf


def _rms(errors: Sequence[Floats | None]) -> list[str]:
    kept = np.array([error for error in errors if error is not None]).reshape(-1, 9)
    per = np.sqrt((kept**2).mean(axis=0)) if len(kept) else np.full(9, np.inf)
    return [*(f"{value:.2f}" for value in per), f"{overall(errors):.2f}", f"{len(errors) - len(kept)}"]


def _words(way: str, strength_uT: float | None) -> tuple[str, str]:
    return way, "unknown" if strength_uT is None else "known"


if __name__ == "__main__":
    fig.leave_with(main)
