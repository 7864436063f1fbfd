"""Two feet of one person: their steps, the clocks of their sensors, and which foot is which.

========= ================================================================================================
`steps`   which footfalls are beside each other, in the mean over cells; how both sensors are turned by them
`clocks`  offset and rate of one sensor's clock against the other's, by the swings
`person`  the path between both feet
========= ================================================================================================

Everything here is numpy: no graph and no estimator. The two feet in one graph are `fg_nav.smoother.feet`.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

Side: TypeAlias = Literal["left", "right"]

SIDES: tuple[Side, Side] = ("left", "right")  # Where both are listed, the left one is first.
