"""Navigating while the walk goes on: samples in, an estimate for each footfall out, and at the end the whole walk.

The way of the data, called by `follow` until the stream ends: `sources` with `rows` (samples as they come), `record`
(what came and was given, and how a walk is resumed), `fg_nav.samples.delivery` (which samples of a resumed stream are
new, and how many are lost), `fg_nav.detection.source` (whether they are of one sensor, worn as said),
`fg_nav.samples.intake` (which of them can be used), `buffer` (the samples so far), `fg_nav.detection.causal`
(footfalls), `navigator`, which adds them to `smoother` (the newest `window` in iSAM2, by its `strides` and their
`field`; all of it solved again beside, by `resolve`), `estimates` (lines of JSON). For a thigh `pocket` is the
navigator.
"""

from fg_nav.online.navigator import OnlineNavigator

__all__ = ["OnlineNavigator"]
