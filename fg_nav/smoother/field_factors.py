"""All factors of the magnetic field of a walk, whose state m (`factors.magnetic_field`) is a variable at each footfall.

    magnetic heading   (X_k, M_k)              compass of each footfall, weighed by the gate
    field potential    (X_k, M_k, M_k+1)       line integral of the field over the stride
    transition         (M_k, M_k+1)            by how rough the field is
    prior              (M_0)                   by direction and strength

Path. The line integrals come from the first trajectory of the walk. With y the body field and nav_T_body the
trajectory, between footfalls k and k+1

    u_k = int (y - R^T e_z E_up) . R^T dp,      s_k = L int R^T dp,      d_k = R_k^T (p_{k+1} - p_k),
    w_k = R_k^T e_z x int (R y) x dp.

E_up is the median vertical field at the footfalls, so that a trajectory that climbs falsely adds nothing; L turns the
body axes into those of a stance: x forward as far as level, z up. Where the trajectory is and which way it heads makes
no difference to u, s, d and w; its tilt does, and by w_k the residual follows the tilt of the pose at footfall k.

Roughness. At footfall k the field deviates from the walk's mean by e_k over the ground, uT an axis, and in potential by
phi_k, uT m. What lies within a stride of the footfall is its own; what a larger object does is alike for metres; what a
corridor or a wing does, for tens of them. Along the path, with s_kj the way between two footfalls,

    cov(e_k, e_j) = white^2 [k = j] + across^2 exp(-s_kj / length) + regional^2 exp(-s_kj / 60 m).

fitted to the walk's own covariances of the deviation along the mean field (`docs/field.md`). The potential, of
`POTENTIAL_PER_FIELD_M` times the spread, has no white part,

    x_k = a_k x_{k-1} + w_k,    a_k = exp(-distance_k / length),    sd(w_k) = sigma sqrt(1 - a_k^2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import gtsam
import numpy as np
from gtsam.symbol_shorthand import M, X

from fg_nav.arrays import Bools, Floats, Ints, robust_sigma
from fg_nav.factors.magnetic_field import (
    DELTA,
    E_H,
    IRON,
    PHI,
    REGION,
    SIZE,
    FieldPotential,
    FieldPrior,
    FieldTransition,
    MagneticHeading,
    integrate_field,
)
from fg_nav.factors.residual import ResidualBlock, factor_of
from fg_nav.frames import level_attitude
from fg_nav.samples.gaps import cross_holes
from fg_nav.smoother.parameters import FieldParameters
from fg_nav.smoother.solver import BlockGroup, GtsamFactors
from fg_nav.smoother.strides import WALKING_M_S, walk_for

COMPASS_SIGMA_UT = 0.3  # Noise of a footfall's mean field, white: what levelling and a soft sole leave.
REGIONAL_LENGTH_M = 60.0  # For how long a region is alike: a corridor, a wing.
CLIP_SIGMAS = 4.0  # At which deviations are clipped (winsorized): an outlier shall not set the scale.
MIN_STEP_M = 0.2  # Shorter moves are no strides.
LAGS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)  # Footfalls apart whose deviations are compared.
LENGTHS_M = np.geomspace(1.5, 6.0, 12)  # Correlation lengths that are tried, of what is alike for metres.
ASSUMED_PAIRS = 20.0  # Pairs at each distance that the assumptions below are worth: feet on six floors have
ASSUMED_SHARE, ASSUMED_LENGTH_M = 0.3, 3.0  # 0.1 to 0.5 of the variance alike for 2 to 6 m,
REGIONAL_SHARE = 0.1  # and 0.05 to 0.15 of it in regions.
INDEPENDENT_M = 2.0  # Of the way from which on pairs of footfalls are others.
MIN_SIGMA_UT = 0.2  # Spread of the field below which a walk's differences are the magnetometer's.
MIN_REGIONAL_UT = 0.01  # Of a region: keeps the equations well conditioned where the field is the same everywhere.
POTENTIAL_PER_FIELD_M = 3.0  # Spread of the potential over that of the field: 2.6 to 3.8 m along 8 real walks.
POTENTIAL_LENGTH_M = 12.0  # Correlation length of the potential.
MIN_INNOVATION = 1e-6  # At a footfall on the same spot: for well-conditioned equations, below the noise of an integral.
MIN_TELESCOPING = 0.01  # Of the potential's variance, where no share of it telescopes: for well-conditioned equations.
MEAN_WALK_UT = 0.003  # Change of the building's mean field from stride to stride: 0.1 uT over a kilometre and a half.
HARD_IRON_WALK_UT = 5e-3  # From stride to stride, 0.16 uT in a thousand: a wrong tilt in the swing looks like iron too.
PATH_SIGMA_UT_M = 0.1  # Noise of the line integral over a stride, uT m: sampling, and what scale errors leave.
COARSEST_M = 0.4  # Longest move between two samples of the field in a line integral: the floor's steel is as near.


@dataclass(frozen=True)
class Roughness:
    """Of a deviation along the path: spread `sigma` (its unit) and correlation length, m."""

    sigma: float
    length_m: float

    def correlation(self, distance_m: Floats) -> Floats:
        """Correlation a of deviations that are this far apart."""
        return np.exp(-distance_m / self.length_m)

    def innovation(self, distance_m: Floats) -> Floats:
        """Standard deviation of the innovation over a distance; above zero."""
        return self.sigma * np.sqrt(1.0 - np.minimum(self.correlation(distance_m), 1.0 - MIN_INNOVATION) ** 2)


@dataclass(frozen=True)
class FieldRoughness:
    """Of a walk: potential (uT m), deviation across the field alike for metres, of regions, and white part (uT)."""

    potential: Roughness
    across: Roughness
    regional: Roughness
    white_uT: float


def split_potential(potential: Roughness, lost_share: float, distance_m: Floats) -> tuple[Roughness, Floats]:
    """Return what telescopes of a potential, and the noise (...) uT m of each integral over a stride that does not."""
    variance = 2.0 * potential.sigma**2 * (1.0 - potential.correlation(distance_m))
    telescoping = max(1.0 - lost_share, MIN_TELESCOPING)
    return replace(potential, sigma=potential.sigma * np.sqrt(telescoping)), np.sqrt(lost_share * variance)


def deviate_along(nav_field: Floats, reference: Floats) -> Floats:
    """(F,) uT of fields (F, 3) along a horizontal one (F, 2), about its median: no heading hides it to first order."""
    along = (nav_field[:, :2] * reference).sum(axis=1) / np.linalg.norm(reference, axis=1)
    return np.asarray(along - np.nanmedian(along))


def measure_roughness(deviation: Floats, seen: Bools, distance_m: Floats) -> FieldRoughness:
    """Return the roughness by deviations (F,) uT along the mean field, where `seen` (F,); ways `distance_m` (F-1,)."""
    # Winsorized deviations, zero where the field is missing.
    x, variance = np.where(seen, deviation, 0.0), MIN_SIGMA_UT**2
    if seen.any():
        limit = CLIP_SIGMAS * max(robust_sigma(x[seen]), MIN_SIGMA_UT)
        x = np.clip(x, -limit, limit)
        variance = max(float(np.mean(x[seen] ** 2)), MIN_SIGMA_UT**2)
    beyond_sensor = max(variance - MIN_SIGMA_UT**2, MIN_REGIONAL_UT**2)
    across, regional = _fit_covariance(x, variance, seen, distance_m)
    alike = float(np.sqrt(beyond_sensor / variance))
    white_uT = float(np.sqrt(max(variance - across.sigma**2 - regional.sigma**2, 0.0)))
    across, regional = (replace(one, sigma=max(alike * one.sigma, MIN_REGIONAL_UT)) for one in (across, regional))
    potential = Roughness(POTENTIAL_PER_FIELD_M * float(np.sqrt(variance)), POTENTIAL_LENGTH_M)
    return FieldRoughness(potential, across, regional, alike * white_uT)


def _fit_covariance(x: Floats, variance: float, seen: Bools, distance_m: Floats) -> tuple[Roughness, Roughness]:
    """Fit the autocovariance of deviations x (F,) uT by two exponentials; return the local and the regional one."""
    walked, count, apart, alike = np.append(0.0, np.cumsum(distance_m)), [], [], []
    for lag in LAGS:
        between = walked[lag:] - walked[:-lag]
        pair = seen[lag:] & seen[:-lag] & (between > MIN_STEP_M) & (between < REGIONAL_LENGTH_M)
        if pair.any():
            count.append(float(pair.sum()))
            apart.append(float(between[pair].mean()))
            alike.append(float(np.mean(x[lag:][pair] * x[:-lag][pair])))
    d = np.array(apart)
    # Overlapping pairs are not independent: their effective number falls with the lag.
    n = np.array(count) / (1.0 + d / INDEPENDENT_M) + ASSUMED_PAIRS
    assumed = ASSUMED_SHARE * np.exp(-d / ASSUMED_LENGTH_M) + REGIONAL_SHARE * np.exp(-d / REGIONAL_LENGTH_M)
    c = np.array(alike) + ASSUMED_PAIRS / n * (assumed * variance - np.array(alike))
    # Non-negative least squares of the two variances: both, or either alone.
    fits = []
    for length_m in LENGTHS_M:
        shares = np.stack([np.exp(-d / length_m), np.exp(-d / REGIONAL_LENGTH_M)], axis=1)
        normal, right = shares.T @ (n[:, None] * shares) + 1e-9 * np.eye(2), shares.T @ (n * c)
        both, alone = np.linalg.solve(normal, right), np.diag(np.maximum(right, 0.0) / np.diagonal(normal))
        some = [both] if both.min() >= 0.0 else alone
        fits += [(float(n @ (c - shares @ found) ** 2), float(length_m), found) for found in some]
    _, length_m, found = min(fits, key=lambda one: one[0])
    found = found * min(1.0, variance / max(float(found.sum()), MIN_SIGMA_UT**2))
    return Roughness(float(np.sqrt(found[0])), length_m), Roughness(float(np.sqrt(found[1])), REGIONAL_LENGTH_M)


@dataclass(frozen=True)
class CompassReadings:
    """The field at F footfalls as the magnetometer has it, and how much each is worth."""

    node: Ints  # (F,) of the graph, at the footfall.
    body_field: Floats  # (F, 3) uT; anything where it was not seen.
    nav_R_level: Floats  # (F, 3, 3) attitude whose tilt levels it.
    sigma_uT: Floats  # (F,) noise of the compass; infinite where it is not used.


@dataclass(frozen=True)
class FieldPath:
    """Of F footfalls and the F - 1 strides between them."""

    u: Floats  # (F-1,) uT m, line integral of the body field less the vertical part.
    level_path: Floats  # (F-1, 3) m, the path in the stance's axes.
    by_up: Floats  # (F-1, 3) uT m, by how much u grows with the direction that is up in the body axes of the first, w.
    body_move: Floats  # (F-1, 3) m, from footfall to footfall, in the body axes of the first.
    nav_R_level: Floats  # (F-1, 3, 3) attitude at the first.
    sigma_uT_m: Floats  # (F-1,) noise of u; infinite where the field was not seen.
    distance_m: Floats  # (F-1,) from footfall to footfall; over a hole at least what a person walks.
    level_R_body: Floats  # (3, 3) stance's axes from the body's.
    jumps: Bools  # (F-1,) where the potential jumps, so that u is not used (`field`).


class FieldFactors(BlockGroup):
    """The factors of a walk's field, of footfalls from number `first` on."""

    def __init__(
        self,
        readings: CompassReadings,
        path: FieldPath,
        prior: FieldPrior,
        rough: FieldRoughness,
        p: FieldParameters,
        lost_share: float = 0.0,
        first: int = 0,
    ) -> None:
        self.readings, self.path, self.lost_share, self.rough = readings, path, lost_share, rough
        self.parameters, self._first = p, first
        self.telescoping, self.drift_uT_m = split_potential(rough.potential, lost_share, path.distance_m)
        self.prior = replace(prior, sigma=np.where(np.arange(SIZE) == PHI, self.telescoping.sigma, prior.sigma))
        pose, state = [X(int(j)) for j in readings.node], [M(first + k) for k in range(len(readings.node))]
        self._states = state
        used = np.flatnonzero(np.isfinite(readings.sigma_uT))
        level = np.broadcast_to(path.level_R_body, (len(used), 3, 3))
        compass = MagneticHeading(readings.body_field[used], level, readings.nav_R_level[used], readings.sigma_uT[used])
        self.heading = ResidualBlock(compass, [(pose[k], state[k]) for k in used], kind="magnetic_heading")
        self.strides = np.flatnonzero(np.isfinite(path.sigma_uT_m) & ~path.jumps & p.potential)
        self.potential = self.integrals_over(self.strides)
        changes = transition(path.distance_m, replace(rough, potential=self.telescoping))
        self.integral_sigma, self.change_sigma = self.sigma_of(self.strides), changes.sigma
        self.keep = changes.keep  # (F-1, 9), of the state from footfall to footfall
        self.transition = ResidualBlock(changes, list(pairwise(state)), is_linear=True)
        of_prior = GtsamFactors(factor_of(self.prior, state[:1]))
        super().__init__(self.heading, self.potential, of_prior, self.transition)
        is_gated = np.isfinite(readings.body_field).all(axis=1) & ~np.isfinite(readings.sigma_uT)
        self.counts["gated_out"] = int(is_gated.sum()) if p.compass else 0

    @property
    def shows_heading(self) -> bool:
        """Whether any footfall has a compass, or any stride a line integral."""
        return len(self.heading) + len(self.strides) > 0

    def sigma_of(self, stride: Ints) -> Floats:
        """Sigma of the line integrals over some strides, uT m."""
        return np.hypot(self.path.sigma_uT_m[stride], self.drift_uT_m[stride])

    def integrals_over(self, stride: Ints) -> ResidualBlock:
        """Return the line integrals over some strides, whether they are used or not."""
        path, node, sigma = self.path, self.readings.node, self.sigma_of(stride)
        level_path, move, nav_R_level = path.level_path[stride], path.body_move[stride], path.nav_R_level[stride]
        integrals = FieldPotential(path.u[stride], level_path, path.by_up[stride], move, nav_R_level, sigma)
        keys = [(X(int(node[k])), *self._states[k : k + 2]) for k in stride]
        return ResidualBlock(integrals, keys, kind="field_potential")

    def mark_jumps(self, stride: Ints, jump: bool) -> FieldFactors:
        """Return them with the potential free to jump at these strides, whose line integrals are left out, or not."""
        jumps = self.path.jumps.copy()
        jumps[stride] = jump
        path = replace(self.path, jumps=jumps)
        return FieldFactors(self.readings, path, self.prior, self.rough, self.parameters, self.lost_share, self._first)

    def assume_lost_share(self, share: float) -> FieldFactors:
        """Return them with another share of the potential's changes that does not telescope (`field`)."""
        return FieldFactors(self.readings, self.path, self.prior, self.rough, self.parameters, share, self._first)

    def insert(self, values: gtsam.Values) -> None:
        """Insert the first state at all footfalls."""
        for key in self._states:
            values.insert(key, self.prior.mean)

    def states(self, values: gtsam.Values) -> Floats:
        """(F, 9)."""
        return np.array([values.atVector(key) for key in self._states])


def transition(distance_m: Floats, rough: FieldRoughness) -> FieldTransition:
    """Change of the state over strides (...) of these lengths, m."""
    keep, new = np.ones((*distance_m.shape, SIZE)), np.empty((*distance_m.shape, SIZE))
    new[..., E_H], new[..., IRON] = MEAN_WALK_UT, HARD_IRON_WALK_UT
    parts = ([PHI], rough.potential), ([DELTA], rough.across), (REGION, rough.regional)
    for column, one in parts:
        keep[..., column] = one.correlation(distance_m)[..., None]
        new[..., column] = one.innovation(distance_m)[..., None]
    return FieldTransition(keep, new)


def integrate_path(
    t: Floats, mag: Floats, position: Floats, nav_R_body: Floats, footfall: Ints, up_uT: float
) -> FieldPath:
    """Integrate the field `mag` (N, 3) uT along a walk, of place and attitude at every sample; NaN without a field.

    `footfall` (F,) are samples, `up_uT` the vertical field of the walk.
    """
    row, unseen = np.flatnonzero(np.isfinite(mag[:, 0])), cross_holes(t, footfall)
    integral = integrate_field(t, nav_R_body, position, mag, t[footfall], up_uT)
    # Stance's axes from the body's: z is the median up of the footfalls, x the body's x as far as it is level.
    level = level_attitude(np.median(nav_R_body[footfall][:, 2], axis=0), heading=np.pi / 2)
    nav_R_begin, straight = nav_R_body[footfall[:-1]], np.diff(position[footfall], axis=0)
    # The longest move between samples of the field that a stride has a part in; endless before the first of them and
    # after the last.
    size = np.full(len(row) + 2, np.inf)  # one more, for `reduceat` to end
    size[1:-2] = np.linalg.norm(np.diff(position[row], axis=0), axis=1)
    first = np.searchsorted(row, footfall[:-1], side="right")
    stop = np.searchsorted(row, footfall[1:], side="left") + 1
    coarsest_m = np.maximum.reduceat(size, np.stack([first, stop], axis=1).ravel())[::2]
    moment = np.diff(integral.moment, axis=0)
    by_up = np.stack([-moment[:, 1], moment[:, 0], np.zeros(len(moment))], axis=1)
    return FieldPath(
        u=np.diff(integral.u),
        level_path=np.diff(integral.s, axis=0) @ level.T,
        by_up=np.einsum("nji,nj->ni", nav_R_begin, by_up),
        body_move=np.einsum("nji,nj->ni", nav_R_begin, straight),
        nav_R_level=nav_R_begin,
        sigma_uT_m=np.where(~unseen & (coarsest_m <= COARSEST_M), PATH_SIGMA_UT_M, np.inf),
        distance_m=np.maximum(np.linalg.norm(straight, axis=1), unseen * WALKING_M_S * walk_for(np.diff(t[footfall]))),
        level_R_body=level,
        jumps=np.zeros(len(footfall) - 1, dtype=np.bool_),
    )


def compass_sigma(variance: Floats, rough: FieldRoughness) -> Floats:
    """Sigma (...) uT of compasses, by their variance over that of the walk's (`detectors.weigh_statistic`)."""
    return np.asarray(np.hypot(COMPASS_SIGMA_UT, rough.white_uT * np.sqrt(variance)))


def weigh_compass(sigma_uT: Floats, rough: FieldRoughness) -> Floats:
    """Information of compasses with these sigmas (...) over that at the walk's own spread, at most 1; 0 without one."""
    return np.asarray(np.minimum((compass_sigma(np.ones(()), rough) / sigma_uT) ** 2, 1.0))
