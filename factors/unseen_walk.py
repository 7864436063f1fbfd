"""A walk that no sensor saw: what a person can have done between two stances.

Between nav_T_body of the last stance before and of the first behind, p position (navigation frame, z up, m), u the
direction of up in the body frame, R^T e_z, psi the turn about up from one attitude to the other (`rotation.turn_from`):

    e = (p_2 - p_1) / s_p                                       over ground and up, each with its own s_p
    e = wrap(psi - turn) / s_psi                                rad
    e = (u_2 - u_1) / s_u                                       a foot is put down as flat as before

The rows of u are three and have rank two; they leave the heading alone, and hold at any angle. psi has no derivative
where the foot has turned by exactly half a turn more than expected.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .residual import POSE, Array
from .rotation import skew, turn_from

ROWS = 7


@dataclass(frozen=True)
class UnseenWalk:
    """What is expected of a walk that was not seen; variables nav_T_body before and behind.

    ============== ======== ================================================
    move_sigma     (..., 3) m, of the displacement, east, north and up
    turn           (...)     rad about up, counter-clockwise, as expected
    turn_sigma     (...)     rad
    tilt_sigma     (...)     rad, of the tilt behind against that before
    ============== ======== ================================================
    """

    name: ClassVar[str] = "unseen walk"
    dims: ClassVar[tuple[int, ...]] = (POSE, POSE)
    rows: ClassVar[int] = ROWS

    move_sigma: Array
    turn: Array
    turn_sigma: Array
    tilt_sigma: Array

    def evaluate(self, variables: Sequence[Array], with_jacobians: bool) -> tuple[Array, list[Array]]:
        """Return the residual (..., 7) and its Jacobians by both poses."""
        before, behind = variables
        R_1, R_2 = before[..., :3, :3], behind[..., :3, :3]
        cosine, sine, by_behind = turn_from(R_1, R_2)
        psi = np.arctan2(sine, cosine) - self.turn
        off = np.arctan2(np.sin(psi), np.cos(psi))[..., None]
        e = np.concatenate([behind[..., :3, 3] - before[..., :3, 3], off, R_2[..., 2, :] - R_1[..., 2, :]], axis=-1)
        sigma = self._sigma()
        if not with_jacobians:
            return e / sigma, []
        by_before = -turn_from(R_2, R_1)[2]
        H = [self._jacobian(R_1, by_before, -1.0), self._jacobian(R_2, by_behind, 1.0)]
        return e / sigma, [one / sigma[..., None] for one in H]

    def _sigma(self) -> Array:
        others = np.stack([self.turn_sigma, self.tilt_sigma, self.tilt_sigma, self.tilt_sigma], axis=-1)
        return np.concatenate([self.move_sigma, others], axis=-1)

    @staticmethod
    def _jacobian(nav_R_body: Array, by_turn: Array, sign: float) -> Array:
        """Jacobian (..., 7, 6), not yet over sigma, by one of the poses; `by_turn` (..., 3) is dpsi by its rotation."""
        H = np.zeros((*nav_R_body.shape[:-2], ROWS, POSE))
        H[..., :3, 3:] = sign * nav_R_body
        H[..., 3, :3] = by_turn
        H[..., 4:, :3] = sign * skew(nav_R_body[..., 2, :])
        return H
