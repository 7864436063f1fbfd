"""Are the claimed sigmas true? Normalised error squared (NEES) of the stance positions.

Position and heading at the start are a gauge: the estimator sets them, the truth has others. So both paths
are taken relative to the first stance that the truth saw, and the truth is turned by the yaw psi that makes
the errors most likely under the claim,

    e_k(psi) = (p_k - p_0) - R_z(psi)^T (q_k - q_0),    psi = argmin sum_k e_k^T C_k^-1 e_k,
    C_k = P_k + 2 sigma_truth^2 I,                       nees_k = e_k^T C_k^-1 e_k.

The weights C_k^-1 put the choice of psi where the claim is sharpest, the early strides; an overconfident
claim turns the path by an error of theirs and is punished further on. For an honest claim nees_k is
chi-square with 3 degrees of freedom, less what the fit of psi absorbs: nothing of the vertical and the
along-track error, but of the cross-track variance two thirds at the end of a straight walk with white steps.
Errors of neighbouring stances are nearly the same error, so the spread of one walk's mean is wide: judge the
median over stances and over walks.

Reference: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EvaluationError
from fg_nav.evaluation.alignment import align
from fg_nav.evaluation.comparison import interpolated
from fg_nav.frames import yaw_rotation
from fg_nav.recording import TrajectoryTruth
from fg_nav.solution import StanceTable

DEGREES_OF_FREEDOM = 3

TRUTH_SIGMA_M = 0.001
"""Motion capture of a marker on a shoe: about a millimetre."""

_YAW_STEPS = 10


@dataclass(frozen=True)
class Consistency:
    """`nees` (M,) at the rows `stance` (M,) of the stance table, and the yaw in rad that was fitted."""

    stance: Ints
    nees: Floats
    yaw: float

    @property
    def median_ratio(self) -> float:
        """Median NEES over the median of chi-square: 1 for honest sigmas, above 1 for overconfident ones."""
        return float(np.median(self.nees) / chi2.median(DEGREES_OF_FREEDOM))

    @property
    def mean_ratio(self) -> float:
        """Mean NEES over its expectation: ruled by the worst stances."""
        return float(np.mean(self.nees) / DEGREES_OF_FREEDOM)

    def coverage(self, probability: float = 0.95) -> float:
        """Share of stances whose error lies inside the ellipsoid of this probability."""
        return float(np.mean(self.nees < chi2.ppf(probability, DEGREES_OF_FREEDOM)))


def stance_nees(stances: StanceTable, truth: TrajectoryTruth, truth_sigma_m: float = TRUTH_SIGMA_M) -> Consistency:
    """Compare claimed stance positions with a true trajectory.

    Raises
    ------
    EvaluationError
        Where the truth saw fewer than two stances, or a claimed covariance is not positive definite.
    """
    row, true_position = interpolated(truth, stances.t)
    if len(row) < 2:
        raise EvaluationError(f"the truth covers {len(row)} stances: the NEES of stance positions needs two.")
    p, q = (path[1:] - path[0] for path in (stances.position[row], true_position))
    whiten = _whitening(stances.position_cov[row[1:]] + 2 * truth_sigma_m**2 * np.eye(3))
    yaw = _most_likely_yaw(p, q, whiten)
    return Consistency(row[1:], np.sum(_whitened_error(yaw, p, q, whiten) ** 2, axis=1), yaw)


def _whitening(covariance: Floats) -> Floats:
    """(M, 3, 3) matrices W with W^T W = C^-1."""
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
    except np.linalg.LinAlgError:
        raise EvaluationError(
            "a claimed covariance of a stance position is not positive definite: the estimator has failed."
        ) from None


def _whitened_error(yaw: float, p: Floats, q: Floats, whiten: Floats) -> Floats:
    return np.asarray(np.einsum("kij,kj->ki", whiten, p - q @ yaw_rotation(yaw)))


def _most_likely_yaw(p: Floats, q: Floats, whiten: Floats) -> float:
    """Gauss-Newton on the one angle, from the unweighted fit."""
    turn = align(p, q).truth_R_nav
    yaw = float(np.arctan2(turn[1, 0], turn[0, 0]))
    for _ in range(_YAW_STEPS):
        turned = q @ yaw_rotation(yaw)
        slope = np.einsum("kij,kj->ki", whiten, np.cross([0.0, 0.0, 1.0], turned))
        yaw -= float(np.sum(slope * _whitened_error(yaw, p, q, whiten)) / np.sum(slope**2))
    return yaw
