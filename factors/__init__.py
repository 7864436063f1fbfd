"""Factors for pedestrian navigation with GTSAM: gtsam and numpy only, useful without the rest of fg-nav.

Vocabulary
----------
Pose keys hold `nav_T_body` (gtsam.Pose3), velocity keys hold nav_v (3-vector, m/s), field keys hold the state of the
magnetic field at a footfall (9-vector, `magnetic_field`). Tangent-space order of a pose is rotation first, then
translation, both in the body frame (gtsam's convention). A residual is what the variables predict minus what was
measured. SI units, and uT.

Where gtsam has a factor in C++, that one is built; where it has not, there is the residual with its Jacobians as a
frozen dataclass of what was measured, for one instant or many (`residual`): `factor_of` makes a factor of one,
`ResidualBlock` linearizes many together. An optimizer of gtsam copies all values at each call of a Python factor,
quadratic in the length of a walk: linearize with `graph.linearize(values)` from Python instead.
"""

from .differential_field import DifferentialField
from .magnetic_field import FieldPotential, FieldPrior, FieldTransition, LineIntegral, MagneticHeading, integrate_field
from .residual import Residual, ResidualBlock, factor_of, guarded_factor, linear_factor_of
from .same_place import SamePlace, weigh_place
from .walk_constraints import (
    BarometerDrift,
    BarometricHeight,
    BuildingDirection,
    FloorHeight,
    Heading,
    UnseenWalk,
    heading_factor,
    position_fix_noise,
)
from .zero_velocity import StanceVelocity, zero_rate_factor

__all__ = [
    "BarometerDrift",
    "BarometricHeight",
    "BuildingDirection",
    "DifferentialField",
    "FieldPotential",
    "FieldPrior",
    "FieldTransition",
    "FloorHeight",
    "Heading",
    "LineIntegral",
    "MagneticHeading",
    "Residual",
    "ResidualBlock",
    "SamePlace",
    "StanceVelocity",
    "UnseenWalk",
    "factor_of",
    "guarded_factor",
    "heading_factor",
    "integrate_field",
    "linear_factor_of",
    "position_fix_noise",
    "weigh_place",
    "zero_rate_factor",
]
