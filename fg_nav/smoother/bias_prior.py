"""How large the gyroscope's bias may be where no rest shows it, averaged by the evidence of the walk.

The prior of the bias about zero is that of a calibrated sensor, sigma s0. One that was not calibrated has several times
as much, and a prior that is too narrow holds its bias back: the heading turns, and the sigmas deny it. A solution with
s0 has, of the first bias variable, mean m and covariance P. Less the prior, what the walk itself shows of it is

    Lambda = P^-1 - I / s0^2,     eta = P^-1 m,

and under another sigma s the evidence of the walk is, up to a constant, in closed form

    log p(z | s) = 1/2 eta^T (Lambda + I / s^2)^-1 eta - 1/2 log|I + s^2 Lambda|          (MacKay 2003, section 28)

The prior has the mean of s^2 over s0 and `LEVELS_DEG_S`, weighted by evidence and `PRIOR`: the variance of the mixture.
Only its factor changes, so the walk is solved again from its solution, not from its samples.
"""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B

from fg_nav.arrays import Floats
from fg_nav.factors.differential_field import GYRO
from fg_nav.smoother.evidence import average
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.solver import Solved

LEVELS_DEG_S = (0.5, 1.5)
"""deg/s: zero-rate output of an uncalibrated part by its sheet, and of one that is cold or old."""

PRIOR = (0.9, 0.08, 0.02)  # Of s0 and these levels, before the walk.
LEAST_SHARE = 1e-9  # Of the prior's information, below which the walk shows nothing: rounding.
LEAST_CHANGE = 1.05  # Of the sigma: less moves nothing by more than a hundredth of its own sigma.


def average_bias_prior(problem: WalkProblem, solved: Solved) -> WalkProblem | None:
    """Return the problem with the prior of the gyro bias that its solution shows; None where it stays, or has rests."""
    if problem.known.rests:
        return None
    assumed, covariance = problem.known.gyro_bias_sigma, solved.root.covariances({B(0)})[B(0)][GYRO, GYRO]
    sigma = average_sigma(solved.values.atConstantBias(B(0)).gyroscope(), covariance, assumed)
    if sigma < LEAST_CHANGE * assumed:
        return None
    at, graph = _find_prior(problem.graph), problem.graph.clone()
    graph.replace(at, _widen(problem.graph.at(at), sigma / assumed))
    note = f"gyro bias of up to {np.degrees(sigma):.2g} deg/s, one sigma, the mean over the evidence"
    known = replace(problem.known, gyro_bias_sigma=sigma, notes=(*problem.known.notes, note))
    return replace(problem, graph=graph, known=known, values=solved.values)


def average_sigma(mean: Floats, covariance: Floats, assumed: float) -> float:
    """Sigma of the prior, rad/s, by mean (3,) and covariance (3, 3) of the bias under the sigma assumed, all rad/s."""
    posterior = np.linalg.inv(covariance)
    # What the walk shows, free of rounding where it shows nothing.
    values, axes = np.linalg.eigh(posterior - np.eye(3) / assumed**2)
    shown = np.where(values > LEAST_SHARE / assumed**2, values, 0.0)
    eta = axes.T @ posterior @ mean
    levels = np.array([assumed, *(max(float(np.radians(level)), assumed) for level in LEVELS_DEG_S)])
    variance = levels[:, None] ** 2
    evidence = 0.5 * np.sum(eta**2 / (shown + 1.0 / variance) - np.log1p(variance * shown), axis=1)
    return float(np.sqrt(average(levels**2, -evidence, np.array(PRIOR))))


def _find_prior(graph: gtsam.NonlinearFactorGraph) -> int:
    """Place of the prior on the first bias."""
    return next(i for i in range(graph.size()) if isinstance(graph.at(i), gtsam.PriorFactorConstantBias))


def _widen(factor: gtsam.NonlinearFactor, by: float) -> gtsam.PriorFactorConstantBias:
    assert isinstance(factor, gtsam.PriorFactorConstantBias)
    sigmas = np.array(cast("gtsam.noiseModel.Diagonal", factor.noiseModel()).sigmas())
    sigmas[GYRO] *= by
    return gtsam.PriorFactorConstantBias(B(0), factor.prior(), gtsam.noiseModel.Diagonal.Sigmas(sigmas))
