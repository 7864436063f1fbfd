"""How good a solution is: alignment with truth and figures of merit.

Whether claimed sigmas are true is in `metrics` too, the ROC of detectors in `roc`: a walk needs neither.
"""

from fg_nav.evaluation.comparison import MODES, Comparison, align, compare, fit_scale
from fg_nav.evaluation.metrics import Metrics, evaluate

__all__ = ["MODES", "Comparison", "Metrics", "align", "compare", "evaluate", "fit_scale"]
