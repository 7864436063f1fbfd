"""How good a solution is: alignment with truth, figures of merit, whether claimed sigmas are true, ROC of detectors."""

from fg_nav.evaluation.alignment import MODES, Alignment, align, similarity_scale
from fg_nav.evaluation.comparison import Comparison, FootprintMatch, compare, match_footprints
from fg_nav.evaluation.consistency import Consistency, stance_nees
from fg_nav.evaluation.metrics import Metrics, evaluate
from fg_nav.evaluation.roc import Band, FieldChange, Roc, compass_deviation, course_change, field_change, roc_of

__all__ = [
    "MODES",
    "Alignment",
    "Band",
    "Comparison",
    "Consistency",
    "FieldChange",
    "FootprintMatch",
    "Metrics",
    "Roc",
    "align",
    "compare",
    "compass_deviation",
    "course_change",
    "evaluate",
    "field_change",
    "match_footprints",
    "roc_of",
    "similarity_scale",
    "stance_nees",
]
