"""The close-up of the stance detection: ten seconds of the walk, and the range of the detector's statistic."""

from __future__ import annotations

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.stances import Stances

EXCERPT_S = 10.0  # Length of the close-up: about ten strides.


def choose_excerpt(t: Floats, stances: Stances) -> slice:
    """Choose the samples of the close-up: around the middle stance, where the walk is in full swing."""
    k = len(stances) // 2
    centre = t[stances.start[k]] if len(stances) else t[len(t) // 2]
    begin = min(max(centre - EXCERPT_S / 2, t[0]), max(t[-1] - EXCERPT_S, t[0]))
    return slice(int(np.searchsorted(t, begin)), int(np.searchsorted(t, begin + EXCERPT_S, side="right")))


def find_log_limits(statistic: Floats) -> tuple[float, float]:
    """Range of a logarithmic axis that shows the statistic and its threshold, 1."""
    positive = statistic[np.isfinite(statistic) & (statistic > 0)]
    if not len(positive):
        return 0.1, 10.0
    low, high = np.percentile(positive, [0.5, 100.0])
    return min(float(low) / 2, 0.5), max(float(high) * 2, 2.0)
