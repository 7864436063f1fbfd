"""Prior of the gyroscope's bias: a mixture of a calibrated sensor and worse ones, weighed by the walk's evidence.

Between recordings the bias of one good sensor scatters by 0.02 to 0.1 deg/s about its mean, that of an uncalibrated
part by several deg/s, and no single sigma serves both: a narrow one holds a large bias back, so that the heading turns
and the sigmas deny it; a wide one lets noise of the strides pass for a bias. So the prior of the first bias variable is

    p(b) = sum_l p_l N(b; mu, s_l^2 I),     s_l = (`LEVELS`) times s0, mu and s0 of the parameters,

mu zero, or as a calibration at rest shows it. The walk is solved with s0 first: mean m and covariance P of the bias.
Less that prior, the walk (rests, swings, field) itself shows, in rad/s,

    Lambda = P^-1 - I / s0^2,     eta = P^-1 m - mu / s0^2,

and under another level its posterior and its evidence are, up to a constant, in closed form (MacKay 2003, section 28)

    P_l = (Lambda + I / s_l^2)^-1,     m_l = P_l (eta + mu / s_l^2),
    log p(z | s_l) = 1/2 d^T (Lambda + I / s_l^2)^-1 d - 1/2 log|I + s_l^2 Lambda|,     d = eta - Lambda mu.

The mixture's posterior has the mean m* and covariance P* of all levels, weighted by evidence and p_l. The Gaussian
prior that leads to it, of information P*^-1 - Lambda, takes the place of the first. Only its factor changes, so the
walk is solved again from its solution, not from its samples.
"""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B
from scipy.linalg import block_diag

from fg_nav.arrays import Floats
from fg_nav.factors.differential_field import GYRO
from fg_nav.smoother.evidence import average
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.solver import Solved
from fg_nav.smoother.strides import ACC_BIAS_SIGMA

LEVELS = (1 / 3, 1.0, 10 / 3, 10.0, 33.0)  # Of s0 = 0.15: 0.05 to 5 deg/s, from a sensor kept calibrated to raw MEMS.
PRIOR = (0.25, 0.3, 0.25, 0.1, 0.1)  # Before the walk, of sensors as they are sold and worn; factors of 2 move nothing.
MIN_SHARE = 1e-9  # Of the prior's information, below which the walk shows nothing: rounding.
MIN_SHIFT_SIGMAS, MIN_CHANGE = 0.05, 0.02  # Of the bias and its sigma: below them the walk would stay as it is.


def average_bias_prior(problem: WalkProblem, solved: Solved) -> WalkProblem | None:
    """Return the problem with the prior of the gyro bias that its solution shows; None where the walk would stay."""
    known, mean = problem.known, solved.values.atConstantBias(B(0)).gyroscope()
    covariance = solved.root.covariances({B(0)})[B(0)][GYRO, GYRO]
    prior_mean, prior, shift, level = match_mixture(mean, covariance, known.gyro_bias_mean, known.gyro_bias_sigma)
    if shift < 1.0:
        return None
    at, graph = _find_prior(problem.graph), gtsam.NonlinearFactorGraph(problem.graph)
    noise = gtsam.noiseModel.Gaussian.Covariance(block_diag(ACC_BIAS_SIGMA**2 * np.eye(3), prior))
    graph.replace(at, gtsam.PriorFactorConstantBias(B(0), gtsam.imuBias.ConstantBias(np.zeros(3), prior_mean), noise))
    note = f"gyro bias of {np.degrees(level):.2g} deg/s before the walk, one sigma, the mean over the evidence"
    return replace(problem, graph=graph, known=replace(known, notes=(*known.notes, note)), values=solved.values)


def match_mixture(mean: Floats, covariance: Floats, mu: Floats, s0: float) -> tuple[Floats, Floats, float, float]:
    """Return mean (3,) rad/s and covariance (3, 3) of the Gaussian prior that leads to the mixture's posterior.

    `mean` (3,) and `covariance` (3, 3) are those of the bias under the prior N(mu, s0^2). The third is by how much the
    posterior changes, in multiples of what matters, the last the levels' root mean square by the evidence, rad/s.
    """
    posterior, size = np.linalg.inv(covariance), np.eye(3)
    # What the walk shows, free of rounding where it shows nothing.
    values, axes = np.linalg.eigh(posterior - size / s0**2)
    shown = np.where(values > MIN_SHARE / s0**2, values, 0.0)
    eta = axes.T @ (posterior @ mean - mu / s0**2)
    off = eta - shown * (axes.T @ mu)
    # Posterior and evidence of each level, in the axes of what is shown.
    variance = (s0 * np.array(LEVELS))[:, None] ** 2
    spread = 1.0 / (shown + 1.0 / variance)
    means = spread * (eta + (axes.T @ mu) / variance)
    minus_log = -0.5 * np.sum(off**2 * spread - np.log1p(variance * shown), axis=1)
    # Their first two moments.
    centre = average(means, minus_log, np.array(PRIOR))
    apart = means - centre
    moments = spread[:, :, None] * size + apart[:, :, None] * apart[:, None, :]
    matched = average(moments, minus_log, np.array(PRIOR))
    # The prior that makes them of what the walk shows; never wider than the widest level.
    information, turn = np.linalg.eigh(np.linalg.inv(matched) - np.diag(shown))
    information = np.maximum(information, 1.0 / variance[-1])
    prior = axes @ (turn / information) @ turn.T @ axes.T
    prior_mean = axes @ centre + prior @ axes @ (shown * centre - eta)
    before = axes.T @ mean
    shift = float((centre - before) @ (axes.T @ posterior @ axes) @ (centre - before)) ** 0.5 / MIN_SHIFT_SIGMAS
    change = np.abs(np.log(np.diagonal(matched) / np.diagonal(axes.T @ covariance @ axes))).max() / (2.0 * MIN_CHANGE)
    level = float(np.sqrt(average(variance[:, 0], minus_log, np.array(PRIOR))))
    return np.asarray(prior_mean), np.asarray(0.5 * (prior + prior.T)), max(shift, float(change)), level


def _find_prior(graph: gtsam.NonlinearFactorGraph) -> int:
    """Place of the prior on the first bias."""
    return next(i for i in range(graph.size()) if isinstance(graph.at(i), gtsam.PriorFactorConstantBias))
