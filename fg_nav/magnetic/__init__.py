"""The magnetometer: heading and inclination, the field at each footfall, and where it is quasi-static.

    Recording, Stances -> inertial attitude -> FootfallField -> detectors -> FieldVerdicts

The footfall field is computed once a walk and shared by all estimators, of which this package knows nothing. Each
judges it along its own solution: the smoother by the gate (`apply_gate`), a filter with a compass by a detector of its
own. The verdicts of the walk itself are for the report of methods without a compass.
"""

from fg_nav.magnetic.detectors import (
    DEFAULT,
    DETECTORS,
    Detector,
    FieldVerdicts,
    judge_field,
)
from fg_nav.magnetic.footfall_field import FootfallField, average_footfall_field

__all__ = [
    "DEFAULT",
    "DETECTORS",
    "Detector",
    "FieldVerdicts",
    "FootfallField",
    "average_footfall_field",
    "judge_field",
]
