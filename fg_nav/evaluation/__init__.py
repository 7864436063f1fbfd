"""How good a solution is: alignment with truth, figures of merit, and whether claimed sigmas are true."""

from fg_nav.evaluation.alignment import MODES, Alignment, align, similarity_scale
from fg_nav.evaluation.comparison import Comparison, compare
from fg_nav.evaluation.consistency import Consistency, stance_nees
from fg_nav.evaluation.footprints import FootprintMatch, match_footprints
from fg_nav.evaluation.metrics import Metrics, evaluate

__all__ = [
    "MODES",
    "Alignment",
    "Comparison",
    "Consistency",
    "FootprintMatch",
    "Metrics",
    "align",
    "compare",
    "evaluate",
    "match_footprints",
    "similarity_scale",
    "stance_nees",
]
