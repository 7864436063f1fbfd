"""What every estimator returns: the dense trajectory, a table with one row a stance, and how it was made.

Sigmas are one standard deviation of the estimator's own claim; the evaluation tests whether they are true.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.recording import Recording


@dataclass(frozen=True)
class StanceTable:
    """One row a stance, taken at its representative (stillest) sample.

    ================== ======== ==========================================================
    sample             (K,)     index into the recording
    t                  (K,)     s
    position           (K, 3)   m, navigation frame
    nav_R_body         (K, 3,3) attitude
    gyro_bias          (K, 3)   rad/s, body frame
    position_cov       (K, 3,3) m^2, navigation frame
    heading_sigma      (K,)     rad
    gyro_bias_sigma    (K, 3)   rad/s
    field              (K,)     verdict on the magnetic field: "none" where it was not used
    field_reason       (K,)     the verdict in words
    pose_cov           (K, 4,4) of east, north, up (m) and yaw about up (rad) together; None
                                where the estimator does not tell
    ================== ======== ==========================================================
    """

    sample: Ints
    t: Floats
    position: Floats
    nav_R_body: Floats
    gyro_bias: Floats
    position_cov: Floats
    heading_sigma: Floats
    gyro_bias_sigma: Floats
    field: tuple[str, ...]
    field_reason: tuple[str, ...]
    pose_cov: Floats | None = None

    def __len__(self) -> int:
        return len(self.sample)

    @property
    def position_sigma(self) -> Floats:
        """(K, 3) standard deviations of position, m."""
        return np.sqrt(np.diagonal(self.position_cov, axis1=1, axis2=2))


@dataclass(frozen=True)
class Solution:
    """A walk as an estimator saw it. Arrays are at the recording's rate.

    `t` (N,) s; `position` (N, 3) m; `velocity` (N, 3) m/s; `nav_R_body` (N, 3, 3).
    `parameters` are the effective ones, ready for JSON; `notes` are remarks for the user. `moment` is what an online
    estimator estimated at each footfall when it was complete, before it knew what came after; None from all others.
    `graph` counts its factors by kind (`smoother.count`), empty where there is none.
    `distance_sigma_m` is that of the distance travelled, the sum of the moves from stance to stance; None where the
    estimator does not tell.
    `polished` is the batch solution of the same walk, where an online estimator was asked for it.
    `recording` has the samples as they were integrated, with clipped peaks as high and rates of the scale that the walk
    showed; None where they are those that were given.
    """

    method: str
    t: Floats
    position: Floats
    velocity: Floats
    nav_R_body: Floats
    stances: StanceTable
    runtime_s: float
    parameters: Mapping[str, object] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    graph: Mapping[str, int] = field(default_factory=dict)
    distance_sigma_m: float | None = None
    moment: StanceTable | None = None
    polished: Solution | None = None
    recording: Recording | None = None
