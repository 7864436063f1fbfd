"""The scale of the gyroscope's axes, found where the magnetic field shows the heading, and taken off.

The gyroscope shows w = (1 + s) w_true + b on each axis, body frame, rad/s; s (3,) is the same for a whole walk. To the
first order in s, the end of an interval preintegrated from the rates (w - b) / (1 + s) is that from w - b moved, in
the tangent space of the state at the end, by D s,

    D = (theta, rho, nu),   theta' = R c,   nu' = (theta) x R f,   rho' = nu,      c = -(w - b) per axis,

R the attitude and f the specific force since the start of the interval, theta, rho and nu brought to the body axes at
its end. So s is one variable of the solved graph, linearized at its minimum, with the columns J of each inertial factor

    J = -(de/dpose_end, de/dv_end nav_R_end) D     and the prior     s = 0 +- `SCALE_SIGMA` per axis.

It is eliminated last, which leaves its minimum s and covariance P. Against s = 0 its evidence is

    log p(z | s free) / p(z | s = 0) = 1/2 s^T P^-1 s - 1/2 log(|SCALE_SIGMA^2 I| / |P|)     (MacKay 2003, section 28)

Only where that is more than `MOST_NATS` the samples are corrected and the walk is solved again; else, and without a
field, the gyroscope stays as it is: on a walk without a heading a scale of a percent explains what it must not.

Model: IEEE Std 528; D is this project's derivation, tested against preintegration of corrected samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, G, X
from numba import njit

from fg_nav.arrays import Floats, Ints
from fg_nav.factors import guarded_factor
from fg_nav.mechanisation import rotate_in_body
from fg_nav.recording import Recording
from fg_nav.smoother.bias_walk import MOST_NATS
from fg_nav.smoother.graph import WalkProblem
from fg_nav.smoother.solver import linearize, time_order

SCALE_SIGMA = 0.01
"""Prior of the scale of each axis: a few tenths of a percent after a calibration, 1 to 3 by the sheet of a raw part."""

INERTIAL_DIMS = (6, 3, 6, 3, 6)
"""Pose, velocity, pose, velocity, bias: the variables of an inertial factor."""


@dataclass(frozen=True)
class GyroScale:
    """Scale errors (3,) of the gyroscope, their covariance (3, 3), and the nats by which they explain a walk better."""

    scale: Floats
    covariance: Floats
    nats: float

    @property
    def note(self) -> str:
        """The same in words."""
        sigma = np.sqrt(np.diagonal(self.covariance))
        axes = ", ".join(f"{100 * s:+.2f} +- {100 * d:.2f}" for s, d in zip(self.scale, sigma, strict=True))
        return f"gyroscope's scale errors {axes} %, taken off: the field shows them by {self.nats:.0f} nats"

    def remove_from(self, recording: Recording) -> Recording:
        """Return the recording with the rates without these errors."""
        return replace(recording, gyr=recording.gyr / (1.0 + self.scale))


def find_gyro_scale(problem: WalkProblem, values: gtsam.Values) -> GyroScale | None:
    """Estimate the scale of the gyroscope at a solution of the walk; None without a field, or evidence of an error."""
    field = problem.field
    if field is None or not len(field.heading) + len(field.strides):
        return None
    found = estimate_gyro_scale(problem, values)
    return found if found.nats > MOST_NATS else None


def estimate_gyro_scale(problem: WalkProblem, values: gtsam.Values) -> GyroScale:
    """Estimate the scale of the gyroscope at a solution of the walk."""
    # The linear graph, its inertial factors with the columns of the scale, and the prior.
    linear = gtsam.GaussianFactorGraph()
    plain = linearize(problem.graph, problem.blocks, values)
    columns = iter(_columns(problem, values))
    for i in range(plain.size()):
        factor = plain.at(i)
        is_inertial = i < problem.graph.size() and problem.graph.at(i).size() == len(INERTIAL_DIMS)
        linear.push_back(_add_columns(factor, next(columns)) if is_inertial else factor)
    linear.push_back(gtsam.JacobianFactor(G(0), np.eye(3) / SCALE_SIGMA, np.zeros(3), gtsam.noiseModel.Unit.Create(3)))
    # The scale is eliminated last: the last rows of the root are its information.
    ordering = time_order(problem.nodes, problem.field is not None, problem.floors)
    ordering.push_back(G(0))
    tree = linear.eliminateMultifrontal(ordering, gtsam.EliminateQR)
    scale = np.asarray(tree.optimize().at(G(0)))
    conditionals = (root.conditional() for root in tree.roots())
    root = next(one.R() for one in conditionals if G(0) in one.keys())[-3:, -3:]  # noqa: SIM118 (no dict)
    covariance = np.asarray(np.linalg.inv(root.T @ root))
    occam = 3.0 * np.log(SCALE_SIGMA) + np.log(np.abs(np.diagonal(root))).sum()
    return GyroScale(scale, covariance, float(0.5 * ((root @ scale) ** 2).sum() - occam))


def _add_columns(factor: gtsam.GaussianFactor, moved: Floats) -> gtsam.GaussianFactor:
    """Give a linearized inertial factor the columns of the scale; `moved` (9, 3) is D with its velocity in nav axes."""
    A, b = cast("gtsam.JacobianFactor", factor).jacobian()
    blocks = np.split(A, np.cumsum(INERTIAL_DIMS)[:-1], axis=1)
    by_scale = -(blocks[2] @ moved[:6] + blocks[3] @ moved[6:])
    columns = [np.ascontiguousarray(block) for block in (*blocks, by_scale)]
    # A JacobianFactor of six keys can be made in Python only by linearizing a factor that is linear.
    keys, unit = [*factor.keys(), G(0)], gtsam.noiseModel.Unit.Create(len(b))
    as_given = guarded_factor("gyroscope's scale", keys, [*INERTIAL_DIMS, 3], unit, lambda _, __: (-b, columns))
    return as_given.linearize(gtsam.Values())


def _columns(problem: WalkProblem, values: gtsam.Values) -> Floats:
    """D (M-1, 9, 3) of all intervals, the velocity in nav axes."""
    recording, nodes = problem.recording, problem.nodes
    force, rate = recording.integrable
    bias = np.array([values.atConstantBias(B(k)).gyroscope() for k in range(int(nodes.bias[-1]) + 1)])
    moved = sense_scale(recording.t, force, rate, nodes.sample, bias[nodes.bias[nodes.footfall[:-1]]])
    nav_R_end = np.array([values.atPose3(X(j)).rotation().matrix() for j in range(1, len(nodes))])
    moved[:, 6:] = nav_R_end @ moved[:, 6:]
    return moved


@njit(cache=True)
def sense_scale(t: Floats, force: Floats, rate: Floats, sample: Ints, bias: Floats) -> Floats:
    """Derivative D (M-1, 9, 3) by the scale of the ends of the intervals between samples (M,).

    Rows: rotation (rad), position (m), velocity (m/s), all in the body axes at the end. `bias` (M-1, 3) rad/s. The
    rotation acts in the middle of each sample.
    """
    moved = np.zeros((len(sample) - 1, 9, 3))
    for k in range(len(sample) - 1):
        R, theta, rho, nu = np.eye(3), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
        for i in range(sample[k], sample[k + 1]):
            h = t[i + 1] - t[i]
            turn = (rate[i] - bias[k]) * h
            rotate_in_body(R, 0.5 * turn[0], 0.5 * turn[1], 0.5 * turn[2])
            change = -R * turn
            a = R @ force[i]
            middle = theta + 0.5 * change
            for axis in range(3):
                x, y, z = middle[:, axis]
                rho[:, axis] += nu[:, axis] * h
                for row, push in enumerate((y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0])):
                    rho[row, axis] += 0.5 * push * h * h
                    nu[row, axis] += push * h
            theta += change
            rotate_in_body(R, 0.5 * turn[0], 0.5 * turn[1], 0.5 * turn[2])
        end_R_start = np.ascontiguousarray(R.T)
        moved[k, :3], moved[k, 3:6], moved[k, 6:] = end_R_start @ theta, end_R_start @ rho, end_R_start @ nu
    return moved
