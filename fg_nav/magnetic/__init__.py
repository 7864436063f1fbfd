"""What the magnetometer says: heading and inclination, the field at each footfall, and where it can be trusted.

    Recording, Stances -> inertial attitude -> FootfallField -> detectors -> FieldVerdicts

Found once a walk and shared by all estimators, of which this package knows nothing.
"""

from fg_nav.magnetic.disturbance import Disturbance, DisturbanceParameters, judge_samples
from fg_nav.magnetic.footfall_field import FootfallField, footfall_field
from fg_nav.magnetic.quasi_static import DEFAULT, DETECTORS, Detector, judge
from fg_nav.magnetic.verdicts import FieldVerdicts

__all__ = [
    "DEFAULT",
    "DETECTORS",
    "Detector",
    "Disturbance",
    "DisturbanceParameters",
    "FieldVerdicts",
    "FootfallField",
    "footfall_field",
    "judge",
    "judge_samples",
]
