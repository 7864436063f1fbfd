"""The same place again: stretches of a walk that are recognized by the magnetic field along them.

The steps (docs/field.md): `signature`, the field along the path by distance, and the part of it that repeats;
`candidates`, pairs of stretches within the path's own uncertainty; `alignment`, the best local alignments among these,
and how many as good chance makes; `recognition`, all of that, and which stretches agree. Of a later walk `overlay` lays
whole pieces on an earlier one, whose places are `saved` in a file, and `location` finds where it is on them.

Everything here is numpy and numba: no graph and no estimator.
"""

from fg_nav.places.candidates import Drift
from fg_nav.places.location import Location, locate
from fg_nav.places.recognition import Stretch, recognize, recognize_known, select_consistent
from fg_nav.places.saved import SavedPlaces, read_places, trace_places, write_places
from fg_nav.places.signature import Signature, trace_signature

__all__ = [
    "Drift",
    "Location",
    "SavedPlaces",
    "Signature",
    "Stretch",
    "locate",
    "read_places",
    "recognize",
    "recognize_known",
    "select_consistent",
    "trace_places",
    "trace_signature",
    "write_places",
]
