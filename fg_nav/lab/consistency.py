"""Consistency of claimed sigmas: normalized estimation error squared (NEES) at the stances.

Position alone (`compute_stance_nees`). Position and heading at the start are a gauge: the estimator sets them, the
truth has others. Both paths are taken relative to the first stance that the truth covers, and the truth is turned by
the yaw psi that makes the errors most likely under the claim,

    e_k(psi) = (p_k - p_0) - R_z(psi)^T (q_k - q_0),    psi = argmin sum_k e_k^T C_k^-1 e_k,
    C_k = P_k + 2 sigma_truth^2 I,                       nees_k = e_k^T C_k^-1 e_k.

For an honest claim nees_k is chi-square with 3 degrees of freedom, less what the fit of psi absorbs: nothing of the
vertical and the along-track error, but of the cross-track variance two thirds at the end of a straight walk with white
steps. Errors of neighbouring stances are strongly correlated: judge the median over stances and over walks.

Where the estimator was given the true heading at its start (`whiten_errors`) nothing is fitted. The errors of places
relative to the first footfall, over ground (m, east and north) and upward (m), and of the absolute heading (rad,
estimate less truth) are whitened by the claim, z = L^-1 e with P = L L^T: an honest claim makes z standard normal.

Reference: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 5.4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import Comparison, align, interpolate_truth
from fg_nav.frames import yaw_rotation
from fg_nav.solution import StanceTable
from fg_nav.truth import TrajectoryTruth

DEGREES_OF_FREEDOM = 3
TRUTH_SIGMA_M = 0.001  # Motion capture of a marker on a shoe: about a millimetre.
_YAW_STEPS = 10  # Gauss-Newton on one angle has converged long before.

PLACES = (0.25, 0.5, 0.75, 1.0)  # Judged footfalls, as shares of the walk.
PARTS: Mapping[str, list[int]] = {"horizontal": [0, 1], "up": [2], "heading": [3]}  # Rows of position and yaw.


@dataclass(frozen=True)
class Consistency:
    """`nees` (M,) at the rows `stance` (M,) of the stance table, and the fitted yaw, rad."""

    stance: Ints
    nees: Floats
    yaw: float

    @property
    def median_ratio(self) -> float:
        """Median NEES over the median of chi-square: 1 for honest sigmas, above 1 for overconfident ones."""
        return float(np.median(self.nees) / chi2_quantile(0.5, DEGREES_OF_FREEDOM))

    @property
    def mean_ratio(self) -> float:
        """Mean NEES over its expectation: dominated by the worst stances."""
        return float(np.mean(self.nees) / DEGREES_OF_FREEDOM)


def compute_stance_nees(
    stances: StanceTable, truth: TrajectoryTruth, truth_sigma_m: float = TRUTH_SIGMA_M
) -> Consistency:
    """Compare claimed stance positions with a true trajectory.

    Raises `EvaluationError` where the truth covers fewer than two stances, or a claimed covariance is not positive
    definite.
    """
    row, true_position = interpolate_truth(truth, stances.t)
    if len(row) < 2:
        raise EvaluationError(f"the truth covers {len(row)} stances: the NEES of stance positions needs two.")
    p, q = (path[1:] - path[0] for path in (stances.position[row], true_position))
    try:
        root = np.linalg.cholesky(stances.position_cov[row[1:]] + 2 * truth_sigma_m**2 * np.eye(3))
        whiten = np.asarray(np.linalg.inv(root))
    except np.linalg.LinAlgError:
        raise EvaluationError(
            "a claimed covariance of a stance position is not positive definite: the estimator has failed."
        ) from None

    def whitened_error(yaw: float) -> Floats:
        return np.asarray(np.einsum("kij,kj->ki", whiten, p - q @ yaw_rotation(yaw)))

    # most likely yaw: Gauss-Newton from the unweighted fit
    turn = align(p, q).truth_R_nav
    yaw = float(np.arctan2(turn[1, 0], turn[0, 0]))
    for _ in range(_YAW_STEPS):
        slope = np.einsum("kij,kj->ki", whiten, np.cross([0.0, 0.0, 1.0], q @ yaw_rotation(yaw)))
        yaw -= float(np.sum(slope * whitened_error(yaw)) / np.sum(slope**2))
    return Consistency(row[1:], np.sum(whitened_error(yaw) ** 2, axis=1), yaw)


def whiten_errors(
    found: Comparison, stances: StanceTable, places: Sequence[float] = PLACES
) -> dict[str, list[list[float]]]:
    """Errors over their claim, by part, one row a footfall at these shares of the walk.

    `found` is of the footfalls, laid as started, with a true attitude, and `stances` of the same solution. Raises
    `EvaluationError` without a true attitude, or where a claimed covariance is not positive definite.
    """
    if found.yaw_error is None or len(found.yaw_error) != len(found.row):
        raise EvaluationError("the truth has no attitude at some footfalls, so their heading errors are not known.")
    chosen = np.unique(np.round(np.array(places) * (len(found.row) - 1)).astype(int))
    error = np.column_stack([found.error - found.error[0], found.yaw_error])[chosen]
    covariance, whitened = stances.position_yaw_cov[found.row[chosen]], {}
    for part, rows in PARTS.items():
        try:
            lower = np.linalg.cholesky(covariance[:, rows][:, :, rows])
        except np.linalg.LinAlgError:
            raise EvaluationError(
                "a claimed covariance of place and heading is not positive definite: the estimator has failed."
            ) from None
        whitened[part] = np.linalg.solve(lower, error[:, rows][:, :, None])[:, :, 0].tolist()
    return whitened


def chi2_quantile(probability: float, freedom: float) -> float:
    """Quantile of a chi-square; `scipy.stats` has it too, and takes half a second to load."""
    return 2.0 * float(gammaincinv(freedom / 2.0, probability))
