"""Fit of the walk model and its covariance.

Gauss-Newton steps with the Student weights and the covariance of d of the last one (`fg_nav.calibration.walk_model`).
Observable are h along and across the pitch axis of the foot, forward and up, in each swing; along that axis, to the
side, only between headings. A straight walk does not determine it. The effect of S on the vertical field is one with h
horizontally where the foot stands; the swings separate the two. The size of S is one with the strength of the field,
and keeps its prior. Covariance:

    A^-1 (M + prior) A^-1 + floor,    M = W C W + sum over strides k, l of W_k rho(|p_k - p_l|) s s^T W_l

========== ============================================================================================================
A          Gauss-Newton matrix with its prior
W          J^T C^-1 of each reading, Student weights included
C          covariance of d within a stride, as learned
rho        exp(-distance / `FIELD_LENGTH_M`): strides past the same place have the same field, be it the next stride,
           the next round of a circle or the way back; of it only the building's share, which exceeds `READING_UT`
s          uT, sigma of d at the phase of the reading
floor      common error of all readings of a sensor
========== ============================================================================================================

rho follows from the places and not from the residuals, because a fit hides correlation: on a circle a field that falls
off across it looks like hard iron, and leaves no residual. For the same reason d is scaled up by the share of
independent fields that the unknowns absorb. Cost: linear in the strides, times the number of passes of the same place.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree

from fg_nav.arrays import Floats, Ints
from fg_nav.calibration.magnetometer import matrix_of, mean_up
from fg_nav.calibration.walk_model import (
    COMMON,
    FIELD,
    FIELD_LENGTH_M,
    IRON,
    PHASES,
    WITHOUT_IRON,
    StrideModel,
    compute_weights,
    learn_spread,
    linearize,
    prior_precision,
    start_unknowns,
    whiten,
)
from fg_nav.magnetic.footfall_field import compute_level_R_body

START_UT = 10.0  # Of d, before its covariance is learned.
MAX_STEPS, MIN_STEPS, CLOSE_UT = 30, 5, 3e-3  # Of Gauss-Newton, which takes 6 to 10; the covariance of d needs five.
READING_UT = 0.25  # Of d without a building: error of magnetometer and inertial attitude in a stride (0.2 uT).
FLOOR_UT = 0.06  # Of h: readings in steps of 0.15 uT, attitudes between samples, gyroscopes at the end of their range.
REACH_M = 3.0 * FIELD_LENGTH_M  # Of correlated places.
SITES = 4  # Parts of a stride whose places are compared: a third of a meter each.
MIN_LEFT = 3.0  # Components of the field that remain where the unknowns absorb them all.


@dataclass(frozen=True)
class Linearization:
    """A fit's last step: residual (S, P, 3), jacobian (S, P, 3, U), weight (S,), whitening (3, P, P), prior (U, U)."""

    residual: Floats
    jacobian: Floats
    weight: Floats
    whitening: Floats
    prior: Floats

    @cached_property
    def information(self) -> Floats:
        """(S, U, U) of each stride, without the prior."""
        return np.asarray(self.weight[:, None, None] * (self._white.transpose(0, 2, 1) @ self._white))

    @cached_property
    def score(self) -> Floats:
        """(S, U) of each stride: derivative of its log likelihood."""
        rows = whiten(self.whitening, self.residual).reshape(len(self.weight), 3 * PHASES, 1)
        return np.asarray(self.weight[:, None] * (self._white.transpose(0, 2, 1) @ rows)[..., 0])

    @cached_property
    def _white(self) -> Floats:
        """Whitened jacobian (S, 3 P, U)."""
        return whiten(self.whitening, self.jacobian).reshape(len(self.weight), 3 * PHASES, -1)


@dataclass(frozen=True)
class IronFit:
    """Solution of a walk.

    Attributes
    ----------
    unknowns : (U,) in the order of the model.
    up : (3,) mean direction of up in the body.
    linearization : about them.
    covariance : (9, 9) of h and the six of S.
    """

    unknowns: Floats
    up: Floats
    linearization: Linearization
    covariance: Floats

    @property
    def h(self) -> Floats:
        """(3,) uT."""
        return self.unknowns[:3]

    @property
    def S(self) -> Floats:
        """(3, 3)."""
        return matrix_of(self.unknowns[3:9])

    @property
    def b(self) -> Floats:
        """(3,) uT."""
        return np.asarray(self.unknowns[FIELD])

    def correct(self, reading: Floats) -> Floats:
        """Field (N, 3) uT."""
        return np.asarray(np.linalg.solve(self.S, (reading - self.h).T).T)

    @property
    def level_covariance(self) -> Floats:
        """Of the horizontal iron, (2, 2) uT^2."""
        level = level_sum(self.up, float(self.b[2]))
        return np.asarray(level @ self.covariance @ level.T)

    @property
    def level_iron(self) -> Floats:
        """Horizontal iron (2,) uT: h, and S times the vertical field."""
        return np.asarray(level_sum(self.up, float(self.b[2])) @ (self.unknowns[IRON] - WITHOUT_IRON))

    @property
    def significance(self) -> float:
        """Squared sigmas of the horizontal iron from none; chi-square with two degrees of freedom."""
        found = self.level_iron
        return float(found @ np.linalg.solve(self.level_covariance, found))

    @property
    def level_sigma(self) -> float:
        """Of the worse horizontal direction, uT."""
        return float(np.sqrt(np.linalg.eigvalsh(self.level_covariance)[1]))


def fit_iron(walk: StrideModel) -> IronFit:
    """Estimate the iron, with all other unknowns, by robust Gauss-Newton from zero, and its sandwich covariance."""
    at, spread = start_unknowns(walk), START_UT**2 * np.stack([np.eye(PHASES)] * 3)
    prior, rest = prior_precision(walk), np.zeros(walk.unknowns)
    rest[IRON] = WITHOUT_IRON
    for step in range(MAX_STEPS):
        residual, jacobian = linearize(walk, at)
        whitening = np.asarray(np.linalg.inv(np.linalg.cholesky(spread)))
        weight = compute_weights(whiten(whitening, residual))
        last = Linearization(residual, jacobian, weight, whitening, prior)
        normal = last.information.sum(axis=0) + prior
        change = np.linalg.solve(normal, last.score.sum(axis=0) - prior @ (at - rest))
        if step >= MIN_STEPS and np.abs(change[:3]).max() < CLOSE_UT:
            break
        at = at + change
        spread = learn_spread(walk, residual - jacobian @ change, weight)
    covariance = compute_covariance(walk, last)[IRON, IRON]
    return IronFit(at, mean_up(walk.strides.standing_R), last, covariance)


def level_sum(up: Floats, vertical_uT: float) -> Floats:
    """Jacobian (2, 9) of the horizontal iron, in levelled axes, by h and the six of S; `up` (3,) in the body."""
    return np.asarray(compute_level_R_body(up)[:2] @ body_sum(up, vertical_uT))


def body_sum(up: Floats, vertical_uT: float) -> Floats:
    """Jacobian (3, 9) of the iron, in body axes, by h and the six of S with the vertical field along `up` (3,)."""
    by_soft = np.stack([matrix_of(one) @ up for one in np.eye(6)], axis=1)
    return np.hstack([np.eye(3), vertical_uT * by_soft])


def compute_covariance(walk: StrideModel, fit: Linearization) -> Floats:
    """Sandwich covariance (U, U) of all unknowns: strides passing one place are not independent."""
    information = fit.information
    bread = np.linalg.inv(information.sum(axis=0) + fit.prior)
    size = float((whiten(fit.whitening, fit.residual) ** 2).mean())
    within = size * np.einsum("k,kij->ij", fit.weight, information)
    # share of the variance of d that is the building's field, repeated wherever the walk returns
    square = float((fit.residual**2).mean())
    share = 1.0 - READING_UT**2 / max(square, READING_UT**2)
    between = share * _sum_over_places(walk, fit)
    # project to positive semidefinite: correlation may only add uncertainty
    value, axes = np.linalg.eigh(between)
    between = (axes * np.maximum(value, 0.0)) @ axes.T
    # independent fields of three components, and those left by the unknowns: all but e and the delay
    _, alike = _compare_places(walk.strides.place[..., :2].mean(axis=1), np.arange(len(walk)))
    fields = 3 * len(walk) ** 2 / (len(walk) + 2 * share * alike.sum())
    absorbed = 1 + FIELD.stop - 2 + walk.unknowns - COMMON.stop
    growth = float(fields / max(fields - absorbed, MIN_LEFT))
    covariance = bread @ (growth * (within + between) + fit.prior) @ bread
    covariance[:3, :3] += FLOOR_UT**2 * np.eye(3)
    return np.asarray(covariance)


def _sum_over_places(walk: StrideModel, fit: Linearization) -> Floats:
    """Cross-stride part (U, U) of M, the covariance of the score, if all of d were the building's field."""
    sigma = (fit.residual**2).mean(axis=0)
    sigma[:, :2] = sigma[:, :2].mean(axis=1, keepdims=True)
    sigma = np.sqrt(sigma)
    pulls = np.swapaxes(fit.whitening, 1, 2) @ np.moveaxis(whiten(fit.whitening, fit.jacobian), 2, 0).reshape(
        3, len(walk), PHASES, -1
    ).swapaxes(0, 1)
    pulls = pulls * fit.weight[:, None, None, None] * sigma.T[None, :, :, None]
    sites = pulls.reshape(len(walk), 3, SITES, PHASES // SITES, -1).sum(axis=3).swapaxes(1, 2)
    place = walk.strides.place.reshape(len(walk), SITES, PHASES // SITES, 3).mean(axis=2)
    pair, alike = _compare_places(place[..., :2].reshape(-1, 2), np.repeat(np.arange(len(walk)), SITES))
    rows = sites.reshape(len(walk) * SITES, -1)
    near = coo_matrix((alike, (pair[:, 0], pair[:, 1])), shape=(len(rows),) * 2).tocsr() @ rows
    unknowns = fit.jacobian.shape[3]
    half = rows.reshape(-1, unknowns).T @ near.reshape(-1, unknowns)
    return np.asarray(half + half.T)


def _compare_places(place: Floats, stride: Ints) -> tuple[Ints, Floats]:
    """Pairs (M, 2) of places (N, 2) m of different strides (N,) within reach, and their fields' correlation (M,)."""
    pair = cKDTree(place).query_pairs(REACH_M, output_type="ndarray")
    pair = pair[stride[pair[:, 0]] != stride[pair[:, 1]]]
    apart = np.linalg.norm(place[pair[:, 0]] - place[pair[:, 1]], axis=1)
    return pair, np.exp(-apart / FIELD_LENGTH_M)
