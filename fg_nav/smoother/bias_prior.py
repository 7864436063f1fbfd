"""How large the gyroscope's bias may be where no rest shows it, by the evidence of the walk.

The prior of the bias about zero is that of a calibrated sensor, sigma s0. One that was not calibrated has several times
as much, and a prior that is too narrow holds its bias back: the heading turns, and the sigmas deny it. A solution with
s0 has, of the first bias variable, mean m and covariance P. Less the prior, what the walk itself shows of it is

    Lambda = P^-1 - I / s0^2,     eta = P^-1 m,

and under another sigma s the evidence of the walk is, up to a constant, in closed form

    log p(z | s) = 1/2 eta^T (Lambda + I / s^2)^-1 eta - 1/2 log|I + s^2 Lambda|          (MacKay 2003, section 28)

`LEVELS_DEG_S` above s0 are tried; the best is taken where it explains the walk better than s0 by more than `MOST_NATS`.
No smaller level is tried: on three numbers a prior three times narrower gains 3.3 nats at most.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from gtsam.symbol_shorthand import B

from fg_nav.arrays import Floats
from fg_nav.factors.differential_field import GYRO
from fg_nav.smoother.evidence import MOST_NATS
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.solver import Solved

LEVELS_DEG_S = (0.5, 1.5)
"""deg/s: zero-rate output of an uncalibrated part by its sheet, and of one that is cold or old."""

LEAST_SHARE = 1e-9
"""Of the prior's information, below which the walk shows nothing: rounding."""


@dataclass(frozen=True)
class BiasPrior:
    """Sigma of the bias before the walk, deg/s, and by how many nats it explains the walk better."""

    sigma_deg_s: float
    nats: float

    @property
    def note(self) -> str:
        """The same in words."""
        return f"gyro bias of up to {self.sigma_deg_s:g} deg/s, one sigma, by the evidence of {self.nats:.0f} nats"


def find_bias_prior(problem: WalkProblem, solved: Solved) -> BiasPrior | None:
    """Find a wider prior of the gyro bias by a solution of the walk; None where it shows none, or has rests."""
    if problem.known.rests:
        return None
    first = B(0)
    mean = solved.values.atConstantBias(first).gyroscope()
    covariance = solved.root.covariances({first})[first][GYRO, GYRO]
    return choose_bias_prior(mean, covariance, problem.known.gyro_bias_sigma)


def choose_bias_prior(mean: Floats, covariance: Floats, assumed: float) -> BiasPrior | None:
    """Choose by mean (3,) and covariance (3, 3) under the sigma assumed, all rad/s; None to keep it."""
    posterior = np.linalg.inv(covariance)
    # What the walk shows, free of rounding where it shows nothing.
    values, axes = np.linalg.eigh(posterior - np.eye(3) / assumed**2)
    shown = np.where(values > LEAST_SHARE / assumed**2, values, 0.0)
    eta = axes.T @ posterior @ mean

    def evidence(sigma: float) -> float:
        return float(0.5 * np.sum(eta**2 / (shown + sigma**-2) - np.log1p(sigma**2 * shown)))

    wider = [level for level in LEVELS_DEG_S if np.radians(level) > assumed]
    gains = [evidence(float(np.radians(level))) - evidence(assumed) for level in wider]
    if not gains or max(gains) <= MOST_NATS:
        return None
    best = int(np.argmax(gains))
    return BiasPrior(wider[best], gains[best])
