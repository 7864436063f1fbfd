"""Factors for pedestrian navigation with GTSAM: gtsam and numpy only, useful without the rest of fg-nav.

Vocabulary
----------
Pose keys hold `nav_T_body` (gtsam.Pose3), velocity keys hold nav_v (3-vector, m/s), field keys hold a magnetic field
(3-vector, uT). Tangent-space order of a pose is rotation first, then translation, both in the body frame (gtsam's
convention). A residual is what the variables say minus what was measured. SI units, and uT.

One idea a file. Where gtsam has the factor in C++ the file builds that one; where it has not, the file has the residual
and its Jacobians as functions of numpy arrays, for many at a time, and a factor made of them.

Every Python factor is built by `guarded_factor`, which checks shapes and finiteness before gtsam sees them. Inside
an optimiser of gtsam such a factor is handed a copy of all values at each call, quadratic in the length of a walk:
linearise with `graph.linearize(values)` from Python instead, which makes no copy.
"""

from .differential_field import (
    differential_field_covariance,
    differential_field_factor,
    differential_field_jacobians,
    differential_field_residual,
)
from .field_potential import (
    WayIntegral,
    field_potential_factor,
    field_potential_jacobians,
    field_potential_residual,
    field_potential_sigma,
    way_integral,
)
from .floor_height import FloorParameters, floor_height_factor, floor_height_residual, floor_labels
from .gravity import gravity_factor, gravity_sigma
from .guarded import guarded_factor
from .gyro_errors import gyro_error_factor, gyro_error_prior, gyro_error_sensitivity, with_gyro_errors
from .local_field import (
    earth_field_prior,
    field_tie_coefficients,
    field_tie_factor,
    field_tie_residual,
    local_field_factor,
    local_field_jacobians,
    local_field_residual,
    student_t_information,
    student_t_noise,
)
from .magnetic_heading import (
    heading_sigma,
    magnetic_heading_factor,
    magnetic_heading_jacobian,
    magnetic_heading_residual,
)
from .position_fix import position_fix_factor, position_fix_noise
from .straight_walk import (
    StraightParameters,
    straight_probability,
    straight_triples,
    straight_walk_factor,
    straight_walk_jacobians,
    straight_walk_residual,
)
from .swing_field import SwingQuadratics, swing_field_factor, swing_field_quadratics
from .zero_rate import zero_rate_factor, zero_rate_sigma
from .zero_velocity import rolling_stance_factor, rolling_stance_jacobian, rolling_stance_residual

__all__ = [
    "FloorParameters",
    "StraightParameters",
    "SwingQuadratics",
    "WayIntegral",
    "differential_field_covariance",
    "differential_field_factor",
    "differential_field_jacobians",
    "differential_field_residual",
    "earth_field_prior",
    "field_potential_factor",
    "field_potential_jacobians",
    "field_potential_residual",
    "field_potential_sigma",
    "field_tie_coefficients",
    "field_tie_factor",
    "field_tie_residual",
    "floor_height_factor",
    "floor_height_residual",
    "floor_labels",
    "gravity_factor",
    "gravity_sigma",
    "guarded_factor",
    "gyro_error_factor",
    "gyro_error_prior",
    "gyro_error_sensitivity",
    "heading_sigma",
    "local_field_factor",
    "local_field_jacobians",
    "local_field_residual",
    "magnetic_heading_factor",
    "magnetic_heading_jacobian",
    "magnetic_heading_residual",
    "position_fix_factor",
    "position_fix_noise",
    "rolling_stance_factor",
    "rolling_stance_jacobian",
    "rolling_stance_residual",
    "straight_probability",
    "straight_triples",
    "straight_walk_factor",
    "straight_walk_jacobians",
    "straight_walk_residual",
    "student_t_information",
    "student_t_noise",
    "swing_field_factor",
    "swing_field_quadratics",
    "way_integral",
    "with_gyro_errors",
    "zero_rate_factor",
    "zero_rate_sigma",
]
