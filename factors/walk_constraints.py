"""What is known of a walk besides its inertial samples: headings, corridors, floors, surveyed positions, air pressure.

Reasons, values and limits: `docs/models.md`.

Directions of a building (`BuildingDirection`): heuristic drift elimination, as a mixture that switches itself off
------------------------------------------------------------------------------------------------------------------

The corridors of a building have four directions at right angles, alpha + m pi/2; alpha (rad, anticlockwise from the x
axis of the navigation frame) is a variable. The course of the displacement over ground d = (d_x, d_y) between two
footfalls n strides apart is off the nearest one by

    r = wrap(psi - alpha) in [-pi/4, pi/4),    psi = atan2(d_y, d_x),    d = p_b - p_a,
    dr/dp_b = -dr/dp_a = (-d_y, d_x, 0) / |d|^2,    dr/dalpha = -1,

rad. Either the walk follows the building, with r normal of sigma s, or it goes anywhere, uniform over a quarter circle:

    p(r) = P N(r; 0, s^2) + (1 - P) 2 / pi,    P the share of displacements that follow it.

The negative logarithm is the loss, with x = r / s the whitened residual and the loss at zero taken off,

    rho(x) = log(1 + c) - log(exp(-x^2/2) + c),    c = s (1 - P) / P sqrt(8 / pi),
    rho'(x) / x = w(x) = exp(-x^2/2) / (exp(-x^2/2) + c).

The weight is the probability that the walk follows the building. The error of a corridor is that of all displacements
along it, so each has a share h <= 1 of its loss (a power likelihood), by which a leg counts as few of them.

Source: Borenstein & Ojeda 2010 (J. Navigation 63); AIEZ (27), (28) compare a course with those before it instead, with
a threshold, and a zero beyond it in place of no row. The mixture is this project's.

Heading (`Heading`): a compass card, a plan, a start that was aligned by hand; of one pose, without a field variable
-------------------------------------------------------------------------------------------------------------------
The axis a of the body, a unit vector, points over ground to the heading psi, rad clockwise from north (East-North-Up):

    n = R a,    e = wrap(atan2(n_E, n_N) - psi) / sigma,
    de/dpose = [-(n_N R_E - n_E R_N) [a]x / (n_E^2 + n_N^2), 0] / sigma,    R_E, R_N the rows of R,

infinite where the axis is vertical. `MagneticHeading` is for fields that deviate, with the field as a variable.

Position fix: gtsam's own `GPSFactor`, e = p - fix on the axes of the navigation frame, with `position_fix_noise`.

Floors (`FloorHeight`): all footfalls on one floor of a building are at one height
----------------------------------------------------------------------------------
Each floor has its height Z (1-vector, m) as a variable, each footfall on it, at the height z, the residual

    e = z - Z,    de/dpose = [0, e_z^T nav_R_body],    de/dZ = -1.

Barometric height (`BarometricHeight`, `BarometerDrift`): height plus an offset is what the pressure shows
----------------------------------------------------------------------------------------------------------
The hypsometric equation turns a pressure p into a height h above that of p_0, in air of the temperature T,

    h = R T / (g M) log(p_0 / p),    dh = -dp R T / (g M p).

With the state (o, r) of the barometer, o m its offset and r m/s the tendency of the weather, a footfall has

    e = z + o - h,    de/dpose = [0, e_z^T nav_R_body],    de/d(o, r) = [1, 0],

with Cauchy's loss, as a slammed door or a gust is no height. Over tau s the state moves on by a random walk,

    e = (o' - o - r tau, r' - r),    the row of o with Cauchy's loss: a door that stays open is a step.

Unseen walk (`UnseenWalk`): what a person can have done between two stances that no sensor saw
----------------------------------------------------------------------------------------------
Between nav_T_body of the last stance before and of the first behind, p position (navigation frame, z up, m), u the
direction of up in the body frame, R^T e_z, psi the turn about up from one attitude to the other (`rotation.turn_from`):

    e = (p_2 - p_1) / s_p                                       over ground and up, each with its own s_p
    e = wrap(psi - turn) / s_psi                                rad
    e = (u_2 - u_1) / s_u                                       a foot is put down as flat as before
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import gtsam
import numpy as np

from .residual import POSE, Array, factor_of, hold_cauchy
from .rotation import skew, turn_from

QUARTER = 0.5 * np.pi  # Between the directions of a building, rad.
BAROMETER_CAUCHY = 3.0  # Sigmas from which a pressure counts for less: Gaussian for 99.7 % of those that are no gust.
ROWS = 7


def odds_of_elsewhere(sigma: float, share: float) -> float:
    """Return c, the odds at r = 0 of walking anywhere over along a direction; sigma in rad, share P in [0, 1]."""
    return float(sigma * (1.0 - share) / share * np.sqrt(8.0 / np.pi))


@dataclass(frozen=True)
class BuildingDirection:
    """Course from one footfall to another; variables nav_T_body at both, and alpha (1,) rad.

    Two rows, the half square of which is the loss h rho(x), at the weight w(x) of the mixture at hand (IRLS):

        sqrt(h) [ sqrt(w) x | sqrt(2 rho - w x^2) ],     of which the second depends on nothing.

    `sigma` s rad, `odds` c, `share` h (...,).
    """

    name: ClassVar[str] = "building direction"
    dims: ClassVar[tuple[int, ...]] = (6, 6, 1)
    rows: ClassVar[int] = 2

    sigma: float
    odds: float
    share: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return both rows (..., 2) and, with the weight held, their Jacobians by both poses and alpha."""
        *poses, alpha = variables
        displacement = poses[1][..., :3, 3] - poses[0][..., :3, 3]
        x = wrap_quarter(measure_course(displacement) - alpha[..., 0]) / self.sigma
        weight = direction_probability(x, self.odds)
        above = 2.0 * direction_loss(x, self.odds) - weight * x**2
        e = np.sqrt(self.share)[..., None] * np.stack([np.sqrt(weight) * x, np.sqrt(np.maximum(above, 0.0))], axis=-1)
        if not with_jacobians:
            return e, []
        scale = np.sqrt(self.share * weight) / self.sigma
        # The derivative of the course by the displacement.
        dx, dy = displacement[..., 0], displacement[..., 1]
        by_place = scale[..., None] * (np.stack([-dy, dx, np.zeros_like(dx)], axis=-1) / (dx**2 + dy**2)[..., None])
        H = [np.zeros((*e.shape, dim)) for dim in self.dims]
        for by_pose, sign, nav_T_body in zip(H, (-1.0, 1.0), poses, strict=False):
            by_pose[..., 0, 3:] = sign * (by_place[..., None, :] @ nav_T_body[..., :3, :3])[..., 0, :]
        H[2][..., 0, 0] = -scale
        return e, H


def wrap_quarter(angle: Array) -> Array:
    """Wrap angles (...) rad to [-pi/4, pi/4)."""
    return np.asarray((angle + 0.5 * QUARTER) % QUARTER - 0.5 * QUARTER)


def wrap_angle(angle: Array) -> Array:
    """Wrap angles (...) rad to [-pi, pi]."""
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))


def measure_course(displacement: Array) -> Array:
    """Course (...,) rad, anticlockwise from x, of displacements (..., 3)."""
    return np.asarray(np.arctan2(displacement[..., 1], displacement[..., 0]))


def direction_probability(whitened: Array | float, odds: float) -> Array:
    """Return the posterior (...) that the building is followed, the IRLS weight, for whitened residuals (...)."""
    followed = np.exp(-0.5 * np.square(whitened))
    return np.asarray(followed / (followed + odds))


def direction_loss(whitened: Array | float, odds: float) -> Array:
    """Return the loss rho (...) of whitened residuals (...): quadratic near zero, log(1 + 1/c) far out."""
    either = np.logaddexp(-0.5 * np.square(whitened), np.log(odds))
    return np.asarray(np.log1p(odds) - either)


def position_fix_noise(horizontal_sigma: float, vertical_sigma: float = np.inf) -> gtsam.noiseModel.Diagonal:
    """Noise of a fix, m: each horizontal axis, and the vertical one; that of a planar fix is infinite."""
    sigmas = np.array([horizontal_sigma, horizontal_sigma, vertical_sigma])
    if not (sigmas > 0.0).all():
        raise ValueError("position fix: the sigmas must be above zero.")
    return gtsam.noiseModel.Diagonal.Precisions(sigmas**-2.0)


@dataclass(frozen=True)
class Heading:
    """Headings (...) rad clockwise from north, with `sigma` (...) rad, of axes (..., 3) of the body; variable pose."""

    name: ClassVar[str] = "heading"
    dims: ClassVar[tuple[int, ...]] = (POSE,)
    rows: ClassVar[int] = 1

    heading: Array
    sigma: Array
    axis: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 1), within pi of zero over its sigma, and its Jacobian by the pose."""
        R = variables[0][..., :3, :3]
        east, north, _ = np.moveaxis((R @ self.axis[..., None])[..., 0], -1, 0)
        e = (wrap_angle(np.arctan2(east, north) - self.heading) / self.sigma)[..., None]
        if not with_jacobians:
            return e, []
        across = (north[..., None] * R[..., 0, :] - east[..., None] * R[..., 1, :]) / (east**2 + north**2)[..., None]
        by_pose = np.zeros((*e.shape, POSE))
        by_pose[..., 0, :3] = -np.cross(across, self.axis) / self.sigma[..., None]
        return e, [by_pose]


def heading_factor(
    pose_key: int, heading: float, sigma: float, axis: Sequence[float] = (1.0, 0.0, 0.0)
) -> gtsam.CustomFactor:
    """Prior on the heading of one pose, rad clockwise from north: of the body's x axis, or another."""
    if not 0.0 < sigma < np.inf or not np.isfinite([heading, *axis]).all():
        raise ValueError("heading: give finite radians, a unit vector, and a sigma above zero.")
    return factor_of(Heading(np.array(heading), np.array(sigma), np.array(axis, dtype=float)), [pose_key])


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


@dataclass(frozen=True)
class BarometricHeight:
    """Barometric heights (..., 1) m of footfalls, with `sigma` (..., 1) m; variables nav_T_body and state (2,)."""

    name: ClassVar[str] = "barometric height"
    dims: ClassVar[tuple[int, ...]] = (6, 2)
    rows: ClassVar[int] = 2

    height: Array
    sigma: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return both rows (..., 2) of the loss and, with the weight held, their Jacobians by pose and state."""
        nav_T_body, state = variables
        x = (nav_T_body[..., 2, 3, None] + state[..., :1] - self.height) / self.sigma
        root, above = hold_cauchy(x**2, BAROMETER_CAUCHY)
        e = np.concatenate([root * x, above], axis=-1)
        if not with_jacobians:
            return e, []
        by_pose, by_state = np.zeros((*e.shape, 6)), np.zeros((*e.shape, 2))
        by_pose[..., 0, 3:] = root * nav_T_body[..., 2, :3] / self.sigma
        by_state[..., 0, :1] = root / self.sigma
        return e, [by_pose, by_state]


@dataclass(frozen=True)
class BarometerDrift:
    """Barometer's state from one to the next, `elapsed` (..., 1) s apart; `sigma` (..., 2) of its change: m, m/s."""

    name: ClassVar[str] = "barometer drift"
    dims: ClassVar[tuple[int, ...]] = (2, 2)
    rows: ClassVar[int] = 3

    elapsed: Array
    sigma: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the rows (..., 3), two of the offset's loss, then the tendency, and their Jacobians."""
        x = variables[1] - variables[0]
        x[..., :1] -= variables[0][..., 1:] * self.elapsed
        x /= self.sigma
        root, above = hold_cauchy(x[..., :1] ** 2, BAROMETER_CAUCHY)
        e = np.concatenate([root * x[..., :1], above, x[..., 1:]], axis=-1)
        if not with_jacobians:
            return e, []
        by_new = np.zeros((*e.shape, 2))
        by_new[..., 0, 0], by_new[..., 2, 1] = root[..., 0] / self.sigma[..., 0], 1.0 / self.sigma[..., 1]
        by_old = -by_new
        by_old[..., 0, 1] = by_old[..., 0, 0] * self.elapsed[..., 0]
        return e, [by_old, by_new]


@dataclass(frozen=True)
class UnseenWalk:
    """What is expected of a walk that was not seen; variables nav_T_body before and behind."""

    name: ClassVar[str] = "unseen walk"
    dims: ClassVar[tuple[int, ...]] = (POSE, POSE)
    rows: ClassVar[int] = ROWS

    move_sigma: Array  # (..., 3) m, of the displacement, east, north and up.
    turn: Array  # (...) rad about up, counter-clockwise, as expected.
    turn_sigma: Array  # (...) rad.
    tilt_sigma: Array  # (...) rad, of the tilt behind against that before.

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 7) and its Jacobians by both poses."""
        before, behind = variables
        R_1, R_2 = before[..., :3, :3], behind[..., :3, :3]
        cosine, sine, by_behind = turn_from(R_1, R_2)
        off = wrap_angle(np.arctan2(sine, cosine) - self.turn)[..., None]
        e = np.concatenate([behind[..., :3, 3] - before[..., :3, 3], off, R_2[..., 2, :] - R_1[..., 2, :]], axis=-1)
        others = np.stack([self.turn_sigma, self.tilt_sigma, self.tilt_sigma, self.tilt_sigma], axis=-1)
        sigma = np.concatenate([self.move_sigma, others], axis=-1)
        if not with_jacobians:
            return e / sigma, []
        by_before = -turn_from(R_2, R_1)[2]
        H = [self._jacobian(R_1, by_before, -1.0), self._jacobian(R_2, by_behind, 1.0)]
        return e / sigma, [one / sigma[..., None] for one in H]

    @staticmethod
    def _jacobian(nav_R_body: Array, by_turn: Array, sign: float) -> Array:
        """Jacobian (..., 7, 6), not yet over sigma, by one of the poses; `by_turn` (..., 3) is dpsi by its rotation."""
        H = np.zeros((*nav_R_body.shape[:-2], ROWS, POSE))
        H[..., :3, 3:] = sign * nav_R_body
        H[..., 3, :3] = by_turn
        H[..., 4:, :3] = sign * skew(nav_R_body[..., 2, :])
        return H
