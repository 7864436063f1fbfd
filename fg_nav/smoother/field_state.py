"""The state of the field at each footfall, and what ties it to the poses and to the state before.

    m = (phi, delta, rho, E_east, E_north, h_x, h_y, h_z)

========= ===== =====================================================================================================
phi       uT m  potential of all that is magnetised about, in place of which the field would be E everywhere
delta     uT    deviation of the field at the footfall across E, to its right
rho       uT    the same of the region: what a room or a wing of the building does to the compass for tens of metres
E         uT    horizontal field of the building
h         uT    hard iron left in the stance's axes (`field_way`), carried along
========= ===== =====================================================================================================

With n = R (y - L^T h) the field in nav at footfall k, R d = p_{k+1} - p_k, u and s the line integral and the way:

    across      (n_E E_N - n_N E_E) / |E| - delta - rho              = 0 +- compass noise
    along the way   E . (R d) + h . s - u - (phi_{k+1} - phi_k)      = 0 +- way noise
    m_{k+1}     = diag(a_phi, a_delta, a_rho, 1, 1, 1, 1, 1) m_k     +- innovations (`field_noise`)

The second is `factors.field_potential`. Both act on the yaw of the pose alone, about up: the field must not tilt
anybody. With psi the yaw,

    d across / d psi = -(n_N E_N + n_E E_E) / |E|,      d along / d psi = E_N (R d)_E - E_E (R d)_N.

`delta` and `phi` are the local field as a variable, reduced to what yaw can learn from it: with an innovation of none
they are one unknown for a whole stretch (field differences), with a spread of none the field is known everywhere
(absolute heading). A magnet moves delta and phi where it lies, and not the heading.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import M, X

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.factors.field_potential import field_potential_jacobians, field_potential_residual
from fg_nav.smoother.field_noise import FieldRoughness
from fg_nav.smoother.field_parameters import FieldParameters
from fg_nav.smoother.field_way import FieldWay

SIZE = 8
PHI, DELTA, RHO = 0, 1, 2
E_H = slice(3, 5)
IRON = slice(5, 8)


@dataclass(frozen=True)
class FieldSeen:
    """The field at F footfalls as the magnetometer has it, and how much each is worth.

    ================ ======= =========================================================================
    node             (F,)    of the graph, at the footfall
    body_field       (F, 3)  uT; anything where it was not seen
    compass_sigma_uT (F,)    noise of the compass; infinite where it is not used
    disturbed        (F,)    where potential and deviation are not those of the walk
    ================ ======= =========================================================================
    """

    node: Ints
    body_field: Floats
    compass_sigma_uT: Floats
    disturbed: Bools


@dataclass(frozen=True)
class FieldPrior:
    """The first state (8,) and its sigmas (8,).

    In place of those of E_east and E_north: of E across the mean, by its direction, and along, by its strength. They
    are kept apart, for a field that is not where it was expected would otherwise shrink instead of turning.
    """

    mean: Floats
    sigma: Floats


DISTURBED_FACTOR = 30.0
"""By how much more than usual deviation and potential may change into a disturbed footfall and out of it."""


class FieldTies:
    """All factors of the field of a walk, linearised together."""

    def __init__(
        self,
        seen: FieldSeen,
        way: FieldWay,
        prior: FieldPrior,
        rough: FieldRoughness,
        p: FieldParameters,
    ) -> None:
        self._pose = [X(int(j)) for j in seen.node]
        self._state = [M(k) for k in range(len(seen.node))]
        self.seen, self.way, self.prior = seen, way, prior
        self.compass = _weight(seen.compass_sigma_uT) if p.compass else np.zeros(len(seen.node))
        self.along = _weight(way.sigma_uT_m) if p.potential else np.zeros(len(way.u))
        self.keep, self.innovation = _transition(seen, way, rough, p)

    def insert(self, values: gtsam.Values) -> None:
        """Put the first state at all footfalls."""
        for key in self._state:
            values.insert(key, self.prior.mean)

    def states(self, values: gtsam.Values) -> Floats:
        """(F, 8)."""
        return np.array([values.atVector(key) for key in self._state])

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of squares of the residuals over their sigmas."""
        m, nav_R_body = self.states(values), self._attitudes(values)
        across, _ = self._across(m, nav_R_body)
        along = self._along_the_way(m, nav_R_body)
        first = self.first(m[0])
        return 0.5 * float(sum((e**2).sum() for e in (across, along, first, self._changes(m))))

    def linearize(self, values: gtsam.Values) -> Iterator[gtsam.GaussianFactor]:
        """Yield two factors a footfall: what was measured, and the change to the next state."""
        m, nav_R_body = self.states(values), self._attitudes(values)
        yield from self._measured(m, nav_R_body)
        yield from self._carried(m)

    def _attitudes(self, values: gtsam.Values) -> Floats:
        return np.array([values.atPose3(key).rotation().matrix() for key in self._pose])

    def _across(self, m: Floats, nav_R_body: Floats) -> tuple[Floats, Floats]:
        """Residuals (F,) over sigma and the field in nav (F, 3)."""
        iron = m[:, IRON] @ self.way.level_R_body
        n = np.einsum("kij,kj->ki", nav_R_body, self.seen.body_field - iron)
        across = across_field(n, m[:, E_H])
        return (across - m[:, DELTA] - m[:, RHO]) * self.compass, n

    def _along_the_way(self, m: Floats, nav_R_body: Floats) -> Floats:
        """Residuals (F-1,) over sigma."""
        way, before = self.way, m[:-1]
        potentials = np.stack([m[:-1, PHI], m[1:, PHI]], axis=1)
        residual = field_potential_residual(
            nav_R_body[:-1], way.body_move, before[:, E_H], before[:, IRON], potentials, way.u, way.level_way
        )
        return np.asarray(residual * self.along)

    def first(self, m: Floats) -> Floats:
        """Residuals (8,) of the first state over sigma."""
        off = m - self.prior.mean
        off[E_H] = _turned_and_longer(m[E_H], self.prior.mean[E_H])
        return np.asarray(off / self.prior.sigma)

    def by_first(self, m: Floats) -> Floats:
        """Derivative (8, 8) of `first`."""
        by_state, strength = np.eye(SIZE), np.linalg.norm(m[E_H])
        turned = across_direction(m[None, E_H])[0] * np.linalg.norm(self.prior.mean[E_H]) / strength
        by_state[E_H, E_H] = turned, m[E_H] / strength
        return np.asarray(by_state / self.prior.sigma[:, None])

    def _changes(self, m: Floats) -> Floats:
        """(F-1, 8) over sigma."""
        return np.asarray((m[1:] - self.keep * m[:-1]) / self.innovation)

    def _measured(self, m: Floats, nav_R_body: Floats) -> Iterator[gtsam.GaussianFactor]:
        across, n = self._across(m, nav_R_body)
        along = self._along_the_way(m, nav_R_body)
        by_rotation, move = field_potential_jacobians(nav_R_body[:-1], self.way.body_move, m[:-1, E_H])
        strength = np.linalg.norm(m[:, E_H], axis=1)
        across_by_yaw = -(n[:, :2] * m[:, E_H]).sum(axis=1) / strength * self.compass
        by_pose = np.zeros((len(m), 2, 6))
        by_pose[:, 0, :3] = across_by_yaw[:, None] * nav_R_body[:, 2]
        by_pose[:-1, 1, :3] = by_rotation * self.along[:, None]
        by_state = self._by_state(m, nav_R_body, n, move)
        by_next = np.zeros((2, SIZE))
        right = -np.stack([across, np.append(along, 0.0)], axis=1)
        unit = gtsam.noiseModel.Unit.Create(2)
        for k, (A, S, b) in enumerate(zip(by_pose[:-1], by_state[:-1], right[:-1], strict=True)):
            by_next[1, PHI] = -self.along[k]
            yield gtsam.JacobianFactor(self._pose[k], A, self._state[k], S, self._state[k + 1], by_next, b, unit)
        yield gtsam.JacobianFactor(self._pose[-1], by_pose[-1], self._state[-1], by_state[-1], right[-1], unit)

    def _by_state(self, m: Floats, nav_R_body: Floats, n: Floats, move: Floats) -> Floats:
        """(F, 2, 8): rows across and along the way."""
        by_state = np.zeros((len(m), 2, SIZE))
        by_state[:, 0, DELTA] = by_state[:, 0, RHO] = -self.compass
        by_state[:, 0, E_H] = across_by_reference(n, m[:, E_H]) * self.compass[:, None]
        right = across_direction(m[:, E_H])
        across_body = np.einsum("ki,kij->kj", right, nav_R_body[:, :2])
        by_state[:, 0, IRON] = -across_body @ self.way.level_R_body.T * self.compass[:, None]
        by_state[:-1, 1, PHI] = self.along
        by_state[:-1, 1, E_H] = move * self.along[:, None]
        by_state[:-1, 1, IRON] = self.way.level_way * self.along[:, None]
        return by_state

    def _carried(self, m: Floats) -> Iterator[gtsam.GaussianFactor]:
        unit = gtsam.noiseModel.Unit.Create(SIZE)
        yield gtsam.JacobianFactor(self._state[0], self.by_first(m[0]), -self.first(m[0]), unit)
        changes = self._changes(m)
        after = 1.0 / self.innovation
        for k, change in enumerate(changes):
            before = np.diag(-self.keep[k] * after[k])
            yield gtsam.JacobianFactor(self._state[k], before, self._state[k + 1], np.diag(after[k]), -change, unit)


def across_direction(reference: Floats) -> Floats:
    """(F, 2) unit vectors over ground, at right angles to the horizontal field (F, 2), to its right."""
    right = np.stack([reference[:, 1], -reference[:, 0]], axis=1)
    return np.asarray(right / np.linalg.norm(reference, axis=1)[:, None])


def across_field(nav_field: Floats, reference: Floats) -> Floats:
    """(F,) uT, the part of a field (F, 3) across a horizontal one (F, 2), to its right."""
    return np.asarray((nav_field[:, :2] * across_direction(reference)).sum(axis=1))


def across_by_reference(nav_field: Floats, reference: Floats) -> Floats:
    """(F, 2) derivative of `across_field` by the reference: it turns, its length makes no difference."""
    strength = np.linalg.norm(reference, axis=1)
    along = (nav_field[:, :2] * reference).sum(axis=1) / strength
    return np.asarray(-(along / strength)[:, None] * across_direction(reference))


def _turned_and_longer(field: Floats, mean: Floats) -> Floats:
    """(2,) by how much a horizontal field (2,) is turned to the right of another, as an arc, and longer than it, uT."""
    length = np.linalg.norm(mean)
    turn = np.arctan2(across_direction(mean[None])[0] @ field, mean @ field / length)
    return np.array([turn * length, np.linalg.norm(field) - length])


def _weight(sigma: Floats) -> Floats:
    """One over sigma, none where that is infinite."""
    return np.asarray(1.0 / sigma)


def _transition(seen: FieldSeen, way: FieldWay, rough: FieldRoughness, p: FieldParameters) -> tuple[Floats, Floats]:
    """Share (F-1, 8) of each state that is left a stride later, and sigma of what is new."""
    d = way.distance_m
    keep, new = np.ones((len(d), SIZE)), np.empty((len(d), SIZE))
    new[:, E_H], new[:, IRON] = p.mean_walk_uT, p.hard_iron_walk_uT
    about = seen.disturbed[1:] | seen.disturbed[:-1]
    for column, one in ((PHI, rough.potential), (DELTA, rough.across), (RHO, rough.regional)):
        keep[:, column] = one.left(d)
        new[:, column] = one.innovation(d)
    new[:, [PHI, DELTA]] *= np.where(about, DISTURBED_FACTOR, 1.0)[:, None]
    return keep, new
