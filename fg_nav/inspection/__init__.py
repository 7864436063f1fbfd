"""What a recording is like, in numbers and in words: the answer of `fg-nav inspect`.

Everything here bears broken files, that is its purpose: what cannot be told is NaN. Whether a recording can
be navigated with is not judged a second time but asked of `Recording.from_raw`.
"""

from fg_nav.inspection.facts import Inspection, MagneticField, Range, Rest, Stamps, StanceShare
from fg_nav.inspection.measure import inspect

__all__ = ["Inspection", "MagneticField", "Range", "Rest", "Stamps", "StanceShare", "inspect"]
