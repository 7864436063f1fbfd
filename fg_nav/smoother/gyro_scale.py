"""The scale of the gyroscope's axes, found where the magnetic field shows the heading, and taken off.

The gyroscope shows w = (1 + s) w_true + b on each axis, body frame, rad/s; s (3,) is the same for a whole walk. To the
first order in s, the end of an interval preintegrated from the rates (w - b) / (1 + s) is that from w - b moved, in
the tangent space of the state at the end, by D s,

    D = (theta, rho, nu),   theta' = R c,   nu' = (theta) x R f,   rho' = nu,      c = -(w - b) per axis,

R the attitude and f the specific force since the start of the interval, theta, rho and nu brought to the body axes at
its end. So s is one variable of the solved graph, linearized at its minimum, with the columns J of each inertial factor

    J = -(de/dpose_end, de/dv_end nav_R_end) D     and, if there is an error, the prior     s = 0 +- `SCALE_SIGMA`.

What else is wrong in all swings alike looks like a scale: axes that are not square, a bent mounting, soft iron. So s
has a part 0 +- `ALIKE_SIGMA` in any case. The walk is eliminated first (`sensitivity`), which leaves the information L
on s and its product eta with the estimate. With a prior of covariance S,

    log p(z | S) = 1/2 eta^T P eta - 1/2 log|I + S L| + const,     P = (L + S^-1)^-1     (`evidence.fit_shared`)

and the evidence for an error of the scale is that of S_1 = (SCALE_SIGMA^2 + ALIKE_SIGMA^2) I over that of
S_0 = ALIKE_SIGMA^2 I. Only where that is more than `MOST_NATS` the samples are corrected by s = P eta, and the walk is
solved again; else, and without a field, the gyroscope stays as it is: on a walk without a heading a scale of a percent
explains what it must not.

Either way the covariances of the walk hold what is not known of the scale. A variable that moves by X s with it has,
where the samples were corrected, X P X^T more. Where they were not, both models are possible and as likely before the
walk, and the second moment about the solution with s = 0 is that of the two together (Hoeting et al. 1999),

    X (w (P_1 + s_1 s_1^T) + (1 - w) (P_0 + s_0 s_0^T)) X^T,     w = 1 / (1 + p(z | S_0) / p(z | S_1)).

Model: IEEE Std 528; D is this project's derivation, tested against preintegration of corrected samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import gtsam
import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.factors.differential_field import GYRO
from fg_nav.mechanisation import rotate_in_body
from fg_nav.recording import Recording
from fg_nav.samples.gaps import cross_holes
from fg_nav.smoother.evidence import MOST_NATS, fit_shared
from fg_nav.smoother.graph import WalkProblem, biases_of
from fg_nav.smoother.linear import stack_factors
from fg_nav.smoother.sensitivity import SharedColumns, SharingFactors, weigh_shared
from fg_nav.smoother.solver import Solved, list_attitudes
from fg_nav.smoother.strides import INERTIAL_KEYS
from fg_nav.system.compiled import njit
from fg_nav.system.spilled import drop_pages

SCALE_SIGMA = 0.01
"""Prior of the scale of each axis: a few tenths of a percent after a calibration, 1 to 3 by the sheet of a raw part."""

ALIKE_SIGMA = 0.002
"""What looks like a scale without being one: axes out of square by 0.1 to 0.3 deg, by the sheet of a calibrated
part."""


@dataclass(frozen=True)
class GyroScale:
    """Scale errors (3,) of the gyroscope, their covariance (3, 3), and the nats by which they explain a walk better.

    `moment_otherwise` (3, 3) is the second moment of what is wrong in all swings alike if they are none.
    """

    scale: Floats
    covariance: Floats
    nats: float
    moment_otherwise: Floats

    @property
    def is_shown(self) -> bool:
        """Whether the walk shows the errors by so much that they are taken off."""
        return self.nats > MOST_NATS

    @property
    def second_moment(self) -> Floats:
        """Of the errors (3, 3) about zero, over both models: with them, and without."""
        weight = 1.0 / (1.0 + np.exp(-self.nats))
        moment = self.covariance + np.outer(self.scale, self.scale)
        return np.asarray(weight * moment + (1.0 - weight) * self.moment_otherwise)

    @property
    def note(self) -> str:
        """The same in words."""
        sigma = np.sqrt(np.diagonal(self.covariance))
        axes = ", ".join(f"{100 * s:+.2f} +- {100 * d:.2f}" for s, d in zip(self.scale, sigma, strict=True))
        return f"gyroscope's scale errors {axes} %, taken off: the field shows them by {self.nats:.0f} nats"

    def remove_from(self, recording: Recording) -> Recording:
        """Return the recording with the rates without these errors."""
        return replace(recording, gyr=recording.gyr / (1.0 + self.scale))


@dataclass(frozen=True)
class WalkScale:
    """The scale of a walk's gyroscope, and its columns in the walk's tree."""

    found: GyroScale
    columns: SharedColumns


def shows_heading(problem: WalkProblem) -> bool:
    """Whether a walk has a field with anything to compare the gyroscope's scale with."""
    return problem.field is not None and len(problem.field.heading) + len(problem.field.strides) > 0


def estimate_gyro_scale(problem: WalkProblem, solved: Solved) -> WalkScale:
    """Estimate the scale of the gyroscope at a solution of the walk."""
    # The walk is eliminated, and what its inertial factors say of the scale is weighed.
    columns, information, pull = weigh_shared(solved.root, _list_inertial(problem, solved.linearized_at), 3)
    return WalkScale(compare_models(information, pull), columns)


def compare_models(information: Floats, pull: Floats) -> GyroScale:
    """Weigh an error of the scale against none, by the information L (3, 3) of a walk and its product eta (3,)."""
    prior = np.eye(3) * (SCALE_SIGMA**2 + ALIKE_SIGMA**2)
    scale, covariance, evidence = fit_shared(information, pull, prior)
    alike, alike_covariance, without = fit_shared(information, pull, np.eye(3) * ALIKE_SIGMA**2)
    return GyroScale(scale, covariance, evidence - without, alike_covariance + np.outer(alike, alike))


POSE_END, VELOCITY_END = slice(9, 15), slice(15, 18)
"""Columns of an inertial factor."""


def _list_inertial(problem: WalkProblem, values: gtsam.Values) -> Iterator[SharingFactors]:
    """Yield the inertial factors with their columns of the scale."""
    graph, moved = problem.graph, _columns(problem, values)
    inertial = (graph.at(i) for i in range(graph.size()))
    stacks = stack_factors(factor.linearize(values) for factor in inertial if factor.size() == INERTIAL_KEYS)
    at = 0
    for stack in stacks:
        A, b, D = stack.rows[..., :-1], stack.rows[..., -1], moved[at : at + len(stack.rows)]
        by_scale = -(A[:, :, POSE_END] @ D[:, :6] + A[:, :, VELOCITY_END] @ D[:, 6:])
        yield SharingFactors(A, b, stack.keys, by_scale)
        at += len(stack.rows)


def _columns(problem: WalkProblem, values: gtsam.Values) -> Floats:
    """D (K, 9, 3) of all intervals that were measured, the velocity in nav axes."""
    recording, nodes = problem.recording, problem.nodes
    force, rate = recording.integrable
    bias = biases_of(nodes, values)[:, GYRO].copy()
    moved = sense_scale(recording.t, force, rate, nodes.sample, bias[nodes.bias[nodes.footfall[:-1]]])
    drop_pages()
    nav_R_end = list_attitudes(range(1, len(nodes)), values)
    moved[:, 6:] = nav_R_end @ moved[:, 6:]
    return moved[~cross_holes(recording.t, nodes.sample)]


def sense_scale(t: Floats, force: Floats, rate: Floats, sample: Ints, bias: Floats) -> Floats:
    """Derivative D (M-1, 9, 3) by the scale of the ends of the intervals between samples (M,).

    Rows: rotation (rad), position (m), velocity (m/s), all in the body axes at the end. `bias` (M-1, 3) rad/s. The
    rotation acts in the middle of each sample.
    """
    count = len(sample) - 1
    start_R_end, moved = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3, 3, 3))
    _integrate_scale(t, force, rate, sample, bias, start_R_end, moved)
    return np.asarray(np.einsum("kji,kpjl->kpil", start_R_end, moved).reshape(count, 9, 3))


@njit(cache=True)
def _integrate_scale(
    t: Floats, force: Floats, rate: Floats, sample: Ints, bias: Floats, start_R_end: Floats, moved: Floats
) -> None:
    """Add theta, rho and nu (M-1, 3, 3, 3) of the intervals, in the axes at their start, and turn the identities."""
    turn, a, push = np.empty(3), np.empty(3), np.empty(3)
    for k in range(len(sample) - 1):
        R, theta, rho, nu = start_R_end[k], moved[k, 0], moved[k, 1], moved[k, 2]
        for i in range(sample[k], sample[k + 1]):
            h = t[i + 1] - t[i]
            for axis in range(3):
                turn[axis] = (rate[i, axis] - bias[k, axis]) * h
            rotate_in_body(R, 0.5 * turn[0], 0.5 * turn[1], 0.5 * turn[2])
            for row in range(3):
                a[row] = R[row, 0] * force[i, 0] + R[row, 1] * force[i, 1] + R[row, 2] * force[i, 2]
            for axis in range(3):
                for row in range(3):
                    theta[row, axis] -= 0.5 * R[row, axis] * turn[axis]
                x, y, z = theta[0, axis], theta[1, axis], theta[2, axis]
                push[0], push[1], push[2] = y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0]
                for row in range(3):
                    rho[row, axis] += (nu[row, axis] + 0.5 * push[row] * h) * h
                    nu[row, axis] += push[row] * h
                    theta[row, axis] -= 0.5 * R[row, axis] * turn[axis]
            rotate_in_body(R, 0.5 * turn[0], 0.5 * turn[1], 0.5 * turn[2])
