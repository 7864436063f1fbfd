"""How good a solution is: alignment with truth and figures of merit.

The consistency of claimed sigmas (`fg_nav.lab.consistency`) and the ROC of detectors (`fg_nav.lab.reproduce.roc`) are
in the laboratory.
"""

from fg_nav.evaluation.comparison import MODES, Comparison, align, compare, fit_scale
from fg_nav.evaluation.metrics import Metrics, evaluate

__all__ = ["MODES", "Comparison", "Metrics", "align", "compare", "evaluate", "fit_scale"]
