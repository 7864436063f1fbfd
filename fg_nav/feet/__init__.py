"""Two feet of one person by numpy alone: their steps, the clocks of their sensors, and the person between them.

No graph and no estimator: the two feet in one graph are `fg_nav.smoother.feet`.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

Side: TypeAlias = Literal["left", "right"]

SIDES: tuple[Side, Side] = ("left", "right")  # Where both are listed, the left one is first.
