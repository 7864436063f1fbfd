"""Figures of merit of a walk, and whether its claimed sigmas are true.

==================== =========================================================================================
rmse_2d_m            root mean square horizontal error over all compared points after alignment
rmse_3d_m            the same in space (absent for footprints, which have no height)
end_error_m          error at the last compared point; in space, or horizontal for footprints
max_error_m          largest error, likewise
heading_rmse_deg     root mean square yaw error after alignment, where the truth has attitude
scale                best-fit similarity of the horizontal path: above 1 the estimate is too short
distance_m           sum of the straight moves from stance to stance, in space: less than the foot flew
closure_m            from the first stance to the last; an error only where the walk ended where it began
closure_percent      closure in percent of distance
strides_detected     stances less one
==================== =========================================================================================

Compared points are the solution's samples inside a true trajectory, or the stances matched with footprints.

Consistency is judged by the normalized error squared (NEES) at the stances.

Position alone (`compute_stance_nees`). Position and heading at the start are a gauge: the estimator sets them, the
truth has others. So both paths are taken relative to the first stance that the truth saw, and the truth is turned by
the yaw psi that makes the errors most likely under the claim,

    e_k(psi) = (p_k - p_0) - R_z(psi)^T (q_k - q_0),    psi = argmin sum_k e_k^T C_k^-1 e_k,
    C_k = P_k + 2 sigma_truth^2 I,                       nees_k = e_k^T C_k^-1 e_k.

For an honest claim nees_k is chi-square with 3 degrees of freedom, less what the fit of psi absorbs: nothing of the
vertical and the along-track error, but of the cross-track variance two thirds at the end of a straight walk with white
steps. Errors of neighboring stances are nearly the same error: judge the median over stances and over walks.

Position and heading (`whiten_errors`). Where the estimator was given the true heading at its start nothing is fitted.
With everything relative to the first footfall but the heading, which is absolute,

    e_k = (p_k - p_0) - (q_k - q_0)  m, east, north, up;    psi_k  rad about up, estimate less truth.

Errors are whitened by the claim, z = L^-1 e with P = L L^T, and an honest claim makes z standard normal:

========== ======= =========================================================================================
pose       4       position and heading together; only where the claim has their joint covariance
ground     3       east, north and heading together; likewise
position   3
horizontal 2       east and north
heading    1
up         1
========== ======= =========================================================================================

|z_k|^2 is the NEES of footfall k, chi-square with so many degrees of freedom n. The errors at two footfalls of a walk
are nearly the same error. So the share of seeds inside the two-sided band is judged at one footfall at a time, and for
the mean over M footfalls the band is widened: for Gaussian z_k, z_l with unit variances and correlation C_kl,
cov(|z_k|^2, |z_l|^2) = 2 |C_kl|^2 (sum of squares), so the mean has mean n and variance v = 2 / M^2 sum_kl |C_kl|^2. It
is taken for a chi-square of nu degrees of freedom, scaled to that mean, nu = 2 n^2 / v (Satterthwaite 1946): M n for
independent footfalls and n for equal ones; the band holds 95 to 97 % of honest walks. C is measured over the seeds, as
a correlation, so that a claim that is too small cannot widen its own band; what chance adds to its square over S seeds,
(1 - c^2) / S, is taken off.

Reference: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 5.4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.special import gammaincinv

from fg_nav.arrays import Floats, Ints
from fg_nav.errors import EvaluationError
from fg_nav.evaluation.comparison import Comparison, align, compare, fit_scale, interpolate_truth, yaw_between
from fg_nav.frames import yaw_rotation
from fg_nav.solution import Solution, StanceTable
from fg_nav.truth import FootprintTruth, TrajectoryTruth, Truth


@dataclass(frozen=True)
class Metrics:
    """See the table above; None where the truth, or the lack of one, does not show it."""

    distance_m: float
    closure_m: float
    strides_detected: int
    closure_percent: float | None = None
    alignment: str | None = None
    points: int | None = None
    rmse_2d_m: float | None = None
    rmse_3d_m: float | None = None
    end_error_m: float | None = None
    max_error_m: float | None = None
    heading_rmse_deg: float | None = None
    scale: float | None = None
    strides_true: int | None = None
    footprints_surveyed: int | None = None
    notes: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """Return what is known, ready for JSON."""
        known = {f.name: getattr(self, f.name) for f in fields(self)}
        known["notes"] = list(self.notes)
        return {name: value for name, value in known.items() if value is not None}


def evaluate(
    solution: Solution, truth: Truth | None = None, alignment: str = "yaw", comparison: Comparison | None = None
) -> Metrics:
    """Measure a solution, against a truth where there is one.

    Without a truth only distance, closure and the stride count are known. `alignment` is "yaw", "none", "origin" or
    "se3" (`fg_nav.evaluation.comparison`); a `comparison` of the two that was made already is used in its place.

    Raises `EvaluationError` where solution and truth cannot be compared, or there is no stance.

    Examples
    --------
    >>> solution = fg_nav.navigate("walk.csv", "inertial")
    >>> fg_nav.evaluate(solution, fg_nav.read_truth("truth.tum")).rmse_2d_m < 0.5  # m
    True
    """
    path = _measure_path(solution.stances.position)
    if truth is None:
        return path
    measured = _add_errors(path, comparison or compare(solution, truth, alignment))
    if isinstance(truth, FootprintTruth):
        return replace(measured, strides_true=truth.stride_count, footprints_surveyed=len(truth.stride))
    return measured


@dataclass(frozen=True)
class Gap:
    """How far two solutions of a walk are apart: rms and largest over all samples, m; rms of the heading, deg."""

    rms_m: float
    max_m: float
    heading_deg: float


def measure_gap(one: Solution, other: Solution) -> Gap:
    """Measure how far two solutions of the same samples are apart as they stand; the heading at the stances of one."""
    apart = np.linalg.norm(one.position - other.position, axis=1)
    sample = one.stances.sample
    turned = yaw_between(one.nav_R_body[sample], other.nav_R_body[sample])
    return Gap(_rms(apart), float(apart.max()), float(np.degrees(_rms(turned))))


def _measure_path(stance_position: Floats) -> Metrics:
    if len(stance_position) == 0:
        raise EvaluationError(
            "the solution has no stance, so it has no distance travelled: check the stance detection."
        )
    moves = np.linalg.norm(np.diff(stance_position, axis=0), axis=1)
    distance, closure = float(moves.sum()), float(np.linalg.norm(stance_position[-1] - stance_position[0]))
    percent = 100 * closure / distance if distance > 0.0 else None
    return Metrics(distance_m=distance, closure_m=closure, closure_percent=percent, strides_detected=len(moves))


def _add_errors(path: Metrics, found: Comparison) -> Metrics:
    size = np.linalg.norm(found.error, axis=1)
    scale = fit_scale(found.estimate, found.truth)
    return replace(
        path,
        alignment=found.alignment.mode,
        points=len(found.row),
        rmse_2d_m=_rms(np.linalg.norm(found.error[:, :2], axis=1)),
        rmse_3d_m=None if found.planar else _rms(size),
        end_error_m=float(size[-1]),
        max_error_m=float(size.max()),
        heading_rmse_deg=None if found.yaw_error is None else float(np.degrees(_rms(found.yaw_error))),
        scale=scale if np.isfinite(scale) else None,
        notes=(*found.notes, *_remark_on_size(scale)),
    )


def _remark_on_size(scale: float) -> tuple[str, ...]:
    if 1 / OTHER_SIZE <= scale <= OTHER_SIZE or not np.isfinite(scale):
        return ()
    return (f"the truth is {scale:.2g} times as large as the path: check its unit, and that it is of this walk",)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


OTHER_SIZE = 2.0
"""Truth over path beyond which one of them is of no use: feet are 3.3, and a filter that works is within some %."""

DEGREES_OF_FREEDOM = 3

TRUTH_SIGMA_M = 0.001  # Motion capture of a marker on a shoe: about a millimeter.

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
        return float(np.median(self.nees) / chi2_quantile(0.5, DEGREES_OF_FREEDOM))

    @property
    def mean_ratio(self) -> float:
        """Mean NEES over its expectation: ruled by the worst stances."""
        return float(np.mean(self.nees) / DEGREES_OF_FREEDOM)

    def coverage(self, probability: float = 0.95) -> float:
        """Share of stances whose error lies inside the ellipsoid of this probability."""
        return float(np.mean(self.nees < chi2_quantile(probability, DEGREES_OF_FREEDOM)))


def compute_stance_nees(
    stances: StanceTable, truth: TrajectoryTruth, truth_sigma_m: float = TRUTH_SIGMA_M
) -> Consistency:
    """Compare claimed stance positions with a true trajectory.

    Raises `EvaluationError` where the truth saw fewer than two stances, or a claimed covariance is not positive
    definite.
    """
    row, true_position = interpolate_truth(truth, stances.t)
    if len(row) < 2:
        raise EvaluationError(f"the truth covers {len(row)} stances: the NEES of stance positions needs two.")
    p, q = (path[1:] - path[0] for path in (stances.position[row], true_position))
    whiten = _invert_root(stances.position_cov[row[1:]] + 2 * truth_sigma_m**2 * np.eye(3))
    yaw = _most_likely_yaw(p, q, whiten)
    return Consistency(row[1:], np.sum(_whitened_error(yaw, p, q, whiten) ** 2, axis=1), yaw)


def _invert_root(covariance: Floats) -> Floats:
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


PARTS: Mapping[str, int] = {"pose": 4, "ground": 3, "position": 3, "horizontal": 2, "heading": 1, "up": 1}
"""Degrees of freedom by part."""

PLACES = (0.25, 0.5, 0.75, 1.0)  # At which footfalls, as shares of the walk.
JOINT = ("pose", "ground")  # Parts that need the covariance of place with heading.

_ROWS = {
    "pose": [0, 1, 2, 3],
    "ground": [0, 1, 3],
    "position": [0, 1, 2],
    "horizontal": [0, 1],
    "heading": [3],
    "up": [2],
}


def whiten_errors(
    found: Comparison, stances: StanceTable, places: Sequence[float] = PLACES
) -> dict[str, list[list[float]]]:
    """Errors over their claim, by part, one row a footfall.

    Parameters
    ----------
    found : of the footfalls, laid as started (`fg_nav.evaluation.walked.compare_at_footfalls`), with a true attitude.
    stances : of the same solution.
    places : shares of the walk.

    Raises `EvaluationError` without a true attitude, or where a claimed covariance is not positive definite.
    """
    if found.yaw_error is None or len(found.yaw_error) != len(found.row):
        raise EvaluationError("the truth has no attitude at some footfalls, so their heading errors are not known.")
    chosen = np.unique(np.round(np.array(places) * (len(found.row) - 1)).astype(int))
    error = np.column_stack([found.error - found.error[0], found.yaw_error])[chosen]
    covariance, joint = pose_covariance(stances, found.row[chosen])
    parts = {part: rows for part, rows in _ROWS.items() if joint or part not in JOINT}
    return {part: _whiten(error[:, rows], covariance[:, rows][:, :, rows]).tolist() for part, rows in parts.items()}


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


def _whiten(error: Floats, covariance: Floats) -> Floats:
    """(M, n) errors over their claim (M, n, n)."""
    try:
        lower = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise EvaluationError(
            "a claimed covariance of place and heading is not positive definite: the estimator has failed."
        ) from None
    return np.asarray(np.linalg.solve(lower, error[:, :, None])[:, :, 0])


def share_in_band(nees: Floats, freedom: float, mean: float, probability: float = 0.95) -> float:
    """Share of NEES inside the two-sided band of a chi-square of `freedom`, scaled to this mean."""
    low, high = nees_band(freedom, mean, probability)
    return float(np.mean((nees >= low) & (nees <= high)))


def chi2_quantile(probability: float, freedom: float) -> float:
    """Quantile of a chi-square; `scipy.stats` has it too, and takes half a second to load."""
    return 2.0 * float(gammaincinv(freedom / 2.0, probability))


def nees_band(freedom: float, mean: float, probability: float = 0.95) -> tuple[float, float]:
    """Two-sided band of a chi-square of `freedom`, scaled to this mean."""
    edges = (1 - probability) / 2, (1 + probability) / 2
    low, high = (float(chi2_quantile(edge, freedom)) * mean / freedom for edge in edges)
    return low, high


def estimate_freedom_of_mean(z: Floats) -> float:
    """Degrees of freedom of the mean NEES over footfalls, from whitened errors (S, M, n) of S seeds; see above."""
    seeds, places, n = z.shape
    flat = z.reshape(seeds, places * n)
    size = np.sqrt(np.mean(flat**2, axis=0))
    correlation = (flat.T @ flat) / seeds / np.outer(size, size)
    squares = np.maximum(correlation**2 - (1 - correlation**2) / seeds, 0.0)
    block = np.kron(np.eye(places), np.ones((n, n))).astype(bool)
    squares[block] = np.tile(np.eye(n), (places, places))[block]  # within a footfall the claim says they are white
    return float(2 * n**2 / (2 * squares.sum() / places**2))
