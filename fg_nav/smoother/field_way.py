"""The field along the way: what each stride's line integral of the body field measured.

With y the body field and nav_T_body the trajectory, between footfalls k and k+1

    u_k = int (y - R^T e_z E_up) . R^T dp,      s_k = L int R^T dp,      d_k = R_k^T (p_{k+1} - p_k).

E_up is the median vertical field at the footfalls, so that a trajectory that climbs falsely adds nothing; L turns the
body axes into those of a stance: x forward as far as level, z up. A stride whose samples of the field lie too far apart
measured nothing.

The trajectory must be good within a stride; where it is and which way it heads makes no difference to u, s and d.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.factors.field_potential import way_integral
from fg_nav.frames import levelled
from fg_nav.smoother.field_parameters import FieldParameters


@dataclass(frozen=True)
class FieldWay:
    """Of F footfalls and the F - 1 strides between them.

    ============== ============ =============================================================================
    u              (F-1,)       uT m, line integral of the body field less the vertical part
    level_way      (F-1, 3)     m, the way in the stance's axes
    body_move      (F-1, 3)     m, from footfall to footfall, in the body axes of the first
    sigma_uT_m     (F-1,)       noise of u; infinite where the field was not seen
    distance_m     (F-1,)       from footfall to footfall
    level_R_body   (3, 3)       stance's axes from the body's
    ============== ============ =============================================================================
    """

    u: Floats
    level_way: Floats
    body_move: Floats
    sigma_uT_m: Floats
    distance_m: Floats
    level_R_body: Floats


def field_way(
    t: Floats, mag: Floats, position: Floats, nav_R_body: Floats, footfall: Ints, up_uT: float, p: FieldParameters
) -> FieldWay:
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
    integral = way_integral(t, nav_R_body, position, mag, t[footfall], up_uT)
    level = _level_R_body(nav_R_body[footfall])
    straight = np.diff(position[footfall], axis=0)
    return FieldWay(
        u=np.diff(integral.u),
        level_way=np.diff(integral.s, axis=0) @ level.T,
        body_move=np.einsum("nji,nj->ni", nav_R_body[footfall[:-1]], straight),
        sigma_uT_m=np.where(_coarsest(move, row, footfall) <= p.coarsest_m, p.way_sigma_uT_m, np.inf),
        distance_m=np.linalg.norm(straight, axis=1),
        level_R_body=level,
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
    return levelled(np.median(nav_R_body[:, 2], axis=0), heading=np.pi / 2)
