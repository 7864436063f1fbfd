"""Are the claimed sigmas of place and heading true? Errors over their claim, at a few footfalls far apart.

At footfall k, with everything relative to the first footfall but the heading, which is absolute,

    e_k = (p_k - p_0) - (q_k - q_0)  m, east, north, up;    psi_k  rad about up, estimate less truth.

Where the estimator was told the true heading at its start nothing is fitted, unlike `fg_nav.evaluation.consistency`.
Errors are whitened by the claim, z = L^-1 e with P = L L^T, and an honest claim makes z standard normal:

========== ======= =========================================================================================
pose       4       place and heading together; only where the claim has their joint covariance
ground     3       east, north and heading together; likewise
position   3
horizontal 2       east and north
heading    1
up         1
========== ======= =========================================================================================

|z_k|^2 is the NEES of footfall k, chi-square with so many degrees of freedom n. One walk has one such number to give:
the errors at two of its footfalls are nearly the same error. So the share of seeds inside the two-sided band is judged
at one footfall at a time, and for the mean over M footfalls the band is widened by how much they tell the same.

For Gaussian z_k, z_l with unit variances and correlation C_kl, cov(|z_k|^2, |z_l|^2) = 2 |C_kl|^2 (sum of squares), so
the mean over the footfalls has mean n and variance v = 2 / M^2 sum_kl |C_kl|^2. It is taken for a chi-square of nu
degrees of freedom, scaled to that mean, nu = 2 n^2 / v (Satterthwaite 1946): nu is M n for independent footfalls and n
for equal ones, and the band holds 95 to 97 % of honest walks. C is measured over the seeds. It is a correlation,
without the sizes, so that a claim that is too small cannot widen its own band; what chance adds to its square over S
seeds, (1 - c^2) / S, is taken off.

Reference: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 5.4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import chi2

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import Comparison
from fg_nav.solution import StanceTable

PARTS: Mapping[str, int] = {"pose": 4, "ground": 3, "position": 3, "horizontal": 2, "heading": 1, "up": 1}
"""Degrees of freedom by part."""

PLACES = (0.25, 0.5, 0.75, 1.0)
"""At which footfalls, as shares of the walk."""

JOINT = ("pose", "ground")
"""Parts that need the covariance of place with heading."""

_ROWS = {
    "pose": [0, 1, 2, 3],
    "ground": [0, 1, 3],
    "position": [0, 1, 2],
    "horizontal": [0, 1],
    "heading": [3],
    "up": [2],
}


def whitened_errors(
    found: Comparison, stances: StanceTable, places: Sequence[float] = PLACES
) -> dict[str, list[list[float]]]:
    """Errors over their claim, by part, one row a footfall.

    Parameters
    ----------
    found : of the footfalls, laid as started (`fg_nav.evaluation.walked.at_footfalls`), with a true attitude.
    stances : of the same solution.
    places : shares of the walk.

    Raises
    ------
    EvaluationError
        Without a true attitude, or where a claimed covariance is not positive definite.
    """
    if found.yaw_error is None or len(found.yaw_error) != len(found.row):
        raise EvaluationError("the truth has no attitude at some footfalls, so their heading errors are not known.")
    chosen = np.unique(np.round(np.array(places) * (len(found.row) - 1)).astype(int))
    error = np.column_stack([found.error - found.error[0], found.yaw_error])[chosen]
    covariance, joint = pose_covariance(stances, found.row[chosen])
    parts = {part: rows for part, rows in _ROWS.items() if joint or part not in JOINT}
    return {part: _whitened(error[:, rows], covariance[:, rows][:, :, rows]).tolist() for part, rows in parts.items()}


def pose_covariance(stances: StanceTable, row: Ints) -> tuple[Floats, bool]:
    """Claimed covariance (M, 4, 4) of east, north, up (m) and yaw about up (rad); and whether it is a joint one.

    Without a `pose_cov` in the table the heading is taken as independent of the place, which it is not.
    """
    if stances.pose_cov is not None:
        return stances.pose_cov[row], True
    blocks = np.zeros((len(row), 4, 4))
    blocks[:, :3, :3] = stances.position_cov[row]
    blocks[:, 3, 3] = stances.heading_sigma[row] ** 2
    return blocks, False


def _whitened(error: Floats, covariance: Floats) -> Floats:
    """(M, n) errors over their claim (M, n, n)."""
    try:
        lower = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise EvaluationError(
            "a claimed covariance of place and heading is not positive definite: the estimator has failed."
        ) from None
    return np.asarray(np.linalg.solve(lower, error[:, :, None])[:, :, 0])


def inside(nees: Floats, freedom: float, mean: float, probability: float = 0.95) -> float:
    """Share of NEES inside the two-sided band of a chi-square of `freedom`, scaled to this mean."""
    low, high = band(freedom, mean, probability)
    return float(np.mean((nees >= low) & (nees <= high)))


def band(freedom: float, mean: float, probability: float = 0.95) -> tuple[float, float]:
    """Two-sided band of a chi-square of `freedom`, scaled to this mean."""
    edges = np.array([(1 - probability) / 2, (1 + probability) / 2])
    low, high = np.asarray(chi2.ppf(edges, freedom)) * mean / freedom
    return float(low), float(high)


def freedom_of_mean(z: Floats) -> float:
    """Degrees of freedom of the mean NEES over footfalls, from whitened errors (S, M, n) of S seeds; see above."""
    seeds, places, n = z.shape
    flat = z.reshape(seeds, places * n)
    size = np.sqrt(np.mean(flat**2, axis=0))
    correlation = (flat.T @ flat) / seeds / np.outer(size, size)
    squares = np.maximum(correlation**2 - (1 - correlation**2) / seeds, 0.0)
    block = np.kron(np.eye(places), np.ones((n, n))).astype(bool)
    squares[block] = np.tile(np.eye(n), (places, places))[block]  # within a footfall the claim says they are white
    return float(2 * n**2 / (2 * squares.sum() / places**2))
