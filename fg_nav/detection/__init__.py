"""What the foot is doing: statistics of stillness, footfalls, stances, rests. Knows nothing of estimators."""

from fg_nav.detection.rest import Rest, RestParameters, find_rests
from fg_nav.detection.stance import StanceParameters, detect_stances

__all__ = ["Rest", "RestParameters", "StanceParameters", "detect_stances", "find_rests"]
