"""Steps of a pocket and fixes of a receiver: the path through both, the step constant and the heading by them.

A step d_k of the path (`dead_reckoning`) is turned and scaled by what the walk does not know well of itself, and both
walk slowly: trousers, pace, and what the compass misses.

    p_k+1 = p_k + exp(s_k) R(psi_k) d_k (+ its own error)       psi_k+1 = psi_k (+ w)       s_k+1 = s_k (+ v)

psi is clockwise about up. A fix observes p at the node nearest in time, with its accuracy for sigma (`fg_nav.gnss`);
each round multiplies the variance of a fix by 1 + (r / (c sigma))^2, which is Cauchy's. An extended Kalman filter
forward and the smoother of Rauch, Tung and Striebel back, about the estimates of the filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.frames import yaw_rotation
from fg_nav.gnss import CAUCHY, CORRELATED_S, Gnss, describe_start, find_turn, select_fixes
from fg_nav.pocket.dead_reckoning import (
    MOUNTING_SIGMA_DEG,
    STEP_HEADING_SIGMA_DEG,
    STEP_SIGMA,
    StepLength,
    SteppedPath,
)
from fg_nav.pocket.track import PocketTrack
from fg_nav.truth import Fix

TURN_WALK_DEG = 2.0  # of psi, deg/sqrt(s): ten degrees in half a minute, of a sensor that shifts and of iron

SCALE_WALK = 0.02  # of s, 1/sqrt(s): a tenth in half a minute, by kerbs, slopes and haste

UNSEEN_M_S = 0.7  # walk of the place where no step is seen, m/sqrt(s): who carries the sensor in a hand goes on

ROUNDS = 8  # of weights

MAX_GIVEN_SIGMA = np.radians(45.0)  # a heading known worse is first sought in all directions


@dataclass(frozen=True)
class FusedPath:
    """Path of steps and fixes.

    Attributes
    ----------
    t : (S + 1,) s, the first step's begin and the end of each.
    position : (S + 1, 2) m east and north, in the frame of the fixes.
    turn, log_scale : (S + 1,) psi in rad clockwise, and s.
    covariance : (S + 1, 4, 4) of position, psi and s.
    weights : (K,) of the fixes, 1 for one without a residual.
    """

    t: Floats
    position: Floats
    turn: Floats
    log_scale: Floats
    covariance: Floats
    weights: Floats


def fuse_fixes(t: Floats, steps: Floats, fixes: Sequence[Fix], heading_sigma: float, scale_sigma: float) -> FusedPath:
    """Find the path through steps and fixes.

    Parameters
    ----------
    t : (S + 1,) s, begin of the first step and end of each.
    steps : (S, 2) m east and north, each.
    fixes : at least `fg_nav.gnss.MIN_FIXES` within the walk; heights are not used.
    heading_sigma, scale_sigma : of psi, rad, and s, at the start.

    Raises `EstimationError` with fewer fixes.
    """
    # node of each fix, and its sigma with that of what was walked in between
    seen = select_fixes(fixes, float(t[0]) - CORRELATED_S, float(t[-1]) + CORRELATED_S)
    node = np.abs(seen.time[:, None] - t).argmin(axis=1)
    place, variance = seen.place, seen.sigma**2 + (UNSEEN_M_S * (seen.time - t[node])) ** 2
    # a heading that is not known is sought first
    walked, turn = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), 0.0
    if heading_sigma > MAX_GIVEN_SIGMA:
        turn, heading_sigma = -find_turn(walked[node], seen)[0], float(MAX_GIVEN_SIGMA)
    best = int(np.argmin(variance))
    start = place[best] - walked[node[best]] @ yaw_rotation(-turn)[:2, :2].T
    prior = np.array([*start, turn, 0.0])
    spread = np.diag([1e4, 1e4, heading_sigma**2, scale_sigma**2])
    # rounds of weights
    scale = np.ones(len(node))
    for _ in range(ROUNDS):
        x, P = _smooth(t, steps, node, place, variance * scale, prior, spread)
        off = ((place - x[node, :2]) ** 2).sum(axis=1) / variance
        scale = 1.0 + off / CAUCHY**2
    return FusedPath(t, x[:, :2], x[:, 2], x[:, 3], P, 1.0 / scale)


def _smooth(
    t: Floats, steps: Floats, node: Ints, place: Floats, variance: Floats, prior: Floats, spread: Floats
) -> tuple[Floats, Floats]:
    """States (S + 1, 4) and covariances (S + 1, 4, 4)."""
    n = len(t)
    x, P, F = np.empty((n, 4)), np.empty((n, 4, 4)), np.tile(np.eye(4), (n - 1, 1, 1))
    ahead_x, ahead_P = np.empty((n, 4)), np.empty((n, 4, 4))
    h, length = np.diff(t), np.linalg.norm(steps, axis=1)
    unseen = UNSEEN_M_S**2 * np.maximum(h - 1.5 * float(np.median(h)), 0.0)
    first = np.searchsorted(node, np.arange(n + 1))
    ahead_x[0], ahead_P[0] = prior, spread
    for k in range(n):
        # fixes at the node: those at one are one, with their mean
        x[k], P[k] = ahead_x[k], ahead_P[k]
        here = slice(first[k], first[k + 1])
        if first[k] < first[k + 1]:
            information = 1.0 / variance[here]
            mean, R = information @ place[here] / information.sum(), 1.0 / information.sum()
            gain = P[k][:, :2] @ np.linalg.inv(P[k][:2, :2] + R * np.eye(2))
            x[k] = x[k] + gain @ (mean - x[k, :2])
            P[k] = P[k] - gain @ P[k][:2]
        # the step
        if k < n - 1:
            move = np.exp(x[k, 3]) * (yaw_rotation(-x[k, 2])[:2, :2] @ steps[k])
            across = np.array([move[1], -move[0]])
            F[k][:2, 2], F[k][:2, 3] = across, move
            Q = np.diag([unseen[k], unseen[k], np.radians(TURN_WALK_DEG) ** 2 * h[k], SCALE_WALK**2 * h[k]])
            if length[k] > 0:
                Q[:2, :2] += STEP_SIGMA**2 * np.outer(move, move)
                Q[:2, :2] += np.radians(STEP_HEADING_SIGMA_DEG) ** 2 * np.outer(across, across)
            ahead_x[k + 1] = x[k] + np.array([*move, 0.0, 0.0])
            ahead_P[k + 1] = F[k] @ P[k] @ F[k].T + Q
    for k in range(n - 2, -1, -1):
        gain = P[k] @ F[k].T @ np.linalg.inv(ahead_P[k + 1])
        x[k] = x[k] + gain @ (x[k + 1] - ahead_x[k + 1])
        P[k] = P[k] + gain @ (P[k + 1] - ahead_P[k + 1]) @ gain.T
    return x, P


def lay_on_fixes(
    track: PocketTrack, path: SteppedPath, gnss: Gnss, heading_sigma: float | None, step_length: StepLength
) -> tuple[PocketTrack, SteppedPath, StepLength, dict[str, float]]:
    """Lay a stepped path, and its track, on fixes; the heading's sigma at its start is None where it is not known.

    Returns both, north being the true one and the origin where the path starts, the step length that came out, and
    where on Earth that start is. Errors as of `fuse_fixes`.
    """
    t = track.t[np.append(path.sample[:1], path.sample[1::2])]
    steps = path.position[1::2, :2] - path.position[::2, :2]
    sigma = np.pi if heading_sigma is None else float(np.hypot(heading_sigma, np.radians(MOUNTING_SIGMA_DEG)))
    fused = fuse_fixes(t, steps, gnss.fixes, sigma, step_length.sigma)
    # the path: a step begins where the one before ended
    length, at = path.length * np.exp(fused.log_scale[:-1]), np.repeat(np.arange(len(t)), 2)[1:-1]
    position, covariance = np.zeros((len(at), 3)), path.covariance.copy()
    position[:, :2], covariance[:, :2, :2] = (fused.position - fused.position[0])[at], fused.covariance[at, :2, :2]
    laid = replace(
        path, position=position, covariance=covariance, length=length, heading=path.heading + fused.turn[:-1]
    )
    # the track, turned as the path
    turned = track.sigma.copy()
    turned[:, 2] = np.interp(track.t, t, np.sqrt(fused.covariance[:, 2, 2]))
    turn = np.interp(track.t, t, fused.turn)
    track = replace(track, nav_R_body=yaw_rotation(-turn) @ track.nav_R_body, sigma=turned)
    # the step constant
    constant = step_length.constant_m * float(length.sum() / path.length.sum())
    found = StepLength(constant, float(np.sqrt(np.mean(fused.covariance[:, 3, 3]))), "GNSS")
    sigma_m = float(np.sqrt(np.trace(fused.covariance[0, :2, :2]) / 2))
    return track, laid, found, describe_start(gnss, fused.position[0], sigma_m, fused.weights > 0.5)
