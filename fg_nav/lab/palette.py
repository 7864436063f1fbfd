"""Colours of the laboratory's pictures: Okabe and Ito's for all eyes (Color Universal Design, 2008).

Neighbours are apart also in grey; truth is always the same wide grey line below the others.
"""

from __future__ import annotations

from typing import Any

BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)  # Colours of methods or axes, in order.
TRUTH = "#9A9A9A"
TRUTH_LINE: dict[str, Any] = {"color": TRUTH, "linewidth": 3.0, "alpha": 0.7}
