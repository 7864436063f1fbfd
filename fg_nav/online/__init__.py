"""Navigating while the walk goes on: samples in, an estimate for each footfall out, and at the end the whole walk.

The data's way: `sources` (rows as they come), `judge` (which of them to take) with `overlap` (which of a resumed stream
are new), `buffer` (the samples so far), `fg_nav.detection.causal` (footfalls), `navigator`, which hands them to
`smoother` (the newest `window`, in `isam2`; all of it solved again in the `background`, `solving`), `estimates` (lines
of JSON), `checkpoint` (save and resume); `follow` calls them until the stream ends. For a thigh `pocket` is the
navigator.
"""

from fg_nav.online.checkpoint import load, save
from fg_nav.online.navigator import OnlineNavigator

__all__ = ["OnlineNavigator", "load", "save"]
