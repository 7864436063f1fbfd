"""Navigating while the walk goes on: samples in, an estimate for each footfall out, and at the end the whole walk.

The data's way: `judge` (which samples of a stream to take) with `overlap` (which of a resumed stream are new),
`fg_nav.detection.causal` (footfalls), `navigator` (hands them to `fg_nav.online.smoother`), `store` (the samples so
far), `checkpoint` (save and resume).
"""

from fg_nav.online.checkpoint import load, save
from fg_nav.online.navigator import OnlineNavigator

__all__ = ["OnlineNavigator", "load", "save"]
