"""What is known of a walk besides its samples: corridors are straight, floors are level, a position was surveyed.

Straight on (`StraightWalk`): heuristic drift reduction, as a mixture that switches itself off
----------------------------------------------------------------------------------------------

Between the displacements over ground that meet at a footfall, d = (d_x, d_y) from p_a to p_b and from p_b to p_c, the
course changes by

    r = wrap(course(p_c - p_b) - course(p_b - p_a)),    course(d) = atan2(d_y, d_x),
    dr/dp_a = g(p_b - p_a),   dr/dp_c = g(p_c - p_b),   dr/dp_b = -dr/dp_a - dr/dp_c,   g(d) = (-d_y, d_x, 0) / |d|^2,

in the navigation frame, rad. Between points one stride apart r is some degrees on the straightest walk, as feet are set
down beside the line, and its errors cancel from one stride to the next: taken as independent, they are worth nothing
against a drift of 0.1 deg a stride. Points n strides apart see n times the drift with a fraction of the noise;
`straight_triples` picks them. Either this is a straight walk, whose r is normal with sigma s, or it is
anything, uniform over the circle:

    p(r) = P N(r; 0, s^2) + (1 - P) / (2 pi),    P the share of straight walking.

Its negative logarithm is the loss, with x = r / s the whitened residual and the loss at zero taken off,

    rho(x) = log(1 + c) - log(exp(-x^2/2) + c),    c = s (1 - P) / (P sqrt(2 pi)),
    rho'(x) / x = w(x) = exp(-x^2/2) / (exp(-x^2/2) + c).

So the weight with which the residual is repeatedly reweighted is the probability that this was a straight walk. In a
curve it is zero, and so is the information: there is no row of zero residual, which would tell the smoother that it
knows the course where nothing shows it. With s = 2 deg and P = 1/2 a change of 6 deg is as likely a curve as not.

The change of course is 0 at a person's will only. Corridors bend slowly, and people drift to one side: what this factor
assumes is wrong where a curve turns by less than s over n strides. It is off unless asked for. Successive changes
share a displacement, so their errors still partly cancel: the information on a steady drift is understated.

Source: Borenstein & Ojeda 2010; AIEZ (27), (28) are the same with a threshold, and a zero beyond it in place of
no row. The mixture is this project's.

Position fix: a surveyed point, or a receiver's position, in the navigation frame
---------------------------------------------------------------------------------
The residual is that of gtsam's own `GPSFactor`, on the axes of the navigation frame,

    e = p - fix,    de/dpose = [0, nav_R_body].

A fix that is known in the plane only has an infinite sigma upwards, and says nothing of the height.

Errors of a receiver persist for many seconds. Fixes are taken as independent here: take one each ten seconds or so,
or enlarge sigma by the square root of how many share an error. Where some are plainly wrong (between houses) wrap the
noise in `gtsam.noiseModel.Robust`.

Floors (`FloorHeight`): all footfalls on one floor of a building are at one height
----------------------------------------------------------------------------------
Each floor has its height Z (1-vector, m) as a variable, each footfall on it the residual

    e = z - Z,    de/dpose = [0, e_z^T nav_R_body],    de/dZ = -1,

z the height of the sensor (navigation frame, z up). The sensor is not at the same height above the floor in each
stance, by a centimetre or so; that is the noise. No floor's height is known before, so a floor that is visited once
gets flat, and nothing else; one that is visited again also gets its height back. Which footfall is on which floor has
to be decided elsewhere (`fg_nav.smoother.floors`): a ramp looks like drift.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import gtsam
import numpy as np
from numpy.typing import NDArray

from .residual import Array

STRIDES = 5
"""Length n of a displacement: two of them are 14 m, as long as corridors are straight for."""

SIGMA_DEG = 2.0
"""Change of course between them on a straight walk: weaving by 7 cm at points 7 m apart is 1.4 deg
(0.07 sqrt(6) / 7 rad), and feet and corridors add to it."""

STRAIGHT_SHARE = 0.5
"""Share of straight stretches: no preference. The weight depends on its logarithm only."""

SHORTEST_M = 2.5
"""Displacements over n strides below this have no course of a walk: half a metre a stride."""


def odds_of_curve(sigma: float, straight_share: float) -> float:
    """Likelihood c of a curve against that of a straight walk without any change of course, with sigma in rad."""
    return float(sigma * (1.0 - straight_share) / (straight_share * np.sqrt(2.0 * np.pi)))


@dataclass(frozen=True)
class StraightWalk:
    """Change of course at the middle one of three footfalls; variables nav_T_body at all three.

    Two rows, the half square of which is the loss rho(x), at the weight w(x) of the mixture at hand:

        [ sqrt(w) x | sqrt(2 rho - w x^2) ],     of which the second depends on nothing.

    Half the square of both with the weight held is rho at the point of linearization, and above it anywhere else: the
    error that the linear model promises is one the loss keeps, and a solver's criterion is meaningful (IRLS).
    """

    name: ClassVar[str] = "straight walk"
    dims: ClassVar[tuple[int, ...]] = (6, 6, 6)
    rows: ClassVar[int] = 2

    sigma: float = float(np.radians(SIGMA_DEG))
    odds_of_curve: float = odds_of_curve(np.radians(SIGMA_DEG), STRAIGHT_SHARE)

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return both rows (..., 2) and, with the weight held, their Jacobians by the three poses."""
        points = [nav_T_body[..., :3, 3] for nav_T_body in variables]
        x = change_of_course(*points) / self.sigma
        weight = straight_probability(x, self.odds_of_curve)
        above = 2.0 * straight_walk_loss(x, self.odds_of_curve) - weight * x**2
        e = np.stack([np.sqrt(weight) * x, -np.sqrt(np.maximum(above, 0.0))], axis=-1)
        if not with_jacobians:
            return e, []
        scale = (np.sqrt(weight) / self.sigma)[..., None]
        H = [np.zeros((*e.shape, 6)) for _ in variables]
        for by_pose, by_point, nav_T_body in zip(H, change_of_course_slopes(*points), variables, strict=True):
            by_pose[..., 0, 3:] = ((scale * by_point)[..., None, :] @ nav_T_body[..., :3, :3])[..., 0, :]
        return e, H


def change_of_course(before: Array, here: Array, after: Array) -> Array:
    """Change of course r (...,) rad, anticlockwise, at the middle one of three footfalls (..., 3) m."""
    first, second = here - before, after - here
    across = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    along = first[..., 0] * second[..., 0] + first[..., 1] * second[..., 1]
    return np.asarray(np.arctan2(across, along))


def change_of_course_slopes(before: Array, here: Array, after: Array) -> tuple[Array, Array, Array]:
    """Derivatives (..., 3) of the change of course by the three positions, in the navigation frame."""
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


def straight_triples(position: Array) -> NDArray[np.intp]:
    """Footfalls (M, 3), n strides apart, of `position` (K, 3) of one foot, between which there are courses."""
    middle = np.arange(STRIDES, len(position) - STRIDES, STRIDES)
    triples = middle[:, None] + STRIDES * np.array([-1, 0, 1])
    before, here, after = np.moveaxis(position[triples], 1, 0)
    return np.asarray(triples[has_course(before, here, after, SHORTEST_M)])


def straight_probability(whitened: Array | float, odds_of_curve: float) -> Array:
    """Probability (...) that the walk is straight, and weight, of residuals (...) over their sigma."""
    straight = np.exp(-0.5 * np.square(whitened))
    return np.asarray(straight / (straight + odds_of_curve))


def straight_walk_loss(whitened: Array | float, odds_of_curve: float) -> Array:
    """Loss (...) of residuals (...) over their sigma: half a square near zero, and log(1 + 1/c) far out."""
    either = np.logaddexp(-0.5 * np.square(whitened), np.log(odds_of_curve))
    return np.asarray(np.log1p(odds_of_curve) - either)


def position_fix_noise(horizontal_sigma: float, vertical_sigma: float = np.inf) -> gtsam.noiseModel.Diagonal:
    """Noise of a fix, m: each horizontal axis, and the vertical one; that of a planar fix is infinite."""
    sigmas = np.array([horizontal_sigma, horizontal_sigma, vertical_sigma])
    if not (sigmas > 0.0).all():
        raise ValueError("position fix: the sigmas must be above zero.")
    return gtsam.noiseModel.Diagonal.Precisions(sigmas**-2.0)


def position_fix_factor(pose_key: int, nav_position: Array, noise: gtsam.noiseModel.Base) -> gtsam.GPSFactor:
    """Tie a pose to a fix.

    Parameters
    ----------
    pose_key
        Key of nav_T_body (Pose3).
    nav_position : (3,) m
        The fix; with a planar noise its height does not count.
    noise
        Of dimension 3, m, on nav's axes; see `position_fix_noise`.
    """
    return gtsam.GPSFactor(pose_key, np.asarray(nav_position, dtype=np.float64), noise)


@dataclass(frozen=True)
class FloorHeight:
    """Height of a footfall above its floor, with `sigma` m; variables nav_T_body and the floor's height (1,) m."""

    name: ClassVar[str] = "floor height"
    dims: ClassVar[tuple[int, ...]] = (6, 1)
    rows: ClassVar[int] = 1

    sigma: float

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 1) and its Jacobians by pose and floor."""
        nav_T_body, floor = variables
        e = (nav_T_body[..., 2, 3, None] - floor) / self.sigma
        if not with_jacobians:
            return e, []
        by_pose = np.zeros((*e.shape, 6))
        by_pose[..., 0, 3:] = nav_T_body[..., 2, :3] / self.sigma
        return e, [by_pose, np.full((*e.shape, 1), -1.0 / self.sigma)]
