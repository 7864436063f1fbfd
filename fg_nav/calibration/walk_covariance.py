"""How well a walk shows the iron: the covariance of what was fitted to its strides.

    A^-1 (M + prior) A^-1 + floor,    M = W C W + sum over strides k, l of W_k rho(|p_k - p_l|) s s^T W_l

========== ============================================================================================================
A          Gauss-Newton matrix with its prior
W          J^T C^-1 of each reading, Student weights included
C          covariance of d within a stride, as learned
rho        exp(-distance / `FIELD_LENGTH_M`): strides that come by the same place feel the same field, be it the next
           stride, the next round of a circle or the way back. Of this only the share counts that is a building's: what
           exceeds `READING_UT`
s          uT, sigma of d at the phase of the reading
floor      what all readings of a sensor have wrong alike
========== ============================================================================================================

That is counted from the places and not from the residuals, because a fit hides what is alike: on a circle a field that
falls off across it looks like hard iron, and leaves no residual. For the same reason d is scaled up by the share of
independent fields that the unknowns take.

Cost: linear in the strides, times how many pass the same place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree

from fg_nav.arrays import Floats, Ints
from fg_nav.calibration.stride_readings import PHASES
from fg_nav.calibration.walk_model import COMMON, FIELD, FIELD_LENGTH_M, Walk, whiten

READING_UT = 0.25
"""Of d: what magnetometer and inertial attitude leave of a stride's readings where there is no building (0.2 uT)."""

FLOOR_UT = 0.06  # Of h: readings in steps of 0.15 uT, attitudes between samples, gyroscopes at the end of their range.

REACH_M = 3.0 * FIELD_LENGTH_M

SITES = 4  # Parts of a stride whose places are compared: a third of a meter each.


@dataclass(frozen=True)
class Linearization:
    """A fit's last step: residual (S, P, 3), jacobian (S, P, 3, U), weight (S,), whitening (3, P, P), prior (U, U)."""

    residual: Floats
    jacobian: Floats
    weight: Floats
    whitening: Floats
    prior: Floats

    @property
    def information(self) -> Floats:
        """(S, U, U) of each stride, without the prior."""
        white = whiten(self.whitening, self.jacobian).reshape(len(self.weight), 3 * PHASES, -1)
        return np.asarray(self.weight[:, None, None] * (white.transpose(0, 2, 1) @ white))

    @property
    def pull(self) -> Floats:
        """(S, U) of each stride: its gradient."""
        white = whiten(self.whitening, self.jacobian).reshape(len(self.weight), 3 * PHASES, -1)
        rows = whiten(self.whitening, self.residual).reshape(len(self.weight), 3 * PHASES, 1)
        return np.asarray(self.weight[:, None] * (white.transpose(0, 2, 1) @ rows)[..., 0])


def compute_covariance(walk: Walk, fit: Linearization) -> Floats:
    """Of all unknowns (U, U)."""
    information = fit.information
    bread = np.linalg.inv(information.sum(axis=0) + fit.prior)
    size = float((whiten(fit.whitening, fit.residual) ** 2).mean())
    within = size * np.einsum("k,kij->ij", fit.weight, information)
    between = _sum_over_places(walk, fit)
    covariance = bread @ (_count_taken(walk, fit) * (within + between) + fit.prior) @ bread
    covariance[:3, :3] += FLOOR_UT**2 * np.eye(3)
    return np.asarray(covariance)


def _find_sigma(fit: Linearization) -> Floats:
    """(P, 3) uT of d."""
    square = (fit.residual**2).mean(axis=0)
    square[:, :2] = square[:, :2].mean(axis=1, keepdims=True)
    return np.asarray(np.sqrt(square))


def _find_share(fit: Linearization) -> float:
    """Of d, in squares, that is the building's."""
    square = float((fit.residual**2).mean())
    return 1.0 - READING_UT**2 / max(square, READING_UT**2)


def _sum_over_places(walk: Walk, fit: Linearization) -> Floats:
    """M between strides (U, U); it may only add uncertainty."""
    pulls = np.swapaxes(fit.whitening, 1, 2) @ np.moveaxis(whiten(fit.whitening, fit.jacobian), 2, 0).reshape(
        3, len(walk), PHASES, -1
    ).swapaxes(0, 1)
    pulls = pulls * fit.weight[:, None, None, None] * _find_sigma(fit).T[None, :, :, None]
    sites = pulls.reshape(len(walk), 3, SITES, PHASES // SITES, -1).sum(axis=3).swapaxes(1, 2)
    place = walk.strides.place.reshape(len(walk), SITES, PHASES // SITES, 3).mean(axis=2)
    pair, alike = _compare_places(place[..., :2].reshape(-1, 2), np.repeat(np.arange(len(walk)), SITES))
    rows = sites.reshape(len(walk) * SITES, -1)
    near = coo_matrix((alike, (pair[:, 0], pair[:, 1])), shape=(len(rows),) * 2).tocsr() @ rows
    unknowns = fit.jacobian.shape[3]
    half = rows.reshape(-1, unknowns).T @ near.reshape(-1, unknowns)
    value, axes = np.linalg.eigh(_find_share(fit) * (half + half.T))
    return np.asarray((axes * np.maximum(value, 0.0)) @ axes.T)


def _compare_places(place: Floats, stride: Ints) -> tuple[Ints, Floats]:
    """Pairs (M, 2) of places (N, 2) m of different strides (N,) within reach, and how alike (M,) their fields are."""
    pair = cKDTree(place).query_pairs(REACH_M, output_type="ndarray")
    pair = pair[stride[pair[:, 0]] != stride[pair[:, 1]]]
    apart = np.linalg.norm(place[pair[:, 0]] - place[pair[:, 1]], axis=1)
    return pair, np.exp(-apart / FIELD_LENGTH_M)


def _count_taken(walk: Walk, fit: Linearization) -> float:
    """By how much d is larger than its residuals: N independent fields of three components over what is left of them.

    The unknowns that are the same in each stride see nothing of the field itself: e, and the delay.
    """
    middle = walk.strides.place[..., :2].mean(axis=1)
    _, alike = _compare_places(middle, np.arange(len(walk)))
    seen = 3 * len(walk) ** 2 / (len(walk) + 2 * _find_share(fit) * alike.sum())
    taken = 1 + FIELD.stop - 2 + walk.unknowns - COMMON.stop
    return float(seen / max(seen - taken, MIN_LEFT))


MIN_LEFT = 3.0  # Components of the field that are left where the unknowns take them all.
