"""Factors for pedestrian navigation with GTSAM: gtsam and numpy only, useful without the rest of fg-nav.

Vocabulary
----------
Pose keys hold `nav_T_body` (gtsam.Pose3), velocity keys hold nav_v (3-vector, m/s). Tangent-space order of a pose is
rotation first, then translation, both in the body frame (gtsam's convention). A residual is what the variables say
minus what was measured. SI units.

Every Python factor is built by `guarded_factor`, which checks shapes and finiteness before gtsam sees them. Inside
an optimiser of gtsam such a factor is handed a copy of all values at each call, quadratic in the length of a walk:
linearise with `graph.linearize(values)` from Python instead, which makes no copy.
"""

from factors.guarded import guarded_factor
from factors.zero_velocity import rolling_stance_factor, rolling_stance_jacobian, rolling_stance_residual

__all__ = ["guarded_factor", "rolling_stance_factor", "rolling_stance_jacobian", "rolling_stance_residual"]
