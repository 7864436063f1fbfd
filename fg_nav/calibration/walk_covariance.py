"""How well a walk tells the iron: the sandwich A^-1 (J^T W corr(d) W J + prior) A^-1.

The correlation of d from footfall to footfall is that of the residuals, and no less than `least_correlation`, for a
straight hides a part of it. A walk of several rounds sees the same places again: the correlation of its residuals shows
it, and it is counted (`_of_other_passes`).
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import correlate

from fg_nav.arrays import Floats
from fg_nav.calibration.walk_model import (
    IRON,
    Walk,
    WalkCalibrationParameters,
    jacobian_of,
    prior_precision,
    residual_of,
    weights_of,
)

MOST_CORRELATED = 0.9
"""Neighbouring footfalls: beyond this nothing could be said of h at all."""

PASS_WIDTH = 9
"""Lags over which another pass shows: rounds differ by some strides."""

LEAST_PULL = 1e-12
"""Of all footfalls, in sigmas squared: readings that never change have none."""

CHANCE_SIGMAS = 5.5
"""Of the mean correlation over them; four, times 1.4 as the deviations are not white."""


def covariance_of(walk: Walk, at: Floats, sigma_d: Floats, p: WalkCalibrationParameters) -> Floats:
    """Of all unknowns (P, P) that were found, with the scale of d (3,) that was: the sandwich.

    The share of the Hessian that the weights keep, `bend`, is that of the Student distribution, averaged over axes.
    """
    prior = prior_precision(walk, p)
    jacobian = jacobian_of(walk, at) / sigma_d[:, None]
    residual = residual_of(walk, at) / sigma_d
    weight = weights_of(residual, np.ones(3), p.tail)
    pull = weight[:, None] * residual
    square = float((pull**2).mean())
    bend = float(weight.mean()) - 2 / (p.tail + 3) * square
    free = len(walk) / max(len(walk) - IRON / 3, 1.0)
    meat = square * free * (_of_neighbours(jacobian, pull, p) + _of_other_passes(jacobian, pull, p))
    bread = np.linalg.inv(bend * _at_lag(jacobian, 0) + prior)
    return np.asarray(bread @ (meat + prior) @ bread)


def _at_lag(jacobian: Floats, lag: int) -> Floats:
    """Sum (P, P) of J_k^T J_k+lag and its transpose; of J_k^T J_k alone for none."""
    columns = jacobian.shape[2]
    product = jacobian[: len(jacobian) - lag].reshape(-1, columns).T @ jacobian[lag:].reshape(-1, columns)
    return np.asarray(product + product.T if lag else product)


def _of_neighbours(jacobian: Floats, pull: Floats, p: WalkCalibrationParameters) -> Floats:
    """J^T corr(d) J (P, P), the correlation a power of that of neighbours, all axes alike."""
    neighbours = float((pull[1:] * pull[:-1]).sum() / _sum_of_squares(pull))
    base = float(np.clip(neighbours, p.least_correlation, MOST_CORRELATED))
    last = min(p.lags, len(pull) - 1)
    return np.asarray(sum(base**lag * _at_lag(jacobian, lag) for lag in range(last + 1)))


def _sum_of_squares(pull: Floats) -> float:
    return max(float((pull**2).sum()), LEAST_PULL)


def _of_other_passes(jacobian: Floats, pull: Floats, p: WalkCalibrationParameters) -> Floats:
    """Add (P, P) for a walk that comes by the same places again: strides far apart are alike there.

    It shows as a correlation over a few neighbouring lags that chance does not make. It may only add doubt.
    """
    lag = np.arange(len(pull))
    pairs = len(pull) - lag
    products = sum(correlate(axis, axis, method="fft")[len(pull) - 1 :] for axis in pull.T)
    correlation = products / _sum_of_squares(pull) * len(pull) / pairs
    about = uniform_filter1d(correlation, PASS_WIDTH)
    chance = CHANCE_SIGMAS / np.sqrt(len(pull.T) * PASS_WIDTH * pairs)
    again = (about > chance) & (lag > p.lags) & (pairs >= p.fewest)
    added = np.zeros((jacobian.shape[2],) * 2)
    for k in np.flatnonzero(again):
        added += correlation[k] * _at_lag(jacobian, int(k))
    value, axes = np.linalg.eigh(added)
    return np.asarray((axes * np.maximum(value, 0.0)) @ axes.T)
