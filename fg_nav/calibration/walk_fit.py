"""The most likely iron of a walk: Gauss-Newton steps with the Student weights of the last one.

The scale of d is found on the way. Model: `fg_nav.calibration.walk_model`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.calibration.footfalls import mean_up
from fg_nav.calibration.magnetometer import matrix_of
from fg_nav.calibration.walk_covariance import covariance_of
from fg_nav.calibration.walk_model import (
    IRON,
    WITHOUT_IRON,
    Walk,
    WalkCalibrationParameters,
    jacobian_of,
    prior_precision,
    residual_of,
    weights_of,
)
from fg_nav.magnetic.compass import level_R_body

MOST_STEPS, CLOSE_UT = 30, 3e-3
"""Of Gauss-Newton: it takes 5 to 15, and steps below this change nothing."""


@dataclass(frozen=True)
class Fit:
    """What was found.

    Attributes
    ----------
    unknowns : (P,) in the order of the Jacobian.
    sigma_d : (3,) uT, scale of d in nav.
    up : (3,) mean direction of up in the body.
    covariance : (9, 9) of h and the six of S; NaN where it was not asked for.
    """

    unknowns: Floats
    sigma_d: Floats
    up: Floats
    covariance: Floats

    @property
    def h(self) -> Floats:
        """(3,) uT."""
        return self.unknowns[:3]

    @property
    def S(self) -> Floats:
        """(3, 3)."""
        return matrix_of(self.unknowns[3:IRON])

    @property
    def b(self) -> Floats:
        """(3,) uT."""
        return self.unknowns[IRON:12]

    def corrected(self, reading: Floats) -> Floats:
        """Field (N, 3) uT."""
        return np.asarray(np.linalg.solve(self.S, (reading - self.h).T).T)

    @property
    def level_covariance(self) -> Floats:
        """Of h over the ground with what S makes of the vertical field, (2, 2) uT^2."""
        level = level_sum(self.up, float(self.b[2]))
        return np.asarray(level @ self.covariance @ level.T)

    @property
    def level_iron(self) -> Floats:
        """What h and S add over the ground, (2,) uT."""
        return np.asarray(level_sum(self.up, float(self.b[2])) @ (self.unknowns[:IRON] - WITHOUT_IRON))

    @property
    def seen(self) -> float:
        """Squared sigmas by which the sensor differs over the ground from one without iron; chi-square with two."""
        found = self.level_iron
        return float(found @ np.linalg.solve(self.level_covariance, found))

    @property
    def level_sigma(self) -> float:
        """Of the worse direction over the ground, uT."""
        return float(np.sqrt(np.linalg.eigvalsh(self.level_covariance)[1]))


def fitted(walk: Walk, p: WalkCalibrationParameters) -> Fit:
    """Find the iron from none on, with its covariance."""
    start = np.concatenate([WITHOUT_IRON, _mean_field(walk), np.zeros(walk.knots.shape[1])])
    found = found_from(walk, p, start, np.full(3, 10.0))
    return replace(found, covariance=covariance_of(walk, found.unknowns, found.sigma_d, p)[:IRON, :IRON])


def found_from(walk: Walk, p: WalkCalibrationParameters, at: Floats, sigma_d: Floats) -> Fit:
    """Find the iron from any unknowns (P,) and scale of d (3,) on, without covariance."""
    prior, rest = prior_precision(walk, p), np.zeros(len(at))
    rest[:IRON] = WITHOUT_IRON
    for _ in range(MOST_STEPS):
        residual = residual_of(walk, at)
        weight = weights_of(residual, sigma_d, p.tail)
        sigma_d = np.sqrt(_scales(residual, weight))
        scaled = jacobian_of(walk, at) / sigma_d[:, None]
        normal = np.einsum("n,nij,nik->jk", weight, scaled, scaled) + prior
        right = np.einsum("n,nij,ni->j", weight, scaled, residual / sigma_d) - prior @ (at - rest)
        step = np.linalg.solve(normal, right)
        at = at + step
        if np.abs(step[:3]).max() < CLOSE_UT:
            break
    return Fit(at, sigma_d, mean_up(walk.nav_R_body), np.full((IRON, IRON), np.nan))


def _mean_field(walk: Walk) -> Floats:
    return np.asarray(np.einsum("nij,nj->ni", walk.nav_R_body, walk.reading).mean(axis=0))


def level_sum(up: Floats, vertical_uT: float) -> Floats:
    """(2, 9): what h and the six of S add up to over the ground, in levelled axes, where up is up in the body."""
    by_soft = np.stack([matrix_of(one) @ up for one in np.eye(6)], axis=1)
    return np.asarray(level_R_body(up)[:2] @ np.hstack([np.eye(3), vertical_uT * by_soft]))


def _scales(residual: Floats, weight: Floats) -> Floats:
    """Squared scale (3,) of d: one over the ground, one upright."""
    square = (weight[:, None] * residual**2).mean(axis=0) + 1e-6
    level = square[:2].mean()
    return np.array([level, level, square[2]])
