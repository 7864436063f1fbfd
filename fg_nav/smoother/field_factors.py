"""All factors of the magnetic field of a walk, whose state m (`factors.magnetic_field`) is a variable at each footfall.

    magnetic heading   (X_k, M_k)              compass, where the gate passes the field at the footfall
    field potential    (X_k, M_k, M_k+1)       line integral of the field over the stride
    transition         (M_k, M_k+1)            by how rough the field is
    prior              (M_0)                   by direction and strength

Roughness. At footfall k the field deviates from the walk's mean, across it by delta (uT) and in potential by phi
(uT m). Each is a stationary process along the path, whose spread and correlation length the walk itself shows:

    x_k = a_k x_{k-1} + w_k,    a_k = exp(-distance_k / length),    sd(w_k) = sigma sqrt(1 - a_k^2);
    sigma robust,    rho = sum x_k x_{k-1} / sum x_k^2,    length = -mean distance / ln rho.

A smooth field keeps its deviation for metres, a reinforced floor for less than a stride, and a foot that stands on one
spot sees one and the same deviation for as long as it stands.

Path. The line integrals come from the first trajectory of the walk. With y the body field and nav_T_body the
trajectory, between footfalls k and k+1

    u_k = int (y - R^T e_z E_up) . R^T dp,      s_k = L int R^T dp,      d_k = R_k^T (p_{k+1} - p_k).

E_up is the median vertical field at the footfalls, so that a trajectory that climbs falsely adds nothing; L turns the
body axes into those of a stance: x forward as far as level, z up. A stride whose samples of the field lie too far apart
measured nothing. The trajectory must be good within a stride; where it is and which way it heads makes no difference to
u, s and d.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, pairwise

import gtsam
import numpy as np
from gtsam.symbol_shorthand import M, X

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.factors.magnetic_field import (
    DELTA,
    E_H,
    IRON,
    PHI,
    RHO,
    SIZE,
    FieldPotential,
    FieldPrior,
    FieldTransition,
    MagneticHeading,
    across_field,
    integrate_field,
)
from fg_nav.factors.residual import ResidualBlock, factor_of, linear_factor_of, one_of
from fg_nav.frames import level_attitude
from fg_nav.smoother.parameters import FieldParameters
from fg_nav.smoother.solver import GtsamFactors, LinearizableBlock

REGIONAL_SHARE = 3.0
"""What rooms and wings of a building do to the compass, as a share of how the field differs from footfall to
footfall, before the walk has shown it: wide, for one who is wrong here on a short walk bends it; nothing in a
homogeneous field."""

REGIONAL_LENGTH_M = 20.0
"""For how long."""

REGIONAL_WEIGHT = 5.0
"""How many regions' worth of evidence this assumption is: a walk through more of them learns its own value."""

MAD_TO_SIGMA = 1.4826
"""Median absolute deviation to standard deviation, of a normal distribution."""

CLIP_SIGMAS = 4.0
"""Beyond which a deviation counts as if it were there: an outlier shall not set the scale."""

LEAST_STEP_M = 0.2
"""Moves that count in the mean distance; shorter ones are no strides."""

MOST_CORRELATED = 0.98


LEAST_SIGMA_UT = 0.2
"""Spread of the field below which a walk's differences are the magnetometer's."""

LEAST_REGIONAL_UT = 0.01
"""Of a region: keeps the equations well conditioned where the field is the same everywhere."""

POTENTIAL_PER_FIELD_M = 1.5
"""Potential over field before it is measured: the reach of the steel of a building."""

LEAST_POTENTIAL_PER_FIELD_M = 1.0
"""And at least: a smoothed heading takes some of the potential for its own."""


@dataclass(frozen=True)
class Roughness:
    """Of a deviation along the path: spread `sigma` (its unit) and correlation length, m."""

    sigma: float
    length_m: float

    def left(self, distance_m: Floats) -> Floats:
        """Share a of a deviation that is left after a distance."""
        return np.exp(-distance_m / self.length_m)

    def innovation(self, distance_m: Floats) -> Floats:
        """Standard deviation of what is new after a distance; never none at all."""
        return self.sigma * np.sqrt(1.0 - np.minimum(self.left(distance_m), 1.0 - LEAST_NEW) ** 2)


@dataclass(frozen=True)
class FieldRoughness:
    """Of a walk: potential (uT m), deviation across the field at a footfall, and that of its region (uT)."""

    potential: Roughness
    across: Roughness
    regional: Roughness


LEAST_NEW = 1e-4
"""Of a deviation that is new at a footfall on the same spot: keeps the equations well conditioned."""


def robust_sigma(values: Floats) -> float:
    """Spread about zero without the tails."""
    return MAD_TO_SIGMA * float(np.median(np.abs(values)))


def roughness_of(values: Floats, seen: Bools, distance_m: Floats, least_sigma: float) -> Roughness:
    """Measure the roughness.

    Parameters
    ----------
    values : (F,) deviations at the footfalls.
    seen : (F,) where they are known.
    distance_m : (F-1,) from footfall to footfall.
    least_sigma : unit of the values, below which a spread is the sensor's noise.
    """
    if not seen.any():
        return Roughness(least_sigma, NOTHING_KNOWN_M)
    limit = CLIP_SIGMAS * max(robust_sigma(values[seen]), least_sigma)
    x = np.clip(values, -limit, limit)
    strides = seen[1:] & seen[:-1] & (distance_m > LEAST_STEP_M)
    variance = float(np.mean(x[seen] ** 2))
    if strides.sum() < FEWEST or variance <= least_sigma**2:
        return Roughness(max(np.sqrt(variance), least_sigma), NOTHING_KNOWN_M)
    rho = float(np.mean(x[1:][strides] * x[:-1][strides])) / variance
    rho = float(np.clip(rho, LEAST_CORRELATED, MOST_CORRELATED))
    return Roughness(float(np.sqrt(variance)), -float(distance_m[strides].mean()) / np.log(rho))


def roughness_of_regions(
    values: Floats, own: Floats, seen: Bools, distance_m: Floats, assumed: Roughness, reach_m: float, weight: float
) -> Roughness:
    """Measure how much whole regions deviate, beginning from an assumption that is worth `weight` regions.

    The walk is cut into pieces as long as a region. The mean of a piece has the variance of its region, and what the
    footfalls' own deviations leave of it: own^2 2 reach / length. A short walk learns little and keeps to what was
    assumed; a long one finds its own.

    Parameters
    ----------
    values : (F, c) deviations at the footfalls, of components that are alike.
    own : (c,) their spreads.
    seen : (F,) where they are known.
    distance_m : (F-1,) from footfall to footfall.
    assumed : before the walk has shown it.
    reach_m : correlation length of the footfalls' own deviations.
    weight : how many regions the assumption is worth.
    """
    region = np.concatenate([[0], np.floor(np.cumsum(distance_m) / assumed.length_m)]).astype(np.int64)[seen]
    count = np.bincount(region)
    found = []
    for column, sigma in zip(values[seen].T, own, strict=True):
        limit = CLIP_SIGMAS * sigma
        mean = np.bincount(region, np.clip(column, -limit, limit))[count > 0] / count[count > 0]
        left = sigma**2 * min(1.0, 2.0 * reach_m / assumed.length_m)
        found.append(max(float(np.sum(mean**2 - left)), 0.0))
    regions = int((count > 0).sum())
    variance = (weight * assumed.sigma**2 + np.mean(found)) / (weight + regions)
    return Roughness(float(np.sqrt(variance)), assumed.length_m)


FEWEST = 5
"""Strides without which a correlation is not measured."""

NOTHING_KNOWN_M = 1.0
"""Correlation length where none is measured: about a stride's."""

LEAST_CORRELATED = 0.02
"""A correlation below is taken for this one: white from stride to stride."""


def field_deviation(nav_field: Floats, reference: Floats) -> Floats:
    """(F, 3) uT of fields (F, 3) across a horizontal one (F, 2), along it, and up."""
    along = (nav_field[:, :2] * reference).sum(axis=1) / np.linalg.norm(reference, axis=1)
    return np.stack([across_field(nav_field, reference), along, nav_field[:, 2]], axis=1)


def usual_deviation(deviation: Floats) -> Floats:
    """(3,) uT, the median of deviations (F, 3) along the mean field and up; none across it."""
    return np.asarray(np.median(deviation, axis=0) * [0.0, 1.0, 1.0])


def measure_roughness(
    deviation: Floats, states: Floats | None, seen: Bools, passed: Bools, distance_m: Floats
) -> FieldRoughness:
    """Measure the roughness of a walk's field.

    Parameters
    ----------
    deviation : (F, 3) uT, across, along and up.
    states : (F, 8) of the round before, which know the potential; None where there was none.
    seen : (F,) footfalls with a field: they show how far the potential reaches.
    passed : (F,) those whose heading is used: they show what it deviates by.
    distance_m : (F-1,) from footfall to footfall.
    """
    deviation = np.nan_to_num(deviation)
    everywhere = roughness_of(deviation[:, 0], seen, distance_m, LEAST_SIGMA_UT)
    across = roughness_of(deviation[:, 0], passed, distance_m, LEAST_SIGMA_UT)
    # Along and up no heading can hide: they stand for the deviation across as well.
    steady = deviation[:, 1:]
    own = np.array([max(robust_sigma(column[passed]), LEAST_SIGMA_UT) for column in steady.T])
    beyond_sensor = np.sqrt(max(across.sigma**2 - LEAST_SIGMA_UT**2, LEAST_REGIONAL_UT**2))
    assumed = Roughness(REGIONAL_SHARE * float(beyond_sensor), REGIONAL_LENGTH_M)
    region = roughness_of_regions(steady, own, passed, distance_m, assumed, across.length_m, REGIONAL_WEIGHT)
    return FieldRoughness(_measure_potential(states, everywhere, distance_m), across, region)


def _measure_potential(states: Floats | None, across: Roughness, distance_m: Floats) -> Roughness:
    if states is None:
        return Roughness(POTENTIAL_PER_FIELD_M * across.sigma, POTENTIAL_PER_FIELD_M)
    phi = states[:, PHI]
    found = roughness_of(phi - np.median(phi), np.ones(len(phi), dtype=bool), distance_m, LEAST_SIGMA_UT)
    return replace(found, sigma=max(found.sigma, LEAST_POTENTIAL_PER_FIELD_M * across.sigma))


MEAN_WALK_UT = 0.003
"""By how much the building's mean field changes from stride to stride, uT: 0.1 uT over a kilometre and a half."""

HARD_IRON_WALK_UT = 5e-3
"""Its random walk from stride to stride, uT: 0.16 uT in a thousand. A tilt that is wrong in every swing looks like
iron too, and changes with the gait."""

PATH_SIGMA_UT_M = 0.1
"""Noise of the line integral over a stride, uT m: sampling, and what scale errors leave."""

COARSEST_M = 0.4
"""Longest move between two samples of the field that a line integral passes over: the floor's steel is as near."""


@dataclass(frozen=True)
class CompassReadings:
    """The field at F footfalls as the magnetometer has it, and how much each is worth.

    ================ ======= =========================================================================
    node             (F,)    of the graph, at the footfall
    body_field       (F, 3)  uT; anything where it was not seen
    nav_R_level      (F, 3, 3) attitude whose tilt levels it
    sigma_uT         (F,)    noise of the compass; infinite where it is not used
    ================ ======= =========================================================================
    """

    node: Ints
    body_field: Floats
    nav_R_level: Floats
    sigma_uT: Floats


@dataclass(frozen=True)
class FieldPath:
    """Of F footfalls and the F - 1 strides between them.

    ============== ============ =============================================================================
    u              (F-1,)       uT m, line integral of the body field less the vertical part
    level_path     (F-1, 3)     m, the path in the stance's axes
    body_move      (F-1, 3)     m, from footfall to footfall, in the body axes of the first
    nav_R_level    (F-1, 3, 3)  attitude at the first
    sigma_uT_m     (F-1,)       noise of u; infinite where the field was not seen
    distance_m     (F-1,)       from footfall to footfall
    level_R_body   (3, 3)       stance's axes from the body's
    jumps          (F-1,)       where the potential jumps, so that u says nothing (`potential`)
    ============== ============ =============================================================================
    """

    u: Floats
    level_path: Floats
    body_move: Floats
    nav_R_level: Floats
    sigma_uT_m: Floats
    distance_m: Floats
    level_R_body: Floats
    jumps: Bools


class FieldFactors:
    """The factors of a walk's field, linearized together, or one by one as factors of gtsam."""

    def __init__(
        self,
        readings: CompassReadings,
        path: FieldPath,
        prior: FieldPrior,
        rough: FieldRoughness,
        p: FieldParameters,
    ) -> None:
        self.readings, self.path, self.prior, self._rough, self._p = readings, path, prior, rough, p
        pose, state = [X(int(j)) for j in readings.node], [M(k) for k in range(len(readings.node))]
        self._states = state
        used = np.flatnonzero(np.isfinite(readings.sigma_uT) & p.compass)
        level = np.broadcast_to(path.level_R_body, (len(used), 3, 3))
        compass = MagneticHeading(readings.body_field[used], level, readings.nav_R_level[used], readings.sigma_uT[used])
        self.heading = ResidualBlock(compass, [(pose[k], state[k]) for k in used])
        self.strides = np.flatnonzero(np.isfinite(path.sigma_uT_m) & ~path.jumps & p.potential)
        self.potential = self._integrals_over(self.strides)
        self.transition = ResidualBlock(transition(path.distance_m, rough), list(pairwise(state)))

    def _integrals_over(self, stride: Ints) -> ResidualBlock:
        path, node = self.path, self.readings.node
        integrals = FieldPotential(
            path.u[stride],
            path.level_path[stride],
            path.body_move[stride],
            path.nav_R_level[stride],
            path.sigma_uT_m[stride],
        )
        return ResidualBlock(integrals, [(X(int(node[k])), M(int(k)), M(int(k) + 1)) for k in stride])

    def mark_jumps(self, stride: Ints, jump: bool) -> FieldFactors:
        """Return them with the potential free to jump at these strides, whose line integrals are left out, or not."""
        jumps = self.path.jumps.copy()
        jumps[stride] = jump
        return FieldFactors(self.readings, replace(self.path, jumps=jumps), self.prior, self._rough, self._p)

    def compute_jumps(self, values: gtsam.Values) -> Floats:
        """(J,) uT m, by how much the integrals of the strides that were left out differ from what was expected."""
        stride = np.flatnonzero(self.path.jumps)
        if not len(stride):
            return np.zeros(0)
        e, _ = self._integrals_over(stride).evaluate(values, with_jacobians=False)
        return np.asarray(-e[:, 0] * self.path.sigma_uT_m[stride])

    def insert(self, values: gtsam.Values) -> None:
        """Put the first state at all footfalls."""
        for key in self._states:
            values.insert(key, self.prior.mean)

    def states(self, values: gtsam.Values) -> Floats:
        """(F, 8)."""
        return np.array([values.atVector(key) for key in self._states])

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of squares of the residuals over their sigmas."""
        return sum(block.error(values) for block in self._blocks())

    def linearize(self, values: gtsam.Values) -> Iterator[gtsam.GaussianFactor]:
        """Yield its factors, linearized at these values."""
        return chain.from_iterable(block.linearize(values) for block in self._blocks())

    def _blocks(self) -> tuple[LinearizableBlock, ...]:
        return self.heading, self.potential, GtsamFactors(factor_of(self.prior, self._states[:1])), self.transition

    def factors(self) -> Iterator[gtsam.NonlinearFactor]:
        """Yield the same as factors of gtsam, footfall by footfall."""
        heading = {keys[1]: factor for keys, factor in zip(self.heading.keys, self.heading.factors(), strict=True)}
        potential = {keys[2]: f for keys, f in zip(self.potential.keys, self.potential.factors(), strict=True)}
        yield factor_of(self.prior, self._states[:1])
        for k, state in enumerate(self._states):
            if state in heading:
                yield heading[state]
            if k > 0:
                yield linear_factor_of(one_of(self.transition.residuals, k - 1), self._states[k - 1 : k + 1])
            if state in potential:
                yield potential[state]

    def turned(self, nav_R_nav: Floats) -> FieldFactors:
        """Return those of a walk that was turned about up: its field is expected there."""
        mean = self.prior.mean.copy()
        mean[E_H] = nav_R_nav[:2, :2] @ mean[E_H]
        other = FieldFactors.__new__(FieldFactors)
        other.__dict__.update(self.__dict__ | {"prior": replace(self.prior, mean=mean)})
        return other


def transition(distance_m: Floats, rough: FieldRoughness) -> FieldTransition:
    """Change of the state over strides (...) of these lengths, m."""
    keep, new = np.ones((*distance_m.shape, SIZE)), np.empty((*distance_m.shape, SIZE))
    new[..., E_H], new[..., IRON] = MEAN_WALK_UT, HARD_IRON_WALK_UT
    for column, one in ((PHI, rough.potential), (DELTA, rough.across), (RHO, rough.regional)):
        keep[..., column] = one.left(distance_m)
        new[..., column] = one.innovation(distance_m)
    return FieldTransition(keep, new)


def integrate_path(
    t: Floats, mag: Floats, position: Floats, nav_R_body: Floats, footfall: Ints, up_uT: float
) -> FieldPath:
    """Integrate the field along a walk.

    Parameters
    ----------
    t, mag : (N,) s, (N, 3) uT; NaN rows where there was no sample.
    position, nav_R_body : (N, 3) m, (N, 3, 3), at every sample.
    footfall : (F,) their samples.
    up_uT : vertical field of the walk.
    """
    row = np.flatnonzero(np.isfinite(mag[:, 0]))
    move = np.diff(position[row], axis=0)
    integral = integrate_field(t, nav_R_body, position, mag, t[footfall], up_uT)
    level = _level_R_body(nav_R_body[footfall])
    straight = np.diff(position[footfall], axis=0)
    return FieldPath(
        u=np.diff(integral.u),
        level_path=np.diff(integral.s, axis=0) @ level.T,
        body_move=np.einsum("nji,nj->ni", nav_R_body[footfall[:-1]], straight),
        nav_R_level=nav_R_body[footfall[:-1]],
        sigma_uT_m=np.where(_coarsest(move, row, footfall) <= COARSEST_M, PATH_SIGMA_UT_M, np.inf),
        distance_m=np.linalg.norm(straight, axis=1),
        level_R_body=level,
        jumps=np.zeros(len(footfall) - 1, dtype=np.bool_),
    )


def _coarsest(move: Floats, row: Ints, footfall: Ints) -> Floats:
    """(F-1,) m, the longest move (M-1, 3) between samples of the field `row` (M,) that a stride has a part in.

    Endless before the first sample and after the last.
    """
    endless = [np.inf]
    size = np.concatenate([endless, np.linalg.norm(move, axis=1), endless, endless])  # one more, for `reduceat` to end
    first = np.searchsorted(row, footfall[:-1], side="right")
    stop = np.searchsorted(row, footfall[1:], side="left") + 1
    return np.asarray(np.maximum.reduceat(size, np.stack([first, stop], axis=1).ravel())[::2])


def _level_R_body(nav_R_body: Floats) -> Floats:
    """Stance's axes from the body's: z is the median up of the footfalls, x the body's x as far as it is level."""
    return level_attitude(np.median(nav_R_body[:, 2], axis=0), heading=np.pi / 2)
