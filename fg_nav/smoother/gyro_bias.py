"""What a walk shows of its gyroscope's bias: the random walk of it, and the sigma of its prior, both by evidence.

Random walk. q (deg/s/sqrt(s)) is its density: from one bias variable to the next, t seconds later, each axis changes by
q sqrt(t), one sigma. Gyroscopes differ in it a hundredfold.

Only the noise S_i(q) of these changes depends on q, so one linearization serves for all, the last one of the solution
with the q that is assumed. What lies between the nodes at which the bias changes is eliminated once, and what is left,
a chain of the biases and these nodes, for each level, by its evidence (`sensitivity`). The walk has the mean of q^2
over `WALK_LEVELS_DEG_S`, weighted by evidence and `WALK_PRIOR`: the variance of the mixture, so no level has to win,
and a walk too short to show one has that of the prior. The evidence is that of the inertial graph; with the magnetic
field it is larger, and chooses the same.

Prior. Between recordings the bias of a good sensor scatters by 0.02 to 0.1 deg/s, that of an uncalibrated part by
several deg/s. So the prior of the first bias variable is a mixture,

    p(b) = sum_l p_l N(b; mu, s_l^2 I),     s_l = (`SIGMA_LEVELS`) times s0, mu and s0 of the parameters,

mu zero, or as a calibration at rest shows it. The walk is solved with s0 first: mean m and covariance P of the bias.
The information of the walk alone is

    Lambda = P^-1 - I / s0^2,     eta = P^-1 m - mu / s0^2,

and under another level its posterior and its evidence are, up to a constant, in closed form (MacKay 2003, section 28)

    P_l = (Lambda + I / s_l^2)^-1,     m_l = P_l (eta + mu / s_l^2),
    log p(z | s_l) = 1/2 d^T (Lambda + I / s_l^2)^-1 d - 1/2 log|I + s_l^2 Lambda|,     d = eta - Lambda mu.

The mixture's posterior has the mean m* and covariance P* of all levels, weighted by evidence and p_l. The Gaussian
prior that leads to it, of information P*^-1 - Lambda, takes the place of the first. Only its factor changes, so the
walk is solved again from its solution, not from its samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import compress
from typing import cast

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X
from scipy.linalg import block_diag

from fg_nav.arrays import Floats
from fg_nav.factors.differential_field import GYRO
from fg_nav.factors.residual import LETTER_SHIFT, Stack
from fg_nav.smoother.gauss_newton import LinearWalk
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.sensitivity import average
from fg_nav.smoother.solver import Solved
from fg_nav.smoother.strides import ACC_BIAS_SIGMA, MIN_WALK_DEG_S

WALK_LEVELS_DEG_S = (6e-4, 2e-3, 6e-3, 2e-2)  # 0.04 to 1.2 deg/s an hour; less also holds scale errors, uneven field.
WALK_PRIOR = (0.9, 0.09, 0.009, 0.001)  # Before the walk: gyroscopes by their sheets, and one in ten that warms up.
SIGMA_LEVELS = (1 / 3, 0.6, 1.0, 1.8, 10 / 3, 6.0, 10.0, 18.0, 33.0)  # Of s0: 0.05 to 5 deg/s.
SIGMA_PRIOR = (0.13, 0.13, 0.15, 0.15, 0.13, 0.1, 0.08, 0.07, 0.06)  # Before the walk, of sensors as sold and worn.
MIN_SHARE = 1e-9  # Of the prior's information, below which the walk shows nothing: rounding.
Change = gtsam.BetweenFactorConstantBias  # From one bias variable to the next; `strides` alone makes them.
MIN_SHIFT_SIGMAS, MIN_CHANGE = 0.05, 0.02  # Of the bias and its sigma: below them the walk would stay as it is.


def average_bias_walk(problem: WalkProblem, stacks: Sequence[Stack]) -> WalkProblem:
    """Return the problem with its gyro-bias random walk averaged over levels by evidence; `stacks`: linear factors."""
    assumed = max(problem.parameters.gyro_bias_walk_deg_s, MIN_WALK_DEG_S)
    # The factors from one bias variable to the next.
    is_change = [one.keys.shape[1] == 2 and (one.keys >> np.uint64(LETTER_SHIFT) == ord("b")).all() for one in stacks]
    changes = list(compress(stacks, is_change))
    if not changes:
        return problem.with_note(f"gyro bias walk {assumed:.2g} deg/s/sqrt(s), as assumed")
    # Marginalize the nodes of each bias variable once, without the random-walk factors, which vary by level.
    nodes = problem.nodes
    begins = np.flatnonzero(np.diff(nodes.bias[nodes.footfall])) + 1
    at_change = np.array([key(int(j)) for j in begins for key in (X, V)], dtype=np.uint64)
    keys = problem.time_order
    between = np.isin(keys >> np.uint64(LETTER_SHIFT), list(map(ord, "xvp"))) & ~np.isin(keys, at_change)
    others = compress(stacks, np.logical_not(is_change))
    linear = LinearWalk.of(others, np.concatenate([keys[between], keys[~between]]))
    chain = linear.eliminate_before(int(between.sum()))
    # The evidence of each level, and the mean variance.
    levels = assumed / WALK_LEVELS_DEG_S[0] * np.array(WALK_LEVELS_DEG_S)
    evidence = np.array([_minus_log_evidence(chain, changes, level / assumed) for level in levels])
    level = float(np.sqrt(average(levels**2, evidence, np.array(WALK_PRIOR))))
    # The random-walk factors with the averaged sigma.
    graph = gtsam.NonlinearFactorGraph()
    for factor in map(problem.graph.at, range(problem.graph.size())):
        if isinstance(factor, Change):
            sigmas = np.array(cast("gtsam.noiseModel.Diagonal", factor.noiseModel()).sigmas())
            sigmas[GYRO] *= level / assumed
            noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
            before, after = factor.keys()
            factor = Change(before, after, factor.measured(), noise)
        graph.push_back(factor)
    problem = replace(problem, graph=graph, parameters=replace(problem.parameters, gyro_bias_walk_deg_s=level))
    count = sum(len(one.keys) for one in changes)
    return problem.with_note(
        f"gyro bias walk {level:.2g} deg/s/sqrt(s), the mean over the evidence of {count} changes of the bias"
    )


def _minus_log_evidence(chain: LinearWalk, changes: Sequence[Stack], by: float) -> float:
    """Return -log evidence of the walk with the gyro-bias random-walk sigmas in `changes` multiplied by `by`."""
    scaled, noise = [], 0.0
    for keys, rows in changes:
        rows = rows.copy()
        rows[:, GYRO] /= by
        scaled.append(Stack(keys, rows))
        noise += 3 * len(keys) * np.log(by)
    return chain.join(scaled).minus_log_evidence(noise)


def average_bias_prior(problem: WalkProblem, solved: Solved) -> WalkProblem | None:
    """Return the problem with the prior of the gyro bias that its solution shows; None where the walk would stay."""
    known, mean = problem.known, solved.values.atConstantBias(B(0)).gyroscope()
    covariance = solved.root.covariances({B(0)})[B(0)][GYRO, GYRO]
    prior_mean, prior, shift, level = match_mixture(mean, covariance, known.gyro_bias_mean, known.gyro_bias_sigma)
    if shift < 1.0:
        return None
    graph = gtsam.NonlinearFactorGraph(problem.graph)
    at = next(i for i in range(graph.size()) if isinstance(graph.at(i), gtsam.PriorFactorConstantBias))
    noise = gtsam.noiseModel.Gaussian.Covariance(block_diag(ACC_BIAS_SIGMA**2 * np.eye(3), prior))
    graph.replace(at, gtsam.PriorFactorConstantBias(B(0), gtsam.imuBias.ConstantBias(np.zeros(3), prior_mean), noise))
    note = f"gyro bias of {np.degrees(level):.2g} deg/s before the walk, one sigma, the mean over the evidence"
    return replace(problem, graph=graph, values=solved.values).with_note(note)


def match_mixture(mean: Floats, covariance: Floats, mu: Floats, s0: float) -> tuple[Floats, Floats, float, float]:
    """Return mean (3,) rad/s and covariance (3, 3) of the Gaussian prior that leads to the mixture's posterior.

    `mean` (3,) and `covariance` (3, 3) are those of the bias under the prior N(mu, s0^2). The third is by how much the
    posterior changes, in multiples of what matters, the last the levels' root mean square by the evidence, rad/s.
    """
    posterior, size = np.linalg.inv(covariance), np.eye(3)
    # Likelihood of the walk: posterior information less the prior's, negative rounding clipped.
    values, axes = np.linalg.eigh(posterior - size / s0**2)
    shown = np.where(values > MIN_SHARE / s0**2, values, 0.0)
    eta = axes.T @ (posterior @ mean - mu / s0**2)
    off = eta - shown * (axes.T @ mu)
    # Posterior and evidence of each prior sigma, in the eigenvectors of the likelihood.
    variance = (s0 * np.array(SIGMA_LEVELS))[:, None] ** 2
    spread = 1.0 / (shown + 1.0 / variance)
    means = spread * (eta + (axes.T @ mu) / variance)
    minus_log = -0.5 * np.sum(off**2 * spread - np.log1p(variance * shown), axis=1)
    # Moment matching: mean and covariance of the mixture.
    centre = average(means, minus_log, np.array(SIGMA_PRIOR))
    apart = means - centre
    moments = spread[:, :, None] * size + apart[:, :, None] * apart[:, None, :]
    matched = average(moments, minus_log, np.array(SIGMA_PRIOR))
    # Divide by the likelihood to obtain the prior; never wider than the widest level.
    information, turn = np.linalg.eigh(np.linalg.inv(matched) - np.diag(shown))
    information = np.maximum(information, 1.0 / variance[-1])
    prior = axes @ (turn / information) @ turn.T @ axes.T
    prior_mean = axes @ centre + prior @ axes @ (shown * centre - eta)
    before = axes.T @ mean
    shift = float((centre - before) @ (axes.T @ posterior @ axes) @ (centre - before)) ** 0.5 / MIN_SHIFT_SIGMAS
    change = np.abs(np.log(np.diagonal(matched) / np.diagonal(axes.T @ covariance @ axes))).max() / (2.0 * MIN_CHANGE)
    level = float(np.sqrt(average(variance[:, 0], minus_log, np.array(SIGMA_PRIOR))))
    return np.asarray(prior_mean), np.asarray(0.5 * (prior + prior.T)), max(shift, float(change)), level
