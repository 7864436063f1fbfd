"""All factors of the magnetic field of a walk, whose state m (`factors.magnetic_field`) is a variable at each footfall.

    magnetic heading   (X_k, M_k)              compass of each footfall, weighed by the gate
    field potential    (X_k, M_k, M_k+1)       line integral of the field over the stride
    transition         (M_k, M_k+1)            by how rough the field is (`roughness`)
    prior              (M_0)                   by direction and strength

Path. The line integrals come from the first trajectory of the walk. With y the body field and nav_T_body the
trajectory, between footfalls k and k+1

    u_k = int (y - R^T e_z E_up) . R^T dp,      s_k = L int R^T dp,      d_k = R_k^T (p_{k+1} - p_k),
    w_k = R_k^T e_z x int (R y) x dp.

E_up is the median vertical field at the footfalls, so that a trajectory that climbs falsely adds nothing; L turns the
body axes into those of a stance: x forward as far as level, z up. A stride whose samples of the field lie too far apart
measured nothing, and one with a hole in its samples neither: that may have been as long as a person walks. The
trajectory must be good within a stride; where it is and which way it heads makes no difference to u, s, d and w. Its
tilt does: by w_k the residual follows the tilt of the pose at footfall k.
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
    REGION,
    SIZE,
    FieldPotential,
    FieldPrior,
    FieldTransition,
    MagneticHeading,
    integrate_field,
)
from fg_nav.factors.residual import ResidualBlock, Stack, factor_of, linear_factor_of, one_of
from fg_nav.frames import level_attitude
from fg_nav.samples.gaps import cross_holes
from fg_nav.smoother.parameters import FieldParameters
from fg_nav.smoother.roughness import FieldRoughness, split_potential
from fg_nav.smoother.solver import GtsamFactors, LinearizableBlock
from fg_nav.smoother.unseen import WALKING_M_S, walk_for
from fg_nav.system.spilled import BLOCK_ROWS, drop_pages

MEAN_WALK_UT = 0.003
"""By how much the building's mean field changes from stride to stride, uT: 0.1 uT over a kilometre and a half."""

HARD_IRON_WALK_UT = 5e-3
"""Its random walk from stride to stride, uT: 0.16 uT in a thousand. A tilt that is wrong in every swing looks like
iron too, and changes with the gait."""

PATH_SIGMA_UT_M = 0.1  # Noise of the line integral over a stride, uT m: sampling, and what scale errors leave.

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
    by_up          (F-1, 3)     uT m, by how much u grows with the direction that is up in the body axes of the first, w
    body_move      (F-1, 3)     m, from footfall to footfall, in the body axes of the first
    nav_R_level    (F-1, 3, 3)  attitude at the first
    sigma_uT_m     (F-1,)       noise of u; infinite where the field was not seen
    distance_m     (F-1,)       from footfall to footfall; over a hole at least what a person walks
    level_R_body   (3, 3)       stance's axes from the body's
    jumps          (F-1,)       where the potential jumps, so that u says nothing (`potential`)
    ============== ============ =============================================================================
    """

    u: Floats
    level_path: Floats
    by_up: Floats
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
        lost_share: float = 0.0,
    ) -> None:
        self.readings, self.path, self.lost_share, self.rough = readings, path, lost_share, rough
        self.parameters = p
        self.telescoping, self.drift_uT_m = split_potential(rough.potential, lost_share, path.distance_m)
        self.prior = replace(prior, sigma=np.where(np.arange(SIZE) == PHI, self.telescoping.sigma, prior.sigma))
        pose, state = [X(int(j)) for j in readings.node], [M(k) for k in range(len(readings.node))]
        self._states = state
        used = np.flatnonzero(np.isfinite(readings.sigma_uT))
        level = np.broadcast_to(path.level_R_body, (len(used), 3, 3))
        compass = MagneticHeading(readings.body_field[used], level, readings.nav_R_level[used], readings.sigma_uT[used])
        self.heading = ResidualBlock(compass, [(pose[k], state[k]) for k in used])
        self.strides = np.flatnonzero(np.isfinite(path.sigma_uT_m) & ~path.jumps & p.potential)
        self.potential = self.integrals_over(self.strides)
        changes = transition(path.distance_m, replace(rough, potential=self.telescoping))
        self.integral_sigma, self.change_sigma = self._integral_sigma(self.strides), changes.sigma
        self.transition = ResidualBlock(changes, list(pairwise(state)))

    def _integral_sigma(self, stride: Ints) -> Floats:
        return np.hypot(self.path.sigma_uT_m[stride], self.drift_uT_m[stride])

    def integrals_over(self, stride: Ints) -> ResidualBlock:
        """Return the line integrals over some strides, whether they are used or not."""
        path, node, sigma = self.path, self.readings.node, self._integral_sigma(stride)
        level_path, move, nav_R_level = path.level_path[stride], path.body_move[stride], path.nav_R_level[stride]
        integrals = FieldPotential(path.u[stride], level_path, path.by_up[stride], move, nav_R_level, sigma)
        return ResidualBlock(integrals, [(X(int(node[k])), M(int(k)), M(int(k) + 1)) for k in stride])

    def mark_jumps(self, stride: Ints, jump: bool) -> FieldFactors:
        """Return them with the potential free to jump at these strides, whose line integrals are left out, or not."""
        jumps = self.path.jumps.copy()
        jumps[stride] = jump
        return self._with(replace(self.path, jumps=jumps), self.lost_share)

    def assume_lost_share(self, share: float) -> FieldFactors:
        """Return them with another share of the potential's changes that does not telescope (`path_noise`)."""
        return self._with(self.path, share)

    def _with(self, path: FieldPath, lost_share: float) -> FieldFactors:
        return FieldFactors(self.readings, path, self.prior, self.rough, self.parameters, lost_share)

    def compute_jumps(self, values: gtsam.Values) -> Floats:
        """(J,) uT m, by how much the integrals of the strides that were left out differ from what was expected."""
        stride = np.flatnonzero(self.path.jumps)
        if not len(stride):
            return np.zeros(0)
        e, _ = self.integrals_over(stride).evaluate(values, with_jacobians=False)
        return np.asarray(-e[:, 0] * self._integral_sigma(stride))

    def insert(self, values: gtsam.Values) -> None:
        """Put the first state at all footfalls."""
        for key in self._states:
            values.insert(key, self.prior.mean)

    def states(self, values: gtsam.Values) -> Floats:
        """(F, 9)."""
        return np.array([values.atVector(key) for key in self._states])

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of squares of the residuals over their sigmas."""
        return sum(block.error(values) for block in self._blocks())

    def linearize(self, values: gtsam.Values) -> Iterator[gtsam.GaussianFactor]:
        """Yield its factors, linearized at these values."""
        return chain.from_iterable(block.linearize(values) for block in self._blocks())

    def stack(self, values: gtsam.Values) -> list[Stack]:
        """Return the same as arrays."""
        return [stack for block in self._blocks() for stack in block.stack(values)]

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


def transition(distance_m: Floats, rough: FieldRoughness) -> FieldTransition:
    """Change of the state over strides (...) of these lengths, m."""
    keep, new = np.ones((*distance_m.shape, SIZE)), np.empty((*distance_m.shape, SIZE))
    new[..., E_H], new[..., IRON] = MEAN_WALK_UT, HARD_IRON_WALK_UT
    parts = ([PHI], rough.potential), ([DELTA], rough.across), (REGION, rough.regional)
    for column, one in parts:
        keep[..., column] = one.left(distance_m)[..., None]
        new[..., column] = one.innovation(distance_m)[..., None]
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
    row, unseen = np.flatnonzero(np.isfinite(mag[:, 0])), cross_holes(t, footfall)
    drop_pages()
    integral = integrate_field(t, nav_R_body, position, mag, t[footfall], up_uT, drop_pages)
    nav_R_begin, level = nav_R_body[footfall[:-1]], _level_R_body(nav_R_body[footfall])
    straight = np.diff(position[footfall], axis=0)
    drop_pages()
    moment = np.diff(integral.moment, axis=0)
    by_up = np.stack([-moment[:, 1], moment[:, 0], np.zeros(len(moment))], axis=1)
    return FieldPath(
        u=np.diff(integral.u),
        level_path=np.diff(integral.s, axis=0) @ level.T,
        by_up=np.einsum("nji,nj->ni", nav_R_begin, by_up),
        body_move=np.einsum("nji,nj->ni", nav_R_begin, straight),
        nav_R_level=nav_R_begin,
        sigma_uT_m=np.where(~unseen & (_coarsest(position, row, footfall) <= COARSEST_M), PATH_SIGMA_UT_M, np.inf),
        distance_m=np.maximum(np.linalg.norm(straight, axis=1), unseen * WALKING_M_S * walk_for(np.diff(t[footfall]))),
        level_R_body=level,
        jumps=np.zeros(len(footfall) - 1, dtype=np.bool_),
    )


def _coarsest(position: Floats, row: Ints, footfall: Ints) -> Floats:
    """(F-1,) m, the longest move between samples of the field `row` (M,) that a stride has a part in.

    Endless before the first sample and after the last.
    """
    size = np.full(len(row) + 2, np.inf)  # one more, for `reduceat` to end
    for start in range(0, len(row) - 1, BLOCK_ROWS):
        moved = np.linalg.norm(np.diff(position[row[start : start + BLOCK_ROWS + 1]], axis=0), axis=1)
        size[start + 1 : start + 1 + len(moved)] = moved
        drop_pages()
    first = np.searchsorted(row, footfall[:-1], side="right")
    stop = np.searchsorted(row, footfall[1:], side="left") + 1
    return np.asarray(np.maximum.reduceat(size, np.stack([first, stop], axis=1).ravel())[::2])


def _level_R_body(nav_R_body: Floats) -> Floats:
    """Stance's axes from the body's: z is the median up of the footfalls, x the body's x as far as it is level."""
    return level_attitude(np.median(nav_R_body[:, 2], axis=0), heading=np.pi / 2)
