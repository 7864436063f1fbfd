"""The rigid motion that lays an estimated path on the true one.

An inertial walk knows neither where it started nor which way north is, so these are taken out before errors
are counted. With estimate p_i and truth q_i (same instants), the modes minimize sum |R p_i + s - q_i|^2 over

======== ============================================== =====================================
mode     R                                              s
======== ============================================== =====================================
none     identity                                       zero
origin   identity                                       first points coincide (not a fit)
yaw      rotation about up (the gauge of an IMU)        free: the default
se3      any rotation (Kabsch 1976)                     free; forgives tilt errors as well
======== ============================================== =====================================

The yaw solution is closed: with both paths centered, tan(psi) = sum (p x q)_z / sum (p . q)_horizontal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EvaluationError
from fg_nav.frames import yaw_rotation

AlignmentMode: TypeAlias = Literal["yaw", "none", "origin", "se3"]

MODES: tuple[str, ...] = get_args(AlignmentMode)
"""What `align` accepts."""


@dataclass(frozen=True)
class Alignment:
    """Rigid motion from the solution's frame to the truth's: q = truth_R_nav p + shift."""

    mode: str
    truth_R_nav: Floats
    shift: Floats

    def apply(self, position: Floats) -> Floats:
        """Positions (N, 3) m of the solution in the truth's frame."""
        return position @ self.truth_R_nav.T + self.shift

    def rotate(self, nav_R_body: Floats) -> Floats:
        """Attitudes (N, 3, 3) of the solution in the truth's frame."""
        return self.truth_R_nav @ nav_R_body


def align(estimate: Floats, truth: Floats, mode: str = "yaw") -> Alignment:
    """Find the rigid motion of `mode` that lays `estimate` (N, 3) m on `truth` (N, 3) m, point by point.

    Raises `EvaluationError` on an unknown mode, on shapes that differ, and where there is no point or one that is not
    finite.
    """
    _check(estimate, truth)
    if mode == "none":
        return Alignment(mode, np.eye(3), np.zeros(3))
    if mode == "origin":
        return Alignment(mode, np.eye(3), truth[0] - estimate[0])
    if mode == "yaw":
        return _fit(mode, yaw_rotation(_yaw(estimate, truth)), estimate, truth)
    if mode == "se3":
        return _fit(mode, _kabsch(estimate - estimate.mean(0), truth - truth.mean(0)), estimate, truth)
    raise EvaluationError(f"alignment '{mode}' is unknown: choose one of {', '.join(MODES)}.")


def fit_scale(estimate: Floats, truth: Floats) -> float:
    """Best scale of the horizontal `estimate` (N, 2 or 3) onto `truth`, after yaw and shift.

    Above 1 the estimate is too short. A closed loop hides a scale error from every other figure. It is the
    least squares scale of the estimate, so random errors of the estimate pull it below 1. NaN where the
    estimate does not move.
    """
    p, q = _center_plane(estimate), _center_plane(truth)
    spread = np.sum(np.abs(p) ** 2)
    return float(np.abs(np.sum(np.conj(p) * q)) / spread) if spread > 0.0 else float("nan")


def _fit(mode: str, truth_R_nav: Floats, estimate: Floats, truth: Floats) -> Alignment:
    return Alignment(mode, truth_R_nav, truth.mean(0) - truth_R_nav @ estimate.mean(0))


def _kabsch(p: Floats, q: Floats) -> Floats:
    """Rotation (3, 3) that lays centered points `p` on centered points `q`; if straight, one of the best."""
    left, _, right = np.linalg.svd(q.T @ p)
    proper = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    return np.asarray(left @ proper @ right)


def _yaw(estimate: Floats, truth: Floats) -> float:
    p, q = _center_plane(estimate), _center_plane(truth)
    return float(np.angle(np.sum(np.conj(p) * q)))


def _center_plane(position: Floats) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
    """Horizontal positions as complex numbers x + iy about their mean: a rotation is then one factor."""
    plane = position[:, 0] + 1j * position[:, 1]
    return np.asarray(plane - plane.mean(), dtype=np.complex128)


def _check(estimate: Floats, truth: Floats) -> None:
    if estimate.shape != truth.shape or estimate.ndim != 2 or estimate.shape[1] != 3 or len(estimate) == 0:
        raise EvaluationError(
            f"an estimate of shape {estimate.shape} cannot be aligned with a truth of shape {truth.shape}: "
            "both must be (N, 3) with at least one point."
        )
    for name, points in (("estimate", estimate), ("truth", truth)):
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(bad):
            raise EvaluationError(
                f"the {name} is not finite at point {bad[0]} ({len(bad)} in all): remove such points first."
            )
