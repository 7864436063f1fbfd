"""How good a solution is: alignment with truth, figures of merit, whether claimed sigmas are true, ROC of detectors."""

from fg_nav.evaluation.alignment import MODES, align, fit_scale
from fg_nav.evaluation.comparison import Comparison, compare
from fg_nav.evaluation.consistency import Consistency, compute_stance_nees
from fg_nav.evaluation.metrics import Metrics, evaluate
from fg_nav.evaluation.roc import (
    Band,
    FieldChange,
    Roc,
    make_roc,
    measure_compass_deviation,
    measure_course_change,
    measure_field_change,
)

__all__ = [
    "MODES",
    "Band",
    "Comparison",
    "Consistency",
    "FieldChange",
    "Metrics",
    "Roc",
    "align",
    "compare",
    "compute_stance_nees",
    "evaluate",
    "fit_scale",
    "make_roc",
    "measure_compass_deviation",
    "measure_course_change",
    "measure_field_change",
]
