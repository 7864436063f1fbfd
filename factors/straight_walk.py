"""People mostly walk straight on: heuristic drift reduction, as a mixture that switches itself off.

Between the displacements over ground that meet at a footfall, d = (d_x, d_y) from p_a to p_b and from p_b to p_c, the
course changes by

    r = wrap(course(p_c - p_b) - course(p_b - p_a)),    course(d) = atan2(d_y, d_x),
    dr/dp_a = g(p_b - p_a),   dr/dp_c = g(p_c - p_b),   dr/dp_b = -dr/dp_a - dr/dp_c,   g(d) = (-d_y, d_x, 0) / |d|^2,

in the navigation frame, rad. Between points one stride apart r is some degrees on the straightest walk, as feet are set
down beside the line, and its errors cancel from one stride to the next: taken as independent, they are worth nothing
against a drift of 0.1 deg a stride. Points n strides apart see n times the drift with a fraction of the noise;
`straight_triples` picks them. Either this is a straight walk, whose
r is normal with sigma s, or it is anything, uniform over the circle:

    p(r) = P N(r; 0, s^2) + (1 - P) / (2 pi),    P the share of straight walking.

Its negative logarithm is the loss, with x = r / s the whitened residual and the loss at zero taken off,

    rho(x) = log(1 + c) - log(exp(-x^2/2) + c),    c = s (1 - P) / (P sqrt(2 pi)),
    rho'(x) / x = w(x) = exp(-x^2/2) / (exp(-x^2/2) + c).

So the weight with which the residual is repeatedly reweighted is the probability that this was a straight walk. In a
curve it is zero, and so is the information: there is no row of zero residual, which would tell the smoother that it
knows the course when nobody does. With s = 2 deg and P = 1/2 a change of 6 deg is as likely a curve as not.

The change of course is 0 at a person's will only. Corridors bend slowly, and people drift to one side: what this factor
believes is wrong where a curve turns by less than s over n strides. It is off unless asked for. Successive changes
share a displacement, so their errors still partly cancel: the information on a steady drift is understated.

Source: Borenstein & Ojeda 2010; Zhang's Eq. 27-28 are the same with a threshold, and a zero beyond it in place of
no row. The mixture is this project's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray

from .guarded import Array, guarded_factor


@dataclass(frozen=True)
class StraightParameters:
    """What a straight walk is, and how common."""

    strides: int = 5
    """Length n of a displacement: two of them are 14 m, as long as corridors are straight for."""
    sigma_deg: float = 2.0
    """Change of course between them on a straight walk: weaving by 7 cm at points 7 m apart is 1.4 deg
    (0.07 sqrt(6) / 7 rad), and feet and corridors add to it."""
    straight_share: float = 0.5
    """Share of straight stretches: no preference. The weight depends on its logarithm only."""
    shortest_m: float = 2.5
    """Displacements over n strides below this have no course of a walk: half a metre a stride."""

    @property
    def sigma(self) -> float:
        """Of the change of course, rad."""
        return float(np.radians(self.sigma_deg))

    @property
    def odds_of_curve(self) -> float:
        """Likelihood c of a curve against that of a straight walk without any change of course."""
        return float(self.sigma * (1.0 - self.straight_share) / (self.straight_share * np.sqrt(2.0 * np.pi)))


def straight_walk_residual(before: Array, here: Array, after: Array) -> Array:
    """Change of course (...,) rad, anticlockwise, at the middle one of three footfalls (..., 3) m."""
    first, second = here - before, after - here
    across = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    along = first[..., 0] * second[..., 0] + first[..., 1] * second[..., 1]
    return np.asarray(np.arctan2(across, along))


def straight_walk_jacobians(before: Array, here: Array, after: Array) -> tuple[Array, Array, Array]:
    """Derivatives (..., 3) of the residual by the three positions, in the navigation frame."""
    by_before, by_after = _by_displacement(here - before), _by_displacement(after - here)
    return by_before, -by_before - by_after, by_after


def _by_displacement(displacement: Array) -> Array:
    """Derivative (..., 3) of the course of a displacement (..., 3)."""
    x, y = displacement[..., 0], displacement[..., 1]
    return np.stack([-y, x, np.zeros_like(x)], axis=-1) / (x**2 + y**2)[..., None]


def has_course(before: Array, here: Array, after: Array, shortest_m: float) -> NDArray[np.bool_]:
    """Whether both displacements (...) over ground are long enough to have a course."""
    lengths = [np.linalg.norm((b - a)[..., :2], axis=-1) for a, b in ((before, here), (here, after))]
    return np.asarray(np.minimum(*lengths) >= shortest_m)


def straight_triples(position: Array, parameters: StraightParameters = StraightParameters()) -> NDArray[np.intp]:
    """Footfalls (M, 3), n strides apart, of `position` (K, 3) of one foot, between which there are courses."""
    n = parameters.strides
    middle = np.arange(n, len(position) - n, n)
    triples = middle[:, None] + n * np.array([-1, 0, 1])
    before, here, after = np.moveaxis(position[triples], 1, 0)
    return np.asarray(triples[has_course(before, here, after, parameters.shortest_m)])


def straight_probability(whitened: Array | float, odds_of_curve: float) -> Array:
    """Probability (...) that the walk is straight, and weight, of residuals (...) over their sigma."""
    straight = np.exp(-0.5 * np.square(whitened))
    return np.asarray(straight / (straight + odds_of_curve))


def straight_walk_loss(whitened: Array | float, odds_of_curve: float) -> Array:
    """Loss (...) of residuals (...) over their sigma: half a square near zero, and log(1 + 1/c) far out."""
    either = np.logaddexp(-0.5 * np.square(whitened), np.log(odds_of_curve))
    return np.asarray(np.log1p(odds_of_curve) - either)


def straight_walk_noise(parameters: StraightParameters = StraightParameters()) -> gtsam.noiseModel.Robust:
    """Mixture of straight and anything, as a robust noise of gtsam of dimension 1."""
    c = parameters.odds_of_curve
    estimator = gtsam.noiseModel.mEstimator.Custom(
        lambda x: float(straight_probability(float(x), c)), lambda x: float(straight_walk_loss(float(x), c))
    )
    return gtsam.noiseModel.Robust.Create(estimator, gtsam.noiseModel.Isotropic.Sigma(1, parameters.sigma))


def straight_walk_factor(pose_keys: Sequence[int], noise: gtsam.noiseModel.Base) -> gtsam.CustomFactor:
    """Keep the course over three footfalls, or more precisely: believe that it was kept.

    Parameters
    ----------
    pose_keys
        Keys of nav_T_body (Pose3) at three footfalls, in order, for which `has_course` holds.
    noise
        Of dimension 1, rad; `straight_walk_noise` is the mixture.
    """
    keys = list(pose_keys)

    def residual(values: gtsam.Values, with_jacobians: bool) -> tuple[Array, Sequence[Array]]:
        poses = [values.atPose3(key) for key in keys]
        points = [pose.translation() for pose in poses]
        e = straight_walk_residual(*points)[None]
        if not with_jacobians:
            return e, []
        by_point = straight_walk_jacobians(*points)
        H = [np.zeros((1, 6)) for _ in keys]
        for H_, by, pose in zip(H, by_point, poses, strict=True):
            H_[0, 3:] = by @ pose.rotation().matrix()
        return e, H

    return guarded_factor("straight walk", keys, [6] * len(keys), noise, residual)
